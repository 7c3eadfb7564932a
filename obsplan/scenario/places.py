"""Places, wherever a scenario has one: in metres about its origin, or in degrees.

A table with a place is a `Place`, a place in a list a `Corner`, the list `Corners`. Checking turns
latitude and longitude into metres, so that nothing behind the tables knows of degrees. The origin
comes with pydantic's context, as ``{"origin": (lat, lon)}``.
"""

from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from obsplan import geo
from obsplan.missions.mission import FARTHEST
from obsplan.scenario.base import Table

NEAR = (
    0.5  # [degrees]; numbers this near to the origin's latitude and longitude are meant to be such
)
AMBIGUOUS, FAR_FROM_ZERO = 1.0, 10.0  # [degrees] from (0, 0); see `degrees_among`
KEYS, ENTRY = "lat = {lat}, lon = {lon}", "{{ lat = {lat}, lon = {lon} }}"  # in a table, in a list
METRES, DEGREES = "[east, north]", "{ lat, lon }"  # pydantic's names for the two forms of a corner

LatLon = tuple[float, float]


class Degrees(Table):
    """A place on Earth."""

    lat: float = Field(ge=-90, le=90, description="latitude [deg], WGS84")
    lon: float = Field(ge=-180, le=180, description="longitude [deg], WGS84")


def to_metres(latlon: Float[np.ndarray, "n 2"], origin: LatLon) -> Float[np.ndarray, "n 2"]:
    """East and north [m] about the origin of latitudes and longitudes [deg].

    Raises
    ------
    ValueError
        A place farther than `FARTHEST` from the origin, on the ellipsoid; names both.
    """
    distance = geo.distance(np.array(origin), latlon)
    worst = int(distance.argmax())
    if not distance[worst] <= FARTHEST:
        lat, lon = latlon[worst].tolist()
        raise ValueError(
            f"latitude {lat}, longitude {lon} lies {distance[worst] / 1e3:.0f} km from the origin "
            f"at latitude {origin[0]}, longitude {origin[1]} degrees, and the map ends at "
            f"{FARTHEST / 1e3:.0f} km: correct one of them"
        )
    return geo.to_local(latlon, origin)


def check_metres(points: Float[np.ndarray, "n 2"], origin: LatLon | None, *, remedy: str) -> None:
    """Refuse numbers [m] that are off the map, or that look like degrees about the origin.

    The remedy has places for these numbers.

    Raises
    ------
    ValueError
        The reason, the first such numbers, and the remedy.
    """
    reach = np.abs(points).max(axis=1, initial=0.0)
    if not reach.max(initial=0.0) <= FARTHEST:
        x, y = points[reach.argmax()].tolist()
        raise ValueError(
            f"({x}, {y}) m is off the map, which ends {FARTHEST / 1e3:.0f} km from the origin: "
            "correct it"
        )
    meant = None if origin is None else degrees_among(points, origin)
    if meant is not None:
        x, y = points[0].tolist()
        raise ValueError(
            f"({x}, {y}), where metres are meant, looks like degrees, so near to the origin's: "
            f"write {remedy.format(lat=meant[0], lon=meant[1])}"
        )


def degrees_among(points: Float[np.ndarray, "n 2"], origin: LatLon) -> LatLon | None:
    """The first of the points in degrees, if all look like degrees about the origin.

    Either order of latitude and longitude will do. Whole numbers do not look so: 63 m is as likely
    as 63 degrees. Near (0, 0) nothing can be told from metres. Within 10 degrees of it, where
    numbers are those of metres in a test tank, only what is finer than a centimetre is taken for
    degrees.
    """
    away = max(abs(origin[0]), abs(origin[1]))
    if away <= AMBIGUOUS or not len(points):
        return None
    unit = 1.0 if away >= FAR_FROM_ZERO else 0.01
    if np.allclose(points, unit * np.round(points / unit), rtol=0.0, atol=1e-9):
        return None
    for latlon in (points, points[:, ::-1]):
        if (np.abs(latlon - np.array(origin)) <= NEAR).all():
            lat, lon = latlon[0].tolist()
            return lat, lon
    return None


class Place(Table):
    """A table with a place: keys x and y in metres, or lat and lon in degrees, turned into those.

    The subclass declares x and y.
    """

    lat: float | None = Field(
        default=None, ge=-90, le=90, description="latitude [deg], WGS84, instead of x and y"
    )
    lon: float | None = Field(
        default=None, ge=-180, le=180, description="longitude [deg], WGS84, instead of x and y"
    )

    @model_validator(mode="after")
    def _in_metres(self, info: Any) -> "Place":
        given = [key for key in ("x", "y", "lat", "lon") if key in self.model_fields_set]
        place: dict[str, Any] = {key: getattr(self, key) for key in ("x", "y", "lat", "lon")}
        if place["lat"] is None and place["lon"] is None:
            if place["x"] is not None and place["y"] is not None:
                point = np.array([[place["x"], place["y"]]])
                check_metres(point, _origin(info), remedy=KEYS)
            return self
        if given != ["lat", "lon"]:
            raise ValueError(
                "a place is x and y in metres, or lat and lon in degrees, got "
                f"{' and '.join(given)}: give one pair"
            )
        origin = _needed(_origin(info))
        x, y = to_metres(np.array([[place["lat"], place["lon"]]]), origin)[0].tolist()
        return self.model_copy(update={"x": x, "y": y, "lat": None, "lon": None})


def _origin(info: Any) -> LatLon | None:
    """The scenario's origin, of pydantic's ValidationInfo; None if wrong: its own table says so."""
    return (info.context or {}).get("origin")


def _needed(origin: LatLon | None) -> LatLon:
    if origin is None:
        raise ValueError("a place in degrees needs the scenario's origin: add it")
    return origin


def _form(value: Any) -> str:
    """Which form a corner has."""
    return DEGREES if isinstance(value, dict | Degrees) else METRES


def _corner(value: Any, info: Any) -> tuple[float, float]:
    """A corner in metres."""
    if not isinstance(value, Degrees):
        return value
    origin = _needed(_origin(info))
    x, y = to_metres(np.array([[value.lat, value.lon]]), origin)[0].tolist()
    return x, y


def _checked(value: tuple[Any, ...], info: Any) -> tuple[Any, ...]:
    """One corner, or corners as a list: one of many may happen to look like degrees."""
    points = np.array(value, dtype=float).reshape(-1, 2)
    check_metres(points, _origin(info), remedy=ENTRY)
    return value


InDegrees = Annotated[Degrees, Tag(DEGREES)]
Corner = Annotated[
    Annotated[tuple[float, float], Tag(METRES)] | InDegrees,
    Discriminator(_form),
    AfterValidator(_corner),
]
Corners = Annotated[tuple[Corner, ...], AfterValidator(_checked)]
Position = Annotated[Corner, AfterValidator(_checked)]
