"""QGroundControl plans (`.plan`, version 1): mission and geofence, for a boat under ArduPilot."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from obsplan.files import write_atomically
from obsplan.missions.mission import Area, Mission
from obsplan.missions.writers.checks import check_geographic, only_track
from obsplan.missions.writers.items import MISSION, End, Item, mission_items

ARDUPILOT, BOAT = 3, 11  # MAV_AUTOPILOT, MAV_TYPE
ABOVE_HOME = 1  # QGroundControl's altitude mode
DECIMALS = 9  # of a degree: 0.1 mm


def write_plan(path: Path | str, mission: Mission, *, end: End = "loiter") -> None:
    """Write the one track of a geographic mission and its limits, as the waypoint file has it.

    Geofences become areas to stay in, keep-outs areas to stay out of. Home is by default at the
    first waypoint.

    Raises
    ------
    ObsplanError
        The file cannot be written.
    ValueError
        Local tracks, or several.
    """
    check_geographic(mission, "a plan")
    _, track = only_track(mission, "a plan")
    home = track.points[0].tolist() if mission.home is None else mission.home
    cruise = None if track.speed is None else track.speed[np.isfinite(track.speed)]
    speed = float(cruise[0]) if cruise is not None and cruise.size else 1.0
    items = enumerate(mission_items(track, end=end), start=1)
    content = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": ARDUPILOT,
            "vehicleType": BOAT,
            "cruiseSpeed": speed,
            "hoverSpeed": speed,
            "globalPlanAltitudeMode": ABOVE_HOME,
            "plannedHomePosition": [*_degrees(home), 0],
            "items": [_item(number, item) for number, item in items],
        },
        "geoFence": {
            "version": 2,
            "polygons": [*_polygons(mission.geofences, True), *_polygons(mission.keep_outs, False)],
            "circles": [*_circles(mission.geofences, True), *_circles(mission.keep_outs, False)],
        },
        "rallyPoints": {"version": 2, "points": []},
    }
    write_atomically(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _item(number: int, item: Item) -> dict[str, Any]:
    """One item; altitudes only where there is a place."""
    simple: dict[str, Any] = {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": [*item.params, *_degrees((item.lat, item.lon)), 0],
    }
    if item.frame != MISSION:
        simple |= {"AltitudeMode": ABOVE_HOME, "Altitude": 0, "AMSLAltAboveTerrain": None}
    return simple


def _degrees(place: Iterable[float]) -> list[float]:
    return [round(value, DECIMALS) for value in place]


def _polygons(areas: tuple[Area, ...], inclusion: bool) -> list[dict[str, Any]]:
    return [
        {
            "version": 1,
            "inclusion": inclusion,
            "polygon": [_degrees(corner) for corner in area.points.tolist()],
        }
        for area in areas
        if area.radius is None
    ]


def _circles(areas: tuple[Area, ...], inclusion: bool) -> list[dict[str, Any]]:
    return [
        {
            "version": 1,
            "inclusion": inclusion,
            "circle": {"center": _degrees(area.points[0].tolist()), "radius": area.radius},
        }
        for area in areas
        if area.radius is not None
    ]
