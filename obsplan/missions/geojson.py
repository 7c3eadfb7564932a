"""GeoJSON (RFC 7946): every LineString is a track."""

import json
import reprlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from obsplan.files import write_atomically
from obsplan.missions.mission import Draft, Mission, Point, check_latlon, check_number, named_tracks
from obsplan.missions.source import read_json
from obsplan.types import ObsplanError

_DECIMALS = 9  # of a degree: 0.1 mm
_ORDER = "GeoJSON has [longitude, latitude]"
_KINDS = (
    "FeatureCollection",
    "Feature",
    "GeometryCollection",
    "LineString",
    "MultiLineString",
    "Point",
    "MultiPoint",
    "Polygon",
    "MultiPolygon",
)


def read_geojson(path: Path | str) -> Mission:
    """Read the lines of a GeoJSON file, named by their features' `name`; points and polygons are passed over.

    Raises
    ------
    ObsplanError
        Not GeoJSON, not WGS 84, no line inside, or a coordinate that is not one; names the place.
    """
    path = Path(path)
    content = read_json(path)
    if content.get("type") not in _KINDS:
        hint = "rename it to .plan" if content.get("fileType") == "Plan" else "export it as GeoJSON"
        raise ObsplanError(
            f'{path} is not GeoJSON ("type" is {reprlib.repr(content.get("type"))}): {hint}'
        )
    _check_crs(path, content)
    drafts = (Draft(name=name, points=points) for name, points in _lines(content, str(path), None))
    tracks, remarks = named_tracks(path, drafts, geographic=True)
    return Mission(tracks=tracks, geographic=True, remarks=remarks)


def _check_crs(path: Path, content: dict[str, Any]) -> None:
    """Refuse the projected coordinates that GeoJSON before RFC 7946 could hold."""
    if (crs := content.get("crs")) is not None:
        properties = crs.get("properties") if isinstance(crs, dict) else None
        name = str(properties.get("name")) if isinstance(properties, dict) else ""
        if not name.endswith(("CRS84", ":4326")):
            raise ObsplanError(
                f"{path}: crs {reprlib.repr(crs)} is not WGS 84: export it again in WGS 84 (EPSG:4326)"
            )


def _lines(node: Any, where: str, name: str | None) -> Iterator[tuple[str | None, list[Point]]]:
    """Walk features and geometries, down to the lines."""
    if node is None:  # a feature without geometry
        return
    if not isinstance(node, dict):
        raise ObsplanError(
            f"{where} must be a GeoJSON object, got {type(node).__name__}: export the file again"
        )
    match node.get("type"):
        case "FeatureCollection":
            for i, feature in _items(node, "features", where):
                yield from _lines(feature, f"{where}: features[{i}]", name)
        case "Feature":
            own = (
                node["properties"].get("name") if isinstance(node.get("properties"), dict) else None
            )
            yield from _lines(
                node.get("geometry"), f"{where}.geometry", str(own) if own is not None else name
            )
        case "GeometryCollection":
            for i, geometry in _items(node, "geometries", where):
                yield from _lines(geometry, f"{where}.geometries[{i}]", name)
        case "LineString":
            yield (
                name,
                [
                    _position(p, f"{where}.coordinates[{i}]")
                    for i, p in _items(node, "coordinates", where)
                ],
            )
        case "MultiLineString":
            for i, line in _items(node, "coordinates", where):
                yield from _lines(
                    {"type": "LineString", "coordinates": line}, f"{where}.coordinates[{i}]", name
                )


def _items(node: dict[str, Any], key: str, where: str) -> Iterator[tuple[int, Any]]:
    """Number the elements of a list that must be there."""
    if not isinstance(node.get(key), list):
        raise ObsplanError(
            f'{where} needs a list "{key}", got {type(node.get(key)).__name__}: export the file again'
        )
    return enumerate(node[key])


def _position(position: Any, where: str) -> Point:
    """Latitude and longitude [degrees] of a GeoJSON position, its altitude dropped."""
    if not isinstance(position, list) or len(position) < 2:
        raise ObsplanError(
            f"{where} must be [longitude, latitude], got {reprlib.repr(position)}: correct it"
        )
    lon, lat = (check_number(value, f"{where}[{i}]") for i, value in enumerate(position[:2]))
    return check_latlon(lat, lon, where, _ORDER)


def write_geojson(path: Path | str, mission: Mission) -> None:
    """Write geographic tracks as a FeatureCollection of LineStrings (a Point where a track has one vertex), named by `name`.

    Raises
    ------
    ObsplanError
        The file cannot be written.
    ValueError
        Local tracks: a GeoJSON file has degrees.
    """
    if not mission.geographic:
        raise ValueError(
            "GeoJSON has latitudes and longitudes, got local tracks: convert them about the origin first"
        )
    features = [
        {
            "type": "Feature",
            "properties": {"name": name},
            "geometry": _geometry(track.points[:, ::-1].round(_DECIMALS).tolist()),
        }
        for name, track in mission.tracks.items()
    ]
    write_atomically(
        path,
        json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False) + "\n",
    )


def _geometry(lonlat: list[list[float]]) -> dict[str, Any]:
    """Geometry of one track."""
    return (
        {"type": "Point", "coordinates": lonlat[0]}
        if len(lonlat) == 1
        else {"type": "LineString", "coordinates": lonlat}
    )
