"""What the thesis's pictures share."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from obsplan.report.style import AID, FAINT, colour

if TYPE_CHECKING:
    import xarray as xr

PANEL = 3.6  # [inch]
START: dict[str, Any] = {"marker": "o", "ms": 4, "mfc": "white", "mew": 1.2, "ls": "", "zorder": 6}


def panels(
    columns: int, *, rows: int = 1, width: float = PANEL, height: float = PANEL
) -> tuple[Figure, list[Axes]]:
    """A figure with a grid of panels, row by row."""
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    return figure, list(np.ravel(figure.subplots(rows, columns)))


def draw_tracks(
    axes: Axes, data: "xr.Dataset", colours: Sequence[str] | None = None, *, lw: float = 0.9
) -> None:
    """Draw the aid vehicle's path from each start, and the AUVs, from above."""
    for i in range(data.sizes["start"]):
        one = data.isel(start=i)
        paint = colours[i] if colours else AID if data.sizes["start"] == 1 else colour(i)
        axes.plot(one.x, one.y, color=paint, lw=lw, zorder=3)
        axes.plot(one.x[0], one.y[0], **START, mec=paint)
    for j, name in enumerate(data.auv.values):
        _draw_auv(
            axes,
            data.isel(start=0, auv=j),
            str(name),
            several=data.sizes["auv"] > 1,
            paint=colour(j),
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("East [m]")
    axes.set_ylabel("North [m]")


def _draw_auv(axes: Axes, one: "xr.Dataset", name: str, *, several: bool, paint: str) -> None:
    """A star where the AUV ends, and its track if it moves."""
    x, y = one.auv_x.values, one.auv_y.values
    axes.plot(x, y, color=paint, lw=3.0, alpha=0.4, zorder=2)
    axes.plot(
        x[-1],
        y[-1],
        marker="*",
        ms=9,
        mfc=paint if several else "black",
        mec="white",
        mew=0.5,
        ls="",
        zorder=7,
        label=name if several else None,
    )


def draw_over_time(
    axes: Axes, data: "xr.Dataset", variable: str, label: str, colours: Sequence[str] | None = None
) -> None:
    """Draw a quantity over time: of each start if there are several, else of each AUV."""
    several = data.sizes["start"] > 1
    lines = data[variable].isel(auv=0) if several else data[variable].isel(start=0)
    for i, line in enumerate(lines.values):
        axes.plot(
            data.time,
            line,
            color=colours[i] if colours else colour(i) if len(lines) > 1 else AID,
            lw=0.9,
        )
    axes.set_xlabel("Time [s]")
    axes.set_ylabel(label)
    axes.set_xlim(0.0, float(data.time[-1]))


def guide(axes: Axes, y: float, text: str) -> None:
    """A horizontal line to compare with, and what it is."""
    axes.axhline(y, color=FAINT, lw=1.0, ls="--", zorder=1)
    axes.annotate(
        text,
        (1.0, y),
        xycoords=("axes fraction", "data"),
        ha="right",
        va="bottom",
        fontsize=8,
        color="#555555",
    )


def log_ticks(axes: Axes, which: Literal["x", "y"]) -> None:
    """Make an axis logarithmic, with plain numbers at 1, 2 and 5."""
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
