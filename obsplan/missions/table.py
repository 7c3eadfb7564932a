"""CSV tables of points: one row a point, tracks by name."""

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path

from obsplan.missions.mission import (
    FARTHEST,
    Draft,
    Mission,
    Point,
    check_latlon,
    check_number,
    named_tracks,
)
from obsplan.missions.source import read_text
from obsplan.types import ObsplanError

# accepted headings, units and case aside; geographic ones first: where a table has both, its metres may have any origin
_GEOGRAPHIC = (("lat", "latitude"), ("lon", "long", "lng", "longitude"))
_LOCAL = (("x", "east"), ("y", "north"))
_UNIT = re.compile(
    r"[\s_\[(]+(m|metres|meters|deg|degrees|°)[\])]*$"
)  # x_m, lat_deg, "east [m]", "lon (deg)"
_DELIMITERS = ",;\t"
_ORDER = "exchange the headings of the two columns"


def read_csv(path: Path | str) -> Mission:
    """Read points under the headings lat, lon (degrees) or x, y or east, north (metres); a column `name` tells tracks apart.

    Commas, semicolons or tabs separate columns; other columns are passed over.

    Raises
    ------
    ObsplanError
        No such headings, a row too short, or a value that is not a coordinate; names the line.
    """
    path = Path(path)
    rows = _rows(path)
    number, headings = next(rows, (1, []))
    columns = [_UNIT.sub("", heading.strip().lower()) for heading in headings]
    geographic, first, second = _find_columns(columns, f"{path}: line {number}")
    named = columns.index("name") if "name" in columns else None
    tracks: dict[str, list[Point]] = {}
    for number, row in rows:
        where = f"{path}: line {number}"
        if len(row) <= max(first, second, named or 0):
            raise ObsplanError(
                f"{where} has too few columns, {len(row)} of the heading's {len(columns)}: complete the line"
            )
        a, b = (
            _number(row[i], f"{where}, column {headings[i].strip()!r},") for i in (first, second)
        )
        point = check_latlon(a, b, where, _ORDER) if geographic else _check_local(a, b, where)
        tracks.setdefault(row[named].strip() if named is not None else "", []).append(point)
    if not tracks:
        raise ObsplanError(f"{path} has a heading but no points: add one line per point")
    drafts = (Draft(name=name, points=points) for name, points in tracks.items())
    named, remarks = named_tracks(path, drafts, geographic=geographic)
    return Mission(tracks=named, geographic=geographic, remarks=remarks)


def _find_columns(columns: list[str], where: str) -> tuple[bool, int, int]:
    """Whether the coordinates are geographic, and the indices of the two columns."""
    for geographic, pair in ((True, _GEOGRAPHIC), (False, _LOCAL)):
        found = [
            next((i for i, column in enumerate(columns) if column in names), None) for names in pair
        ]
        if found[0] is not None and found[1] is not None:
            return geographic, found[0], found[1]
    raise ObsplanError(
        f'{where} must name the columns "lat,lon" or "x,y", got {",".join(columns)[:80]!r}: add such a heading'
    )


def _check_local(east: float, north: float, where: str) -> Point:
    """Return a local point; refuse one that only a map projection gives."""
    if max(abs(east), abs(north)) > FARTHEST:
        remedy = "if these are UTM coordinates, give latitude and longitude instead"
        raise ObsplanError(
            f"{where} has ({east}, {north}) m, more than {FARTHEST / 1e3:.0f} km from the origin: {remedy}"
        )
    return east, north


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Numbered lines that are not blank, split into columns."""
    text = read_text(path)
    heading = text.lstrip().splitlines()[0]
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=max(_DELIMITERS, key=heading.count)
    )
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                yield reader.line_num, row
    except csv.Error as error:
        raise ObsplanError(
            f"{path}: line {reader.line_num} is not CSV ({error}): export the table again"
        ) from error


def _number(cell: str, where: str) -> float:
    """Number in a cell."""
    try:
        return check_number(float(cell), where)
    except ValueError as error:
        raise ObsplanError(
            f"{where} must be a number, got {cell.strip()[:40]!r}: correct it"
        ) from error
