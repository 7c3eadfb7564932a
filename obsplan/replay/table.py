"""A CSV table of a recording: columns by their names, numbers in our units, times."""

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from obsplan.missions.mission import read_number
from obsplan.missions.source import MOST_BYTES, read_loose_text
from obsplan.missions.tables.cells import pointed
from obsplan.missions.tables.rows import read_rows
from obsplan.missions.timing import seconds_of
from obsplan.quantities import Quantity
from obsplan.spelling import visible
from obsplan.types import ObsplanError

MOST_ROWS = 2_000_000
SHOWN = 4  # names of a column in a sentence
LONGEST_NAME = 60  # letters of a vehicle or a beacon
UNITS = {"_s": 1.0, "": 1.0, "_ms": 1e-3, "_us": 1e-6, "_ns": 1e-9}  # of times, by their ending
# of times
INSTANT = Quantity(-1e10, 1e10, "s", "centuries about 1970; milliseconds are time_ms, say")
_MISSING = ("", "nan", "none", "null", "-")


class Table:
    """Rows under names of columns, which are in lower case with `_` between words."""

    def __init__(self, path: Path, needs: Sequence[Sequence[str]]) -> None:
        """Read a file that has, of each of ``needs``, one of the columns.

        Raises
        ------
        ObsplanError
            No such file, no such columns, or too many rows; names the file and the remedy.
        """
        self.path = path
        if path.is_file() and path.stat().st_size > MOST_BYTES:
            raise ObsplanError(
                f"{path} is larger than {MOST_BYTES / 1e6:.0f} MB: thin it out, or split the "
                "recording by time"
            )
        text, self.remarks = read_loose_text(path)
        known = {name for names in needs for name in names}
        asked = " and ".join(_alternatives(names) for names in needs)
        found = read_rows(text, path, lambda cells, _: bool(known & set(map(_plain, cells))), asked)
        self.names = [_plain(cell) for cell in found.heading]
        for names in needs:
            if not set(names) & set(self.names):
                given = ", ".join(visible(name) for name in self.names)[:120]
                raise ObsplanError(
                    f"{path} has no column {_alternatives(names)}, but {given or 'no heading'}: "
                    "name it so"
                )
        if len(found.rows) > MOST_ROWS:
            raise ObsplanError(
                f"{path} has {len(found.rows)} rows, more than {MOST_ROWS}: thin it out"
            )
        self._rows = found.rows

    def __len__(self) -> int:
        return len(self._rows)

    def first_of(self, *names: str) -> str | None:
        """The first of these columns that there is."""
        return next((name for name in names if name in self.names), None)

    def texts(self, name: str) -> list[str]:
        """Cells of a column; empty where a row is too short."""
        at = self.names.index(name)
        return [cells[at] if at < len(cells) else "" for _, cells in self._rows]

    def labels(self, name: str) -> list[str]:
        """Names in a column; whole numbers are the same with or without a point.

        Raises
        ------
        ObsplanError
            A name that is too long, or cannot be printed.
        """
        found = self.texts(name)
        for wrong in {text for text in found if len(text) > LONGEST_NAME or not text.isprintable()}:
            line = self._rows[found.index(wrong)][0]
            raise ObsplanError(
                f"{self.path}: line {line}, column {name} has {visible(wrong)[:40]!r}, and names "
                f"have at most {LONGEST_NAME} letters that can be printed: rename it"
            )
        return [re.sub(r"^(\d+)[.,]0*$", r"\1", text) for text in found]

    def numbers(self, name: str, within: Quantity | None = None) -> Float[np.ndarray, " n"]:
        """Numbers of a column; nan where there is none.

        Raises
        ------
        ObsplanError
            A text, or a number out of the range; names line, column and value.
        """
        texts = self.texts(name)
        try:
            if any("_" in text for text in texts):
                raise ValueError
            found = np.array(texts, dtype=float)
        except ValueError:
            found = np.array([self._number(i, name, text) for i, text in enumerate(texts)])
        found = np.where(np.isinf(found), np.nan, found).reshape(-1)
        if within is not None:
            outside = np.flatnonzero((found < within.least) | (found > within.greatest))
            if outside.size:
                i = int(outside[0])
                raise ObsplanError(
                    f"{self.place(i, name)} must be {within}, got {texts[i]}: correct it, or "
                    "remove the row"
                )
        return found

    def _number(self, row: int, name: str, text: str) -> float:
        """A number with a decimal point or comma; nan for what says that there is none."""
        text = text.strip()
        if text.lower() in _MISSING or text.lower().lstrip("+-") in ("nan", "inf"):
            return math.nan
        return read_number(pointed(text), self.place(row, name))

    def place(self, row: int, name: str) -> str:
        """Where a cell stands, to begin a sentence with."""
        return f"{self.path}: line {self._rows[row][0]}, column {name}"

    def time_column(self, *stems: str) -> str | None:
        """The column of times called so, whatever its unit."""
        return self.first_of(*time_names(*stems))

    def times(self, *stems: str) -> Float[np.ndarray, " n"]:
        """Times [s]: seconds, seconds since 1970, or ISO 8601; nan where there is none.

        Raises
        ------
        ObsplanError
            What is none of these; names line, column and value.
        """
        name = self.time_column(*stems)
        if name is None:
            return np.full(len(self), np.nan)
        texts = self.texts(name)
        seconds = np.array([seconds_of(text) if _is_date(text) else math.nan for text in texts])
        if np.isfinite(seconds).any():
            wrong = [i for i, text in enumerate(texts) if text and math.isnan(seconds[i])]
            if wrong:
                raise ObsplanError(
                    f"{self.place(wrong[0], name)} must be a time in ISO 8601 as others are, got "
                    f"{texts[wrong[0]][:40]!r}: correct it"
                )
            return seconds
        unit = next(unit for unit in ("_ms", "_us", "_ns", "_s", "") if name.endswith(unit))
        if any(_is_date(text) for text in texts):
            raise ObsplanError(
                f"{self.place(0, name)} must be seconds or a time in ISO 8601, got "
                f"{texts[0][:40]!r}: write 2024-05-01T12:00:00Z"
            )
        factor = UNITS[unit]
        within = Quantity(INSTANT.least / factor, INSTANT.greatest / factor, "", INSTANT.reason)
        return self.numbers(name, within) * factor

    def tell_unused(self, used: Sequence[str]) -> str:
        """A sentence on the columns that are not read; empty if all are."""
        unused = [visible(name) for name in self.names if name and name not in used]
        if not unused:
            return ""
        return f"{self.path.name}: columns passed over: {', '.join(unused)[:200]}"


def time_names(*stems: str) -> list[str]:
    """Names that a column of times may have."""
    return [f"{stem}{unit}" for stem in stems for unit in (*UNITS, "_utc", "_iso")]


def kept(keep: Bool[np.ndarray, " n"], *columns: np.ndarray) -> list[np.ndarray]:
    """The same rows of several columns."""
    return [column[keep] for column in columns]


def _alternatives(names: Sequence[str]) -> str:
    """The first of the names that a column may have."""
    return " or ".join(names[:SHOWN])


def _plain(heading: str) -> str:
    """A heading as the columns are named: `Speed (m/s)` is speed_m_s."""
    return re.sub(r"[^a-z0-9]+", "_", heading.lower()).strip("_")


def _is_date(text: str) -> bool:
    """Whether a text is meant as a date."""
    return "-" in text[1:] and ":" in text
