"""The strings of MOOS-IvP that stand for points: lists, lawnmowers and polygons around a centre.

What they mean is MOOS-IvP's own (https://oceanai.mit.edu/ivpman; string2SegList and string2Poly of
its lib_geometry), its rounding included, so that a track is what the vehicle would follow.
"""

import math
import re
from collections.abc import Iterator

from obsplan.missions.findings import Vertex, check_count
from obsplan.missions.mission import Point, check_local, read_number
from obsplan.types import ObsplanError

MOST_VERTICES = 20_000  # of one track, lanes and rounds written out
_NEARLY_ONE = 0.99999  # MOOS-IvP rounds the number of lanes up, but for rounding errors
_SNAP = 1e-5  # [m]; it rounds the vertices of a lawnmower to this, unless told otherwise
_FINEST = 1e-9  # [m]
_DRAWING = (
    *("label", "label_color", "color", "edge_color", "edge_size", "vertex_color", "vertex_size"),
    *("source", "type", "active", "msg", "time", "duration", "id"),
)
_LIST = re.compile(r"(?<!\w)pts\s*=\s*[{\"]([^}\"]*)")
_PLACEHOLDER = re.compile(r"[$%]\(")
_FORMAT = re.compile(r"(?<!\w)format\s*=\s*([a-z]+)", re.IGNORECASE)
_PREFIX = re.compile(r"^[\s\"]*([a-z]+)\s*:+", re.IGNORECASE)  # lawnmower: ..., radial:: ...


def pattern_of(text: str) -> str:
    """Name the form of a string of points: `lawnmower`, `radial`, ...; empty for a plain list."""
    if _PLACEHOLDER.search(text):
        return "placeholder of nsplug"
    if _LIST.search(text):
        return ""
    told = _FORMAT.search(text) or _PREFIX.match(text)
    pattern = told[1].lower() if told else ""
    return "" if pattern in ("pts", "points") else pattern


def read_points(text: str, where: str) -> list[Vertex] | None:
    """Vertices x, y [m] and z, nan where not said, of a string of points.

    None if it is a pattern that is not read.

    Raises
    ------
    ObsplanError
        Not points; names the place.
    """
    match pattern_of(text):
        case "":
            return _read_list(text, where)
        case "lawnmower":
            return _lawnmower(_parameters(text), where)
        case "radial":
            return _radial(_parameters(text), where)
    return None


def _read_list(text: str, where: str) -> list[Vertex]:
    """Vertices (x, y, z or nan) of `x,y : x,y`, with or without `pts={}` and labels."""
    inner = _LIST.search(text)
    listed = inner[1] if inner else _PREFIX.sub("", text, count=1).strip('" ')
    check_count(listed.count(":") + 1, where)
    vertices: list[Vertex] = []
    for token in listed.split(":"):
        x, _, rest = (part.strip() for part in token.partition(","))
        if not token.strip() or x.lower() in _DRAWING:  # label,survey : 0,0 : 10,0
            continue
        y, _, rest = (part.strip() for part in rest.partition(","))
        z = rest.partition(",")[0]
        place = f"{where}, point {len(vertices) + 1},"
        point = check_local(read_number(x, f"{place} x"), read_number(y, f"{place} y"), place)
        has_z = z and not z[0].isalpha()  # else a property of the point
        vertices.append((*point, read_number(z, f"{place} z") if has_z else math.nan))
    return vertices


def _parameters(text: str) -> dict[str, str]:
    """Parameters `key = value`, separated by commas, of a pattern."""
    pairs = (part.partition("=") for part in _PREFIX.sub("", text, count=1).strip('" ').split(","))
    return {key.strip().lower(): value.strip() for key, _, value in pairs}


def _number(
    given: dict[str, str], key: str, where: str, *, positive: bool = False, default: str = ""
) -> float:
    """A number that a pattern must have, unless there is a default."""
    number = read_number(given.get(key, default), f"{where}: {key}")
    if positive and not number > 0:
        raise ObsplanError(f"{where}: {key} must be positive, got {number}: correct it")
    return number


def _lawnmower(given: dict[str, str], where: str) -> list[Vertex]:
    """Vertices of parallel lanes over a rectangle about x, y, from the corner nearest to the start.

    The rectangle, of a width from west to east and a height from south to north, is turned
    clockwise by degs.
    """
    center = _number(given, "x", where), _number(given, "y", where)
    across = _number(given, "width", where, positive=True)
    along = _number(given, "height", where, positive=True)
    key = "lane_width" if "lane_width" in given else "swath"
    spacing = _number(given, key, where, positive=True)
    turn = _number(given, "degs", where, default="0")
    if given.get("rows", "").lower() not in ("ns", "north-south"):
        across, along, turn = along, across, turn + 90.0
    if turn != 0 and turn < 1:
        raise ObsplanError(
            f"{where}: degs turns the lanes to heading {turn}, and MOOS-IvP takes none below 1 "
            "degree: add 360"
        )
    if across / spacing > MOST_VERTICES / 2:
        raise ObsplanError(
            f"{where}: {key} {spacing} makes over {MOST_VERTICES} vertices: widen it"
        )
    lanes = _lanes(center, across=across, along=along, heading=math.radians(turn), spacing=spacing)
    start = [_number(given, key, where, default="0") for key in ("startx", "starty")]
    step = _number(given, "snap", where, default=str(_SNAP))
    return [_vertex(point, step, where) for point in _from_corner(lanes, start)]


def _lanes(
    center: Point, *, across: float, along: float, heading: float, spacing: float
) -> list[list[Point]]:
    """Both ends of parallel lanes, heading clockwise from north [rad].

    The first lies half the width to the left. The last lies on the right side, or beyond it where
    the spacing does not divide the width.
    """
    east, north = math.sin(heading), math.cos(heading)
    lanes: list[list[Point]] = []
    for i in range(math.trunc(across / spacing + 1 + _NEARLY_ONE)):
        right = i * spacing - across / 2
        middle = center[0] + right * north, center[1] - right * east
        halves = (along / 2, -along / 2)
        lanes.append([(middle[0] + half * east, middle[1] + half * north) for half in halves])
    return lanes


def _from_corner(lanes: list[list[Point]], start: list[float]) -> Iterator[Point]:
    """Ends of lanes back and forth, from the outer end that is nearest to the start."""
    corners = [(lane, end) for lane in (0, -1) for end in (0, 1)]
    away = {corner: math.dist(start, lanes[corner[0]][corner[1]]) for corner in corners}
    least = min(away.values()) + _SNAP  # of those equally near, the first
    first, end = next(corner for corner in corners if away[corner] <= least)
    for i, lane in enumerate(lanes if first == 0 else reversed(lanes)):
        yield from lane if (i + end) % 2 == 0 else reversed(lane)


def _radial(given: dict[str, str], where: str) -> list[Vertex]:
    """Corners of a regular polygon about x, y, the first half a corner clockwise from north."""
    x, y = _number(given, "x", where), _number(given, "y", where)
    radius = _number(given, "radius", where, positive=True)
    count = _number(given, "pts", where, positive=True)
    if not 3 <= count <= MOST_VERTICES:
        raise ObsplanError(f"{where}: pts must be 3 to {MOST_VERTICES}, got {count}: correct it")
    step = _number(given, "snap", where, default="0")
    headings = (2 * math.pi * (i + 0.5) / int(count) for i in range(int(count)))
    corners = ((x + radius * math.sin(h), y + radius * math.cos(h)) for h in headings)
    return [_vertex(corner, step, where) for corner in corners]


def _vertex(point: tuple[float, float], step: float, where: str) -> Vertex:
    """A point, rounded to a step [m] unless that is 0, or as good as 0."""
    x, y = check_local(*point, where)
    if step >= _FINEST:
        x, y = check_local(round(x / step) * step, round(y / step) * step, where)
    return x, y, math.nan
