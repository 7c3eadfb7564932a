"""QGroundControl plans (`.plan`): the positions a vehicle would pass, as one track."""

import reprlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from obsplan.missions.mission import Draft, Mission, Point, check_latlon, check_number, named_tracks
from obsplan.missions.source import read_json
from obsplan.types import ObsplanError

# MAV_CMD numbers of the MAVLink common message set
_NAVIGATION = {
    16: "waypoint",
    17: "loiter",
    18: "loiter turns",
    19: "loiter time",
    21: "land",
    22: "take-off",
    82: "spline waypoint",
}
_JUMP = 177
_GLOBAL_FRAMES = (
    0,
    3,
    5,
    6,
    10,
    11,
)  # MAV_FRAME_GLOBAL and its relatives, which differ in altitude only
_ORDER = "QGroundControl has latitude in params[4], longitude in params[5]"


def read_plan(path: Path | str) -> Mission:
    """Read the waypoints of a QGroundControl plan: simple items, and surveys and corridors by the path stored in them.

    A navigation item at latitude and longitude 0 (or none) means "here" and is passed over, as are cameras, speeds and other actions.

    Raises
    ------
    ObsplanError
        Not a plan, no waypoint inside, a local frame, a jump, a pattern without a stored path, or a bad coordinate; names the item.
    """
    path = Path(path)
    content = read_json(path)
    if content.get("fileType") != "Plan":
        hint = (
            "rename it to .geojson"
            if "features" in content or "coordinates" in content
            else "save it from QGroundControl's Plan view"
        )
        raise ObsplanError(
            f'{path} is not a QGroundControl plan ("fileType" is {reprlib.repr(content.get("fileType"))}): {hint}'
        )
    mission = content.get("mission")
    items = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(mission, dict) or not isinstance(items, list):
        raise ObsplanError(
            f"{path} has no list mission.items: save it again from QGroundControl's Plan view"
        )
    points = list(_positions(items, f"{path}: mission.items"))
    if not points:
        raise ObsplanError(
            f"{path}: mission.items holds no waypoint: add the survey's waypoints in QGroundControl"
        )
    tracks, remarks = named_tracks(path, [Draft(points=points)], geographic=True)
    return Mission(tracks=tracks, geographic=True, home=_home(mission, path), remarks=remarks)


def _home(mission: dict[str, Any], path: Path) -> Point | None:
    """Planned home position, where there is one."""
    home = mission.get("plannedHomePosition")
    return None if home is None else _pair(home, f"{path}: mission.plannedHomePosition")


def _positions(items: list[Any], where: str) -> Iterator[Point]:
    """Positions of simple and complex items, in order."""
    for i, item in enumerate(items):
        place = f"{where}[{i}]"
        if not isinstance(item, dict):
            raise ObsplanError(
                f"{place} must be an object, got {type(item).__name__}: save the plan again"
            )
        if item.get("type") == "ComplexItem":
            yield from _pattern(item, place)
        elif item.get("type") == "SimpleItem":
            yield from _simple(item, place)
        else:
            raise ObsplanError(
                f'{place}.type must be "SimpleItem" or "ComplexItem", got {reprlib.repr(item.get("type"))}: save the plan again'
            )


def _simple(item: dict[str, Any], where: str) -> Iterator[Point]:
    """Position of a navigation item; none for an action."""
    command = item.get("command")
    if command == _JUMP:
        raise ObsplanError(
            f"{where} is a jump (command {_JUMP}), which repeats waypoints: write the repeated waypoints out"
        )
    if not isinstance(command, int) or command not in _NAVIGATION:
        return
    if item.get("frame", _GLOBAL_FRAMES[0]) not in _GLOBAL_FRAMES:
        frame = reprlib.repr(item["frame"])
        raise ObsplanError(
            f"{where}.frame must be global (one of {_GLOBAL_FRAMES}), got {frame}: give the waypoint in latitude and longitude"
        )
    position, place = _stored_position(item, where)
    if position in ([0, 0], [None, None]):  # MAVLink: at the present position
        return
    yield _pair(position, place)


def _stored_position(item: dict[str, Any], where: str) -> tuple[list[Any], str]:
    """Latitude and longitude as stored, and where: in `params`, or in the `coordinate` of early versions."""
    for key, first in (("params", 4), ("coordinate", 0)):
        values = item.get(key)
        if isinstance(values, list) and len(values) >= first + 2:
            return values[first : first + 2], f"{where}.{key}[{first}:{first + 2}]"
    raise ObsplanError(
        f"{where}.params must be a list of seven numbers, got {reprlib.repr(item.get('params'))}: save the plan again"
    )


def _pattern(item: dict[str, Any], where: str) -> Iterator[Point]:
    """Path stored in a survey or a corridor scan: its flight items, else the points drawn on the map."""
    transects = item.get("TransectStyleComplexItem", item)
    if isinstance(transects, dict):
        place = f"{where}.TransectStyleComplexItem"
        points = (
            list(_positions(transects["Items"], f"{place}.Items"))
            if isinstance(transects.get("Items"), list)
            else []
        )
        drawn = transects.get("VisualTransectPoints")
        if not points and isinstance(drawn, list):
            points = [
                _pair(point, f"{place}.VisualTransectPoints[{i}]") for i, point in enumerate(drawn)
            ]
        if points:
            yield from points
            return
    kind = reprlib.repr(item.get("complexItemType"))
    raise ObsplanError(
        f"{where} is a pattern ({kind}) with no path stored in the file: replace it by a survey, a corridor or waypoints"
    )


def _pair(values: Any, where: str) -> Point:
    """Latitude and longitude [degrees] at the start of a list."""
    if not isinstance(values, list) or len(values) < 2:
        raise ObsplanError(
            f"{where} must be [latitude, longitude], got {reprlib.repr(values)}: correct it"
        )
    lat, lon = (check_number(value, where) for value in values[:2])
    return check_latlon(lat, lon, where, _ORDER)
