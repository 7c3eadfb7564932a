"""Tables 5.1 and 5.2: four policies, fast and slow, and which of our assumptions decide them."""

from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from obsplan.thesis import assumptions
from obsplan.thesis.assumptions import AS_ASSUMED, CHANGES, FAST, OURS, POLICIES, SLOW, THESIS
from obsplan.thesis.item import VERDICTS, Finding, Item
from obsplan.thesis.marks import LOST
from obsplan.thesis.montecarlo import counted, figure, fly_grid, interval, judged, spread
from obsplan.thesis.tables_drawing import draw

if TYPE_CHECKING:
    import xarray as xr

DECIDED = {True: "agrees", False: "does not agree", None: "undecided"}
# Half an order of magnitude: the thesis has one run, of a noise that it does not state.
SIZE = float(np.sqrt(10.0))
GRID_SHARE = 5  # a fifth of the seeds for each cell of the grid

Pair = tuple[str, str]


def compute(name: str, *, runs: int, seed: int) -> "xr.Dataset":
    """Errors by policy and seed, like the thesis and as ours, and by assumption over few seeds."""
    many = range(seed, seed + runs)
    like = {(label,): one for label, one in assumptions.like(name).items()}
    own = {(label,): one for label, one in assumptions.policies(name).items()}
    data, beside = fly_grid(like, ("policy",), many), fly_grid(own, ("own_policy",), many)
    cells = {
        (text, label): one
        for listed, under in ((CHANGES, assumptions.like), (OURS, assumptions.ours))
        for text, change in listed.items()
        for label, one in under(name, change).items()
    }
    few = range(seed, seed + max(2, runs // GRID_SHARE))
    grid = fly_grid(cells, ("assumption", "grid_policy"), few).rename(seed="grid_seed")
    return data.assign(
        own_rms_error=beside.rms_error,
        own_max_error=beside.max_error,
        grid_rms_error=grid.rms_error,
    )


def orderings(name: str) -> list[Pair]:
    """Pairs of policies that the thesis reports, the better by RMS error first."""
    ranked = sorted(POLICIES, key=lambda label: THESIS[name][label][0])
    return list(combinations(ranked, 2))


def share_before(errors: "xr.DataArray", better: str, worse: str) -> float:
    """Share of seeds in which one policy beats the other, of errors by policy and seed."""
    label = next(str(dim) for dim in errors.dims if str(dim).endswith("policy"))
    return float((errors.sel({label: better}) < errors.sel({label: worse})).mean())


def holds(errors: "xr.DataArray", better: str, worse: str) -> tuple[float, bool | None]:
    """Share of seeds in which one policy beats the other, and whether it does so in most."""
    share = share_before(errors, better, worse)
    return share, judged(share, errors.sizes["seed"])


def all_at_once(errors: "xr.DataArray", name: str) -> int:
    """Number of seeds in which every ordering holds, of errors by policy and seed."""
    label = next(str(dim) for dim in errors.dims if str(dim).endswith("policy"))
    ranked = sorted(POLICIES, key=lambda policy: THESIS[name][policy][0])
    rising = errors.sel({label: ranked}).transpose(..., label).values
    return int((np.diff(rising, axis=-1) > 0).all(axis=-1).sum())


def size(name: str, errors: "xr.DataArray", label: str) -> float:
    """Median RMS error over the thesis's, of errors by policy and seed."""
    return float(np.median(errors.sel(policy=label))) / THESIS[name][label][0]


def sized(ratio: float) -> bool:
    """Whether a size agrees: within half an order of magnitude either way."""
    return 1.0 / SIZE < ratio < SIZE


def deciders(data: "xr.Dataset", better: str, worse: str) -> dict[str, float]:
    """Changes that reverse an ordering, each alone, and the share of seeds in which it holds then.

    Reversed is what holds in less than half of the seeds, and in fewer, at 95 %, than as assumed.
    """
    grid, n = data.grid_rms_error, data.sizes["grid_seed"]
    shares = {
        change: share_before(grid.sel(assumption=change), better, worse) for change in CHANGES
    }
    assumed = shares.pop(AS_ASSUMED)
    return {
        change: share
        for change, share in shares.items()
        if share < 0.5 and interval(share, n)[1] < assumed
    }


def rows(name: str, data: "xr.Dataset") -> list[list[str]]:
    """Sizes, orderings and the ablation, one below the other, each under its own heading."""
    return size_rows(name, data) + ordering_rows(name, data) + ablation_rows(name, data)


def size_rows(name: str, data: "xr.Dataset") -> list[list[str]]:
    """Errors beside the thesis's."""
    table = [
        [
            "policy",
            "thesis: RMS (greatest) [m]",
            "RMS, median [quartiles] (greatest) [m]",
            "size",
            "with our own noise [m]",
            "lost: like the thesis, with ours",
        ]
    ]
    for label in POLICIES:
        rms, most = THESIS[name][label]
        like, own = data.sel(policy=label), data.sel(own_policy=label)
        ratio = size(name, data.rms_error, label)
        table.append(
            [
                label,
                f"{rms:g} ({most:g})",
                _errors(like.rms_error, like.max_error),
                f"{DECIDED[sized(ratio)]}: {ratio:.2g} times",
                _errors(own.own_rms_error, own.own_max_error),
                f"{_lost(like.rms_error):.0%}, {_lost(own.own_rms_error):.0%}",
            ]
        )
    return table


def _errors(rms: "xr.DataArray", most: "xr.DataArray") -> str:
    return f"{spread(rms.values)} ({figure(float(np.median(most)))})"


def _lost(errors: "xr.DataArray") -> float:
    """Share of missions that lose the position."""
    return float((errors > LOST).mean())


def ordering_rows(name: str, data: "xr.Dataset") -> list[list[str]]:
    """Each ordering: in how many seeds it holds, and what reverses it."""
    table = [
        [
            "ordering by RMS error",
            "thesis",
            "seeds in which it holds [95 %]",
            "verdict",
            "with our own noise",
            "reversed by, alone (holds in)",
        ]
    ]
    n = data.sizes["seed"]
    for better, worse in orderings(name):
        share, decided = holds(data.rms_error, better, worse)
        own = share_before(data.own_rms_error, better, worse)
        reverse = deciders(data, better, worse)
        table.append(
            [
                f"{better} before {worse}",
                "yes",
                counted(share, n),
                DECIDED[decided],
                f"{own:.0%}",
                "; ".join(f"{change} ({left:.0%})" for change, left in reverse.items()),
            ]
        )
    return table


def ablation_rows(name: str, data: "xr.Dataset") -> list[list[str]]:
    """Median RMS error of each policy under each assumption, one changed at a time."""
    table = [
        ["changed alone: median RMS [m] (lost)", *POLICIES, "all six orderings at once [95 %]"]
    ]
    n = data.sizes["grid_seed"]
    for change in data.assumption.values:
        errors = data.grid_rms_error.sel(assumption=change)
        cells = [
            f"{figure(float(np.median(one)))} ({_lost(one):.0%})"
            for one in (errors.sel(grid_policy=label) for label in POLICIES)
        ]
        table.append([str(change), *cells, counted(all_at_once(errors, name) / n, n)])
    return table


def found(name: str, data: "xr.Dataset") -> Finding:
    """Orderings and sizes as the thesis's, what decides them, and what our own noise makes."""
    order = {pair: holds(data.rms_error, *pair) for pair in orderings(name)}
    ratios = {label: size(name, data.rms_error, label) for label in POLICIES}
    ordered = sum(mark is True for _, mark in order.values())
    right = sum(sized(ratio) for ratio in ratios.values())
    whole = ordered == len(order) and right == len(ratios)
    return Finding(
        agrees=True if whole else None if 2 * ordered >= len(order) else False,
        sentence=" ".join(
            [
                order_sentence(name, data, order),
                size_sentence(ratios),
                decisive(name, data),
                beside(name, data),
            ]
        ),
    )


def order_sentence(
    name: str, data: "xr.Dataset", order: dict[Pair, tuple[float, bool | None]]
) -> str:
    """How many orderings hold, and in how many seeds."""
    n = data.sizes["seed"]
    ordered = sum(mark is True for _, mark in order.values())
    verdict = VERDICTS[ordered == len(order) or (None if 2 * ordered >= len(order) else False)]
    marks = "; ".join(
        f"{a} before {b} {counted(share, n)}{'' if mark else f' ({DECIDED[mark]})'}"
        for (a, b), (share, mark) in order.items()
    )
    together = counted(all_at_once(data.rms_error, name) / n, n)
    return (
        f"Orderings: {verdict}. Under assumptions like the thesis's (`{assumptions.LIKE[name]}`) "
        f"{ordered} of {len(order)} hold in most seeds: {marks}. All hold at once in {together}."
    )


def size_sentence(ratios: dict[str, float]) -> str:
    """Which sizes agree."""
    right = sum(sized(ratio) for ratio in ratios.values())
    verdict = VERDICTS[right == len(ratios) or (None if right else False)]
    texts = ", ".join(f"{label} {ratio:.2g}" for label, ratio in ratios.items())
    return (
        f"Sizes: {verdict}. Median RMS error over the thesis's: {texts}; within "
        f"{SIZE:.1f} times either way are {right} of {len(ratios)}."
    )


def decisive(name: str, data: "xr.Dataset") -> str:
    """What decides, measured: changes that reverse orderings, and the mechanism of each."""
    reversed_by: dict[str, list[str]] = {}
    for pair in orderings(name):
        for change in deciders(data, *pair):
            reversed_by.setdefault(change, []).append(" before ".join(pair))
    if not reversed_by:
        return "No assumption changed alone reverses an ordering."
    clauses = [
        f"{change} reverses {' and '.join(pairs)}"
        + (f" ({CHANGES[change].why})" if CHANGES[change].why else "")
        for change, pairs in reversed_by.items()
    ]
    return f"What decides, changed alone: {'; '.join(clauses)}."


def beside(name: str, data: "xr.Dataset") -> str:
    """What is left of it with our own noise, and why that is as it is."""
    held = [
        pair
        for pair in orderings(name)
        if judged(share_before(data.own_rms_error, *pair), data.sizes["seed"])
    ]
    medians = ", ".join(
        f"{label} {figure(float(np.median(data.own_rms_error.sel(own_policy=label))))} m"
        for label in data.own_policy.values
    )
    return (
        f"With our own noise (`{name}`), whose filter is told what the AUV's speed does, "
        f"0.005 m/s/√s, and how little it knows at first, {len(held)} of 6 orderings hold: "
        f"{medians}. There the circle does not drift, and which of AUV and image a beacon at "
        "rest finds is chance."
    )


def item(name: str, number: str, title: str, claim: str) -> Item:
    """The table of one survey."""
    return Item(
        name=f"table5.{number}",
        title=title,
        claim=claim,
        compute=partial(compute, name),
        draw=partial(draw, name, orderings(name), share_before),
        found=partial(found, name),
        rows=partial(rows, name),
    )


ITEMS = (
    item(
        FAST,
        "1",
        "Localization with a fast aid vehicle, ten times the AUV's speed",
        (
            "RMS (greatest) error: Gramian 0.1 (2.3) m, path inertia 0.2 (3.1) m, circle 29.3 "
            "(117.8) m, stationary 71.0 (118.0) m: both planning methods dramatically better."
        ),
    ),
    item(
        SLOW,
        "2",
        "Localization with a slow aid vehicle, as fast as the AUV",
        (
            "RMS (greatest) error: path inertia 0.3 (3.1) m, stationary 2.5 (12.6) m, Gramian 5.6 "
            "(16.3) m, circle 24.1 (48.6) m: path inertia as good as when fast, the Gramian "
            "method markedly worse."
        ),
    ),
)
