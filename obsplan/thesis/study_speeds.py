"""Open question: which missions and speed ratios defeat each method."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from obsplan.scenario import Scenario, load
from obsplan.thesis.assumptions import POLICIES, PRINTED
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.montecarlo import figure, fly_grid
from obsplan.thesis.paired import QUARTILES, Case, Paired, by_case, compare, seeds, table

if TYPE_CHECKING:
    import xarray as xr

RATIOS = (0.5, 1.0, 2.0, 5.0, 10.0)  # speed of the aid vehicle over the AUV's
SURVEYS = {  # some hundred metres each, from the thesis's first position
    "lawnmower": (
        '{ kind = "lawnmower", legs = 3, length = 25.0, spacing = 8.0, heading_deg = 90.0, '
        'x = -2.0, y = 0.0, side = "right" }'
    ),
    "straight": '{ kind = "waypoints", points = [[-2.0, 0.0], [-2.0, 100.0]] }',
    "square": (
        '{ kind = "waypoints", points = [[-2.0, 0.0], [-2.0, 25.0], [23.0, 25.0], [23.0, 0.0], '
        "[-2.0, 0.0]] }"
    ),
    "zigzag": (
        '{ kind = "waypoints", points = [[-2.0, 0.0], [8.0, 17.0], [-2.0, 34.0], [8.0, 51.0], '
        "[-2.0, 68.0], [8.0, 85.0]] }"
    ),
}
METHODS = POLICIES | PRINTED
GRAMIAN = next(iter(POLICIES))
DEFEATED = 2.0  # RMS error [m] that tells no more than the first estimate, which is 2 m off
SCALE, COLOURS = LogNorm(0.1, 100.0), "viridis_r"  # [m]


def mission(survey: str, ratio: float, method: str) -> Scenario:
    """One survey at one speed under one method."""
    planner, *own = METHODS[method]
    return load(
        "survey-slow",
        planner=planner,
        settings=(f"auv.0.survey={SURVEYS[survey]}", f"auv.0.speed={1.0 / ratio}", *own),
    )


def compute(*, runs: int, seed: int) -> "xr.Dataset":
    """Errors by method, survey and ratio."""
    cases = {(m, s, f"{r:g}"): mission(s, r, m) for m in METHODS for s in SURVEYS for r in RATIOS}
    return fly_grid(cases, ("policy", "survey", "ratio"), seeds(runs, seed)).assign_coords(
        ratio=list(RATIOS)
    )


def draw(data: "xr.Dataset") -> Figure:
    """A map for each method."""
    figure = Figure(figsize=(19.0, 4.0), layout="constrained")
    axes = figure.subplots(1, data.sizes["policy"], sharey=True)
    for one, method in zip(axes, data.policy.values, strict=True):
        _draw_map(one, data.sel(policy=method))
        one.set_title(str(method))
    figure.colorbar(
        ScalarMappable(SCALE, COLOURS), ax=list(axes), label="Median RMS error [m] (quartiles)"
    )
    return figure


def compare_methods(data: "xr.Dataset") -> dict[Case, Paired]:
    """Every method beside the Gramian method, by survey and ratio."""
    errors = by_case(data.rms_error, "policy", "survey", "ratio")
    return compare(errors, lambda case: (GRAMIAN, *case[1:]))


def _draw_map(axes: Axes, data: "xr.Dataset") -> None:
    errors = data.rms_error.transpose("survey", "ratio", "seed").values
    first, median, third = np.quantile(errors, QUARTILES, axis=-1)
    axes.imshow(median, cmap=COLOURS, norm=SCALE, aspect="auto")
    for place, value in np.ndenumerate(median):
        quartiles = f"{figure(first[place])}-{figure(third[place])}"
        axes.text(
            place[1],
            place[0],
            f"{figure(value)}\n({quartiles})",
            ha="center",
            va="center",
            fontsize=7,
            color="white" if value > DEFEATED else "black",
        )
    axes.set_xticks(range(len(RATIOS)), [f"{ratio:g}" for ratio in RATIOS])
    axes.set_yticks(range(len(SURVEYS)), list(SURVEYS))
    axes.set_xlabel("Speed, aid vehicle / AUV")
    axes.grid(visible=False)


def found(data: "xr.Dataset") -> Finding:
    """Which combinations defeat each method."""
    median, compared, parts = data.rms_error.median("seed"), compare_methods(data), []
    for method in METHODS:
        lost = []
        for survey in SURVEYS:
            errors = median.sel(policy=method, survey=survey)
            ratios = [f"{r:g}" for r in RATIOS if float(errors.sel(ratio=r)) > DEFEATED]
            if ratios:
                lost.append(f"{survey} at {', '.join(ratios)}")
        worst = float(median.sel(policy=method).max())
        told = [one for case, one in compared.items() if case[0] == method and one.differs]
        better = sum(one.ratio < 1.0 for one in told)
        beside = f", better than the Gramian method in {better}, worse in {len(told) - better}"
        parts.append(
            f"{method}: {'; '.join(lost) if lost else 'none'} (worst {figure(worst)} m"
            f"{'' if method == GRAMIAN else beside})"
        )
    return Finding(
        agrees=None,
        sentence=(
            f"Surveys and speed ratios at which the median RMS error exceeds {DEFEATED:g} m, the "
            f"first error, and in how many of {len(SURVEYS) * len(RATIOS)} a method differs from "
            f"the Gramian method beyond chance: {'. '.join(parts)}."
        ),
    )


ITEMS = (
    Item(
        name="study-speeds",
        title="Which speeds and missions defeat each method",
        claim=(
            "Which missions, or combinations of vehicle speeds, lead to poor estimation even with "
            "the planning methods (chapter 6)?"
        ),
        compute=compute,
        draw=draw,
        found=found,
        rows=lambda data: table(("method", "survey", "ratio of speeds"), compare_methods(data)),
    ),
)
