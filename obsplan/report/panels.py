"""Rows of panels over time: their places, lines, and axes on which nothing is cut off."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from obsplan.report.style import FAINT, outline

# The layout is fixed [inch]: one that matplotlib finds takes longer than all of the drawing.
WIDTH = 11.0  # of the figure
PANEL, BETWEEN = 1.55, 0.5  # height of a panel, and of what is between two of them
BESIDE, END = 0.75, 0.12  # to the left of each panel, and to the right of the last
HEAD, FOOT = 0.52, 0.48  # above the panels, and for the time's label below them
NAME, TIME = 0.56, 0.27  # from a panel to its labels, to the left and below; six digits fit
ABOVE = 0.05  # the heading
LEGEND_COLUMNS, LEGEND_LINE = 6, 0.17
SETTLED = 0.25  # of the mission: what comes later sets the scale of an error
USUAL = 0.95  # quantile of what is stated: its rare peaks do not set the scale
OVERSHOOT = 1.5  # times that scale, beyond which the rest of an axis is logarithmic
LINEAR = 0.75  # of such an axis that is linear
ROUND = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0)  # times a power of ten: ends of a scale
BEYOND = "#f2f2f2"  # behind the logarithmic part of an axis


def empty_rows(figure: Figure, counts: Sequence[int]) -> list[list[Axes]]:
    """Rows of so many panels each, whose places `_lay_out` gives."""
    anywhere = (0.0, 0.0, 1.0, 1.0)
    return [[figure.add_axes(anywhere) for _ in range(count)] for count in counts]


def _lay_out(figure: Figure, rows: Sequence[Sequence[Axes]], *, legend_lines: int) -> None:
    """Make a figure as high as its rows need, and give its panels and their labels places."""
    below = FOOT + LEGEND_LINE * (legend_lines + 1)
    height = HEAD + len(rows) * PANEL + (len(rows) - 1) * BETWEEN + below
    figure.set_size_inches(WIDTH, height)
    for i, row in enumerate(rows):
        bottom = below + (len(rows) - 1 - i) * (PANEL + BETWEEN)
        column = (WIDTH - END) / len(row)
        width = column - BESIDE
        for k, axes in enumerate(row):
            left = k * column + BESIDE
            axes.set_position((left / WIDTH, bottom / height, width / WIDTH, PANEL / height))
            axes.yaxis.set_label_coords(-NAME / width, 0.5)
            axes.xaxis.set_label_coords(0.5, -TIME / PANEL)


def finish(
    figure: Figure, rows: Sequence[Sequence[Axes]], handles: Sequence[Line2D | Patch], heading: str
) -> None:
    """Give panels their places, the figure its legend below and its heading above."""
    for axes in figure.axes:
        axes.xaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 5, 10]))
    _lay_out(figure, rows, legend_lines=-(-len(handles) // LEGEND_COLUMNS))
    figure.legend(handles=handles, loc="lower center", ncols=LEGEND_COLUMNS, fontsize=8)
    top = 1.0 - ABOVE / figure.get_figheight()
    figure.suptitle(heading, x=0.01, y=top, ha="left", fontsize=11, fontweight="bold")


def draw_line(
    axes: Axes, time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], **how: object
) -> None:
    """A line over time, thinned."""
    shown = outline(values)
    axes.plot(time[shown], values[shown], **how)  # pyright: ignore[reportArgumentType]


def scale_errors(
    panels: Sequence[Axes],
    errors: Float[np.ndarray, "rows n"],
    stated: Float[np.ndarray, "rows n"],
    *,
    signed: bool,
) -> None:
    """Scale axes alike, to what matters once the first quarter of the mission is over.

    That is every error, and what is stated of it but for its rare peaks. Where something is far
    beyond, as the first estimate may be, the rest of the axes is logarithmic, and shaded: nothing
    is cut off.

    Parameters
    ----------
    panels
        To be scaled.
    errors, stated
        Magnitudes of the errors, and of what the filter or a bound says of them [m]; nan where
        there is none.
    signed
        Whether errors go both ways.
    """
    error, said = np.fmax.reduce(errors), np.fmax.reduce(stated)
    late = slice(int(SETTLED * error.size), None)
    usual = float(np.nanquantile(said[late], USUAL)) if np.isfinite(said[late]).any() else 0.0
    settled = float(np.fmax.reduce(error[late], initial=usual))
    highest = float(np.fmax.reduce(np.fmax(error, said), initial=0.0))
    if not highest > 0:
        return
    for axes in panels:
        if settled > 0 and round_up(1.1 * settled) < highest / OVERSHOOT:
            bend(axes, round_up(1.1 * settled), round_up(1.05 * highest), signed=signed)
        else:
            axes.set_ylim(-1.1 * highest if signed else 0.0, 1.1 * highest)


def curve_handles(figure: Figure) -> list[Patch]:
    """What a legend says of axes that are bent, if some are."""
    if not any(axes.get_yscale() == "symlog" for axes in figure.axes):
        return []
    return [Patch(fc=BEYOND, ec=FAINT, lw=0.5, label="logarithmic from here on")]


def bend(axes: Axes, threshold: float, end: float, *, signed: bool) -> None:
    """Make an axis linear up to a threshold, and logarithmic from there to its end."""
    decades = np.log10(end / threshold)
    axes.set_yscale("symlog", linthresh=threshold, linscale=decades * LINEAR / (1 - LINEAR))
    axes.set_ylim(-end if signed else 0.0, end)
    ticks = np.array([threshold / 2, threshold, end])
    below = -ticks[::-1] if signed else []
    axes.yaxis.set_major_locator(FixedLocator([*below, 0.0, *ticks]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "−")))
    axes.axhspan(threshold, end, color=BEYOND, lw=0, zorder=0)
    if signed:
        axes.axhspan(-end, -threshold, color=BEYOND, lw=0, zorder=0)


def round_up(value: float) -> float:
    """Smallest round number that is no less."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(next(step * decade for step in ROUND if value <= step * decade * (1 + 1e-9)))
