"""CSV tables of points, one row a point, or of geometries in WKT."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from obsplan.missions.findings import MOST_VERTICES, Findings, Vertex
from obsplan.missions.mission import Mission
from obsplan.missions.source import read_loose_text
from obsplan.missions.tables.cells import PAIRS, Row, Table
from obsplan.missions.tables.columns import find_columns
from obsplan.missions.tables.guess import guess_columns, looks_like_degrees
from obsplan.missions.tables.rows import read_rows
from obsplan.missions.tables.wkt import are_degrees, is_wkt, parse_wkt, point_of, read_geometry
from obsplan.missions.timing import lengths
from obsplan.types import ObsplanError

_ODD, _LONG = 5.0, 1000.0  # times the longest of the others, and [m]: a leg that is odd
_VALUES = ("speed", "hold", "time")  # roles, and arguments of `Findings.line`


def read_csv(path: Path | str) -> Mission:
    """Read points under headings of degrees or metres, or geometries in WKT.

    Headings of degrees are lat and lon; of metres x and y, east and north, or easting and
    northing. Commas, semicolons, tabs, bars or blanks separate columns; decimals have a point or a
    comma. Degrees may have minutes, seconds and hemisphere letters, beside them or in columns of
    their own.

    A column track, line, leg, route or vehicle tells tracks apart, as does one called name, unless
    most rows have a name of their own: a waypoint's. Columns of altitude or depth, of the speed
    towards each point, of holds and of times are read, those in other units converted. A table
    without a heading is read where its numbers are clear.

    Raises
    ------
    ObsplanError
        No such headings, a row too short or too long, a value that is no coordinate (names the
        line), or degrees in columns of metres.
    """
    path = Path(path)
    text, remarks = read_loose_text(path)
    if text.count("\n") > 2 * MOST_VERTICES:
        raise ObsplanError(
            f"{path} has more than {2 * MOST_VERTICES} lines: export the mission, not the log of "
            "one"
        )
    rows = read_rows(text, path, _is_heading)
    if not rows.rows:
        raise ObsplanError(f"{path} has a heading but no points: add one line per point")
    found = Findings(path=path, remarks=remarks)
    if rows.preamble:
        found.remarks.append(f"lines before the heading, {rows.preamble} of them, passed over")
    where = f"{path}: line {rows.heading_line}"
    columns = find_columns(rows.heading, where) if rows.heading else guess_columns(rows, found)
    table = Table(path=path, heading=rows.heading, rows=rows.rows, columns=columns)
    ended = text.endswith(("\n", "\r"))
    if "wkt" in columns and any(is_wkt(table.cell(row, "wkt")) for row in table.rows):
        _read_geometries(table, found)
    elif any(set(pair) <= set(columns) for pair in PAIRS):
        _read_points(table, found, ended=ended)
    else:
        heading = columns["wkt"].heading
        raise ObsplanError(f"{where} has a column {heading!r} without WKT: export it as WKT")
    _tell_unused(table, found)
    return found.mission()


def _is_heading(cells: Sequence[str], where: str) -> bool:
    """Whether cells name coordinates."""
    roles = find_columns(cells, where)
    return "wkt" in roles or any(set(pair) <= set(roles) for pair in PAIRS)


def _tell_unused(table: Table, found: Findings) -> None:
    """Remark on the columns that are not read."""
    used = {column.index for role, column in table.columns.items() if role in table.used}
    for index, heading in enumerate(table.heading):
        if index not in used and heading:
            found.passed_over("column", "passed over", heading)


def _read_points(table: Table, found: Findings, *, ended: bool) -> None:
    """Add the tracks of a table of points, whose last line has an end or not."""
    pair = table.pair
    found.geographic = pair == PAIRS[0]
    grouping = _grouping(table, table.rows)
    rows: list[Row] = []
    points: list[Vertex] = []
    for row in table.rows:
        table.check_length(row, [*pair, *grouping])
        if not any(table.cell(row, role) for role in pair):
            found.passed_over("row", "without coordinates passed over")
            continue
        rows.append(row)
        points.append((*table.point(row), math.nan))
    if not found.geographic and points:
        _check_metres(table, np.array(points)[:, :2])
    if not ended and len(rows) > 1:
        _doubt_the_end(table, rows, np.array(points)[:, :2], found)
    _add_tracks(table, rows, points, grouping, found)


def _doubt_the_end(table: Table, rows: Sequence[Row], points: np.ndarray, found: Findings) -> None:
    """Refuse, or remark on, a last line without an end that may be cut within its last number.

    It may be if the number is shorter than all above it; it is if that makes a leg that none of the
    others is like.
    """
    number, cells = rows[-1]
    role = next((r for r in table.pair if table.columns[r].index == len(cells) - 1), None)
    if role is None:
        return
    texts = [table.cell(row, role) for row in rows]
    if len(texts[-1]) >= min(map(len, texts[:-1])):
        return
    legs = lengths(points, geographic=found.geographic)
    said = f"line {number}, the last, has no end, and its {texts[-1]} may be cut short"
    if len(legs) > 1 and legs[-1] > max(_ODD * legs[:-1].max(), _LONG):
        raise ObsplanError(
            f"{table.path}: {said}, for it makes a leg of {legs[-1] / 1e3:.3g} km, unlike the "
            "others: complete the line, or end it with a line break"
        )
    found.remarks.append(said)


def _check_metres(table: Table, points: np.ndarray) -> None:
    """Refuse degrees in columns of metres."""
    if len(points) > 1 and looks_like_degrees(points):
        east, north = (table.columns[role].heading for role in PAIRS[1])
        first = f"({points[0, 0]:g}, {points[0, 1]:g})"
        raise ObsplanError(
            f"{table.path}: columns {east!r} and {north!r} look like degrees, {first} first, "
            "not metres: "
            'head the longitudes "lon" and the latitudes "lat"'
        )


def _grouping(table: Table, rows: Sequence[Row]) -> list[str]:
    """The role of the column that tells tracks apart, if there is one.

    It is a track's name if at least half of the rows share theirs with another; else the names
    are the waypoints'.
    """
    for role in ("track", "name"):
        if role in table.columns:
            index = table.columns[role].index
            names = Counter(cells[index] for _, cells in rows if index < len(cells))
            if sum(count for count in names.values() if count > 1) >= len(rows) / 2:
                return [role]
    return []


def _add_tracks(
    table: Table,
    rows: Sequence[Row],
    points: Sequence[Vertex],
    grouping: list[str],
    found: Findings,
) -> None:
    """Add a track for each value of the column that tells them apart."""
    values = {role: _values(table, rows, role, found) for role in _VALUES}
    heights = _heights(table, rows, found)
    tracks: dict[str, list[int]] = {}
    for i, row in enumerate(rows):
        name = table.cell(row, grouping[0]) if grouping else ""
        tracks.setdefault(name, []).append(i)
    for name, indices in tracks.items():
        vertices = [(*points[i][:2], heights[i] if heights else points[i][2]) for i in indices]
        told = {
            role: [column[i] for i in indices]
            for role, column in values.items()
            if column is not None
        }
        found.line(name or None, vertices, **told)


def _values(table: Table, rows: Sequence[Row], role: str, found: Findings) -> list[float] | None:
    """Values of a column, if there is one and they can be read."""
    if role not in table.columns:
        return None
    values = table.times(rows) if role == "time" else table.numbers(rows, role)
    lowest = 0.0 if role in ("speed", "hold") else -math.inf
    if values is None or any(value < lowest for value in values):
        heading = table.columns[role].heading
        remedy = ": write ISO 8601, or seconds under time_s" if role == "time" else ""
        found.passed_over("column", f"with values that cannot be read passed over{remedy}", heading)
        return None
    return values


def _heights(table: Table, rows: Sequence[Row], found: Findings) -> list[float] | None:
    """Altitudes [m], the depths downwards, if there are any."""
    if "depth" in table.columns:
        depths = _values(table, rows, "depth", found)
        return None if depths is None else [-depth for depth in depths]
    return _values(table, rows, "altitude", found)


def _read_geometries(table: Table, found: Findings) -> None:
    """Add what the geometries of a table are; points one after the other make tracks."""
    rows = [row for row in table.rows if table.cell(row, "wkt")]
    for _ in range(len(table.rows) - len(rows)):
        found.passed_over("row", "without a geometry passed over")
    cells = [table.cell(row, "wkt") for row in rows]
    places = [table.place(row, "wkt") for row in rows]
    geometries = [parse_wkt(cell, place) for cell, place in zip(cells, places, strict=True)]
    found.geographic = are_degrees(geometries, cells)
    points: list[tuple[Row, Vertex]] = []
    for row, geometry, place in zip(rows, geometries, places, strict=True):
        point = point_of(geometry, place, geographic=found.geographic)
        if point is not None:
            points.append((row, point))
            continue
        name = table.cell(row, "track") or table.cell(row, "name")
        texts = [table.cell(row, "kind"), name, table.cell(row, "description")]
        read_geometry(geometry, name, texts, place, found)
    if points:
        grouping = _grouping(table, [row for row, _ in points])
        _add_tracks(
            table, [row for row, _ in points], [vertex for _, vertex in points], grouping, found
        )
