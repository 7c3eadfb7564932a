"""Whether a mission file can hold a survey: no degrees read as metres, no millimetres, no days."""

import numpy as np
from jaxtyping import Float

from obsplan import geo
from obsplan.missions import Mission, Track
from obsplan.missions.mission import FARTHEST
from obsplan.missions.tables.guess import looks_like_degrees
from obsplan.types import ObsplanError

SMALLEST = 1.0  # [m]; of a survey, unless its vehicle is as small
SLOW = 0.1  # [m/s]; of a vehicle that surveys less than that
SHORTEST, LONGEST = 1.0, 48 * 3600.0  # [s] of a mission


def known_speeds(track: Track) -> Float[np.ndarray, " legs"] | None:
    """Speed of each leg [m/s]; None if there is none.

    A leg without one keeps that before it; the first ones take that after them.
    """
    if track.speed is None:
        return None
    said = np.flatnonzero(~np.isnan(track.speed))
    if not said.size:
        return None
    latest = np.searchsorted(said, np.arange(track.speed.size), side="right") - 1
    return track.speed[said[np.maximum(latest, 0)]]


def check_metres_are_metres(name: str, mission: Mission) -> None:
    """Refuse a mission in metres whose numbers are degrees.

    Raises
    ------
    ObsplanError
        Names the file, the first point, and the remedy.
    """
    if mission.geographic:
        return
    points = np.concatenate([track.points for track in mission.tracks.values()])
    if looks_like_degrees(points):
        x, y = points[0].tolist()
        reach = np.ptp(points, axis=0).max()
        raise ObsplanError(
            f"{name} has all its {len(points)} points within {reach:.2g} m of ({x}, {y}), "
            "which look like degrees in columns of metres: head the columns lat and lon"
        )


def check_extent(name: str, mission: Mission) -> None:
    """Refuse a mission that is too small or too large for a survey.

    Raises
    ------
    ObsplanError
        Names the file, its extent and the remedy.
    """
    points = np.concatenate([track.points for track in mission.tracks.values()])
    reach = distance_between(mission, points[:1], points)
    if reach.max() > FARTHEST:
        place = tuple(points[reach.argmax()].tolist())
        raise ObsplanError(
            f"{name} spans {reach.max() / 1e3:.0f} km, and the map ends at {FARTHEST / 1e3:.0f} "
            f"km: correct the point {place} if it is astray, or split the file"
        )
    speeds = [known_speeds(track) for track in mission.tracks.values()]
    slow = all(s is not None and s.max() < SLOW for s in speeds)
    if extent(mission) < SMALLEST and not slow:
        raise ObsplanError(
            f"{name} spans {extent(mission) * 1e3:.3g} mm, less than any survey at the speed of "
            "an AUV: correct its unit, metres or degrees of latitude and longitude"
        )


def check_duration(name: str, duration: float) -> None:
    """Refuse a mission [s] that is over at once, or lasts for days.

    Raises
    ------
    ObsplanError
        Names the file, the duration and the remedy.
    """
    if not duration >= SHORTEST:
        raise ObsplanError(
            f"{name} is a mission of {duration:.2g} s, over before anything can be measured: "
            "check its points and speeds"
        )
    if duration > LONGEST:
        raise ObsplanError(
            f"{name} is a mission of {duration / 3600:.0f} h, and at most {LONGEST / 3600:.0f} h "
            "are planned: check its points and speeds, or split it"
        )


def extent(mission: Mission) -> float:
    """Greatest distance [m] of a vertex from the first one."""
    points = np.concatenate([track.points for track in mission.tracks.values()])
    return float(distance_between(mission, points[:1], points).max())


def distance_between(
    mission: Mission, a: Float[np.ndarray, "*#n 2"], b: Float[np.ndarray, "*#n 2"]
) -> Float[np.ndarray, "*n"]:
    """Distance [m] between points of a mission: on the ellipsoid, or in the plane if local."""
    if mission.geographic:
        return geo.distance(a, b)
    return np.hypot(b[..., 0] - a[..., 0], b[..., 1] - a[..., 1])
