"""Well-known text (WKT) in a table: lines and successive points are tracks, polygons areas."""

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from obsplan.missions.findings import Findings, Outline, Vertex, check_count, join_at_180, ring_area
from obsplan.missions.mission import check_latlon, check_local, check_number
from obsplan.missions.tables.guess import looks_like_degrees
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

_SRID = re.compile(r"\s*SRID=(\d+);", re.IGNORECASE)
_WGS84 = ("4326", "4979")
_WKT = re.compile(
    r"(\s*SRID=\d+;)?\s*(MULTI)?(POINT|LINESTRING|LINEARRING|POLYGON|GEOMETRYCOLLECTION)",
    re.IGNORECASE,
)
_ORDER = "exchange them, WKT has longitude latitude"


def is_wkt(text: str) -> bool:
    """Whether a text starts as WKT does."""
    return _WKT.match(text) is not None


def parse_wkt(text: str, where: str) -> "BaseGeometry":
    """Parse WKT, or WKT after its `SRID=4326;`.

    Raises
    ------
    ObsplanError
        Not WKT, or of another reference system; names the place.
    """
    import shapely

    srid = _SRID.match(text)
    if srid and srid[1] not in _WGS84:
        raise ObsplanError(
            f"{where} is in EPSG:{srid[1][:10]}, not WGS 84: export it again in WGS 84 (EPSG:4326)"
        )
    try:
        # numbers beyond floats are refused as not finite
        with np.errstate(over="ignore", invalid="ignore"):
            return shapely.from_wkt(text[srid.end() :] if srid else text)
    except shapely.GEOSException as error:
        raise ObsplanError(f"{where} is no WKT, got {text[:40]!r}: correct it") from error


def are_degrees(geometries: Sequence["BaseGeometry"], cells: Sequence[str]) -> bool:
    """Whether geometries say that they are in degrees, or look so."""
    import shapely

    points = shapely.get_coordinates(geometries)
    points = points[np.isfinite(points).all(axis=1)]
    return any(map(_SRID.match, cells)) or (len(points) > 0 and looks_like_degrees(points))


def point_of(geometry: "BaseGeometry", where: str, *, geographic: bool) -> Vertex | None:
    """The vertex that a geometry is, if it is a point."""
    if geometry.geom_type != "Point" or geometry.is_empty:
        return None
    return _vertices(geometry, where, geographic=geographic)[0]


def read_geometry(
    geometry: "BaseGeometry", name: str, texts: Sequence[str], where: str, found: Findings
) -> None:
    """Add the lines and the areas of a geometry that is no point."""
    import shapely

    parts = list(shapely.get_parts(geometry))
    if geometry.geom_type == "GeometryCollection":
        for part in parts:
            read_geometry(part, name, texts, where, found)
        return
    if geometry.is_empty:
        found.passed_over("empty shape", "passed over", name)
    elif "Line" in geometry.geom_type:
        lines = [_vertices(part, where, geographic=found.geographic) for part in parts]
        for line in join_at_180(lines) if found.geographic else lines:
            found.line(name, line)
    elif "Polygon" in geometry.geom_type:
        outer = [part.exterior for part in parts]
        holes = [ring for part in parts for ring in part.interiors]
        outline = Outline(
            name=name,
            texts=texts,
            parts=[ring_area(_vertices(r, where, geographic=found.geographic)) for r in outer],
            holes=[ring_area(_vertices(r, where, geographic=found.geographic)) for r in holes],
        )
        found.outlines.append(outline)
    else:
        kind = geometry.geom_type.lower()
        found.passed_over(kind, "passed over: only lines are tracks", name)


def _vertices(geometry: "BaseGeometry", where: str, *, geographic: bool) -> list[Vertex]:
    """Vertices of a point, a line or a ring."""
    import shapely

    check_count(int(shapely.get_num_coordinates(geometry)), where)
    vertices: list[Vertex] = []
    for x, y, z in shapely.get_coordinates(geometry, include_z=True).tolist():
        x, y = check_number(x, where), check_number(y, where)
        point = check_latlon(y, x, where, _ORDER) if geographic else check_local(x, y, where)
        vertices.append((*point, z if math.isfinite(z) else math.nan))
    return vertices
