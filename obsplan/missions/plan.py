"""QGroundControl plans (`.plan`): a mission, its fence and its rally points."""

import math
import reprlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from obsplan.missions.mavlink import build_mission
from obsplan.missions.mavlink.commands import FLOWN, LARGEST, Command
from obsplan.missions.mavlink.fences import Fences
from obsplan.missions.mavlink.items import NO_HOME, Item, collect, is_blank, whole_number
from obsplan.missions.mavlink.notes import counted
from obsplan.missions.mission import Mission, Point, check_latlon, check_number
from obsplan.missions.source import read_json
from obsplan.types import ObsplanError

_GLOBAL_RELATIVE_ALT = 3  # MAV_FRAME, where an item has none
_PARAMETERS = 7
_LONGEST_NAME = 40  # letters of a pattern's name in a sentence
# [m/s]; a cruise speed from here on is not that of an AUV: QGroundControl writes 15 m/s, and a
# hover speed of 5 m/s, into every plan
_AIRCRAFT = 5.0


def read_plan(path: Path | str) -> Mission:
    """Read a QGroundControl plan: items as a vehicle would follow them, fences as limits.

    Surveys and corridor scans are flown by the path that is stored in them; patterns without one
    are passed over, and so is a cruise speed of 5 m/s or more, QGroundControl's placeholder.

    Raises
    ------
    ObsplanError
        Not a plan, or a value that is not what it should be; names the item.
    """
    path = Path(path)
    content = read_json(path)
    if content.get("fileType") != "Plan":
        hint = (
            "rename it to .geojson"
            if "features" in content or "coordinates" in content
            else "save it from QGroundControl's Plan view"
        )
        kind = reprlib.repr(content.get("fileType"))
        raise ObsplanError(f'{path} is not a QGroundControl plan ("fileType" is {kind}): {hint}')
    mission = content.get("mission")
    nodes = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(mission, dict) or not isinstance(nodes, list):
        raise ObsplanError(
            f"{path} has no list mission.items: save it again from QGroundControl's Plan view"
        )
    patterns: Counter[str] = Counter()
    items = collect(_items(path, nodes, "mission.items", patterns), path)
    home, no_home = _home(path, mission)
    cruise, no_cruise = _cruise(path, mission)
    plan = build_mission(
        path,
        items,
        home=home,
        cruise=cruise,
        fences=_fences(path, content),
        remarks=_without_path(patterns),
    )
    return replace(
        plan, remarks=(*plan.remarks, *_rally_points(path, content), *no_home, *no_cruise)
    )


def _items(path: Path, nodes: list[Any], where: str, patterns: Counter[str]) -> Iterator[Item]:
    """Items in order, those stored in patterns as well; patterns without any are counted."""
    for i, node in enumerate(nodes):
        place = f"{where}[{i}]"
        if not isinstance(node, dict):
            raise ObsplanError(
                f"{path}: {place} must be an object, got {type(node).__name__}: save the plan again"
            )
        if node.get("type") == "SimpleItem":
            yield _item(path, node, place)
        elif node.get("type") == "ComplexItem":
            stored = _stored(path, node, place, patterns)
            if not stored:
                patterns[_kind(node)] += 1
            yield from stored
        else:
            kind = reprlib.repr(node.get("type"))
            raise ObsplanError(
                f'{path}: {place}.type must be "SimpleItem" or "ComplexItem", got {kind}: '
                "save the plan again"
            )


def _item(path: Path, node: dict[str, Any], place: str) -> Item:
    """A simple item; its place stands in `params`, or in the `coordinate` of early versions."""
    params, coordinate = node.get("params"), node.get("coordinate")
    values = list(params[:_PARAMETERS]) if isinstance(params, list) else []
    command = whole_number(node.get("command"), f"{path}: {place}.command", LARGEST)
    if command in FLOWN and len(values) < 6 and not isinstance(coordinate, list):
        got = reprlib.repr(params)
        raise ObsplanError(
            f"{path}: {place}.params must be a list of seven numbers, got {got}: save the plan "
            "again"
        )
    values += [None] * (_PARAMETERS - len(values))
    if isinstance(coordinate, list) and all(is_blank(v) or v == 0 for v in values[4:6]):
        values[4:] = (coordinate + [None] * 3)[:3]
    number = node.get("doJumpId")
    numbered = type(number) is int and 0 <= number <= LARGEST
    return Item(
        path=path,
        place=place,
        command=command,
        frame=node.get("frame", _GLOBAL_RELATIVE_ALT),
        values=tuple(values),
        number=number if numbered else None,
    )


def _stored(path: Path, node: dict[str, Any], place: str, patterns: Counter[str]) -> list[Item]:
    """Items of a survey or a corridor scan: those it flies, else the points drawn on the map."""
    transects = node.get("TransectStyleComplexItem", node)
    if not isinstance(transects, dict):
        return []
    place = f"{place}.TransectStyleComplexItem"
    nodes, drawn = transects.get("Items"), transects.get("VisualTransectPoints")
    if isinstance(nodes, list):
        items = list(_items(path, nodes, f"{place}.Items", patterns))
        if any(item.command in FLOWN for item in items):
            return items
    if not isinstance(drawn, list):
        return []
    place = f"{place}.VisualTransectPoints"
    return [_waypoint(path, point, f"{place}[{i}]") for i, point in enumerate(drawn)]


def _waypoint(path: Path, point: Any, place: str) -> Item:
    """A point drawn on the map, as a waypoint."""
    lat, lon = _pair(point, f"{path}: {place}")
    return Item(
        path=path,
        place=place,
        command=Command.NAV_WAYPOINT,
        frame=_GLOBAL_RELATIVE_ALT,
        values=(None, None, None, None, lat, lon, None),
    )


def _kind(node: dict[str, Any]) -> str:
    """Name of a pattern, as it may be printed."""
    kind = node.get("complexItemType")
    if isinstance(kind, str) and kind.isidentifier() and len(kind) <= _LONGEST_NAME:
        return kind
    return reprlib.repr(kind)


def _without_path(patterns: Counter[str]) -> list[str]:
    """Name the patterns that hold no path."""
    if not patterns:
        return []
    return [f"patterns with no path stored in the file, passed over: {counted(patterns)}"]


def _home(path: Path, mission: dict[str, Any]) -> tuple[Point | None, list[str]]:
    """Planned home position; none if it is a placeholder."""
    stored = mission.get("plannedHomePosition")
    empty = isinstance(stored, list) and all(is_blank(value) for value in stored[:2])
    if stored is None or empty:
        return None, [NO_HOME]
    home = _pair(stored, f"{path}: mission.plannedHomePosition")
    return (home, []) if home != (0.0, 0.0) else (None, [NO_HOME])


def _cruise(path: Path, mission: dict[str, Any]) -> tuple[float, list[str]]:
    """Speed [m/s] until another is commanded; nan if it is not that of an AUV."""
    stored = mission.get("cruiseSpeed")
    if is_blank(stored):
        return math.nan, []
    speed = check_number(stored, f"{path}: mission.cruiseSpeed")
    if 0 < speed < _AIRCRAFT:
        return speed, []
    remark = (
        f"cruise speed {speed:g} m/s is not that of an AUV (below {_AIRCRAFT:g} m/s) but "
        "QGroundControl's placeholder or an aircraft's: passed over"
    )
    return math.nan, [remark]


def _fences(path: Path, content: dict[str, Any]) -> Fences:
    """Polygons and circles of the fence; early versions have one polygon, not to be left."""
    fences = Fences()
    fence = _part(path, content, "geoFence")
    for place, node in _nodes(path, fence, "polygons"):
        where = f"{path}: {place}"
        corners = _pairs(node.get("polygon"), f"{where}.polygon")
        fences.add_polygon(corners, where, inclusion=_inclusion(node, where))
    for place, node in _nodes(path, fence, "circles"):
        where = f"{path}: {place}.circle"
        circle = node.get("circle")
        if not isinstance(circle, dict):
            got = type(circle).__name__
            raise ObsplanError(f"{where} must be an object, got {got}: save the plan again")
        centre = _pair(circle.get("center"), f"{where}.center")
        radius = check_number(circle.get("radius"), f"{where}.radius")
        fences.add_circle(centre, radius, where, inclusion=_inclusion(node, f"{path}: {place}"))
    if fence.get("polygon"):
        where = f"{path}: geoFence.polygon"
        fences.add_polygon(_pairs(fence["polygon"], where), where, inclusion=True)
    if fence.get("breachReturn"):
        fences.remarks.append("place to return to from behind the fence: passed over")
    return fences


def _rally_points(path: Path, content: dict[str, Any]) -> list[str]:
    """Say how many rally points there are."""
    points = _part(path, content, "rallyPoints").get("points")
    if not isinstance(points, list) or not points:
        return []
    return [f"rally points, passed over: {len(points)}"]


def _part(path: Path, content: dict[str, Any], key: str) -> dict[str, Any]:
    """An object that may be missing."""
    part = content.get(key) or {}
    if not isinstance(part, dict):
        got = type(part).__name__
        raise ObsplanError(f"{path}: {key} must be an object, got {got}: save the plan again")
    return part


def _nodes(path: Path, fence: dict[str, Any], key: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Objects in a list of the fence that may be missing, each with its place."""
    nodes = fence.get(key) or []
    place = f"geoFence.{key}"
    if not isinstance(nodes, list):
        got = type(nodes).__name__
        raise ObsplanError(f"{path}: {place} must be a list, got {got}: save the plan again")
    for i, node in enumerate(nodes):
        if not isinstance(node, dict):
            got = type(node).__name__
            raise ObsplanError(
                f"{path}: {place}[{i}] must be an object, got {got}: save the plan again"
            )
        yield f"{place}[{i}]", node


def _inclusion(node: dict[str, Any], where: str) -> bool:
    """Whether an area is not to be left; else it is not to be entered."""
    inclusion = node.get("inclusion")
    if not isinstance(inclusion, bool):
        got = reprlib.repr(inclusion)
        raise ObsplanError(
            f"{where}.inclusion must be true or false, got {got}: save the plan again"
        )
    return inclusion


def _pairs(values: Any, where: str) -> list[Point]:
    """Places in a list."""
    if not isinstance(values, list):
        got = reprlib.repr(values)
        raise ObsplanError(
            f"{where} must be a list of [latitude, longitude], got {got}: correct it"
        )
    return [_pair(value, f"{where}[{i}]") for i, value in enumerate(values)]


def _pair(values: Any, where: str) -> Point:
    """Latitude and longitude [degrees] at the start of a list."""
    if not isinstance(values, list) or len(values) < 2:
        raise ObsplanError(
            f"{where} must be [latitude, longitude], got {reprlib.repr(values)}: correct it"
        )
    lat, lon = (check_number(value, where) for value in values[:2])
    return check_latlon(lat, lon, where, "exchange them, latitude comes first")
