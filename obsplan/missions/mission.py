"""What a mission file holds: tracks, limits, a home, and what of the file was passed over."""

import math
import re
import reprlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan import geo
from obsplan.quantities import POSITION
from obsplan.types import ObsplanError

# [m]; beyond it the origin is a mistake, and a tangent plane no longer a map
FARTHEST = POSITION.greatest
REPEATED = 1e-3  # [m]; nearer than this, two points are one place
_LONGEST = 40  # letters of a name in a sentence
# the last two are refused as not finite
_NUMBER = re.compile(r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf)", re.ASCII | re.IGNORECASE)

Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """A line to follow from vertex to vertex, and what the file says of each.

    None is where it says nothing. ``points`` are latitude and longitude [degrees, WGS 84], or east
    and north [m], as the mission says.
    """

    points: Float[np.ndarray, "n 2"]
    altitude: Float[np.ndarray, " n"] | None = None  # [m], upwards; the file's own datum
    speed: Float[np.ndarray, " legs"] | None = None  # on each leg [m/s]; nan where not said
    hold: Float[np.ndarray, " n"] | None = None  # time kept at each vertex [s]
    time: Float[np.ndarray, " n"] | None = None  # at each vertex, from the first [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Area:
    """A closed area: a polygon by its corners, none repeated, or a circle by centre and radius."""

    points: Float[np.ndarray, "n 2"]  # in the mission's coordinates; one for a circle
    radius: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mission:
    """Named tracks and limits, all latitude and longitude [degrees, WGS 84], or all local [m].

    Local is east and north. ``remarks`` say in one sentence each what the file holds that was
    passed over, or changed, and why.
    """

    tracks: dict[str, Track]
    geographic: bool
    home: Point | None = None  # latitude and longitude [degrees] of the planned launch
    keep_outs: tuple[Area, ...] = ()  # not to be entered
    geofences: tuple[Area, ...] = ()  # not to be left: all of them hold
    areas: tuple[Area, ...] = ()  # that the file does not call a limit
    remarks: tuple[str, ...] = ()

    @property
    def origin(self) -> Point | None:
        """Where to put the origin [degrees]; None if the tracks are local.

        It is the home, unless that is a placeholder farther than `FARTHEST` from every vertex:
        then the first vertex.
        """
        if not self.geographic:
            return None
        vertices = np.concatenate([track.points for track in self.tracks.values()])
        if self.home is not None and geo.distance(np.array(self.home), vertices).min() <= FARTHEST:
            return self.home
        lat, lon = vertices[0]
        return float(lat), float(lon)


def to_local(mission: Mission, origin: Point | None = None) -> Mission:
    """Turn a mission into east and north [m] about an origin, by default `Mission.origin`.

    A mission that is local stays as it is. Areas that are no limit are left out.

    Raises
    ------
    ObsplanError
        A track or a limit farther than `FARTHEST` from the origin, on the ellipsoid.
    """
    default = mission.origin
    if default is None:
        return mission
    origin = origin or default
    for name, track in mission.tracks.items():
        _check_near(f'track "{name}"', track.points, origin, default)
    for area in (*mission.keep_outs, *mission.geofences):
        _check_near("a limit", area.points, origin, default)

    return _mapped(mission, lambda points: geo.to_local(points, origin), geographic=False)


def to_geographic(mission: Mission, origin: Point) -> Mission:
    """Turn east and north [m] about an origin [degrees] into latitude and longitude.

    A mission that has them stays as it is.
    """
    if mission.geographic:
        return mission
    return _mapped(mission, lambda points: geo.to_geographic(points, origin), geographic=True)


def _mapped(
    mission: Mission, change: Callable[[np.ndarray], np.ndarray], *, geographic: bool
) -> Mission:
    """The same tracks and limits in other coordinates."""

    def changed(part: Any) -> Any:
        return replace(part, points=change(part.points))

    return replace(
        mission,
        tracks={name: changed(track) for name, track in mission.tracks.items()},
        keep_outs=tuple(changed(area) for area in mission.keep_outs),
        geofences=tuple(changed(area) for area in mission.geofences),
        areas=(),
        geographic=geographic,
        home=None,
    )


def _check_near(what: str, points: Float[np.ndarray, "n 2"], origin: Point, default: Point) -> None:
    """Refuse points that are on another map."""
    distance = geo.distance(np.array(origin), points).max()
    if not distance <= FARTHEST:
        remedy = f"move the origin to the survey, for example to {default}"
        if origin == default:
            remedy = "correct it, or remove it from the file"
        raise ObsplanError(
            f"{what} lies {distance / 1e3:.0f} km from the origin at latitude {origin[0]}, "
            f"longitude {origin[1]} degrees: {remedy}"
        )


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
        raise ObsplanError(
            f"{where} must be a finite number, got {number}: correct it or remove the point"
        )
    return number


def read_number(text: str, where: str) -> float:
    """Read a finite decimal number, blanks around it aside.

    Raises
    ------
    ObsplanError
        Anything else; names the place and the text.
    """
    text = text.strip()
    if not _NUMBER.fullmatch(text):  # stricter than `float`: no 1_000, no letters of other scripts
        raise ObsplanError(f"{where} must be a number, got {text[:_LONGEST]!r}: correct it")
    return check_number(float(text), where)


def check_latlon(lat: float, lon: float, where: str, order: str) -> Point:
    """Return a latitude and longitude [degrees] on Earth; longitudes to 360 are wrapped to ±180.

    Raises
    ------
    ObsplanError
        Out of range; says so if they look swapped, `order` being how this format has them.
    """
    if abs(lat) > 90 and abs(lon) <= 90 and abs(lat) <= 180:
        raise ObsplanError(
            f"{where} has latitude {lat} and longitude {lon}, which look swapped: {order}"
        )
    if abs(lat) > 90:
        raise ObsplanError(
            f"{where} has latitude {lat}, beyond 90 degrees: give WGS 84 degrees, not metres of a "
            "map projection"
        )
    if abs(lon) > 360:
        raise ObsplanError(
            f"{where} has longitude {lon}, beyond 360 degrees: give WGS 84 degrees from -180 to 180"
        )
    return lat, lon if abs(lon) <= 180 else lon - math.copysign(360.0, lon)


def check_local(east: float, north: float, where: str) -> Point:
    """Return a local point [m]; refuse one that only a map projection gives.

    Raises
    ------
    ObsplanError
        Farther than `FARTHEST` from the origin.
    """
    if max(abs(east), abs(north)) > FARTHEST:
        remedy = "if these are UTM coordinates, give latitude and longitude instead"
        raise ObsplanError(
            f"{where} has ({east}, {north}) m, more than {FARTHEST / 1e3:.0f} km from the origin: "
            f"{remedy}"
        )
    return east, north


@dataclass(slots=True, kw_only=True)
class Draft:
    """A track as a reader finds it, vertex by vertex, before repeated places are joined."""

    name: str | None = None
    points: list[Point]
    altitude: list[float] | None = None  # as in `Track`
    speed: list[float] | None = (
        None  # towards each vertex, the first one's unused [m/s]; nan: not said
    )
    hold: list[float] | None = None
    time: list[float] | None = None


def named_tracks(
    path: Path, drafts: Iterable[Draft], *, geographic: bool
) -> tuple[dict[str, Track], tuple[str, ...]]:
    """Collect tracks under unique names: their own, else the file's, numbered from 2 if taken.

    Places repeated one after the other are one vertex: their holds add up. A track of fewer than
    two places is passed over.

    Returns
    -------
    The tracks, and remarks on those that were passed over.

    Raises
    ------
    ObsplanError
        A name that cannot be printed.
    """
    named: dict[str, Track] = {}
    stubs: dict[str, list[str]] = {}
    used: dict[str, int] = {}  # the last number given to each name
    for draft in drafts:
        base = (draft.name or "").strip() or path.stem
        if not base.isprintable():
            raise ObsplanError(
                f"{path}: the track name {base!r} cannot be printed: rename the track"
            )
        name = base
        while name in named:
            used[base] = used.get(base, 1) + 1
            name = f"{base}-{used[base]}"
        track = _joined(draft, geographic)
        if track is None:
            places = "no place" if not draft.points else "a single place"
            stubs.setdefault(places, []).append(base)
        else:
            named[name] = track
    remarks = (
        f'track "{names[0]}" has {places}, and no line: passed over'
        if len(names) == 1
        else f"{count_of(names, 'track')} have {places}, and no line: passed over"
        for places, names in stubs.items()
    )
    return named, tuple(remarks)


def count_of(names: Sequence[str], kind: str, *, most: int = 5) -> str:
    """Count things of a kind and give the first names: `3 points ("a", "b" and 1 more)`."""
    shown = [_quoted(name) for name in names[:most] if name]
    unnamed = len(names) - len(shown)
    if shown and unnamed:
        shown.append(f"{unnamed} more")
    listed = " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)
    counted = f"{len(names)} {kind}{'' if len(names) == 1 else 's'}"
    return f"{counted} ({listed})" if listed else counted


def _quoted(name: str) -> str:
    """The beginning of a name in quotes, without what cannot be printed."""
    letters = [letter if letter.isprintable() else "?" for letter in name[:_LONGEST]]
    return f'"{"".join(letters)}"'


def _joined(draft: Draft, geographic: bool) -> Track | None:
    """A track of a draft, consecutive vertices at one place joined; None of fewer than two."""
    points = np.array(draft.points, dtype=float).reshape(-1, 2)
    if len(points) < 2:
        return None
    moved = (
        geo.distance(points[:-1], points[1:])
        if geographic
        else np.hypot(*np.diff(points, axis=0).T)
    )
    first = np.flatnonzero(np.append(True, moved > REPEATED))
    if len(first) < 2:
        return None

    def pick(values: list[float] | None) -> np.ndarray | None:
        return None if values is None else np.array(values, dtype=float)[first]

    speed = pick(draft.speed)
    hold = None if draft.hold is None else np.add.reduceat(np.array(draft.hold, dtype=float), first)
    return Track(
        points=points[first],
        altitude=pick(draft.altitude),
        speed=None if speed is None or np.isnan(speed[1:]).all() else speed[1:],
        hold=None if hold is None or not hold.any() else hold,
        time=pick(draft.time),
    )
