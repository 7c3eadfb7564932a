"""A mission as an autopilot stores it: items, each a MAVLink command."""

from typing import Literal, NamedTuple

import numpy as np

from obsplan.missions.mavlink.commands import Command
from obsplan.missions.mission import Track

End = Literal["loiter", "return", "stop"]

# MAV_FRAME; altitudes are above home, 0 for a surface vehicle
GLOBAL, MISSION, RELATIVE = 0, 2, 3
GROUND_SPEED, SAME_THROTTLE = 1.0, -1.0  # of a change of speed


class Item(NamedTuple):
    """One item: what to do, and where [degrees]; 0, 0 for what has no place."""

    command: Command
    frame: int
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    lat: float = 0.0
    lon: float = 0.0


def mission_items(track: Track, *, end: End = "loiter") -> list[Item]:
    """List the items of a geographic track: waypoints with holds, and speeds where they change.

    A speed stands before the waypoint to which it is sailed, the first one before all waypoints.
    ``loiter`` makes of the last waypoint one that is never left, ``return`` sails home after it,
    and after ``stop`` the autopilot does what it is set to do when a mission is done.
    """
    items: list[Item] = []
    last = len(track.points) - 1
    commanded = np.nan
    speeds = [] if track.speed is None else track.speed.tolist()
    for i, (lat, lon) in enumerate(track.points.tolist()):
        speed = speeds[max(i - 1, 0)] if speeds else np.nan
        if np.isfinite(speed) and speed != commanded:
            items.append(
                Item(Command.DO_CHANGE_SPEED, MISSION, (GROUND_SPEED, speed, SAME_THROTTLE, 0.0))
            )
            commanded = speed
        hold = 0.0 if track.hold is None else float(track.hold[i])
        if i == last and end == "loiter":
            items.append(Item(Command.NAV_LOITER_UNLIM, RELATIVE, lat=lat, lon=lon))
        else:
            items.append(Item(Command.NAV_WAYPOINT, RELATIVE, (hold, 0.0, 0.0, 0.0), lat, lon))
    if end == "return":
        items.append(Item(Command.NAV_RETURN_TO_LAUNCH, MISSION))
    return items


def count_items(track: Track, *, end: End) -> int:
    """Count what an autopilot has to store: the items, and home, which is the first of them."""
    return 1 + len(mission_items(track, end=end))
