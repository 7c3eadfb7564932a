"""Missions of MAVLink autopilots, whatever the file: items become a track, limits and remarks."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from obsplan import geo
from obsplan.missions.mavlink.commands import (
    CIRCLES,
    FLOWN,
    PLACES,
    POLYGONS,
    Command,
)
from obsplan.missions.mavlink.fences import Fences, find_fences
from obsplan.missions.mavlink.flight import Flight
from obsplan.missions.mavlink.items import Item
from obsplan.missions.mavlink.jumps import unroll
from obsplan.missions.mavlink.notes import Notes, command_name, counted
from obsplan.missions.mission import FARTHEST, Area, Mission, Point, named_tracks

__all__ = ["build_mission"]

_ACCOUNTED = (  # commands that are flown, or said otherwise than as actions
    FLOWN
    | POLYGONS
    | CIRCLES
    | PLACES
    | {
        Command.NAV_RETURN_TO_LAUNCH,
        Command.NAV_DELAY,
        Command.DO_CHANGE_SPEED,
        Command.DO_JUMP,
        Command.DO_JUMP_TAG,
        Command.JUMP_TAG,
    }
)


def build_mission(
    path: Path,
    items: Sequence[Item],
    *,
    home: Point | None = None,
    cruise: float = math.nan,
    fences: Fences | None = None,
    remarks: Sequence[str] = (),
) -> Mission:
    """Follow mission items as a vehicle would, and account for every one of them.

    Parameters
    ----------
    path
        The file they are from; it names the track.
    items
        In the order of the file.
    home
        Latitude and longitude [degrees] of the launch; None if the file gives none.
    cruise
        Speed [m/s] before the first command for another; nan if the file gives none.
    fences
        Those that the file holds apart from its items.
    remarks
        What the reader of the file has passed over already; they come first.

    Raises
    ------
    ObsplanError
        A value that is not what its place asks for, or out of bounds; names the item.
    """
    notes = Notes()
    home, doubts = _real_home(home, items)
    flight = Flight(cruise=cruise, notes=notes)
    reached = unroll(items, notes)
    for item in reached:
        flight.follow(item)
    tracks, joined = named_tracks(path, [flight.draft], geographic=True)
    own = find_fences(items)
    given = fences or Fences()
    geofences = (*given.inclusions, *own.inclusions)
    return Mission(
        tracks=tracks,
        geographic=True,
        home=home,
        geofences=geofences,
        keep_outs=(*given.exclusions, *own.exclusions),
        remarks=(
            *remarks,
            *joined,
            *notes.remarks(),
            *_unflown(items, reached),
            *_datums(flight.datums),
            *given.remarks,
            *own.remarks,
            *_several(geofences),
            *doubts,
        ),
    )


def _real_home(home: Point | None, items: Sequence[Item]) -> tuple[Point | None, list[str]]:
    """The home, unless it is far from every place that is flown to: then it is a placeholder."""
    places = [item.position for item in items if item.command in FLOWN]
    known = [place for place in places if place is not None]
    if home is None or not known:
        return home, []
    nearest = geo.distance(np.array(home), np.array(known)).min()
    if nearest <= FARTHEST:
        return home, []
    where = f"latitude {home[0]}, longitude {home[1]}"
    remark = f"home at {where} is {nearest / 1e3:.0f} km from the nearest waypoint: passed over"
    return None, [remark]


def _unflown(items: Sequence[Item], reached: Sequence[Item]) -> list[str]:
    """What of the items is no part of the track: waypoints behind its end, places and actions."""
    remarks = []
    come_to = set(reached)
    left = sum(item.command in FLOWN and item not in come_to for item in items)
    if left:
        remarks.append(f"waypoints that are never come to, passed over: {left}")
    places = Counter(command_name(item.command) for item in items if item.command in PLACES)
    if places:
        remarks.append(f"places that are not flown to, passed over: {counted(places)}")
    others = (item.command for item in items if item.command not in _ACCOUNTED)
    actions = Counter(map(command_name, others))
    if actions:
        remarks.append(f"actions on the way, passed over: {counted(actions)}")
    return remarks


def _several(geofences: Sequence[Area]) -> list[str]:
    """Say what more than one area not to be left means: autopilots differ in that."""
    if len(geofences) < 2:
        return []
    return [f"areas not to be left, of which every one is kept to: {len(geofences)}"]


def _datums(datums: Sequence[str]) -> list[str]:
    """Say so if altitudes are not all above the same."""
    if len(datums) < 2:
        return []
    return [f"altitudes are above {' and '.join(datums)}, kept as they are in the file"]
