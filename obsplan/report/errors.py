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

from obsplan.record import distance
from obsplan.report.panels import curve_handles, draw_line, empty_rows, finish, scale_errors
from obsplan.report.sigmas import draw_hypotheses, shows_hypotheses, sigmas_figure
from obsplan.report.style import (
    BROKEN,
    FAINT,
    LIMIT,
    colour,
    dark,
    named,
    outline,
    plain_decades,
    time_axis,
)
from obsplan.report.words import metres, sailed, title
from obsplan.run import Run

SIGMAS = 3.0
NEES_BAND = (0.0506, 7.378)  # 2.5 % and 97.5 % of chi-square with 2 degrees
NEAR = 2.0  # times the greatest separation: a limit beyond is told, not drawn
_BOUND: dict[str, Any] = {"color": "black", "lw": 1.0, "ls": "--"}
_SMOOTHED: dict[str, Any] = {"lw": 0.8, "ls": (0, (4, 1.5))}
_CONSISTENT: dict[str, Any] = {"fc": to_rgba(FAINT, 0.2), "ec": FAINT, "lw": 0.6, "ls": ":"}
_LIMIT: dict[str, Any] = {"color": LIMIT, "lw": 1.0, "ls": (0, (1, 1.5))}


def errors_figure(run: Run) -> Figure:
    """Draw a row per AUV (errors east and north, distance) and a row for all of them.

    That row has the separation, the predicted condition number and the consistency. Without the
    truth there are the filter's own standard deviations instead of errors, and innovations.
    """
    if not run.known.any():
        return sigmas_figure(run)
    lower = [_draw_separation, _draw_nees] if run.has_aid else [_draw_nees]
    if np.isfinite(run.condition).any():
        lower.append(_draw_condition)
    if shows_hypotheses(run):
        lower.append(draw_hypotheses)
    figure = Figure()
    *upper, last = empty_rows(figure, [3] * len(run.names) + [len(lower)])
    time, label = time_axis(run.time)
    for i, panels in enumerate(upper):
        _draw_errors(panels[:2], run, time, i)
        _draw_distance(panels[2], run, time, i)
    for axes, draw in zip(last, lower, strict=True):
        draw(axes, run, time)
        axes.set_xlabel(label)
    for axes in figure.axes:
        axes.set_xlim(time[0], time[-1])
    handles = [*_legend(run, curve_handles(figure))]
    finish(figure, [*upper, last], handles, _heading(run))
    return figure


def _heading(run: Run) -> str:
    said = f"RMS position error {metres(run.rms_error)}, worst {metres(run.max_error)}"
    return f"{title(run.scenario.table.name)}, {sailed(run)}: {said}"


def _draw_errors(panels: Sequence[Axes], run: Run, time: Float[np.ndarray, " n"], i: int) -> None:
    """East and north error of an AUV, with three standard deviations to either side."""
    error = (run.mean[i, :, :2] - run.true[i, :, :2]).T
    variance = np.diagonal(run.covariance[i, :, :2, :2], axis1=1, axis2=2).T
    band = SIGMAS * np.sqrt(np.maximum(variance, 0.0))
    for axes, name, one, stated in zip(panels, ("East", "North"), error, band, strict=True):
        shown = outline(stated)
        below, above = -stated[shown], stated[shown]
        axes.fill_between(time[shown], below, above, color=colour(i), alpha=0.2, lw=0)
        draw_line(axes, time, one, color=colour(i), lw=0.8)
        axes.axhline(0.0, color=FAINT, lw=0.5)
        axes.set_title(f"{run.names[i]}: {name.lower()} error")
        axes.set_ylabel(f"{name} error [m]")
    scale_errors(panels, np.abs(error), band, signed=True)


def _draw_distance(axes: Axes, run: Run, time: Float[np.ndarray, " n"], i: int) -> None:
    draw_line(axes, time, run.error[i], color=colour(i), lw=0.8)
    bound = np.full(time.size, np.nan)
    if not run.unbounded_below:
        bound = np.sqrt(run.cramer_rao_variance[i])
        draw_line(axes, time, bound, **_BOUND)
    if run.smoothed is not None:
        smoothed = distance(run.smoothed[i], run.true[i])
        draw_line(axes, time, smoothed, color=dark(colour(i)), **_SMOOTHED)
    scale_errors([axes], run.error[i][None], bound[None], signed=False)
    axes.set_title(f"{run.names[i]}: distance from the truth")
    axes.set_ylabel("Error [m]")


def _draw_separation(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i in range(len(run.names)):
        draw_line(axes, time, run.separation[i], color=colour(i), lw=0.8)
    for limit in run.limits:
        if limit.auv is not None and limit.aid == 0 and limit.broken.any():
            outside = np.where(limit.broken, run.separation[limit.auv], np.nan)
            axes.plot(time, outside, color=BROKEN, lw=3.0, alpha=0.7, zorder=1.5)
    for value in _drawn_limits(run).values():
        axes.axhline(value, **_LIMIT)
    axes.set_ylim(bottom=0.0)
    axes.set_title("Distance to the aid vehicle")
    axes.set_ylabel("Separation [m]")


def _drawn_limits(run: Run) -> dict[str, float]:
    """Least and greatest separation [m], as far as they are set and near what was flown."""
    limits, farthest = run.scenario.constraints, float(run.separation[run.known].max())
    if not run.has_aid:
        return {}
    told = {"least": limits.min_separation, "greatest": limits.max_separation}
    return {name: value for name, value in told.items() if 0 < value <= NEAR * farthest}


def _draw_condition(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i, condition in enumerate(run.condition):
        decided = np.isfinite(condition)
        draw_line(axes, time[decided], condition[decided], color=colour(i), lw=0.8)
    axes.set_yscale("log")
    plain_decades(axes.yaxis)
    axes.set_title("Condition number the planner predicts")
    axes.set_ylabel(f"{run.condition_label} [-]")


def _draw_nees(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i, nees in enumerate(run.nees):
        known = nees > 0
        if known.any():
            draw_line(axes, time[known], nees[known], color=colour(i), lw=0.8)
    axes.axhspan(*NEES_BAND, **_CONSISTENT)
    axes.set_yscale("log")
    plain_decades(axes.yaxis)
    axes.set_title("Normalised error squared (NEES)")
    axes.set_ylabel("NEES [-]")


def _legend(run: Run, curves: Sequence[Patch]) -> Iterator[Line2D | Patch]:
    """What is drawn, beside all panels."""
    one = colour(0) if len(run.names) == 1 else FAINT
    if len(run.names) > 1:
        for i, name in enumerate(run.names):
            yield Line2D([], [], color=colour(i), lw=2.5, label=named(name))
    yield Line2D([], [], color=one, lw=0.8, label="error")
    yield Patch(fc=one, alpha=0.2, label="±3σ of the filter")
    if not run.unbounded_below:
        yield Line2D([], [], **_BOUND, label="Cramér–Rao bound, RMS")
    if run.smoothed is not None:
        yield Line2D([], [], color=dark(one), **_SMOOTHED, label="error, smoothed")
    yield Patch(**_CONSISTENT, label="NEES, 95 % if consistent")
    yield from curves
    if drawn := _drawn_limits(run):
        values = ", ".join(f"{name} {value:g} m" for name, value in drawn.items())
        yield Line2D([], [], **_LIMIT, label=f"separation limits: {values}")
    if any(limit.auv is not None and limit.broken.any() for limit in run.limits):
        yield Line2D([], [], color=BROKEN, lw=3.0, alpha=0.7, label="limit broken")
