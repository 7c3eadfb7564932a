"""The scenario beside a tape: what a filter begins with and assumes, and what was surveyed."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Integer

from obsplan.quantities import AUV_SPEED, DISTANCE, INTERVAL, VESSEL_SPEED
from obsplan.replay.compass import first_heading
from obsplan.replay.log import Fixes, Log
from obsplan.replay.merge import Candidates, Course, Frame, pose, speed_of
from obsplan.scenario import Scenario, from_dict
from obsplan.surveys.reference import SLOWEST

SIGMA = 1.0  # of ranges, where none is told [m]
HEADING_SIGMA = 2.0  # of compasses, where none is told [deg]
NOISE = {"position": 0.05, "heading_deg": 0.1, "speed": 0.01}  # where none is told
FIRST_SPEED_SIGMA = 0.1  # [m/s]; speeds are measured
UNKNOWN_HEADING = 104.0  # standard deviation of any heading [deg]
MOST_POINTS, MOST_WAYPOINTS = 20_000, 2000  # of a track, and of a survey that it is taken for
THIN = 0.005  # of the survey's extent, a waypoint that is left out is nearer than that
TURN_RADIUS = 10.0  # of aid vehicles, of which none is recorded [m]
STILL = 0.05  # [m]; a vehicle that moves less stays where it is


class First(NamedTuple):
    """What a vehicle's filter begins with, at its first row."""

    given: dict[str, float]  # keys of `first_estimate`
    x: float
    y: float
    heading: float  # [rad]

    def placed(self, moved: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, " n"]:
        """Places reached, east + i north [m], of those from the origin, at first heading east."""
        return complex(self.x, self.y) + moved * np.exp(1j * self.heading)


def first_estimate(
    log: Log, course: Course, told: dict[str, Any], truth: Fixes | None, near: "Near"
) -> First:
    """First mean and standard deviations: those told, the truth if so told, or what ranges say."""
    given: dict[str, float] = {}
    if log.settings.table.first_estimate == "truth" and truth is not None:
        at = np.array([course.begin])
        east, north, heading = pose(truth, at)[0]
        if np.isfinite(truth.heading).any():
            heading = truth.heading[np.isfinite(truth.heading)][0]
        given = {"x": east, "y": north, "heading_deg": float(np.rad2deg(heading))}
        given |= {"sigma_position": 1.0}
        log.note(f'"{course.name}" begins where the truth is, as recording.toml asks for')
    given |= told
    if "x" not in given or "y" not in given:
        given = {"x": near.x, "y": near.y, "sigma_position": near.sigma} | given
        log.note(
            f'no first position of "{course.name}" is told: ({near.x:.0f}, {near.y:.0f}) m '
            f"± {near.sigma:.0f} m, by the beacons it heard first; give x and y under "
            "[[auv]] first_estimate"
        )
    if "heading_deg" not in given:
        given |= _first_heading(log, course, near)
    given.setdefault("sigma_speed", FIRST_SPEED_SIGMA)
    heading = float(np.deg2rad(given["heading_deg"]))
    return First(given, float(given["x"]), float(given["y"]), heading)


def _first_heading(log: Log, course: Course, near: "Near") -> dict[str, float]:
    """The first heading by the compass; none, where there is none."""
    read = first_heading(log, course, near.start)
    if read is None:
        log.note(
            f'no first heading of "{course.name}" is told or read: 0 ± {UNKNOWN_HEADING:.0f} '
            "degrees; give heading_deg under [[auv]] first_estimate"
        )
        return {"heading_deg": 0.0, "sigma_heading_deg": UNKNOWN_HEADING}
    sigma = _sigma_of_headings(log)
    log.note(f'the first heading of "{course.name}" is its first reading, ± {sigma:g} degrees')
    return {"heading_deg": float(np.rad2deg(read)), "sigma_heading_deg": sigma}


def _sigma_of_headings(log: Log) -> float:
    ranging = log.settings.scenario.get("ranging", {})
    told = ranging.get("heading_sigma_deg") if isinstance(ranging, dict) else None
    return float(told) if isinstance(told, int | float) else HEADING_SIGMA


class Near(NamedTuple):
    """Where a vehicle is about, by the first ranges."""

    x: float
    y: float
    sigma: float  # of each coordinate [m]
    start: float  # time 0 on the recording's clock

    @classmethod
    def of(
        cls, rows: Candidates, auv: int, beacons: dict[str, Fixes], start: float, first: int = 10
    ) -> "Near":
        """The mean of the beacons heard first, and how far from it they are heard."""
        tracks = [*beacons.values()]
        own = np.flatnonzero((rows.auv == auv) & (rows.beacon < len(tracks)))[:first]
        if not own.size:
            places = np.stack([pose(fixes, np.zeros(1))[0, :2] for fixes in tracks])
            x, y = places.mean(axis=0).tolist()
            return cls(x, y, 1000.0, start)
        places = np.stack([pose(tracks[rows.beacon[i]], rows.sent[i : i + 1])[0, :2] for i in own])
        center = places.mean(axis=0)
        spread = float(((places - center) ** 2).sum(axis=1).mean())
        squared = float(np.median(rows.value[own])) ** 2 + spread
        sigma = min(max(np.sqrt(squared / 2), 1.0), DISTANCE.greatest)
        return cls(float(center[0]), float(center[1]), float(sigma), start)


def make_scenario(
    log: Log,
    auvs: Sequence[dict[str, Any]],
    beacons: dict[str, Fixes],
    rows: Candidates,
    frame: Frame,
    duration: float,
    time_step: float,
) -> Scenario:
    """Build the scenario; what ``recording.toml`` says has the last word.

    Raises
    ------
    ObsplanError
        A value that no scenario can have; names the key.
    """
    told = without_first_estimates(log.settings.scenario)
    made: dict[str, Any] = {
        "name": _name(log),
        "origin": {"lat": frame.origin[0], "lon": frame.origin[1]},
        "duration": duration,
        "time_step": time_step,
        "auv": list(auvs),
        "ranging": _ranging(log, rows, beacons, time_step),
        **_aids(log, beacons, duration),
    }
    return from_dict(merged(made, told), source=log.settings.source, folder=log.path.parent)


def without_first_estimates(told: dict[str, Any]) -> dict[str, Any]:
    """What is told but for what AUVs begin with, which is in what was made, and the duration."""
    kept = {key: value for key, value in told.items() if key != "duration"}
    if _tables(kept.get("auv")):
        kept["auv"] = [
            {key: value for key, value in auv.items() if key != "first_estimate"}
            for auv in kept["auv"]
        ]
    return kept


def _name(log: Log) -> str:
    """The folder's or file's name, in letters that a scenario's may have."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "-" for c in log.path.stem)
    return name.lstrip("._-")[:100] or "recording"


def _ranging(
    log: Log, rows: Candidates, beacons: dict[str, Fixes], time_step: float
) -> dict[str, Any]:
    """What ranges and compass are, where it is not told."""
    told = log.settings.scenario.get("ranging", {})
    deep = bool(log.depths) or any(fixes.depth.any() for fixes in beacons.values())
    found: dict[str, Any] = {"geometry": "slant" if deep else "horizontal"}
    if "geometry" not in told:
        how = "slant, over the depths" if deep else "horizontal, for no depth is recorded"
        log.note(f"ranges are taken to be {how}")
    if "sigma" not in told:
        known = rows.sigma[np.isfinite(rows.sigma)]
        found["sigma"] = float(np.median(known)) if known.size else SIGMA
        if known.size < rows.sigma.size:
            log.note(
                f"no standard deviation of {rows.sigma.size - known.size} ranges is told: "
                f"{found['sigma']:g} m is taken; give sigma under [ranging]"
            )
    if log.headings:
        found["heading_sigma_deg"] = HEADING_SIGMA
        if "heading_sigma_deg" not in told:
            log.note(
                f"the compass is taken to err by {HEADING_SIGMA:g} degrees; give "
                "heading_sigma_deg under [ranging]"
            )
    apart = []
    for auv in np.unique(rows.auv):
        apart.extend(np.diff(np.unique(rows.received[rows.auv == auv])).tolist())
    usual = float(np.median(apart)) if apart else time_step
    steps = max(round(min(usual, INTERVAL.greatest) / time_step), 1)
    found["interval"] = steps * time_step
    return found


def _aids(log: Log, beacons: dict[str, Fixes], duration: float) -> dict[str, Any]:
    """Beacons that move as transducers of aid vehicles, which keeps their names, others moored."""
    aids, transducers = [], []
    for name, fixes in beacons.items():
        beacon: dict[str, Any] = {"name": name, "depth": float(fixes.depth.mean())}
        if fixes.fixed:
            beacon["x"], beacon["y"] = fixes.place[0].tolist()
        else:
            beacon["on"] = len(aids)
            aids.append(_aid(fixes, duration))
        transducers.append(beacon)
    if aids:
        if "cna" not in log.settings.scenario:
            log.note(
                f"aid vehicles are taken to turn in {TURN_RADIUS:g} m and to sail as fast as "
                "recorded; give [cna] for plans"
            )
    else:
        # no scenario is without an aid vehicle; nobody ranges to this one
        aids = [_idle(transducers[0])]
        log.note(
            "no beacon moves; as a scenario has an aid vehicle, one that nobody ranges to is put "
            "at the first of them"
        )
    return {"cna": aids[0] if len(aids) == 1 else aids, "beacon": transducers}


def _aid(fixes: Fixes, duration: float) -> dict[str, Any]:
    """An aid vehicle that was where a beacon was, whose own transducer is that beacon."""
    x, y, heading = pose(fixes, np.zeros(1))[0].tolist()
    during = (fixes.time >= 0) & (fixes.time <= duration)
    speeds = speed_of(fixes)[during] if fixes.time.size > 1 else np.zeros(0)
    usual = float(np.percentile(speeds, 90)) if speeds.size else 1.0
    start = {"x": x, "y": y, "heading_deg": float(np.rad2deg(np.angle(np.exp(1j * heading))))}
    return {
        "speed": float(np.clip(usual, 0.1, VESSEL_SPEED.greatest)),
        "min_turn_radius": TURN_RADIUS,
        "start": start,
        "ranged": False,
    }


def _idle(beacon: dict[str, Any]) -> dict[str, Any]:
    """An aid vehicle that nobody ranges to."""
    start = {"x": beacon["x"], "y": beacon["y"]}
    return {"speed": 1.0, "min_turn_radius": TURN_RADIUS, "start": start, "ranged": False}


def as_survey(time: Float[np.ndarray, " n"], track: Float[np.ndarray, "n 2"]) -> dict[str, Any]:
    """A track as the survey it was: the fewest points near it, and the speed from each to the next.

    Points that are left out are within `THIN` of the extent of a leg, unless there are too many;
    legs slower than any survey are at the least speed.
    """
    from shapely import LineString

    extent = float(np.hypot(*np.ptp(track, axis=0)))
    if extent < STILL:
        x, y = track[0].tolist()
        return {"survey": {"kind": "static", "x": x, "y": y}}
    some = _evenly(time.size, MOST_POINTS)
    time, track = time[some], track[some]
    simpler = LineString(track).simplify(THIN * extent, preserve_topology=False)
    chosen = _indices(track, np.array(simpler.coords))
    chosen = _apart(track, chosen[_evenly(chosen.size, MOST_WAYPOINTS)])
    points, at = track[chosen], time[chosen]
    legs = np.hypot(*np.diff(points, axis=0).T)
    speeds = np.clip(legs / np.diff(at), 2 * SLOWEST, AUV_SPEED.greatest)
    return {"survey": {"kind": "waypoints", "points": points.tolist(), "speeds": speeds.tolist()}}


def _evenly(count: int, most: int) -> Integer[np.ndarray, " n"]:
    """As many numbers from 0 to the last, evenly; all of them if there are no more."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))


def _indices(
    track: Float[np.ndarray, "n 2"], simpler: Float[np.ndarray, "k 2"]
) -> Integer[np.ndarray, " m"]:
    """Numbers of the points of a track that a simpler line has."""
    chosen = [0]
    for point in simpler[1:]:
        after = chosen[-1] + 1
        chosen.append(after + int((track[after:] == point).all(axis=1).argmax()))
    return np.array(chosen)


def _apart(
    track: Float[np.ndarray, "n 2"], chosen: Integer[np.ndarray, " k"]
) -> Integer[np.ndarray, " m"]:
    """Those of the chosen points that are not at the place of the one before; at least two."""
    kept = [0]
    for i in chosen[1:].tolist():
        if np.hypot(*(track[i] - track[kept[-1]])) > STILL:
            kept.append(i)
    if len(kept) < 2:
        kept.append(int(np.hypot(*(track - track[0]).T).argmax()))
    return np.array(kept)


def merged(made: Any, told: Any) -> Any:
    """What is told in place of what was made, key by key; entries of lists by their names."""
    if isinstance(made, dict) and isinstance(told, dict):
        both = dict(made)
        for key, value in told.items():
            both[key] = merged(made[key], value) if key in made else value
        return both
    if not (_tables(made) and _tables(told)):
        return told
    entries = list(made)
    names = [entry.get("name") for entry in entries]
    for i, entry in enumerate(told):
        at = names.index(entry["name"]) if entry.get("name") in names else i
        entries[at : at + 1] = [merged(one, entry) for one in entries[at : at + 1]] or [entry]
    return entries


def _tables(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(one, dict) for one in value)
