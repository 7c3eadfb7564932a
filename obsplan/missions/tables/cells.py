"""A table whose columns are known: its cells as coordinates, numbers and times."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from obsplan.missions.mission import Point, check_latlon, check_local, read_number
from obsplan.missions.tables.angles import is_plain, read_angle
from obsplan.missions.tables.columns import Column
from obsplan.missions.timing import seconds_of
from obsplan.types import ObsplanError

# roles of coordinates; geographic first: where a table has both, its metres may have any origin
PAIRS = (("lat", "lon"), ("east", "north"))
_LETTERS = {"north or south": ("N", "S"), "east or west": ("E", "W")}
_NO_UNIT = ("", "utc", "iso", "iso8601")  # of numbers under a heading of times
_ORDER = "exchange the headings of the two columns"

Row = tuple[int, list[str]]  # the number of its line, and its cells


@dataclass(slots=True, kw_only=True)
class Table:
    """Rows, and columns by their roles; the roles that were asked for are noted."""

    path: Path
    heading: list[str]  # empty if the file has none
    rows: list[Row]
    columns: dict[str, Column]
    used: set[str] = field(default_factory=set)

    @property
    def pair(self) -> tuple[str, str]:
        """The roles of the coordinates that are read."""
        return next(pair for pair in PAIRS if set(pair) <= set(self.columns))

    def cell(self, row: Row, role: str) -> str:
        """Cell of a row in the column with a role; empty where there is none."""
        self.used.add(role)
        column = self.columns.get(role)
        cells = row[1]
        return cells[column.index] if column and column.index < len(cells) else ""

    def place(self, row: Row, role: str) -> str:
        """Where a cell stands, to begin a sentence with."""
        return f"{self.path}: line {row[0]}, column {self.columns[role].heading!r},"

    def check_length(self, row: Row, roles: Sequence[str]) -> None:
        """Refuse a row without a cell for each of the roles, or with more cells than the heading.

        Raises
        ------
        ObsplanError
            Names the line.
        """
        number, cells = row
        where = f"{self.path}: line {number}"
        least = max(self.columns[role].index for role in roles) + 1
        width = len(self.heading) or least
        if len(cells) < least:
            raise ObsplanError(
                f"{where} has too few columns, {len(cells)} of the heading's {width}: complete "
                "the line"
            )
        if self.heading and any(cells[width:]):
            raise ObsplanError(
                f"{where} has too many columns, {len(cells)} for the heading's {width}: "
                "quote cells that hold the delimiter, as decimal commas do"
            )

    def point(self, row: Row) -> Point:
        """Latitude and longitude [degrees], or east and north [m], of a row.

        Raises
        ------
        ObsplanError
            Not coordinates; names the line.
        """
        where = f"{self.path}: line {row[0]}"
        if self.pair == PAIRS[0]:
            lat = self._degrees(row, "lat", "north or south")
            return check_latlon(lat, self._degrees(row, "lon", "east or west"), where, _ORDER)
        return check_local(self._scaled(row, "east"), self._scaled(row, "north"), where)

    def _scaled(self, row: Row, role: str) -> float:
        """Number in a cell, in our unit."""
        number = read_number(pointed(self.cell(row, role)), self.place(row, role))
        return number * self.columns[role].factor

    def _degrees(self, row: Row, role: str, hemisphere: str) -> float:
        """Angle [degrees] in a cell and the columns of minutes, seconds and hemisphere beside."""
        text, where = pointed(self.cell(row, role)), self.place(row, role)
        if is_plain(text):
            angle, letter = read_number(text, where), ""
        else:
            angle, letter = read_angle(text, where)
        beside = self._minutes(row, role, angle)
        angle += math.copysign(beside, -1.0 if text.startswith("-") else 1.0)
        letters = letter + self.cell(row, hemisphere)[:1].upper()
        if letters == "":
            return angle
        positive, negative = _LETTERS[hemisphere]
        if not set(letters) <= {positive, negative}:
            raise ObsplanError(
                f"{where} must be {hemisphere}, got the letter {letters!r}: {_ORDER}"
            )
        if letter == "" and letters == negative:
            if angle < 0:
                raise ObsplanError(f"{where} is negative and {letters}: leave one of them out")
            return -angle
        return angle

    def _minutes(self, row: Row, role: str, angle: float) -> float:
        """Degrees that the columns of minutes and seconds add to an angle."""
        degrees = 0.0
        for part, per_degree in ((f"{role} minutes", 60.0), (f"{role} seconds", 3600.0)):
            if part in self.columns:
                value = read_number(pointed(self.cell(row, part)), self.place(row, part))
                if not 0 <= value < 60 or not angle.is_integer():
                    raise ObsplanError(
                        f"{self.place(row, part)} must be 0 to 60 beside whole degrees, got "
                        f"{value} beside {angle}: correct it"
                    )
                degrees += value / per_degree
        return degrees

    def numbers(self, rows: Sequence[Row], role: str) -> list[float] | None:
        """Numbers in a column, in our unit, nan for an empty cell; None if one is anything else."""
        factor = self.columns[role].factor
        try:
            texts = [pointed(self.cell(row, role)) for row in rows]
            return [read_number(text, "") * factor if text else math.nan for text in texts]
        except ObsplanError:
            return None

    def times(self, rows: Sequence[Row]) -> list[float] | None:
        """Times [s] in their column, nan where a cell is empty; None if a cell is something else.

        Numbers are times if the heading gives their unit, or if they can only count from 1970;
        texts are in ISO 8601.
        """
        numbers = self.numbers(rows, "time")
        if numbers is not None and (
            self.columns["time"].unit not in _NO_UNIT or _since_1970(numbers)
        ):
            return numbers
        texts = [self.cell(row, "time") for row in rows]
        times = [seconds_of(text) if text else math.nan for text in texts]
        readable = all(
            text == "" or math.isfinite(time) for text, time in zip(texts, times, strict=True)
        )
        return times if readable else None


def _since_1970(numbers: Sequence[float]) -> bool:
    """Whether numbers are seconds since 1970, from 1985 to 2128."""
    return all(math.isnan(number) or 5e8 < number < 5e9 for number in numbers)


def pointed(text: str) -> str:
    """A number with a decimal point and a plain minus."""
    text = text.replace("\N{MINUS SIGN}", "-")
    return text.replace(",", ".") if text.count(",") == 1 and "." not in text else text
