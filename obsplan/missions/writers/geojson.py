"""GeoJSON (RFC 7946): tracks as lines with times and speeds, limits as areas."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.files import write_atomically
from obsplan.missions.mission import Area, Mission, Track
from obsplan.missions.writers.checks import check_geographic
from obsplan.missions.writers.names import limit_names

DECIMALS = 9  # of a degree: 0.1 mm
MILLIS = 3  # decimals of seconds
MICROS = 6  # of speeds


def write_geojson(path: Path | str, mission: Mission) -> None:
    """Write geographic tracks and limits as a FeatureCollection.

    A track is a LineString (a Point where it has one vertex), with properties ``name``, ``kind``
    ("track") and, where they are known, ``time_s`` and ``hold_s`` of each vertex and ``speed_mps``
    of each leg (null where it is not). A limit is a Polygon of kind "geofence" or "keep-out"; a
    circle is a Point with its ``radius_m``. A line over 180 degrees goes on past it.

    Raises
    ------
    ObsplanError
        The file cannot be written.
    ValueError
        Local tracks: a GeoJSON file has degrees.
    """
    check_geographic(mission, "GeoJSON")
    write_atomically(path, _collection(mission))


def _collection(mission: Mission) -> Iterator[str]:
    """The file in pieces, a feature each: as a whole it takes much more memory than the mission."""
    yield '{"type": "FeatureCollection", "features": ['
    for i, feature in enumerate(_features(mission)):
        separator = ", " if i else ""
        yield separator + json.dumps(feature, ensure_ascii=False, allow_nan=False)
    yield "]}\n"


def _features(mission: Mission) -> Iterator[dict[str, Any]]:
    for name, track in mission.tracks.items():
        yield _track(name, track)
    for name, kind, area in limit_names(mission):
        yield _limit(name, kind, area)


def _track(name: str, track: Track) -> dict[str, Any]:
    places = _positions(track.points)
    geometry = _geometry("LineString", places) if len(places) > 1 else _geometry("Point", places[0])
    columns = {
        "time_s": (track.time, MILLIS),
        "hold_s": (track.hold, MILLIS),
        "speed_mps": (track.speed, MICROS),
    }
    known = {
        key: _numbers(values, decimals)
        for key, (values, decimals) in columns.items()
        if values is not None
    }
    return _feature({"name": name, "kind": "track", **known}, geometry)


def _limit(name: str, kind: str, area: Area) -> dict[str, Any]:
    properties = {"name": name, "kind": kind}
    places = _positions(area.points)
    if area.radius is not None:
        return _feature(properties | {"radius_m": area.radius}, _geometry("Point", places[0]))
    lon, lat = np.array(places).T
    if (lon * np.roll(lat, -1) - np.roll(lon, -1) * lat).sum() < 0:
        places.reverse()  # RFC 7946: counter-clockwise
    return _feature(properties, _geometry("Polygon", [[*places, places[0]]]))


def _feature(properties: dict[str, Any], geometry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _geometry(kind: str, coordinates: list[Any]) -> dict[str, Any]:
    return {"type": kind, "coordinates": coordinates}


def _positions(points: Float[np.ndarray, "n 2"]) -> list[list[float]]:
    """Longitudes, without jumps at 180 degrees, and latitudes."""
    lon = np.unwrap(points[:, 1], period=360.0)
    return np.column_stack([lon, points[:, 0]]).round(DECIMALS).tolist()


def _numbers(values: Float[np.ndarray, " n"], decimals: int) -> list[float | None]:
    rounded = values.round(decimals).tolist()
    return [value if np.isfinite(value) else None for value in rounded]
