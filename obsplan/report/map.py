"""The map of a run: who was where when, how sure of it, and within which limits."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float, Integer
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from obsplan.record import NO_TRUTH
from obsplan.report.map_limits import binding_separations, boundary, draw_limits, ring
from obsplan.report.marks import Label, draw_labels, mark_label, marked_instants, marks_in_words
from obsplan.report.style import AID, BROKEN, FAINT, colour, dark, named, styled
from obsplan.report.surround import draw_bar_and_north, draw_heading, draw_notes, fit_figure
from obsplan.report.words import after, capital, clock, limit_name, metres, sailed, title
from obsplan.run import AidTrack, Run

PROBABILITY = 0.95
# of the ellipse in standard deviations: chi-square with 2 degrees
RADIUS = float(np.sqrt(-2.0 * np.log(1.0 - PROBABILITY)))
ELLIPSES = 32  # in all
SMALLEST = 0.004  # semi-axis of an ellipse worth drawing, as a share of the map's width
WINDING = 20.0  # times the map's width: the path is so long that it would hide the rest
MOST_VERTICES = 50_000  # of a track
MOST_PINGS = 150  # marked
MOST_GROWTH = 2.0  # of the map's sides, to show more than the vehicles' tracks
STILL = 0.015  # of the map's diagonal: a vehicle that has moved no farther gets no new time mark
WIDE, HIGH = 6.0, 7.5  # the most of the map itself [inch]
MARGIN = 0.7  # left and below, for the axes' labels [inch]
BAND = 0.35  # opacity of a true track
_START: dict[str, Any] = {"marker": "o", "ms": 5, "mfc": "white", "mew": 1.5, "ls": ""}
_AID_START: dict[str, Any] = {"marker": "o", "ms": 7, "mfc": "white", "mec": AID, "mew": 1.6}
_MOORED: dict[str, Any] = {"marker": "^", "ms": 7, "mfc": "white", "mec": AID, "ls": ""}
_SMOOTHED: dict[str, Any] = {"lw": 0.9, "ls": (0, (4, 1.5))}
_TIME: dict[str, Any] = {"marker": "o", "ms": 5, "mec": "white", "mew": 0.7, "ls": ""}
_PING: dict[str, Any] = {"marker": "o", "ms": 2.4, "mfc": "white", "mew": 0.6, "ls": ""}
_ARROW: dict[str, Any] = {"ms": 7, "mfc": AID, "mec": "white", "mew": 0.4, "ls": ""}


@styled()  # in any case: its own size depends on the style
def map_figure(run: Run) -> Figure:
    """Draw from above: surveys, true tracks, estimates with ellipses, aid vehicle, limits."""
    low, high = extent(run)
    width, height = high - low
    inch = float(min(WIDE / width, HIGH / height))  # inches a metre
    figure = Figure(figsize=(width * inch + MARGIN, height * inch + MARGIN))
    place = (MARGIN, MARGIN, width * inch, height * inch)
    size = np.tile(figure.get_size_inches(), 2)
    axes = figure.add_axes(tuple(np.array(place) / size), aspect="equal")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), autoscale_on=False)
    limits = draw_limits(axes, run)
    for i in range(len(run.names)):
        _draw_auv(axes, run, i, smallest=SMALLEST * float(width))
    _draw_aid(axes, run)
    _draw_pings(axes, run)
    _draw_moored(axes, run)
    tracks = [*aid_tracks(run), *map(finite, run.places)]
    draw_labels(axes, _draw_marks(axes, run), tracks, inch=inch)
    origin = run.scenario.table.origin
    told = (origin.lat, origin.lon) != (0.0, 0.0)  # what a recording that does not say has
    axes.set_xlabel(f"East of {degrees(origin.lon, 'E', 'W')} [m]" if told else "East [m]")
    axes.set_ylabel(f"North of {degrees(origin.lat, 'N', 'S')} [m]" if told else "North [m]")
    draw_heading(axes, heading(run))
    draw_bar_and_north(axes, float(width), inch)
    draw_notes(axes, off_the_map(run, low, high))
    axes.legend(
        handles=[*_legend(run), *limits],
        loc="upper left",
        bbox_to_anchor=(1.0, 1.0, 0.0, -0.62 / (height * inch)),
        borderaxespad=0.9,
        fontsize=8,
        handlelength=2.4,
    )
    fit_figure(figure, axes)
    return figure


def heading(run: Run) -> list[tuple[str, str]]:
    """Lines above the map, each with its colour."""
    lines = [
        (f"{title(run.scenario.table.name)}, {sailed(run)}", "black"),
        (f"{_error(run)}; {clock(run, run.time[-1])}{_identity(run)}", "black"),
    ]
    broken = [limit for limit in run.limits if limit.broken.any()]
    if broken:
        worst = max(broken, key=lambda limit: limit.violation.max())
        most, when = metres(float(worst.violation.max())), after(run, worst.worst)
        said = f"{limit_name(worst)} broken by {most} {when}"
        others = f", and {len(broken) - 1} more" if len(broken) > 1 else ""
        lines.append((capital(said) + others, BROKEN))
    return lines


def _error(run: Run) -> str:
    """How far off estimates were, as far as that is known."""
    if not run.known.any():
        return capital(NO_TRUTH)
    return f"RMS position error {metres(run.rms_error)}, worst {metres(run.max_error)}"


def _identity(run: Run) -> str:
    """What tells it from other runs of the scenario."""
    if run.is_replay:
        return "" if run.began is None else f" from {run.began:%Y-%m-%d %H:%M} UTC"
    return f", seed {run.seed}"


def degrees(value: float, positive: str, negative: str) -> str:
    """A latitude or longitude to 0.1 m, with its hemisphere."""
    digits = f"{abs(value):.6f}".rstrip("0").rstrip(".")
    return f"{digits}° {negative if value < 0 else positive}"


def extent(run: Run) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Lower left and upper right corner [m] of the map.

    It holds all true tracks and surveys; estimates, ellipses and limits too, unless one of them
    would make the map more than twice as large.
    """
    points = np.concatenate([*aid_tracks(run), *map(finite, run.places), *plans(run)])
    low, high = points.min(axis=0), points.max(axis=0)
    side = max(float((high - low).max()), 1.0)
    for _, other in _companions(run):
        low, high = _grown(low, high, other, side)
    margin = 0.05 * max(*(high - low), 1.0)
    flattest = 0.25 * (high - low).max()  # a map is not a line
    spare = np.maximum(flattest - (high - low), 0.0) / 2
    return low - spare - margin, high + spare + margin


def aid_tracks(run: Run) -> list[Float[np.ndarray, "samples 2"]]:
    """Positions of all aid vehicles."""
    return [aid.pose[:, :2] for aid in run.aids] if run.has_aid else []


def plans(run: Run) -> list[Float[np.ndarray, "_ 2"]]:
    """Planned surveys; of a recording they are made of its tracks, and no plan."""
    if run.is_replay:
        return []
    return [reference.polyline for reference in run.scenario.references]


def finite(places: Float[np.ndarray, "samples 2"]) -> Float[np.ndarray, "_ 2"]:
    """Those of some places that are known."""
    return places[np.isfinite(places).all(axis=1)]


def moored_places(run: Run) -> Float[np.ndarray, "beacons 2"]:
    """Where moored beacons are."""
    places = [beacon.place for beacon in run.scenario.beacons if beacon.carrier is None]
    return np.array(places, dtype=float).reshape(-1, 2)


def off_the_map(run: Run, low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"]) -> list[str]:
    """What is not wholly on the map."""
    outside = [
        name
        for name, points in _companions(run)
        if len(points) and ((points < low) | (points > high)).any()
    ]
    return [f"Beyond the map: {', '.join(outside)}."] if outside else []


def _companions(run: Run) -> Iterator[tuple[str, Float[np.ndarray, "_ 2"]]]:
    """What is on the map beside the tracks, with its outline [m], the most wanted first."""
    if len(moored_places(run)):
        yield "moored beacons", moored_places(run)
    limits = run.scenario.constraints
    for k, area in enumerate(limits.keep_out, start=1):
        yield f"keep-out {k}", boundary(area)
    if limits.geofence is not None:
        yield "the geofence", boundary(limits.geofence)
    for limit in binding_separations(run):
        yield limit.name, ring(run, limit)
    for i, name in enumerate(run.names):
        yield f"estimate of {name}", finite(run.mean[i, :, :2])  # nan where the filter has failed
    for i, name in enumerate(run.names):
        P = run.covariance[i, :1, :2, :2]
        if np.isfinite(P).all():
            yield f"first ellipse of {name}", ellipses(P, run.mean[i, :1, :2])[0]


def _grown(
    low: Float[np.ndarray, " 2"],
    high: Float[np.ndarray, " 2"],
    points: Float[np.ndarray, "_ 2"],
    side: float,
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Corners that hold the points, too, or those of before where that would be too much."""
    if not len(points):
        return low, high
    lower = np.minimum(low, points.min(axis=0))
    higher = np.maximum(high, points.max(axis=0))
    fits = bool((higher - lower).max() <= MOST_GROWTH * side)
    return (lower, higher) if fits else (low, high)


def ellipses(
    covariance: Float[np.ndarray, "n 2 2"], center: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 49 2"]:
    """Outlines of the 95 % ellipses."""
    variance, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = RADIUS * np.stack([np.cos(angle), np.sin(angle)])
    half_axes = axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :]
    return center[:, None, :] + np.swapaxes(half_axes @ circle, 1, 2)


def apart(
    shapes: Float[np.ndarray, "n 49 2"], center: Float[np.ndarray, "n 2"], smallest: float
) -> list[int]:
    """Which ellipses to draw: those large enough [m] that do not hide the one drawn before.

    They must not be much like it, either.
    """
    size = np.linalg.norm(shapes - center[:, None], axis=-1).max(axis=-1)
    drawn: list[int] = []
    for k in np.flatnonzero(size >= smallest):
        last = drawn[-1] if drawn else k
        if (
            not drawn
            or np.hypot(*(center[k] - center[last])) > size[last]
            or not 0.5 < size[k] / size[last] < 2.0
        ):
            drawn.append(int(k))
    return drawn


def _draw_auv(axes: Axes, run: Run, i: int, *, smallest: float) -> None:
    paint, every = colour(i), _every(run)
    for plan in plans(run)[i : i + 1]:
        cross = "+" if len(plan) == 1 else ""
        axes.plot(*plan.T, color=FAINT, lw=0.8, ls=(0, (5, 3)), marker=cross, zorder=1)
    if run.truth is not None:
        true = {"color": paint, "alpha": BAND, "lw": 3.5, "solid_capstyle": "round"}
        axes.plot(*run.truth[i, every, :2].T, **true, zorder=2)
    axes.plot(*run.mean[i, every, :2].T, color=paint, lw=0.9, zorder=5)
    if run.smoothed is not None:
        axes.plot(*run.smoothed[i, every].T, color=dark(paint), **_SMOOTHED, zorder=5.2)
    axes.plot(*finite(run.places[i])[:1].T, **_START, mec=paint, zorder=6)
    count = max(4, ELLIPSES // len(run.names))
    at = np.unique(np.linspace(0, run.time.size - 1, count).astype(int))
    at = at[np.isfinite(run.covariance[i, at, :2, :2]).all(axis=(1, 2))]
    shapes = ellipses(run.covariance[i, at, :2, :2], run.mean[i, at, :2])
    shapes = shapes[apart(shapes, run.mean[i, at, :2], smallest)]
    drawn = PolyCollection(list(shapes), fc=to_rgba(paint, 0.2), ec=paint, lw=0.6, zorder=3)
    axes.add_collection(drawn, autolim=False)


def _draw_moored(axes: Axes, run: Run) -> None:
    """Beacons that stay where they are."""
    places = moored_places(run)
    if len(places):
        axes.plot(*places.T, **_MOORED, zorder=8)


def _draw_aid(axes: Axes, run: Run) -> None:
    for aid in run.aids if run.has_aid else ():
        _draw_one_aid(axes, run, aid)


def _draw_one_aid(axes: Axes, run: Run, aid: AidTrack) -> None:
    path = aid.pose[_every(run), :2]
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    winding = length[-1] > WINDING * np.ptp(path, axis=0).max()
    line: dict[str, Any] = {"lw": 0.3, "alpha": 0.6} if winding else {"lw": 0.8, "alpha": 0.75}
    axes.plot(*path.T, color=AID, **line, zorder=1.5 if winding else 4)
    if length[-1] > 0:
        _draw_course(axes, run, aid)
        axes.plot(*path[-1], marker="s", ms=6, mfc=AID, mec="white", ls="", zorder=9.5)
    axes.plot(*path[0], **_AID_START, ls="", zorder=8)


def _draw_course(axes: Axes, run: Run, aid: AidTrack) -> None:
    """Arrows along the aid vehicle's path, halfway between the time marks."""
    marks = np.concatenate([[0], marked_instants(run.time), [run.time.size - 1]])
    for k in (marks[1:] + marks[:-1]) // 2:
        pointed = (3, 0, np.rad2deg(aid.pose[k, 2]) - 90.0)
        axes.plot(*aid.pose[k, :2], marker=pointed, **_ARROW, zorder=7)


def _pinged(run: Run, b: int, i: int) -> Integer[np.ndarray, " pings"]:
    """Samples at which an AUV's ranges to a beacon are marked."""
    pings = np.flatnonzero(np.isfinite(run.ranges[b, i]))
    return pings[:: _every_ping(pings.size)]


def _every_ping(pings: int) -> int:
    """One in how many ranges is marked: a round number."""
    for one_in in (1, 2, 5):
        if pings <= one_in * MOST_PINGS:
            return one_in
    one_in = 10
    while pings > one_in * MOST_PINGS:
        one_in *= 2
    return one_in


def _draw_pings(axes: Axes, run: Run) -> None:
    """Ticks where ranges were taken, on both ends of them."""
    for b, place in enumerate(run.beacon_places):
        pinged = [_pinged(run, b, i) for i in range(len(run.names))]
        for i, samples in enumerate(pinged):
            x, y = run.places[i, samples].T
            axes.plot(x, y, **_PING, mec=colour(i), zorder=5.5)
        if run.scenario.beacons[b].carrier is not None:
            x, y = place[np.unique(np.concatenate(pinged))].T
            axes.plot(x, y, **_PING, mec=AID, zorder=5.5)


def _draw_marks(axes: Axes, run: Run) -> list[Label]:
    """Mark the same instants on all tracks; returns their labels and the AUVs' names."""
    longest = float(run.time[-1])
    still = STILL * float(np.hypot(np.diff(axes.get_xlim()), np.diff(axes.get_ylim()))[0])
    aids = zip(run.aid_names if run.others else [""], aid_tracks(run), strict=False)
    auvs = run.names if len(run.names) > 1 else [""]
    tracks = [(name, AID, track) for name, track in aids]
    tracks += [(name, colour(i), run.places[i]) for i, name in enumerate(auvs)]
    labels = [
        Label(text=name, at=track[0], colour=dark(paint), bold=True)
        for name, paint, track in tracks
        if name
    ]
    for _, paint, track in tracks:
        last = track[0]
        for k in marked_instants(run.time):
            if np.hypot(*(track[k] - last)) < still:
                continue
            last = track[k]
            axes.plot(*last, **_TIME, mfc=paint, zorder=9)
            labels.append(
                Label(text=mark_label(float(run.time[k]), longest), at=last, colour=dark(paint))
            )
    return labels


def _every(run: Run) -> slice:
    return slice(None, None, -(-run.time.size // MOST_VERTICES))


def _legend(run: Run) -> list[Line2D | Patch]:
    one = colour(0) if len(run.names) == 1 else FAINT
    moves = any(bool((track != track[0]).any()) for track in aid_tracks(run))
    ellipse = f"{100 * PROBABILITY:.0f} % ellipse"
    handles: list[Line2D | Patch] = []
    if len(run.names) > 1:
        handles += [
            Line2D([], [], color=colour(i), lw=2.5, label=named(name))
            for i, name in enumerate(run.names)
        ]
    if plans(run):
        handles.append(Line2D([], [], color=FAINT, lw=0.8, ls=(0, (5, 3)), label="survey plan"))
    if run.truth is not None:
        handles.append(Line2D([], [], color=one, lw=3.5, alpha=BAND, label="AUV, true"))
    handles += [
        Line2D([], [], **_START, mec=one, label="AUV, start"),
        Line2D([], [], color=one, lw=0.9, label="AUV, estimated"),
        Patch(fc=to_rgba(one, 0.2), ec=one, lw=0.6, label=ellipse),
    ]
    if run.smoothed is not None:
        handles.append(Line2D([], [], color=dark(one), **_SMOOTHED, label="AUV, smoothed"))
    if run.has_aid:
        start = {"color": AID, "lw": 0.8 * moves, **_AID_START}
        handles.append(Line2D([], [], **start, label="aid vehicle, start"))
    if moves:
        course = {"color": AID, "lw": 0.8}
        handles += [
            Line2D([], [], **course, marker=(3, 0, -90), ms=7, label="aid vehicle, course"),
            Line2D([], [], **course, marker="s", ms=6, label="aid vehicle, end"),
        ]
    if len(moored_places(run)):
        handles.append(Line2D([], [], **_MOORED, label="moored beacon"))
    handles.append(Line2D([], [], **_TIME, mfc=AID, label=marks_in_words(run.time)))
    handles.append(Line2D([], [], **_PING, mec=AID, label=_pings_in_words(run)))
    return handles


def _pings_in_words(run: Run) -> str:
    shown = _every_ping(int(np.count_nonzero(np.isfinite(run.range[0]))))
    interval = run.scenario.table.ranging.interval
    what = "range that came, due" if run.scenario.ranges_may_be_lost else "range,"
    what = "range" if run.is_replay else f"{what} every {interval:g} s"
    return what + (f",\none in {shown} shown" if shown > 1 else "")
