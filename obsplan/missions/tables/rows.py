"""Split the text of a table: which delimiter, which lines are comments, where the heading is."""

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from obsplan.missions.source import MOST_BYTES
from obsplan.missions.tables.angles import is_marked
from obsplan.types import ObsplanError

_DELIMITERS = "\t;|, "  # the surest first: numbers may hold commas, names may hold blanks
_COMMENTS = ("#", "//", "%")
_PREAMBLE = 30  # lines before the heading, at most
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)

Line = tuple[int, str]  # its number in the file, from 1, and its text


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """A table: its heading, empty where there is none, and its rows, each with its line number."""

    heading: list[str]
    heading_line: int
    rows: list[tuple[int, list[str]]]
    preamble: int = 0  # lines before the heading


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a point or a comma, or an angle with a mark or a letter."""
    return _NUMBER.fullmatch(cell) is not None or is_marked(cell)


def read_rows(
    text: str,
    path: Path,
    is_heading: Callable[[Sequence[str], str], bool],
    names: str = '"lat,lon" or "x,y"',
) -> Rows:
    """Split a table by the first delimiter that gives it a heading, or numbers in its first line.

    The heading is in its first lines. Lines that start with #, // or % are comments; the last one
    before the first row may be the heading.

    Parameters
    ----------
    is_heading
        Whether cells, from a place in the file, name the columns.
    names
        What such a heading names, for a message.

    Raises
    ------
    ObsplanError
        No such delimiter, or quotes that do not match.
    """
    lines = [(i, line) for i, line in enumerate(text.splitlines(), start=1) if line.strip(" ,;\t|")]
    if lines and re.fullmatch(r"\"?sep=.\"?", lines[0][1].strip()):  # a hint for spreadsheets
        del lines[0]
    data = [line for line in lines if not line[1].lstrip().startswith(_COMMENTS)]
    above = [line for line in lines if not data or line[0] < data[0][0]]
    for number, line in (*above[-1:], *data[:_PREAMBLE]):
        for delimiter in _DELIMITERS:
            cells = _split(line.lstrip(" #/%"), delimiter)
            if is_heading(cells, f"{path}: line {number}"):
                below = [row for row in data if row[0] > number]
                return Rows(
                    heading=cells,
                    heading_line=number,
                    rows=_rows(below, delimiter, path),
                    preamble=sum(row[0] < number for row in data),
                )
    delimiter = _delimiter_of_numbers(data, path, names)
    return Rows(heading=[], heading_line=0, rows=_rows(data, delimiter, path))


def _delimiter_of_numbers(data: Sequence[Line], path: Path, names: str) -> str:
    """The delimiter that makes numbers of the first line of a table without a heading."""
    number, line = data[0] if data else (1, "")
    for everything in (True, False):
        for delimiter in _DELIMITERS:
            cells = _split(line, delimiter)
            numbers = sum(map(is_number, cells))
            if numbers >= 2 and (numbers == len(cells) or not everything):
                return delimiter
    raise ObsplanError(
        f"{path}: line {number} must name the columns {names}, "
        f"got {line.strip()[:80]!r}: add such a heading"
    )


def _split(line: str, delimiter: str) -> list[str]:
    """Cells of one line; none if its quotes do not match."""
    try:
        return _cells([(0, line)], delimiter)[0][1]
    except csv.Error:
        return []


def _rows(lines: Sequence[Line], delimiter: str, path: Path) -> list[tuple[int, list[str]]]:
    """Rows that have any cell."""
    try:
        return [(number, cells) for number, cells in _cells(lines, delimiter) if any(cells)]
    except csv.Error as error:
        raise ObsplanError(f"{path}: {error}: export the table again") from error


def _cells(lines: Sequence[Line], delimiter: str) -> list[tuple[int, list[str]]]:
    """Cells of the rows that lines make, each row with the number of its first line."""
    texts = [line + "\n" for _, line in lines]
    if delimiter == " ":
        texts = [" ".join(text.split()) + "\n" for text in texts]
    reader = csv.reader(texts, delimiter=delimiter, skipinitialspace=True, strict=True)
    longest = csv.field_size_limit(MOST_BYTES)  # a line in WKT is a long cell
    rows: list[tuple[int, list[str]]] = []
    first = 0
    try:
        for cells in reader:
            rows.append((lines[first][0], [cell.strip() for cell in cells]))
            first = reader.line_num
    except csv.Error as error:
        raise csv.Error(f"line {lines[first][0]} is not CSV ({error})") from error
    finally:
        csv.field_size_limit(longest)
    return rows
