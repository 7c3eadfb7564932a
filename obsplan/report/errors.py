"""Errors of a run over time, against what the filter says of them, and separations with limits."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from obsplan.report.style import (
    BROKEN,
    FAINT,
    LIMIT,
    colour,
    named,
    outline,
    plain_decades,
    time_axis,
)
from obsplan.report.words import metres, title
from obsplan.run import Run

SIGMAS = 3.0
NEES_BAND = (0.0506, 7.378)  # 2.5 % and 97.5 % of chi-square with 2 degrees
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
NEAR = 2.0  # times the greatest separation: a limit beyond is told, not drawn
BEYOND = "#f2f2f2"  # behind the logarithmic part of an axis
_BOUND: dict[str, Any] = {"color": "black", "lw": 1.0, "ls": "--"}
_CONSISTENT: dict[str, Any] = {"fc": to_rgba(FAINT, 0.2), "ec": FAINT, "lw": 0.6, "ls": ":"}
_LIMIT: dict[str, Any] = {"color": LIMIT, "lw": 1.0, "ls": (0, (1, 1.5))}


def errors_figure(run: Run) -> Figure:
    """Draw a row per AUV (errors east and north, distance) and a row for all of them.

    That row has the separation, the predicted condition number and the consistency.
    """
    lower = [_draw_separation, _draw_nees]
    if np.isfinite(run.condition).any():
        lower.append(_draw_condition)
    figure = Figure()
    *upper, last = _empty_rows(figure, [3] * len(run.names) + [len(lower)])
    time, label = time_axis(run.time)
    for i, panels in enumerate(upper):
        _draw_errors(panels[:2], run, time, i)
        _draw_distance(panels[2], run, time, i)
    for axes, draw in zip(last, lower, strict=True):
        draw(axes, run, time)
        axes.set_xlabel(label)
    for axes in figure.axes:
        axes.set_xlim(time[0], time[-1])
        axes.xaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 5, 10]))
    curved = any(axes.get_yscale() == "symlog" for axes in figure.axes)
    handles = list(_legend(run, curved=curved))
    _lay_out(figure, [*upper, last], legend_lines=-(-len(handles) // LEGEND_COLUMNS))
    figure.legend(handles=handles, loc="lower center", ncols=LEGEND_COLUMNS, fontsize=8)
    _write_heading(figure, run)
    return figure


def _empty_rows(figure: Figure, counts: Sequence[int]) -> list[list[Axes]]:
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


def _write_heading(figure: Figure, run: Run) -> None:
    said = f"RMS position error {metres(run.rms_error)}, worst {metres(run.max_error)}"
    text = f"{title(run.scenario.table.name)}, planner {run.planner}: {said}"
    figure.suptitle(
        text,
        x=0.01,
        y=1.0 - ABOVE / figure.get_figheight(),
        ha="left",
        fontsize=11,
        fontweight="bold",
    )


def _line(
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
            _bend(axes, round_up(1.1 * settled), round_up(1.05 * highest), signed=signed)
        else:
            axes.set_ylim(-1.1 * highest if signed else 0.0, 1.1 * highest)


def _bend(axes: Axes, threshold: float, end: float, *, signed: bool) -> None:
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


def _draw_errors(panels: Sequence[Axes], run: Run, time: Float[np.ndarray, " n"], i: int) -> None:
    """East and north error of an AUV, with three standard deviations to either side."""
    error = (run.mean[i, :, :2] - run.truth[i, :, :2]).T
    variance = np.diagonal(run.covariance[i, :, :2, :2], axis1=1, axis2=2).T
    band = SIGMAS * np.sqrt(np.maximum(variance, 0.0))
    for axes, name, one, stated in zip(panels, ("East", "North"), error, band, strict=True):
        shown = outline(stated)
        below, above = -stated[shown], stated[shown]
        axes.fill_between(time[shown], below, above, color=colour(i), alpha=0.2, lw=0)
        _line(axes, time, one, color=colour(i), lw=0.8)
        axes.axhline(0.0, color=FAINT, lw=0.5)
        axes.set_title(f"{run.names[i]}: {name.lower()} error")
        axes.set_ylabel(f"{name} error [m]")
    scale_errors(panels, np.abs(error), band, signed=True)


def _draw_distance(axes: Axes, run: Run, time: Float[np.ndarray, " n"], i: int) -> None:
    _line(axes, time, run.error[i], color=colour(i), lw=0.8)
    bound = np.sqrt(run.cramer_rao_variance[i])
    _line(axes, time, bound, **_BOUND)
    scale_errors([axes], run.error[i][None], bound[None], signed=False)
    axes.set_title(f"{run.names[i]}: distance from the truth")
    axes.set_ylabel("Error [m]")


def _draw_separation(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i in range(len(run.names)):
        _line(axes, time, run.separation[i], color=colour(i), lw=0.8)
    for limit in run.limits:
        if limit.auv is not None and limit.aid == 0 and limit.broken.any():
            outside = np.where(limit.broken, run.separation[limit.auv], np.nan)
            axes.plot(time, outside, color=BROKEN, lw=3.0, alpha=0.7, zorder=1.5)
    for distance in _drawn_limits(run).values():
        axes.axhline(distance, **_LIMIT)
    axes.set_ylim(bottom=0.0)
    axes.set_title("Distance to the aid vehicle")
    axes.set_ylabel("Separation [m]")


def _drawn_limits(run: Run) -> dict[str, float]:
    """Least and greatest separation [m], as far as they are set and near what was flown."""
    limits, farthest = run.scenario.constraints, float(run.separation.max())
    told = {"least": limits.min_separation, "greatest": limits.max_separation}
    return {name: value for name, value in told.items() if 0 < value <= NEAR * farthest}


def _draw_condition(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i, condition in enumerate(run.condition):
        decided = np.isfinite(condition)
        _line(axes, time[decided], condition[decided], color=colour(i), lw=0.8)
    axes.set_yscale("log")
    plain_decades(axes.yaxis)
    axes.set_title("Condition number the planner predicts")
    axes.set_ylabel(f"{run.condition_label} [-]")


def _draw_nees(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i, nees in enumerate(run.nees):
        known = nees > 0
        if known.any():
            _line(axes, time[known], nees[known], color=colour(i), lw=0.8)
    axes.axhspan(*NEES_BAND, **_CONSISTENT)
    axes.set_yscale("log")
    plain_decades(axes.yaxis)
    axes.set_title("Normalised error squared (NEES)")
    axes.set_ylabel("NEES [-]")


def _legend(run: Run, *, curved: bool) -> Iterator[Line2D | Patch]:
    """What is drawn, beside all panels."""
    one = colour(0) if len(run.names) == 1 else FAINT
    if len(run.names) > 1:
        for i, name in enumerate(run.names):
            yield Line2D([], [], color=colour(i), lw=2.5, label=named(name))
    yield Line2D([], [], color=one, lw=0.8, label="error")
    yield Patch(fc=one, alpha=0.2, label="±3σ of the filter")
    yield Line2D([], [], **_BOUND, label="Cramér–Rao bound, RMS")
    yield Patch(**_CONSISTENT, label="NEES, 95 % if consistent")
    if curved:
        yield Patch(fc=BEYOND, ec=FAINT, lw=0.5, label="logarithmic from here on")
    if drawn := _drawn_limits(run):
        values = ", ".join(f"{name} {value:g} m" for name, value in drawn.items())
        yield Line2D([], [], **_LIMIT, label=f"separation limits: {values}")
    if any(limit.auv is not None and limit.broken.any() for limit in run.limits):
        yield Line2D([], [], color=BROKEN, lw=3.0, alpha=0.7, label="limit broken")
