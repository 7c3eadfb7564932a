"""The pictures of Figures B.1 to B.8: tracks, estimate and errors of one mission."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsplan.report.style import AID, colour, time_axis

if TYPE_CHECKING:
    import xarray as xr


def draw(data: "xr.Dataset") -> Figure:
    """(a) tracks, (b) the estimate, (c), (d) errors east and north with three deviations."""
    figure = Figure(figsize=(11.0, 7.2), layout="constrained")
    (tracks, estimate), (east, north) = figure.subplots(2, 2, height_ratios=(1.5, 1.0))
    _draw_map(tracks, data, (("auv", "AUV", colour(0)), ("cna", "aid vehicle", AID)), "(a) tracks")
    _draw_map(
        estimate,
        data,
        (("auv", "AUV", colour(0)), ("estimate", "estimate", colour(1))),
        "(b) estimated track",
    )
    for axes, axis, label in ((east, "x", "(c) east"), (north, "y", "(d) north")):
        _draw_error(axes, data, axis, label)
    return figure


def _draw_map(
    axes: Axes, data: "xr.Dataset", drawn: tuple[tuple[str, str, str], ...], title: str
) -> None:
    for prefix, label, paint in drawn:
        x, y = data[f"{prefix}_x"].values, data[f"{prefix}_y"].values
        moves = bool(np.ptp(x) + np.ptp(y) > 0)
        axes.plot(
            x,
            y,
            color=paint,
            lw=0.9 if moves else 0.0,
            marker="" if moves else "o",
            ms=6,
            label=label,
        )
    axes.set(xlabel="East [m]", ylabel="North [m]", title=title)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)


def _draw_error(axes: Axes, data: "xr.Dataset", axis: str, label: str) -> None:
    time, text = time_axis(data.time.values)
    error, band = data[f"estimate_{axis}"] - data[f"auv_{axis}"], 3.0 * data[f"sigma_{axis}"]
    axes.fill_between(time, -band, band, color=colour(1), alpha=0.2, lw=0, label="±3σ")
    axes.plot(time, error, color=colour(1), lw=0.9)
    highest = 1.1 * max(float(np.abs(error).max()), float(np.quantile(band, 0.98)))
    axes.set(
        xlabel=text,
        ylabel="Error [m]",
        title=label,
        ylim=(-highest, highest),
        xlim=(time[0], time[-1]),
    )
    axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
