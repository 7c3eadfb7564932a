"""Times of vertices, and what follows from them: the speed on each leg, and the holds."""

import datetime
import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from obsplan import geo
from obsplan.missions.mission import REPEATED, Draft

FASTEST = 30.0  # [m/s]; faster legs tell when the waypoints were drawn, not when they are passed
_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)


def seconds_of(text: str) -> float:
    """Give the seconds [s] since 1970 of an ISO 8601 time, in UTC without a zone; nan if none."""
    try:
        time = datetime.datetime.fromisoformat(text.strip())
    except ValueError:
        return math.nan
    if time.tzinfo is None:
        time = time.replace(tzinfo=datetime.UTC)
    return (time - _EPOCH).total_seconds()


def follow_times(draft: Draft, *, geographic: bool) -> tuple[Draft, str]:
    """Count a draft's times from the first, and derive leg speeds and holds where it has none.

    The speed on a leg is its length over the time from the end of the hold before it; a place
    repeated later is a hold. Times [s] may run from any start, nan where the file has none.

    Returns
    -------
    The draft, and what is wrong with its times; empty if nothing is.
    """
    if draft.time is None or len(draft.points) < 2 or np.isnan(draft.time).all():
        return replace(draft, time=None), ""
    time = np.array(draft.time, dtype=float)
    if np.isnan(time).any():
        return replace(draft, time=None), "with a time at only some vertices: times passed over"
    length = lengths(np.array(draft.points, dtype=float), geographic=geographic)
    moved = length > REPEATED
    hold = np.zeros(len(time)) if draft.hold is None else np.array(draft.hold, dtype=float)
    passed = np.diff(time) - hold[:-1]
    speed = np.full(len(time), np.nan)
    runs_on = moved & (passed > 0)
    speed[1:][runs_on] = length[runs_on] / passed[runs_on]
    if np.nanmax(speed, initial=0.0) > FASTEST:
        why = f"with times that no vehicle keeps (over {FASTEST:g} m/s): times passed over"
        return replace(draft, time=None), why
    if draft.hold is None:
        hold[1:][~moved] = np.maximum(passed[~moved], 0.0)
    timed = replace(
        draft,
        time=(time - time[0]).tolist(),
        speed=draft.speed or speed.tolist(),
        hold=hold.tolist(),
    )
    stands = (moved & (passed <= 0)).any()
    return timed, "with legs along which the times do not run on: no speed there" if stands else ""


def lengths(points: Float[np.ndarray, "n 2"], *, geographic: bool) -> Float[np.ndarray, " legs"]:
    """Distances [m] between successive points, on the ellipsoid or in the plane."""
    if geographic:
        return geo.distance(points[:-1], points[1:])
    return np.hypot(*np.diff(points, axis=0).T)
