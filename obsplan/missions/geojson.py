"""GeoJSON (RFC 7946): every line is a track, and every polygon that is named so a limit."""

import math
import re
import reprlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.missions.findings import Findings, Outline, Vertex, check_count, join_at_180, ring_area
from obsplan.missions.mission import Area, Mission, check_latlon, check_number
from obsplan.missions.source import read_json
from obsplan.types import ObsplanError

_ORDER = "exchange them, GeoJSON has [longitude, latitude]"
_GEOMETRIES = (
    "GeometryCollection",
    "LineString",
    "MultiLineString",
    "Point",
    "MultiPoint",
    "Polygon",
    "MultiPolygon",
)
_KINDS = ("FeatureCollection", "Feature", *_GEOMETRIES)
# properties with a value for each leg or vertex: the argument of a draft, and the vertices before
# the first value
_PER_VERTEX = {"speed_mps": ("speed", 1), "hold_s": ("hold", 0), "time_s": ("time", 0)}
_WGS84 = re.compile(r"(^|:)(CRS84h?|4326|4979|WGS ?84)$", re.IGNORECASE)


def read_geojson(path: Path | str) -> Mission:
    """Read the lines of a GeoJSON file, named by their features' `name`, and its limits.

    Limits are the polygons that are named so.

    A line that was cut at ±180 degrees is one track. Third coordinates are altitudes. Of the
    properties, `speed_mps` (a number, or one for each leg), `hold_s` and `time_s` (one for each
    vertex) are read, and `radius_m` makes a point a circle. Other points are passed over.

    Raises
    ------
    ObsplanError
        Not GeoJSON, not WGS 84, or a coordinate that is not one; names the place.
    """
    path = Path(path)
    found = Findings(path=path)
    for feature, where in _features(_content(path), str(path)):
        _read_feature(feature, where, found)
    return found.mission()


def read_lines(path: Path | str) -> list[Float[np.ndarray, "vertices 2"]]:
    """Read every line and every ring of a GeoJSON file: a coast, say, or contours of depth.

    Returns latitudes and longitudes [degrees, WGS 84] of each.

    Raises
    ------
    ObsplanError
        As `read_geojson`.
    """
    path = Path(path)
    found = []
    for feature, where in _features(_content(path), str(path)):
        _check_object(feature, where)
        for geometry, place in _geometries(feature.get("geometry"), where):
            for line, at in _lines(geometry, place):
                vertices = _items(line, "coordinates", at)
                places = [_position(v, f"{at}.coordinates[{i}]")[:2] for i, v in vertices]
                found.append(np.array(places).reshape(-1, 2))
    return found


def _content(path: Path) -> dict[str, Any]:
    """What a file holds, if that is GeoJSON."""
    content = read_json(path)
    if content.get("type") not in _KINDS:
        hint = "rename it to .plan" if content.get("fileType") == "Plan" else "export it as GeoJSON"
        raise ObsplanError(
            f'{path} is not GeoJSON ("type" is {reprlib.repr(content.get("type"))}): {hint}'
        )
    return content


def _lines(geometry: dict[str, Any], where: str) -> Iterator[tuple[dict[str, Any], str]]:
    """The lines and rings of a geometry; points have none."""
    match geometry["type"]:
        case "LineString":
            yield geometry, where
        case "MultiLineString" | "Polygon":
            yield from _parts(geometry, where)
        case "MultiPolygon":
            for polygon, place in _parts(geometry, where):
                yield from _parts(polygon, place)


def _features(node: Any, where: str) -> Iterator[tuple[dict[str, Any], str]]:
    """Walk collections down to the features, a bare geometry being one without properties."""
    _check_object(node, where)
    match node.get("type"):
        case "FeatureCollection":
            for i, feature in _items(node, "features", where):
                if feature is not None:
                    yield from _features(feature, f"{where}: features[{i}]")
        case "Feature":
            yield node, f"{where}.geometry"
        case _:
            yield {"geometry": node}, where


def _check_object(node: Any, where: str) -> None:
    """Refuse what is no object, and the projected coordinates of GeoJSON before RFC 7946."""
    if not isinstance(node, dict):
        raise ObsplanError(
            f"{where} must be a GeoJSON object, got {type(node).__name__}: export the file again"
        )
    if (crs := node.get("crs")) is not None:
        properties = crs.get("properties") if isinstance(crs, dict) else None
        properties = properties if isinstance(properties, dict) else {}
        name = str(properties.get("name", properties.get("code")))
        if not _WGS84.search(name):
            raise ObsplanError(
                f"{where}: crs {reprlib.repr(crs)} is not WGS 84: export it again in WGS 84 "
                "(EPSG:4326)"
            )


def _read_feature(feature: dict[str, Any], where: str, found: Findings) -> None:
    """Add the lines and the limits of a feature to the findings."""
    _check_object(feature, where)
    properties = feature.get("properties")
    properties = properties if isinstance(properties, dict) else {}
    told = {str(key).lower(): value for key, value in properties.items() if value is not None}
    name = str(told["name"]) if "name" in told else None
    texts = [str(told[key]) for key in ("kind", "type", "name", "description") if key in told]
    lines: list[list[Vertex]] = []
    for geometry, place in _geometries(feature.get("geometry"), where):
        match geometry["type"]:
            case "LineString":
                lines.append(_positions(geometry, place))
            case "MultiLineString":
                pieces = [_positions(piece, at) for piece, at in _parts(geometry, place)]
                lines += join_at_180(pieces)
            case "Polygon" | "MultiPolygon":
                parts, holes = _polygons(geometry, place)
                found.outlines.append(
                    Outline(name=name or "", texts=texts, parts=parts, holes=holes)
                )
            case "Point" if "radius_m" in told:
                circle = _circle(geometry, told["radius_m"], place)
                found.outlines.append(Outline(name=name or "", texts=texts, parts=[circle]))
            case "Point" | "MultiPoint":
                found.passed_over("point", "passed over: only lines are tracks", name)
            case kind:
                found.passed_over(
                    "shape", f"of unknown type {reprlib.repr(kind)} passed over", name
                )
    if feature.get("geometry") is None:
        found.passed_over("feature", "without geometry passed over", name)
    for line in lines:
        found.line(name, line, **_told_of_vertices(told, len(line), name, found))


def _geometries(node: Any, where: str) -> Iterator[tuple[dict[str, Any], str]]:
    """Walk a geometry down to the single ones."""
    if node is None:  # a feature without geometry
        return
    _check_object(node, where)
    if node.get("type") == "GeometryCollection":
        for i, geometry in _items(node, "geometries", where):
            yield from _geometries(geometry, f"{where}.geometries[{i}]")
    else:
        yield {"type": None, **node}, where


def _items(node: dict[str, Any], key: str, where: str) -> Iterator[tuple[int, Any]]:
    """Number the elements of a list that must be there."""
    if not isinstance(node.get(key), list):
        raise ObsplanError(
            f'{where} needs a list "{key}", got {type(node.get(key)).__name__}: '
            "export the file again"
        )
    return enumerate(node[key])


def _parts(node: dict[str, Any], where: str) -> Iterator[tuple[dict[str, Any], str]]:
    """The parts of a geometry of many, each with coordinates of its own."""
    for i, part in _items(node, "coordinates", where):
        yield {"coordinates": part}, f"{where}.coordinates[{i}]"


def _positions(node: dict[str, Any], where: str) -> list[Vertex]:
    """Vertices of a line or a ring."""
    positions = list(_items(node, "coordinates", where))
    check_count(len(positions), where)
    return [_position(position, f"{where}.coordinates[{i}]") for i, position in positions]


def _position(position: Any, where: str) -> Vertex:
    """Latitude and longitude [degrees] and altitude [m] of a GeoJSON position."""
    if not isinstance(position, list) or len(position) < 2:
        raise ObsplanError(
            f"{where} must be [longitude, latitude], got {reprlib.repr(position)}: correct it"
        )
    lon, lat = (check_number(value, f"{where}[{i}]") for i, value in enumerate(position[:2]))
    has_altitude = len(position) > 2 and position[2] is not None
    altitude = check_number(position[2], f"{where}[2]") if has_altitude else math.nan
    return (*check_latlon(lat, lon, where, _ORDER), altitude)


def _polygons(geometry: dict[str, Any], where: str) -> tuple[list[Area], list[Area]]:
    """Outer rings and holes of a polygon, or of many."""
    polygons = [(geometry, where)]
    if geometry["type"] == "MultiPolygon":
        polygons = list(_parts(geometry, where))
    outer: list[Area] = []
    holes: list[Area] = []
    for polygon, place in polygons:
        rings = [ring_area(_positions(ring, at)) for ring, at in _parts(polygon, place)]
        outer += rings[:1]
        holes += rings[1:]
    return outer, holes


def _circle(geometry: dict[str, Any], radius: Any, where: str) -> Area:
    """The circle of a point with a radius [m]."""
    lat, lon, _ = _position(geometry.get("coordinates"), f"{where}.coordinates")
    radius = check_number(radius, f"{where}: radius_m")
    if not radius > 0:
        raise ObsplanError(f"{where}: radius_m must be positive [m], got {radius}: correct it")
    return Area(points=np.array([[lat, lon]]), radius=radius)


def _told_of_vertices(
    told: dict[str, Any], count: int, name: str | None, found: Findings
) -> dict[str, list[float]]:
    """Speeds, holds and times that the properties give to a line of so many vertices."""
    values: dict[str, list[float]] = {}
    for key, (argument, before) in _PER_VERTEX.items():
        if key not in told:
            continue
        numbers = _numbers(told[key], count - before)
        if numbers is None:
            each = "leg" if before else "vertex"
            found.passed_over(
                "track",
                f"with {key} that is not a number of at least 0 for each {each}: passed over",
                name,
            )
        else:
            values[argument] = [math.nan] * before + numbers
    return values


def _numbers(given: Any, count: int) -> list[float] | None:
    """So many numbers of at least 0, null being nan; one number stands for all.

    None if it is something else.
    """
    values = given if isinstance(given, list) else [given] * count
    numbers = [math.nan if value is None else value for value in values]
    fits = all(type(number) in (int, float) and not number < 0 for number in numbers)
    if len(numbers) != count or not fits:
        return None
    return [float(number) if number < math.inf else math.nan for number in numbers]
