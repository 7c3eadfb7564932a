"""What a mission file holds: named tracks, geographic or local."""

import math
import reprlib
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan import geo
from obsplan.types import ObsplanError

FARTHEST = 100e3  # [m]; beyond it the origin is a mistake, and a tangent plane no longer a map

Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mission:
    """Named tracks, all of one kind: latitude and longitude [degrees, WGS 84], or east and north [m]."""

    tracks: dict[str, Float[np.ndarray, "_ 2"]]
    geographic: bool
    home: Point | None = None  # latitude and longitude [degrees] of the planned launch, where the file has one

    @property
    def origin(self) -> Point | None:
        """Where to put the origin [degrees]: at home, else at the first vertex; None if the tracks are local already."""
        if not self.geographic:
            return None
        lat, lon = self.home or next(iter(self.tracks.values()))[0]
        return float(lat), float(lon)


def to_local(mission: Mission, origin: Point | None = None) -> Mission:
    """Turn a mission into east and north [m] about an origin [degrees], by default `Mission.origin`; one that is local stays as it is.

    Raises
    ------
    ObsplanError
        A track farther than `FARTHEST` from the origin.
    """
    default = mission.origin
    if default is None:
        return mission
    origin = origin or default
    tracks = {name: geo.to_local(track, origin) for name, track in mission.tracks.items()}
    for name, track in tracks.items():
        distance = np.hypot(track[:, 0], track[:, 1]).max()
        if not distance <= FARTHEST:
            raise ObsplanError(
                f'track "{name}" lies {distance / 1e3:.0f} km from the origin at latitude {origin[0]}, longitude {origin[1]} degrees: '
                f"move the origin to the survey, for example to {default}"
            )
    return Mission(tracks=tracks, geographic=False)


def check_number(value: Any, where: str) -> float:
    """Return a finite number as a float.

    Raises
    ------
    ObsplanError
        Anything else; names the place and the value.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ObsplanError(f"{where} must be a number, got {reprlib.repr(value)}: correct it")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ObsplanError(f"{where} must be a finite number, got {number}: correct it or remove the point")
    return number


def check_latlon(lat: float, lon: float, where: str, order: str) -> Point:
    """Return a latitude and longitude [degrees] that are on Earth.

    Raises
    ------
    ObsplanError
        Out of range; says so if they look swapped, `order` being how this format has them.
    """
    if abs(lat) > 90 and abs(lon) <= 90 and abs(lat) <= 180:
        raise ObsplanError(f"{where} has latitude {lat} and longitude {lon}, which look swapped: {order}")
    if abs(lat) > 90:
        raise ObsplanError(f"{where} has latitude {lat}, beyond 90 degrees: give WGS 84 degrees, not metres of a map projection")
    if abs(lon) > 180:
        raise ObsplanError(f"{where} has longitude {lon}, beyond 180 degrees: give WGS 84 degrees from -180 to 180")
    return lat, lon


def name_tracks(path: Path, tracks: Iterable[tuple[str | None, list[Point]]]) -> dict[str, Float[np.ndarray, "_ 2"]]:
    """Collect tracks under unique names: their own, else the file's, numbered from 2 where one is taken.

    Raises
    ------
    ObsplanError
        A name that cannot be printed, a track of fewer than two points, or two identical consecutive ones, counted from 1.
    """
    named: dict[str, np.ndarray] = {}
    for own, points in tracks:
        base = own or path.stem
        if not base.isprintable():
            raise ObsplanError(f"{path}: the track name {base!r} cannot be printed: rename the track")
        name, count = base, 1
        while name in named:
            count += 1
            name = f"{base}-{count}"
        if len(points) < 2:
            raise ObsplanError(f'{path}: track "{name}" needs at least two points, got {len(points)}: add points or remove the track')
        for i, (a, b) in enumerate(pairwise(points), start=1):
            if a == b:
                raise ObsplanError(f'{path}: points {i} and {i + 1} of track "{name}" are identical, at {a}: remove one of them')
        named[name] = np.array(points)
    return named
