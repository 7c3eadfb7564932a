"""MOOS-IvP behaviour (`.bhv`) and mission (`.moos`) files: each list of points is a local track."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from obsplan.missions.findings import Findings, Outline, ring_area
from obsplan.missions.mission import Mission, read_number
from obsplan.missions.moos_points import MOST_VERTICES, pattern_of, read_points
from obsplan.missions.source import read_loose_text
from obsplan.types import ObsplanError

_OPENING = re.compile(r"(?:behavior|processconfig)\s*=\s*(\w+)", re.IGNORECASE)
_INSIDE = re.compile(r"(?<!\w)points?\s*=\s*([^\"#]*)", re.IGNORECASE)  # of another value
_SPEED = re.compile(r"(?<!\w)speed\s*=\s*([^,\"#]*)", re.IGNORECASE)
_LABEL = re.compile(r"(?<!\w)label\s*[=,]\s*([^,:\"#]*)", re.IGNORECASE)
# what a polygon is, and the keys that give it, by how the behaviour or the application starts
_LIMITS = {
    "bhv_opregion": ("geofence", ("polygon", "poly", "core_poly")),
    "bhv_avoidobstacle": ("keep-out", ("polygon", "poly")),
    "pobstaclemgr": ("keep-out", ("given_obstacle",)),
}


@dataclass(slots=True)
class _Block:
    """A behaviour, an application, or the rest: its lines `key = value`, numbered."""

    kind: str = ""
    lines: list[tuple[int, str, str]] = field(default_factory=list)

    def value(self, key: str) -> str | None:
        """Give the last value of a key, which is the one that counts."""
        return next((value for _, other, value in reversed(self.lines) if other == key), None)


def read_moos(path: Path | str) -> Mission:
    """Read the points of behaviours, named by `name`, at their `speed`, and the limits.

    Points are `x,y : x,y`, `pts={x,y:x,y}` or `format=lawnmower, ...`, the values of `points`,
    `point` and a waypoint behaviour's `polygon`, or inside another value
    (`SURVEY_UPDATES = points = ...`). `order` and `repeat` are followed. The polygon of a
    BHV_OpRegion is a geofence; those of BHV_AvoidObstacle and `given_obstacle` are keep-outs.

    Raises
    ------
    ObsplanError
        Points or a limit that cannot be read; names the line.
    """
    path = Path(path)
    text, remarks = read_loose_text(path)
    found = Findings(path=path, geographic=False, remarks=remarks)
    if text.count("\n") > MOST_VERTICES:
        raise ObsplanError(f"{path} has more than {MOST_VERTICES} lines: give the behaviours alone")
    for block in _blocks(text, found):
        limits = _read_limits(block, found)
        tracks = _read_tracks(block, found)
        if block.kind.lower().startswith("bhv_") and not limits + tracks:
            name = f"{block.value('name') or ''} ({block.kind})".strip()
            found.passed_over("behaviour", "without points passed over", name)
    return found.mission()


def _blocks(text: str, found: Findings) -> Iterator[_Block]:
    """Split a file into its blocks, without comments after //; what stands outside comes last."""
    outside = block = _Block()
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.partition("//")[0].strip()
        if line.startswith("#"):
            why = "of the preprocessor passed over: expand the file with nsplug"
            found.passed_over("line", why, line)
        elif opening := _OPENING.match(line):
            block = _Block(opening[1])
        elif line.startswith("}"):
            if block is not outside:
                yield block
            block = outside
        elif "=" in line:
            key, _, value = line.partition("=")
            block.lines.append((number, key.strip().lower(), value.strip()))
    if block is not outside:
        found.remarks.append("the file ends within a block { ... }: it may be cut short")
        yield block
    _tell_origin(outside, found)
    yield outside


def _tell_origin(outside: _Block, found: Findings) -> None:
    """Say where on Earth the local metres are, where the file says it."""
    lat, lon = outside.value("latorigin"), outside.value("longorigin")
    if lat and lon:
        where = f"{found.path}: LatOrigin, LongOrigin"
        place = f"lat = {read_number(lat, where)}, lon = {read_number(lon, where)}"
        found.remarks.append(
            f"the origin of the file is at {place}: put it in the scenario's origin"
        )


def _read_limits(block: _Block, found: Findings) -> int:
    """Add the limits of a block; return how many."""
    kind = block.kind.lower()
    limit, keys = next(
        (meaning for start, meaning in _LIMITS.items() if kind.startswith(start)), ("", ())
    )
    polygons = [(number, value) for number, key, value in block.lines if key in keys]
    for number, value in polygons:
        where = f"{found.path}: line {number}"
        corners = read_points(value, where)
        if corners is None:
            raise ObsplanError(
                f"{where} has a {limit} in a form that is not read ({pattern_of(value)}): write "
                "its corners as pts={x,y:x,y}"
            )
        label = _LABEL.search(value)
        name = label[1].strip() if label else block.value("name") or ""
        found.outlines.append(Outline(name=name, texts=[limit], parts=[ring_area(corners)]))
    return len(polygons)


def _read_tracks(block: _Block, found: Findings) -> int:
    """Add the tracks of a block; return how many points it has been told to follow."""
    keys = ("points", "point")
    if block.kind.lower().startswith("bhv_waypoint"):
        keys += ("polygon",)
    told = [(number, value) for number, key, value in block.lines if key in keys]
    if block.kind and len(told) > 1:
        why = "replaced by later ones of the same behaviour: passed over"
        for _ in told[:-1]:
            found.passed_over("list of points", why, block.value("name"))
        told = told[-1:]
    for number, value in told:
        _read_track(number, value, block.value("speed"), block, found)
    inside = [
        (number, points[1], _SPEED.search(value))
        for number, key, value in block.lines
        if key not in keys and (points := _INSIDE.search(value))
    ]
    for number, points, speed in inside:
        _read_track(number, points, speed and speed[1], block, found)
    return len(told) + len(inside)


def _read_track(number: int, value: str, speed: str | None, block: _Block, found: Findings) -> None:
    """Add the track of a list of points, in the order and as often as the behaviour follows it."""
    where = f"{found.path}: line {number}"
    label = _LABEL.search(value)
    name = block.value("name") or (label[1].strip() if label else None)
    vertices = read_points(value, where)
    if vertices is None:
        why = f"in a form that is not read ({pattern_of(value)}) passed over: write its points out"
        found.passed_over("track", why, name)
        return
    if any(not math.isnan(vertex[2]) for vertex in vertices):
        why = "with points that have a z passed over: MOOS-IvP follows x and y alone"
        found.passed_over("track", why, name)
    vertices = [(x, y, math.nan) for x, y, _ in vertices]
    if (block.value("order") or "").lower().startswith("reverse"):
        vertices.reverse()
    vertices *= _rounds(block, name, len(vertices), found)
    speeds = None
    if speed and "(" in speed:
        found.passed_over("speed", "with a placeholder passed over: expand the file with nsplug")
    elif speed:
        speeds = [read_number(speed, f"{where}: its speed")] * len(vertices)
    found.line(name, vertices, speed=speeds)


def _rounds(block: _Block, name: str | None, count: int, found: Findings) -> int:
    """How often a behaviour goes through so many points: once, and as often as `repeat` says."""
    text = (block.value("repeat") or "0").lower()
    times = int(text) if text.isdecimal() and len(text) < 10 else MOST_VERTICES
    if text.strip() == "0" or count < 2:
        return 1
    if (times + 1) * count > MOST_VERTICES:
        found.passed_over("track", f"with repeat = {text[:20]!r}: followed once", name)
        return 1
    found.passed_over("track", f"with repeat = {times}: followed {times + 1} times", name)
    return times + 1
