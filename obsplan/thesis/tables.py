"""Tables 5.1 and 5.2: four policies, fast and slow, over many seeds and a grid of assumptions."""

from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsplan.report.style import AID, colour
from obsplan.scenario import Scenario, load
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.montecarlo import figure, fly_grid, interval, spread

if TYPE_CHECKING:
    import xarray as xr

POLICIES = {
    "Empirical Gramian": ("gramian", 'planner.gramian="exact"'),
    "Path Inertia": ("path-inertia", "planner.gamma=1.0"),
    "Circular": ("circle",),
    "Stationary": ("stationary",),
}
# (4.6) without the heading's effect on the ranges
PRINTED = {"Gramian as printed": ("gramian", 'planner.gramian="thesis"')}
THESIS = {  # distance error, RMS and maximum [m]
    "survey-fast": {
        "Empirical Gramian": (0.1, 2.3),
        "Path Inertia": (0.2, 3.1),
        "Circular": (29.3, 117.8),
        "Stationary": (71.0, 118.0),
    },
    "survey-slow": {
        "Empirical Gramian": (5.6, 16.3),
        "Path Inertia": (0.3, 3.1),
        "Circular": (24.1, 48.6),
        "Stationary": (2.5, 12.6),
    },
}
AUV, FIRST, NOISE = "auv.0", "auv.0.first_estimate", "auv.0.process_noise"
ASSUMPTIONS = {
    "as stated": (),
    "σ = 0.5 m²": ("ranging.sigma=0.5",),
    "σ = 8 m²": ("ranging.sigma=8.0",),
    "the range itself, σ = 0.5 m": ('ranging.kind="range"', "ranging.sigma=0.5"),
    "a range every 1 s": ("ranging.interval=1.0",),
    "a range every 10 s": ("ranging.interval=10.0",),
    "no process noise": (f"{NOISE}.position=0.0", f"{NOISE}.heading_deg=0.0", f"{NOISE}.speed=0.0"),
    "5 times the process noise": (
        f"{NOISE}.position=0.1",
        f"{NOISE}.heading_deg=0.5",
        f"{NOISE}.speed=0.025",
    ),
    "first estimate vague, 10 m, 10 m/s": (
        f"{FIRST}.sigma_position=10.0",
        f"{FIRST}.sigma_speed=10.0",
    ),
    "first estimate too sure, 0.1 m": (f"{FIRST}.sigma_position=0.1",),
}
STRONG = 0.35  # distance of a share from a half whose colour is dark
LOST = 10.0  # RMS error [m] of a lost position: a quarter of a leg
DECIDED = {True: "reproduced", False: "reversed", None: "undecided"}
GRID_SHARE = 10  # a tenth of the seeds for each cell of the grid


def policies(name: str, *settings: str, printed: bool = True) -> dict[str, Scenario]:
    """A survey under every policy."""
    listed = POLICIES | (PRINTED if printed else {})
    return {
        label: load(name, planner=planner, settings=(*settings, *own))
        for label, (planner, *own) in listed.items()
    }


def compute(name: str, *, runs: int, seed: int) -> "xr.Dataset":
    """Errors by policy and seed as assumed, and by assumption over fewer seeds."""
    few = range(seed, seed + max(2, runs // GRID_SHARE))
    stated = fly_grid(
        {(label,): one for label, one in policies(name).items()},
        ("policy",),
        range(seed, seed + runs),
    )
    cells = {
        (text, label): one
        for text, settings in ASSUMPTIONS.items()
        for label, one in policies(name, *settings, printed=False).items()
    }
    grid = fly_grid(cells, ("assumption", "grid_policy"), few)
    return stated.assign(grid_rms_error=grid.rms_error.rename(seed="grid_seed"))


def orderings(name: str) -> list[tuple[str, str]]:
    """Pairs of policies that the thesis reports, the better by RMS error first."""
    ranked = sorted(POLICIES, key=lambda label: THESIS[name][label][0])
    return list(combinations(ranked, 2))


def holds(data: "xr.Dataset", better: str, worse: str) -> tuple[float, bool | None]:
    """Share of seeds in which one policy beats the other, and whether it does so at 95 %.

    None where the seeds do not decide.
    """
    share = float((data.rms_error.sel(policy=better) < data.rms_error.sel(policy=worse)).mean())
    low, high = interval(share, data.sizes["seed"])
    return share, True if low > 0.5 else False if high < 0.5 else None


def reason(name: str, data: "xr.Dataset", better: str, worse: str) -> str:
    """Why an ordering is as it is with us."""
    errors = {label: data.rms_error.sel(policy=label).values for label in (better, worse)}
    clauses = []
    if "Stationary" in errors:
        lost = errors["Stationary"] > LOST
        good = (
            f"{figure(np.median(errors['Stationary'][~lost]))} m otherwise"
            if not lost.all()
            else "never right"
        )
        image = "an image" if THESIS[name]["Stationary"][0] > LOST else "the truth"
        clauses.append(
            f"stationary is on the mirror image in {lost.mean():.0%} of the seeds and {good}; the "
            f"thesis's run was on {image}"
        )
    if "Circular" in errors:
        drifted, thesis = np.mean(errors["Circular"] > LOST), THESIS[name]["Circular"][0]
        clauses.append(
            f"on the circle the filter drifts away in {drifted:.0%} of the seeds; the thesis's "
            f"did, to {thesis:g} m"
        )
    if not clauses:
        ours = (figure(np.median(errors[better])), figure(np.median(errors[worse])))
        theirs = (THESIS[name][p][0] for p in (better, worse))
        clauses.append(
            f"medians {' and '.join(ours)} m, the thesis's runs "
            f"{' and '.join(f'{value:g}' for value in theirs)} m"
        )
    return "; ".join(clauses)


def rows(name: str, data: "xr.Dataset") -> list[list[str]]:
    """Errors beside the thesis's, then the orderings."""
    first = [
        "policy",
        "thesis RMS [m]",
        "thesis greatest [m]",
        "RMS [m], median [quartiles]",
        "greatest [m]",
        "lost",
    ]
    table = [first]
    for label in data.policy.values:
        theirs = [f"{value:g}" for value in THESIS[name].get(label, ())] or ["", ""]
        one = data.sel(policy=label)
        table.append(
            [
                label,
                *theirs,
                spread(one.rms_error.values),
                spread(one.max_error.values),
                f"{float((one.rms_error > LOST).mean()):.0%}",
            ]
        )
    table.append(
        ["ordering by RMS error", "thesis", "seeds in which it holds", "verdict", "why", ""]
    )
    for better, worse in orderings(name):
        share, decided = holds(data, better, worse)
        table.append(
            [
                f"{better} before {worse}",
                "yes",
                f"{share:.0%}",
                DECIDED[decided],
                reason(name, data, better, worse),
                "",
            ]
        )
    return table


def found(name: str, data: "xr.Dataset") -> Finding:
    """Each ordering: reproduced, reversed or undecided."""
    decided = {pair: holds(data, *pair) for pair in orderings(name)}
    count = sum(mark is True for _, mark in decided.values())
    errors = "; ".join(
        f"{label} {spread(data.rms_error.sel(policy=label).values)}" for label in data.policy.values
    )
    marks = "; ".join(
        f"{a} before {b} {DECIDED[mark]} ({share:.0%})" for (a, b), (share, mark) in decided.items()
    )
    whys = dict.fromkeys(why for pair in decided for why in reason(name, data, *pair).split("; "))
    return Finding(
        agrees=True if count == len(decided) else None if count else False,
        sentence=(
            f"RMS errors [m], median [quartiles] over {data.sizes['seed']} seeds: {errors}. "
            f"{count} of {len(decided)} orderings are reproduced (share of seeds): {marks}. Why: "
            f"{'; '.join(whys)}."
        ),
    )


def draw(name: str, data: "xr.Dataset") -> Figure:
    """Errors beside the thesis's, and the share of seeds in which each ordering holds.

    The errors are RMS and greatest; the shares are over the grid.
    """
    figure = Figure(figsize=(13.5, 4.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.1))
    for axes, variable, column, label in (
        (left, "rms_error", 0, "RMS error [m]"),
        (middle, "max_error", 1, "Greatest error [m]"),
    ):
        _draw_errors(axes, name, data, variable, column)
        axes.set_xlabel(label)
    middle.set_yticklabels([])
    left.plot([], [], "D", ms=7, mfc="none", mec="black", label="thesis, one run")
    left.plot([], [], "|", ms=14, mew=2, color=AID, label="median and quartiles")
    left.legend(loc="upper left", bbox_to_anchor=(0.0, 1.16), ncols=2, fontsize=8)
    _draw_grid(right, name, data)
    return figure


def _draw_errors(axes: Axes, name: str, data: "xr.Dataset", variable: str, column: int) -> None:
    labels = [str(label) for label in data.policy.values]
    for y, label in enumerate(labels):
        values = data[variable].sel(policy=label).values
        first, median, third = np.quantile(values, [0.25, 0.5, 0.75])
        axes.plot(
            values,
            y + np.linspace(-0.25, 0.25, values.size),
            "o",
            ms=3,
            mfc=colour(y),
            mec="none",
            alpha=0.5,
        )
        axes.plot([first, third], [y, y], color=AID, lw=1.5)
        axes.plot(median, y, "|", ms=16, mew=2.0, color=AID)
        if label in THESIS[name]:
            axes.plot(THESIS[name][label][column], y, "D", ms=8, mfc="none", mec="black", mew=1.4)
    axes.set_xscale("log")
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)


def _draw_grid(axes: Axes, name: str, data: "xr.Dataset") -> None:
    pairs, cells = orderings(name), [str(cell) for cell in data.assumption.values]
    shares = np.array([[grid_share(data, cell, *pair) for pair in pairs] for cell in cells])
    axes.imshow(shares, cmap="RdBu", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, k), share in np.ndenumerate(shares):
        axes.text(
            k,
            i,
            f"{share:.0%}",
            ha="center",
            va="center",
            fontsize=7,
            color="white" if abs(share - 0.5) > STRONG else "black",
        )
    short = {
        "Empirical Gramian": "Gramian",
        "Path Inertia": "Inertia",
        "Circular": "Circle",
        "Stationary": "At rest",
    }
    axes.set_xticks(
        range(len(pairs)),
        ["\n< ".join(short.get(p, p) for p in pair) for pair in pairs],
        fontsize=7,
    )
    axes.set_yticks(range(len(cells)), cells, fontsize=8)
    axes.set_title(f"Seeds (of {data.sizes['grid_seed']}) in which the thesis's ordering holds")
    axes.grid(visible=False)


def grid_share(data: "xr.Dataset", assumption: str, better: str, worse: str) -> float:
    """Share of seeds in which one policy beats the other under an assumption."""
    cell = data.grid_rms_error.sel(assumption=assumption)
    return float((cell.sel(grid_policy=better) < cell.sel(grid_policy=worse)).mean())


def item(name: str, number: str, title: str, claim: str) -> Item:
    """The table of one survey."""
    return Item(
        name=f"table5.{number}",
        title=title,
        claim=claim,
        compute=partial(compute, name),
        draw=partial(draw, name),
        found=partial(found, name),
        rows=partial(rows, name),
    )


ITEMS = (
    item(
        "survey-fast",
        "1",
        "Localization with a fast aid vehicle, ten times the AUV's speed",
        (
            "RMS (greatest) error: Gramian 0.1 (2.3) m, path inertia 0.2 (3.1) m, circle 29.3 "
            "(117.8) m, stationary 71.0 (118.0) m: both planning methods dramatically better."
        ),
    ),
    item(
        "survey-slow",
        "2",
        "Localization with a slow aid vehicle, as fast as the AUV",
        (
            "RMS (greatest) error: path inertia 0.3 (3.1) m, stationary 2.5 (12.6) m, Gramian 5.6 "
            "(16.3) m, circle 24.1 (48.6) m: path inertia as good as when fast, the Gramian "
            "method markedly worse."
        ),
    ),
)
