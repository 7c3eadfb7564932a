"""Panels over time beside a map: what each draws, thinned, and the scale it begins with."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.fates import Fate
from obsplan.ranged import Ranged
from obsplan.record import distance
from obsplan.report.errors import NEES_BAND, SIGMAS
from obsplan.report.innovations import BAND
from obsplan.report.page.pack import line, packed
from obsplan.report.panels import OVERSHOOT, SETTLED, USUAL
from obsplan.report.style import colour, outline, time_axis
from obsplan.run import Run

Series = dict[str, Any]
Panel = dict[str, Any]
INK, FAINT, LIMIT, BROKEN = "ink", "faint", "limit", "broken"  # colours that follow the theme
MOST_DOTS = 4000


def panels_of(run: Run) -> list[Panel]:
    """All panels of one run; those that differ by AUV have as many choices."""
    time, _ = time_axis(run.time)
    found = [_offsets(run, time, 0, "East"), _offsets(run, time, 1, "North")]
    if run.known.any():
        found.append(_distances(run, time))
    if run.has_aid and run.known.any():
        found.append(_separation(run, time))
    if run.ranged is not None and np.isfinite(run.ranged.normalised).any():
        found.append(_innovations(run, time))
    if run.known.any():
        found.append(_nees(run, time))
    found += [*_decisions(run, time)]
    if run.hypotheses is not None and (run.hypotheses > 1).any():
        several = [_drawn(run, i, time, one) for i, one in enumerate(run.hypotheses)]
        found.append(panel("Positions that fit", several))
    return found


def panel(title: str, series: Sequence[Series], **more: Any) -> Panel:
    """A panel that shows the same whichever AUV is chosen."""
    return {"title": title, "choices": [list(series)], **more}


def _drawn(run: Run, i: int, time: Float[np.ndarray, " n"], values: np.ndarray) -> Series:
    return {"kind": "line", "name": run.names[i], "colour": colour(i), **line(time, values)}


def _offsets(run: Run, time: Float[np.ndarray, " n"], axis: int, name: str) -> Panel:
    """Error east or north of each AUV within three standard deviations; or only these."""
    choices, reach = [], []
    for i in range(len(run.names)):
        variance = run.covariance[i, :, axis, axis]
        stated = SIGMAS * np.sqrt(np.maximum(variance, 0.0))
        shown = np.flatnonzero(np.isfinite(stated))
        shown = shown[outline(stated[shown])] if shown.size else shown
        band = {"t": packed(time[shown]), "low": packed(-stated[shown]), "y": packed(stated[shown])}
        series = [{"kind": "band", "name": "±3σ of the filter", "colour": colour(i), **band}]
        error = np.full(time.size, np.nan)
        if run.known[i].any():
            error = run.mean[i, :, axis] - run.true[i, :, axis]
            series.append(
                {"kind": "line", "name": "error", "colour": colour(i), **line(time, error)}
            )
        choices.append(series)
        reach.append(settled_scale(np.abs(error), stated))
    what = f"{name} error" if run.known.any() else f"{name}: ±3σ of the filter, no truth known"
    return {
        "title": f"{what} [m]",
        "choices": choices,
        "ranges": [[-most, most] for most in reach],
    }


def settled_scale(error: Float[np.ndarray, " n"], stated: Float[np.ndarray, " n"]) -> float:
    """Where an axis ends: it holds all once the first quarter is over, or all if that is no more.

    Of what is stated, rare peaks do not set it; as in `obsplan.report.panels.scale_errors`.
    """
    late = slice(int(SETTLED * error.size), None)
    known = np.isfinite(stated[late])
    usual = float(np.quantile(stated[late][known], USUAL)) if known.any() else 0.0
    settled = 1.1 * float(np.fmax.reduce(error[late], initial=usual))
    highest = 1.1 * float(np.fmax.reduce(np.fmax(error, stated), initial=0.0))
    if 0 < settled < highest / OVERSHOOT:
        return settled
    return highest if highest > 0 else 1.0


def _distances(run: Run, time: Float[np.ndarray, " n"]) -> Panel:
    """Distance from the truth with its Cramér-Rao bound, and that of smoothed tracks."""
    choices, ranges = [], []
    for i in range(len(run.names)):
        series = []
        if run.known[i].any():
            series.append(
                {"kind": "line", "name": "error", "colour": colour(i), **line(time, run.error[i])}
            )
        bound = np.full(time.size, np.nan)
        if not run.unbounded_below:
            bound = np.sqrt(run.cramer_rao_variance[i])
            series.append(_dashed("Cramér–Rao bound, RMS", INK, line(time, bound)))
        if run.smoothed is not None and run.known[i].any():
            smoothed = distance(run.smoothed[i], run.true[i])
            series.append(_dashed("error, smoothed", FAINT, line(time, smoothed)))
        choices.append(series)
        ranges.append([0.0, settled_scale(run.error[i], bound)])
    return {"title": "Distance from the truth [m]", "choices": choices, "ranges": ranges}


def _dashed(name: str, paint: str, values: Series) -> Series:
    return {"kind": "line", "name": name, "colour": paint, "dash": True, **values}


def _separation(run: Run, time: Float[np.ndarray, " n"]) -> Panel:
    series = [_drawn(run, i, time, one) for i, one in enumerate(run.separation)]
    farthest = 1.1 * float(np.fmax.reduce(run.separation[run.known], initial=1.0))
    limits, levels = run.scenario.constraints, []
    for name, value in (("least", limits.min_separation), ("greatest", limits.max_separation)):
        if 0 < value < np.inf:
            levels.append({"kind": "level", "name": f"{name}, {value:g} m", "at": value})
    top = max([farthest, *(1.1 * one["at"] for one in levels if one["at"] < 2 * farthest)])
    title = "Distance to the aid vehicle [m]"
    return panel(title, [*series, *levels], ranges=[[0.0, top]])


def _innovations(run: Run, time: Float[np.ndarray, " n"]) -> Panel:
    """Innovations of each AUV in standard deviations, whose squares are NIS."""
    assert run.ranged is not None
    length = run.time[-1] / time[-1]
    choices, ranges = [], []
    for i in range(len(run.names)):
        own = run.ranged.of(auv=i)
        seen = np.isfinite(own.normalised)
        series = [{"kind": "span", "name": "95 % if consistent", "low": -BAND, "high": BAND}]
        for taken in (True, False):
            if dots := _dots(own, seen & (own.taken == taken), length, taken=taken, i=i):
                series.append(dots)
        most = float(np.fmax.reduce(np.abs(own.normalised[own.taken]), initial=2 * BAND))
        choices.append(series)
        ranges.append([-1.1 * most, 1.1 * most])
    return {"title": "Innovation [σ]; its square is NIS", "choices": choices, "ranges": ranges}


def _dots(own: Ranged, which: np.ndarray, length: float, *, taken: bool, i: int) -> Series | None:
    """Innovations of some of an AUV's ranges, in units of time so long [s]."""
    shown = np.flatnonzero(which)
    shown = shown[:: -(-shown.size // MOST_DOTS) or 1]
    if not shown.size:
        return None
    found = {
        "kind": "dots",
        "name": "taken" if taken else "rejected",
        "colour": colour(i) if taken else BROKEN,
        "t": packed(own.received[shown] / length),
        "y": packed(own.normalised[shown]),
    }
    if taken:
        return found
    words = [Fate(code).words for code in own.fate[shown].tolist()]
    return found | {"cross": True, "words": words}


def _nees(run: Run, time: Float[np.ndarray, " n"]) -> Panel:
    """Consistency of each AUV's errors; where a filter knows all exactly there is none."""
    low, high = NEES_BAND
    series: list[Series] = [
        {"kind": "span", "name": "95 % if consistent", "low": low, "high": high}
    ]
    for i, nees in enumerate(run.nees):
        series.append(_drawn(run, i, time, np.where(nees > 0, nees, np.nan)))
    top = float(np.fmax.reduce(run.nees[np.isfinite(run.nees)], initial=high))
    return panel("NEES", series, log=True, ranges=[[low / 5, 2 * top]])


def _decisions(run: Run, time: Float[np.ndarray, " n"]) -> Iterator[Panel]:
    """What the planner predicts: condition numbers, and its own score."""
    condition = np.where(np.isfinite(run.condition) & (run.condition > 0), run.condition, np.nan)
    if np.isfinite(condition).any():
        series = [_drawn(run, i, time, one) for i, one in enumerate(condition)]
        least, most = float(np.nanmin(condition)), float(np.nanmax(condition))
        what = f"Condition number that the planner predicts, {run.condition_label}"
        yield panel(what, series, log=True, ranges=[[least / 1.5, most * 1.5]])
    if np.isfinite(run.score).any():
        names = run.aid_names if run.others else ("score",)
        series = [
            {"kind": "line", "name": name, "colour": INK, **line(time, aid.score)}
            for name, aid in zip(names, run.aids, strict=True)
        ]
        yield panel("The planner's own score", series)
