"""What a map plays back of one run: vehicles, ellipses, limits, ranges, each over time."""

from typing import Any

import numpy as np
from jaxtyping import Float, Integer

from formulations.solution import Status
from obsplan.fates import Fate
from obsplan.report.map import RADIUS, aid_tracks, extent, moored_places, plans
from obsplan.report.map_limits import boundary
from obsplan.report.page.pack import chosen_frames, packed, packed_bytes, track
from obsplan.report.style import colour
from obsplan.report.words import capital, limit_name
from obsplan.run import AidTrack, Run
from obsplan.simulation.arrivals import Arrivals

MOST_FRAMES = 20_000  # of a run
MOST_STATES = 100_000  # of all AUVs of all runs of a page: 6 MB
MOST_PINGS = 20_000  # of a run
MOST_PLACES = 120_000  # of planned paths of all aid vehicles of all runs of a page: 2 MB
LOST = "lost on its way"
NO_STATUS = 255
SHOWN = 0.5  # of the interval between ranges: for so long one is on the map


def scene_of(run: Run, label: str, *, runs: int = 1) -> dict[str, Any]:
    """Everything that a map shows of a run, as one of so many on a page."""
    low, high = extent(run)
    side = float((high - low).max())
    most = min(MOST_FRAMES, MOST_STATES // (len(run.names) * runs))
    places = MOST_PLACES // (len(aid_tracks(run)) * runs) if run.planned else 0
    frames = chosen_frames(run.time.size, max(most, 2))
    played = {
        "label": label,
        "time": packed(run.time[frames]),
        "thinned": -(-run.time.size // frames.size) if frames.size < run.time.size else 0,
        "low": low.tolist(),
        "high": high.tolist(),
    }
    return played | {
        "auvs": [_auv(run, i, frames, side) for i in range(len(run.names))],
        "aids": [
            _aid(run, k, frames, side) | _ahead(run, k, places) for k in range(len(aid_tracks(run)))
        ],
        "plans": [track(plan, side) for plan in plans(run)],
        "areas": _areas(run),
        "moored": moored_places(run).tolist(),
        "rings": _rings(run),
        "limits": _limits(run, frames),
        "pings": _pings(run),
        "shown": SHOWN * run.scenario.table.ranging.interval,
    }


def _auv(run: Run, i: int, frames: Integer[np.ndarray, " n"], side: float) -> dict[str, Any]:
    mean, place = run.mean[i, frames], run.places[i, frames]
    major, minor, angle = ellipse(run.covariance[i, frames, :2, :2])
    heading = mean[:, 2] if run.truth is None else run.truth[i, frames, 2]
    found: dict[str, Any] = {
        "name": run.names[i],
        "colour": colour(i),
        "track": track(run.places[i], side),
        "known": bool(run.known[i].any()),
        "x": packed(place[:, 0]),
        "y": packed(place[:, 1]),
        "heading": packed(heading),
        "est_x": packed(mean[:, 0]),
        "est_y": packed(mean[:, 1]),
        "major": packed(major),
        "minor": packed(minor),
        "angle": packed(angle),
    }
    if run.known[i].any():
        found["error"] = packed(run.error[i, frames])
    if run.known[i].any() and run.has_aid:
        found["separation"] = packed(run.separation[i, frames])
    if run.smoothed is not None:
        found["smoothed"] = track(run.smoothed[i], side)
    return found


def ellipse(
    P: Float[np.ndarray, "n 2 2"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Half axes of 95 % ellipses [m], and the longer one's direction [rad]; nan without one."""
    middle = (P[:, 0, 0] + P[:, 1, 1]) / 2
    half = (P[:, 0, 0] - P[:, 1, 1]) / 2
    spread = np.hypot(half, P[:, 0, 1])
    major = RADIUS * np.sqrt(np.maximum(middle + spread, 0.0))
    minor = RADIUS * np.sqrt(np.maximum(middle - spread, 0.0))
    return major, minor, np.arctan2(P[:, 0, 1], half) / 2


def _aid(run: Run, k: int, frames: Integer[np.ndarray, " n"], side: float) -> dict[str, Any]:
    aid = run.aids[k]
    east, north, heading = aid.pose[frames].T
    return {
        "name": run.aid_names[k],
        "track": track(aid.pose[:, :2], side),
        "x": packed(east),
        "y": packed(north),
        "heading": packed(heading),
        "turn": packed(aid.turn_rate[frames]),
        "speed": packed(aid.speed[frames]),
        **_decisions(aid, frames),
    }


def _ahead(run: Run, k: int, most: int) -> dict[str, Any]:
    """The paths that an aid vehicle's planner had in mind, at most of so many places."""
    planned = run.planned[k] if run.planned else None
    if planned is None:
        return {}
    if planned.is_flown:
        return {"planned": {"flown": True, "thinned": 0}}
    every = -(-planned.time.size // most)
    shown = np.arange(0, planned.decided.size, every)
    lengths = np.diff(planned.ends, prepend=0)[shown]
    kept = np.isin(planned.path, shown)
    columns = {
        "decided": planned.decided[shown],
        "ends": lengths.cumsum(),
        "t": planned.time[kept],
        "x": planned.place[kept, 0],
        "y": planned.place[kept, 1],
    }
    found: dict[str, Any] = {name: packed(column) for name, column in columns.items()}
    return {"planned": found | {"thinned": every if every > 1 else 0}}


def _decisions(aid: AidTrack, frames: Integer[np.ndarray, " n"]) -> dict[str, Any]:
    """Status and score in force at each frame; nothing where none was recorded."""
    decided = np.isfinite(aid.status)
    if not decided.any():
        return {}
    newest = np.maximum.accumulate(np.where(decided, np.arange(decided.size), -1))[frames]
    codes = np.where(newest < 0, NO_STATUS, aid.status[newest])
    said = {code: Status(code) for code in np.unique(codes).astype(int).tolist() if code < 255}
    return {
        "status": packed_bytes(codes),
        "score": packed(np.where(newest < 0, np.nan, aid.score[newest])),
        "words": {f"{code}": f"{one.label}: {one.advice}" for code, one in said.items()},
    }


def _areas(run: Run) -> list[dict[str, Any]]:
    """Keep-outs and the geofence by their outlines."""
    limits, found = run.scenario.constraints, []
    for k, area in enumerate(limits.keep_out, start=1):
        found.append({"name": f"keep-out {k}", "keep_out": True, **_outline(boundary(area))})
    if limits.geofence is not None:
        found.append({"name": "geofence", "keep_out": False, **_outline(boundary(limits.geofence))})
    return found


def _outline(corners: Float[np.ndarray, "n 2"]) -> dict[str, Any]:
    return {"x": packed(corners[:, 0]), "y": packed(corners[:, 1])}


def _rings(run: Run) -> list[dict[str, Any]]:
    """Separations that the aid vehicle has to keep from each AUV."""
    limits = run.scenario.constraints
    rings = {
        "least separation": limits.min_separation,
        "greatest separation": limits.max_separation,
    }
    return [
        {"name": name, "radius": radius}
        for name, radius in rings.items()
        if 0 < radius < np.inf and run.has_aid
    ]


def _limits(run: Run, frames: Integer[np.ndarray, " n"]) -> dict[str, Any] | None:
    """Which limit is broken most, or nearest to it, and by how much [m]; None without any."""
    if not run.limits:
        return None
    violation = np.stack([limit.violation[frames] for limit in run.limits])
    worst = violation.argmax(axis=0)
    return {
        "names": [capital(limit_name(limit)) for limit in run.limits],
        "worst": packed(worst),
        "violation": packed(violation.max(axis=0)),
    }


def _pings(run: Run) -> dict[str, Any]:
    """Ranges in the order in which they came, and those that were lost, between their two ends."""
    columns = _ranged(run) if run.ranged is not None else _came(run)
    if not run.is_replay and Arrivals.matter(run):
        lost = _at(run, np.argwhere(np.moveaxis(Arrivals.lost(run), -1, 0)))
        columns = [np.concatenate(both) for both in zip(columns, lost, strict=True)]
    order = np.argsort(columns[0], kind="stable")
    every = -(-order.size // MOST_PINGS) or 1
    shown = order[::every]
    names = ("t", "auv", "beacon", "fate", "value", "expected", "sigma", "x0", "y0", "x1", "y1")
    ends = _ends(run, *(columns[k][shown] for k in (0, 1, 2)))
    kept = [*(column[shown] for column in columns), *ends]
    words = {f"{fate.value}": fate.words for fate in Fate} | {f"{len(Fate)}": LOST}
    return {
        "columns": {name: packed(column) for name, column in zip(names, kept, strict=True)},
        "beacons": _beacon_names(run),
        "words": words,
        "taken": [fate.value for fate in Fate if fate.taken],
        "unit": "m²" if run.scenario.ranging_kind == "squared-range" else "m",
        "thinned": every if every > 1 else 0,
    }


def _ranged(run: Run) -> list[np.ndarray]:
    log = run.ranged
    assert log is not None
    sigma = np.sqrt(log.variance)
    return [log.received, log.auv, log.beacon, log.fate, log.value, log.expected, sigma]


def _came(run: Run) -> list[np.ndarray]:
    """What came, where nothing was recorded of what became of it."""
    return _at(run, np.argwhere(np.moveaxis(run.came, -1, 0)), fate=Fate.ACCEPTED)


def _at(run: Run, which: Integer[np.ndarray, "n 3"], fate: int = len(Fate)) -> list[np.ndarray]:
    """Ranges by sample, beacon and AUV, of which nothing but the value is known."""
    sample, beacon, auv = which.T
    nothing = np.full(sample.size, np.nan)
    value = run.ranges[beacon, auv, sample]
    codes = np.full(sample.size, fate)
    return [run.time[sample], auv, beacon, codes, value, nothing, nothing]


def _beacon_names(run: Run) -> list[str]:
    log = run.ranged
    return [one.name for one in run.scenario.beacons] if log is None else [*log.beacons]


def _ends(
    run: Run,
    time: Float[np.ndarray, " n"],
    auv: Integer[np.ndarray, " n"],
    beacon: Integer[np.ndarray, " n"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """East and north of AUV and beacon when a range came [m]; nan of an unknown beacon."""
    sample = np.searchsorted(run.time, time - 1e-6).clip(max=run.time.size - 1)
    own = run.places[auv, sample]
    names = [one.name for one in run.scenario.beacons]
    known = dict(zip(names, run.beacon_places, strict=True))
    known |= dict(zip(run.names, run.places, strict=True))
    unknown = np.full((run.time.size, 2), np.nan)
    places = np.stack([known.get(name, unknown) for name in _beacon_names(run)])
    other = places[beacon, sample]
    return own[:, 0], own[:, 1], other[:, 0], other[:, 1]
