"""A mission item as a file has it; its values are checked when they are used."""

import math
import reprlib
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from obsplan.missions.mission import Point, check_latlon, check_number
from obsplan.types import ObsplanError

# MAV_FRAME_GLOBAL and its relatives, which differ in what the altitude is above
_SEA_LEVEL, _HOME, _TERRAIN = "sea level", "home", "the ground"
_GLOBAL_FRAMES = {
    0: _SEA_LEVEL,
    3: _HOME,
    5: _SEA_LEVEL,
    6: _HOME,
    10: _TERRAIN,
    11: _TERRAIN,
}
_HIGHEST = 100e3  # [m]
MOST_ITEMS = 65_535  # in a mission, whose items are numbered with 16 bits
NO_HOME = "home is a placeholder (latitude and longitude 0, or none): passed over"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Item:
    """One item: a place to fly to, something to do, or a part of a fence.

    ``values`` are its seven parameters, unchecked; None or nan where the file says nothing.
    """

    path: Path
    place: str  # in the file: "mission.items[3]", "line 5"
    command: int  # MAV_CMD
    frame: Any  # MAV_FRAME
    values: tuple[Any, ...]
    number: int | None = None  # by which jumps name it

    @property
    def where(self) -> str:
        """The file and the place in it, to begin a sentence with."""
        return f"{self.path}: {self.place}"

    def value(self, n: int, what: str, low: float, high: float) -> float:
        """Give parameter ``n`` (1 to 7), 0 where the file says nothing.

        Raises
        ------
        ObsplanError
            Not a number from low to high.
        """
        raw = self.values[n - 1]
        if is_blank(raw):
            return 0.0
        where = f"{self.where}, {what} (parameter {n}),"
        number = check_number(raw, where)
        if not low <= number <= high:
            raise ObsplanError(
                f"{where} must be from {low:g} to {high:g}, got {number:g}: correct it"
            )
        return number

    def altitude(self, default: float) -> float:
        """Altitude [m] above what `datum` says, the default where the file says nothing."""
        if is_blank(self.values[6]):
            return default
        return self.value(7, "altitude", -_HIGHEST, _HIGHEST)

    @property
    def datum(self) -> str:
        """What the altitude of a place is above, in words."""
        return _GLOBAL_FRAMES[self.frame]

    @property
    def position(self) -> Point | None:
        """Latitude and longitude [degrees]; None where both are 0 or not given, which means "here".

        Raises
        ------
        ObsplanError
            Not numbers, not on Earth, or in a frame that is not global.
        """
        raw = self.values[4:6]
        if all(is_blank(value) for value in raw):
            return None
        names = ("latitude (parameter 5),", "longitude (parameter 6),")
        lat, lon = (
            check_number(value, f"{self.where}, {name}")
            for value, name in zip(raw, names, strict=True)
        )
        if lat == 0 and lon == 0:
            return None
        if self.frame not in tuple(_GLOBAL_FRAMES):  # a tuple: the frame may be anything
            known = ", ".join(map(str, _GLOBAL_FRAMES))
            raise ObsplanError(
                f"{self.where}, frame, must be global (one of {known}), got "
                f"{reprlib.repr(self.frame)}: give the waypoint in latitude and longitude"
            )
        return check_latlon(lat, lon, self.where, "exchange them, latitude comes first")


def collect(items: Iterable[Item], path: Path) -> list[Item]:
    """Take the items of a file as they are read, as many as a mission may have.

    Raises
    ------
    ObsplanError
        More than `MOST_ITEMS`.
    """
    taken = list(islice(items, MOST_ITEMS + 1))
    if len(taken) > MOST_ITEMS:
        raise ObsplanError(
            f"{path} holds more than {MOST_ITEMS} items, more than any autopilot takes: "
            "export the survey alone, or a part of it"
        )
    return taken


def is_blank(value: Any) -> bool:
    """Whether a parameter is left to the vehicle: null in JSON, nan in text."""
    return value is None or (isinstance(value, float) and math.isnan(value))


def whole_number(value: Any, where: str, largest: int) -> int:
    """Return a whole number from 0 to the largest, which may be written as a float.

    Raises
    ------
    ObsplanError
        Anything else; names the place and the value.
    """
    number = check_number(value, where)
    if not (0 <= number <= largest and number.is_integer()):
        raise ObsplanError(
            f"{where} must be a whole number from 0 to {largest}, got {number:g}: correct it"
        )
    return int(number)
