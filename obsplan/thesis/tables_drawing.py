"""The picture of Tables 5.1 and 5.2: errors beside the thesis's, and orderings by assumption."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsplan.report.style import AID, FAINT, colour, plain_decades
from obsplan.thesis.assumptions import CIRCLE, GRAMIAN, INERTIA, POLICIES, STATIONARY, THESIS

if TYPE_CHECKING:
    import xarray as xr

STRONG = 0.35  # distance of a share from a half whose colour is dark
SHORT = {GRAMIAN: "Gramian", INERTIA: "Inertia", CIRCLE: "Circle", STATIONARY: "At rest"}
OWN = 0.38  # by how much the marks of our own noise stand below


def draw(
    name: str,
    pairs: list[tuple[str, str]],
    share_before: Callable[["xr.DataArray", str, str], float],
    data: "xr.Dataset",
) -> Figure:
    """RMS and greatest errors, and the share of seeds in which each ordering holds, by assumption.

    ``pairs`` are the orderings; ``share_before`` gives their share, of errors by policy and seed.
    """
    figure = Figure(figsize=(15.0, 8.0), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(0.9, 0.8, 1.2))
    for axes, variable, column, label in (
        (left, "rms_error", 0, "RMS error [m]"),
        (middle, "max_error", 1, "Greatest error [m]"),
    ):
        _draw_errors(axes, name, data, variable, column)
        axes.set_xlabel(label)
    middle.set_yticklabels([])
    left.plot([], [], "D", ms=7, mfc="none", mec="black", label="thesis, one run")
    left.plot([], [], "|-", ms=14, mew=2, color=AID, label="like the thesis: median, quartiles")
    left.plot([], [], "|-", ms=9, mew=2, color=FAINT, label="our own noise: the same")
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize=8)
    _draw_grid(right, pairs, share_before, data)
    return figure


def _draw_errors(axes: Axes, name: str, data: "xr.Dataset", variable: str, column: int) -> None:
    for y, label in enumerate(POLICIES):
        values = data[variable].sel(policy=label).values
        heights = y + np.linspace(-0.25, 0.25, values.size)
        axes.plot(values, heights, "o", ms=3, mfc=colour(y), mec="none", alpha=0.5)
        _draw_spread(axes, values, y, AID, 16)
        own = data[f"own_{variable}"].sel(own_policy=label).values
        _draw_spread(axes, own, y + OWN, FAINT, 9)
        thesis = THESIS[name][label][column]
        axes.plot(thesis, y, "D", ms=8, mfc="none", mec="black", mew=1.4)
    axes.set_xscale("log")
    plain_decades(axes.xaxis)
    axes.set_yticks(range(len(POLICIES)), POLICIES)
    axes.set_ylim(len(POLICIES) - 0.4, -0.5)


def _draw_spread(
    axes: Axes, values: np.ndarray, y: int | float, paint: str, tall: int | float
) -> None:
    """Median and quartiles."""
    first, median, third = np.quantile(values, [0.25, 0.5, 0.75])
    axes.plot([first, third], [y, y], color=paint, lw=1.5)
    axes.plot(median, y, "|", ms=tall, mew=2.0, color=paint)


def _draw_grid(
    axes: Axes,
    pairs: list[tuple[str, str]],
    share_before: Callable[["xr.DataArray", str, str], float],
    data: "xr.Dataset",
) -> None:
    cells, grid = [str(cell) for cell in data.assumption.values], data.grid_rms_error
    shares = np.array(
        [[share_before(grid.sel(assumption=cell), *pair) for pair in pairs] for cell in cells]
    )
    axes.imshow(shares, cmap="RdBu", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, k), share in np.ndenumerate(shares):
        paint = "white" if abs(share - 0.5) > STRONG else "black"
        axes.text(k, i, f"{share:.0%}", ha="center", va="center", fontsize=7, color=paint)
    names = ["\n< ".join(SHORT[policy] for policy in pair) for pair in pairs]
    axes.set_xticks(range(len(pairs)), names, fontsize=7)
    axes.set_yticks(range(len(cells)), cells, fontsize=8)
    axes.axhline(cells.index("ours") - 0.5, color="black", lw=2.0)
    axes.set_title(
        f"Seeds (of {data.sizes['grid_seed']}) in which the ordering holds:\n"
        "one assumption changed alone; below the line ours",
        fontsize=10,
    )
    axes.grid(visible=False)
