"""Waypoint files for autopilots (`QGC WPL 110`), as Mission Planner, QGroundControl and MAVProxy load them."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from obsplan import geo
from obsplan.files import write_atomically
from obsplan.missions.mission import Mission

TOLERANCE = 0.05  # [m]; autopilots take a few hundred waypoints, and steer to about a metre
_WAYPOINT = 16  # MAV_CMD_NAV_WAYPOINT
_GLOBAL, _GLOBAL_RELATIVE_ALT = (
    0,
    3,
)  # MAV_FRAME; altitude above home, which is 0 for a surface vehicle


def write_waypoints(path: Path | str, mission: Mission, *, tolerance: float = TOLERANCE) -> int:
    """Write the one track of a geographic mission, simplified (Douglas-Peucker) to a tolerance [m]; return the number of waypoints.

    Line 0 is home, at the first point of the track.

    Raises
    ------
    ObsplanError
        The file cannot be written.
    ValueError
        Local tracks, several tracks, or a tolerance that is negative or not finite.
    """
    if not mission.geographic or len(mission.tracks) != 1:
        kind = "geographic" if mission.geographic else "local"
        raise ValueError(
            f"a waypoint file holds one geographic track, got {len(mission.tracks)} {kind}: write one at a time, in degrees"
        )
    if not 0 <= tolerance < np.inf:
        raise ValueError(f"tolerance must be at least 0 [m] and finite, got {tolerance}")
    (track,) = (track.points for track in mission.tracks.values())
    points = _simplify(track, tolerance)
    lines = [
        "QGC WPL 110",
        _line(0, track[0], frame=_GLOBAL),
        *(_line(i, p, frame=_GLOBAL_RELATIVE_ALT) for i, p in enumerate(points, start=1)),
    ]
    write_atomically(path, "\n".join(lines) + "\n")
    return len(points)


def _line(index: int, point: Float[np.ndarray, " 2"], *, frame: int) -> str:
    """Index, current, frame, command, four parameters at their defaults, latitude, longitude, altitude, autocontinue."""
    current = int(index == 0)
    return f"{index}\t{current}\t{frame}\t{_WAYPOINT}\t0\t0\t0\t0\t{point[0]:.9f}\t{point[1]:.9f}\t0\t1"


def _simplify(track: Float[np.ndarray, "n 2"], tolerance: float) -> Float[np.ndarray, "k 2"]:
    """Drop the vertices that lie within a tolerance [m] of the line through the others; a vehicle that stays put has one."""
    import shapely

    origin = (float(track[0, 0]), float(track[0, 1]))
    local = geo.to_local(track, origin)
    if np.hypot(local[:, 0], local[:, 1]).max() <= tolerance:
        return track[:1]
    line = shapely.LineString(local).simplify(tolerance, preserve_topology=False)
    return geo.to_geographic(shapely.get_coordinates(line), origin)
