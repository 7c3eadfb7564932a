"""Waypoint files (`QGC WPL 110`) for Mission Planner, QGroundControl, MAVProxy and autopilots."""

from pathlib import Path

from obsplan.files import write_atomically
from obsplan.missions.mavlink.commands import Command
from obsplan.missions.mission import Mission
from obsplan.missions.writers.checks import check_geographic, only_track
from obsplan.missions.writers.items import GLOBAL, End, Item, mission_items


def write_waypoints(path: Path | str, mission: Mission, *, end: End = "loiter") -> None:
    """Write a geographic mission's one track, its speeds, its holds, and what it ends with.

    Line 0 is home, by default at the first waypoint. The format holds no limits.

    Raises
    ------
    ObsplanError
        The file cannot be written.
    ValueError
        Local tracks, or several.
    """
    check_geographic(mission, "a waypoint file")
    _, track = only_track(mission, "a waypoint file")
    lat, lon = track.points[0].tolist() if mission.home is None else mission.home
    items = [Item(Command.NAV_WAYPOINT, GLOBAL, lat=lat, lon=lon), *mission_items(track, end=end)]
    lines = ["QGC WPL 110", *(_line(i, item) for i, item in enumerate(items))]
    write_atomically(path, "\n".join(lines) + "\n")


def _line(index: int, item: Item) -> str:
    """Index, current, frame, command, 4 parameters, latitude, longitude, altitude, autocontinue."""
    numbers = (*(f"{value:.6g}" for value in item.params), f"{item.lat:.9f}", f"{item.lon:.9f}")
    return "\t".join((f"{index}\t{index == 0:d}\t{item.frame}\t{item.command:d}", *numbers, "0\t1"))
