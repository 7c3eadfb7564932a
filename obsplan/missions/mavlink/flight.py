"""The track of a vehicle that follows mission items one after the other."""

import math
from collections.abc import Sequence

import numpy as np

from obsplan import geo
from obsplan.missions.mavlink.commands import FLOWN, Command
from obsplan.missions.mavlink.items import Item
from obsplan.missions.mavlink.notes import Notes
from obsplan.missions.mission import Draft, Point
from obsplan.types import ObsplanError

FASTEST = 50.0  # [m/s]; faster than anything that floats
LONGEST_HOLD = 7 * 86400.0  # [s]
LARGEST_RADIUS = 10e3  # [m], of a loiter circle
MOST_TURNS = 1000.0
MOST_CIRCLED = 10_000  # vertices that loiter circles may add to a track
SAGITTA = 0.1  # [m]; chords leave their circle by no more than this,
_FEWEST_CHORDS = 16  # and a turn has no fewer than these

_NO_CHANGE, _DEFAULT = -1.0, -2.0  # what DO_CHANGE_SPEED may have instead of a speed
_GROUND, _DESCENT = 1.0, 3.0  # SPEED_TYPE: 0 airspeed, 1 groundspeed, 2 climb, 3 descent
_HOLDING = (Command.NAV_WAYPOINT, Command.NAV_LOITER_TIME, Command.NAV_SPLINE_WAYPOINT)
_SIMPLIFIED: dict[int, str] = {
    Command.NAV_SPLINE_WAYPOINT: "splines, flown as straight lines",
    Command.NAV_ARC_WAYPOINT: "arcs, flown as straight lines",
    Command.NAV_LOITER_TO_ALT: "loiters to an altitude, flown to without circles",
    Command.NAV_LOITER_UNLIM: "loiters without limit, passed without a stop: an operator ends them",
    Command.NAV_LOITER_TIME: "loiters for a time, held in place without circles",
}


class Flight:
    """Writes down, vertex by vertex, what a vehicle would do.

    Parameters
    ----------
    cruise
        Speed [m/s] until another is commanded; nan if that is not known.
    notes
        Where to say what was not flown as the file has it.
    """

    def __init__(self, *, cruise: float, notes: Notes) -> None:
        self._points: list[Point] = []
        self._altitude: list[float] = []
        self._speed: list[float] = []
        self._hold: list[float] = []
        self._datums: set[str] = set()
        self._cruise = cruise
        self._present_speed = cruise
        self._circled = 0
        self._notes = notes

    @property
    def draft(self) -> Draft:
        """The track so far; it has altitudes only if one of them is not 0."""
        return Draft(
            points=self._points,
            altitude=self._altitude if any(self._altitude) else None,
            speed=self._speed,
            hold=self._hold,
        )

    @property
    def datums(self) -> list[str]:
        """What the altitudes are above, in words."""
        return sorted(self._datums)

    def follow(self, item: Item) -> None:
        """Do what one item says; items that are no part of a track do nothing."""
        if item.command in FLOWN:
            self._fly_to(item)
        elif item.command == Command.NAV_RETURN_TO_LAUNCH:
            self._notes.add("returns to launch, which are no part of the survey, passed over", item)
        elif item.command == Command.NAV_DELAY:
            self._delay(item)
        elif item.command == Command.DO_CHANGE_SPEED:
            self._change_speed(item)

    def _fly_to(self, item: Item) -> None:
        """Go to the place of an item, and stay or circle there as it says."""
        place = item.position
        if place is None:
            if not self._points:
                self._notes.add("without a place before the first waypoint, passed over", item)
                return
            self._notes.add("without a place of their own, done at the place before", item)
            place = self._points[-1]
        else:
            self._datums |= {item.datum} if item.altitude(0.0) else set()
        if item.command in _SIMPLIFIED:
            self._notes.add(_SIMPLIFIED[item.command], item)
        if item.command == Command.NAV_LOITER_TURNS:
            self._circle(item, place)
        else:
            self._add(place, self._altitude_of(item))
        if item.command in _HOLDING:
            self._hold[-1] += item.value(1, "time to hold", 0.0, LONGEST_HOLD)

    def _altitude_of(self, item: Item) -> float:
        """Altitude [m] of an item, that of the vertex before where it has none."""
        return item.altitude(self._altitude[-1] if self._altitude else 0.0)

    def _add(self, place: Point, altitude: float) -> None:
        """Add a vertex."""
        self._points.append(place)
        self._altitude.append(altitude)
        self._speed.append(self._present_speed)
        self._hold.append(0.0)

    def _circle(self, item: Item, centre: Point) -> None:
        """Fly loiter turns from the circle's nearest point, clockwise if the radius is positive."""
        turns = item.value(1, "number of turns", 0.0, MOST_TURNS)
        radius = item.value(3, "radius", -LARGEST_RADIUS, LARGEST_RADIUS)
        altitude = self._altitude_of(item)
        if not turns or not radius:
            what = "loiters without a number of turns or a radius, flown to without circles"
            self._notes.add(what, item)
            self._add(centre, altitude)
            return
        chords = math.ceil(turns * _chords(abs(radius)))
        self._circled += chords
        if self._circled > MOST_CIRCLED:
            raise ObsplanError(
                f"{item.where}: loiter circles add more than {MOST_CIRCLED} vertices to the track: "
                "lower their number of turns (parameter 1)"
            )
        for place in _ring(centre, radius, turns, chords, self._points[-1:]):
            self._add(place, altitude)

    def _delay(self, item: Item) -> None:
        """Stay at the vertex before for a time."""
        seconds = item.value(1, "delay", -1.0, LONGEST_HOLD)
        if seconds < 0:
            self._notes.add("delays until a time of day, passed over", item)
        elif self._hold:
            self._hold[-1] += seconds
        else:
            self._notes.add("delays before the first place, passed over", item)

    def _change_speed(self, item: Item) -> None:
        """Go on at another speed."""
        speed = item.value(2, "speed", _DEFAULT, math.inf)
        if item.value(1, "type of speed", 0.0, _DESCENT) > _GROUND:
            self._notes.add("speeds of climb or descent, passed over", item)
        elif speed == _DEFAULT:
            self._present_speed = self._cruise
        elif 0 < speed <= FASTEST:
            self._present_speed = speed
        elif speed != _NO_CHANGE:
            what = f"speeds not above 0, or above {FASTEST:g} m/s, passed over"
            self._notes.add(what, item)


def _chords(radius: float) -> int:
    """Chords in a full circle of a radius [m]."""
    half_angle = math.acos(max(1 - SAGITTA / radius, 0.0))
    return max(_FEWEST_CHORDS, math.ceil(math.pi / half_angle))


def _ring(
    centre: Point, radius: float, turns: float, chords: int, before: Sequence[Point]
) -> list[Point]:
    """Vertices about a centre; the first is nearest to the point before, or north without one."""
    entry = math.pi / 2
    if before:
        east, north = geo.to_local(np.array(before[-1]), centre)
        if east or north:
            entry = math.atan2(north, east)
    angle = entry - math.copysign(2 * math.pi * turns, radius) * np.linspace(0.0, 1.0, chords + 1)
    circle = abs(radius) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return [(float(lat), float(lon)) for lat, lon in geo.to_geographic(circle, centre)]
