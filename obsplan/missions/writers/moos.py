"""MOOS-IvP behaviours (`.bhv`): the path as points in local metres."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from obsplan.files import write_atomically
from obsplan.missions.mission import Area, Mission, Point, Track, to_local
from obsplan.missions.writers.checks import only_track
from obsplan.missions.writers.names import limit_names

WAYPOINTS = """\
Behavior = BHV_Waypoint
{{
  name           = {name}
  pwt            = 100
  points         = {points}
  speed          = {speed:.4g}
  capture_radius = {capture:g}
  slip_radius    = {slip:g}
  repeat         = 0
}}
"""
REGION = """
Behavior = BHV_OpRegion
{{
  name    = {name}
  polygon = {points}
}}
"""
SLIP = 2.0  # capture radii; a waypoint passed so near counts as reached


def write_moos(
    path: Path | str, mission: Mission, *, origin: Point | None = None, capture: float = 2.0
) -> None:
    """Write a mission's one track as a waypoint behaviour, a convex geofence as a region.

    A behaviour has one speed: that which comes to the end in time. How far a vehicle at that speed
    is ahead or behind on the way stands in a comment, and so does every limit that MOOS has no
    behaviour for.

    Parameters
    ----------
    origin
        Latitude and longitude [degrees] of (0, 0), by default `Mission.origin`.
    capture
        Radius [m] within which a waypoint is reached.

    Raises
    ------
    ObsplanError
        The file cannot be written, or the mission is far from the origin.
    ValueError
        Several tracks.
    """
    name, _ = only_track(mission, "a MOOS behaviour")
    origin = origin or mission.origin
    local = to_local(mission, origin)
    speed, off = _one_speed(local.tracks[name])
    notes = [
        _about(origin),
        *([f"ahead or behind by up to {off:.1f} s at its one speed"] if off else []),
    ]
    regions: list[str] = []
    for limit, kind, area in limit_names(local):
        points = _points(area.points)
        if kind == "geofence" and area.radius is None and _is_convex(area.points):
            regions.append(REGION.format(name=limit, points=points))
        else:
            notes.append(f"not kept by a behaviour: {limit}, {_words(area, points)}")
    behaviour = WAYPOINTS.format(
        name=name,
        points=_points(local.tracks[name].points),
        speed=speed,
        capture=capture,
        slip=SLIP * capture,
    )
    comments = "".join(f"// {note}\n" for note in notes)
    write_atomically(path, comments + behaviour + "".join(regions))


def _about(origin: Point | None) -> str:
    if origin is None:
        return "east and north [m] of the origin"
    lat, lon = origin
    return f"east and north [m] of LatOrigin = {lat:.8f}, LongOrigin = {lon:.8f}"


def _one_speed(track: Track) -> tuple[float, float]:
    """The speed [m/s] that is at the end in time, and how far off [s] it is on the way.

    Both are 0 where nothing is known.
    """
    lengths = np.hypot(*np.diff(track.points, axis=0).T)
    if track.time is None or not lengths.size:
        known = [] if track.speed is None else track.speed[np.isfinite(track.speed)]
        return (float(np.mean(known)) if len(known) else 0.0), 0.0
    along, time = np.append(0.0, np.cumsum(lengths)), track.time - track.time[0]
    speed = float(along[-1] / time[-1])
    return speed, float(abs(along / speed - time).max())


def _points(points: Float[np.ndarray, "n 2"]) -> str:
    return " : ".join(f"{x:.2f},{y:.2f}" for x, y in (points.round(2) + 0.0).tolist())


def _words(area: Area, points: str) -> str:
    return f"polygon {points}" if area.radius is None else f"circle {points} of {area.radius:g} m"


def _is_convex(corners: Float[np.ndarray, "n 2"]) -> bool:
    """Whether a polygon turns one way at all its corners."""
    sides = np.roll(corners, -1, axis=0) - corners
    ahead = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * ahead[:, 1] - sides[:, 1] * ahead[:, 0]
    return bool((turns >= 0).all() or (turns <= 0).all())
