"""What the headings of a table mean: a quantity, and its unit as a factor to ours."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from obsplan.types import ObsplanError

_METRES = {"": 1.0, "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0}
_LENGTH = {**_METRES, "km": 1e3, "ft": 0.3048, "feet": 0.3048, "foot": 0.3048}
_SPEED = {"": 1.0, "m/s": 1.0, "mps": 1.0, "km/h": 1 / 3.6, "kmh": 1 / 3.6} | dict.fromkeys(
    ("kn", "kt", "kts", "knots"), 1852 / 3600
)
_TIME = dict.fromkeys(("", "s", "sec", "seconds", "utc", "iso", "iso8601"), 1.0)
_TIME |= {"ms": 1e-3, "min": 60.0, "minutes": 60.0}
_ANGLE = dict.fromkeys(("", "deg", "degree", "degrees", "°", "decimal degrees", "dd"), 1.0)
_ANGLE |= dict.fromkeys(("dms", "dm", "ddm", "wgs84", "wgs 84", "epsg:4326"), 1.0)
_ANGLE |= dict.fromkeys(("n", "e", "°n", "°e", "degrees north", "degrees east"), 1.0)
_MINUTES = dict.fromkeys(("min", "minutes", "'"), 1.0)
_SECONDS = dict.fromkeys(("s", "sec", "seconds", '"'), 1.0)
_TEXT = {"": 1.0}
_TRACK = ("track", "line", "leg", "route", "vehicle", "auv")
_TRACK += ("track name", "line name", "track id", "line id", "vehicle id")

# for each role, the headings that have it, unit and case aside, and the units they may be in
_ROLES = {
    "lat": (("lat", "latitude", "latitud", "breite", "breitengrad", "breddegrad"), _ANGLE),
    "lon": (
        ("lon", "long", "lng", "longitude", "longitud", "länge", "längengrad", "lengdegrad"),
        _ANGLE,
    ),
    "east": (("x", "east", "easting", "e"), _LENGTH),
    "north": (("y", "north", "northing", "n"), _LENGTH),
    "altitude": (("alt", "altitude", "ele", "elev", "elevation", "height", "z"), _LENGTH),
    "depth": (("depth",), _LENGTH),
    "speed": (("speed", "sog", "velocity"), _SPEED),
    "hold": (("hold", "hold time", "wait", "dwell", "loiter time"), _TIME),
    "time": (("time", "datetime", "date time", "timestamp", "utc"), _TIME),
}
_ROLES |= {
    "track": (_TRACK, _TEXT),
    "name": (("name",), _TEXT),
    "wkt": (("wkt", "geometry", "geom", "the geom", "wkt geom"), _TEXT),
    "kind": (("kind", "type"), _TEXT),
    "description": (("description", "desc"), _TEXT),
    "north or south": (("n/s", "ns", "lat hemisphere", "lat dir", "lat ref", "north/south"), _TEXT),
    "east or west": (("e/w", "ew", "lon hemisphere", "lon dir", "lon ref", "east/west"), _TEXT),
    "lat minutes": (("lat", "latitude"), _MINUTES),
    "lon minutes": (("lon", "long", "longitude"), _MINUTES),
    "lat seconds": (("lat", "latitude"), _SECONDS),
    "lon seconds": (("lon", "long", "longitude"), _SECONDS),
}
_BRACKETED = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])]\s*")


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table that is read."""

    index: int
    heading: str
    unit: str = ""  # as the heading has it
    factor: float = 1.0  # from it to metres, m/s, seconds or degrees


def find_columns(headings: Sequence[str], where: str) -> dict[str, Column]:
    """Columns by their roles, the first of each.

    Raises
    ------
    ObsplanError
        A coordinate in an unknown unit.
    """
    found: dict[str, Column] = {}
    for index, heading in enumerate(headings):
        name, unit = _split(heading)
        for role, (names, units) in _ROLES.items():
            if name in names and unit in units:
                found.setdefault(role, Column(index, heading.strip(), unit, units[unit]))
                break
        else:
            if name in (*_ROLES["lat"][0], *_ROLES["lon"][0], "easting", "northing"):
                raise ObsplanError(
                    f"{where} has {heading.strip()[:40]!r} in a unit that is not read: give "
                    "degrees or metres"
                )
    return found


def _split(heading: str) -> tuple[str, str]:
    """Name and unit of a heading: `Depth (m)`, `lat_deg`, `speed_mps`."""
    text = " ".join(heading.strip().strip('"').lower().replace("_", " ").split())
    bracketed = _BRACKETED.fullmatch(text)
    if bracketed:
        return bracketed[1], bracketed[2].strip()
    name, _, unit = text.rpartition(" ")
    known = any(unit in units and unit for _, units in _ROLES.values())
    return (name, unit) if name and known else (text, "")
