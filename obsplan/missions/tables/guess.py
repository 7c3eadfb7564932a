"""Tell degrees from metres by their values, and the columns of a table that has no heading."""

import numpy as np
from jaxtyping import Float

from obsplan.missions.findings import Findings
from obsplan.missions.tables.angles import is_marked, read_angle
from obsplan.missions.tables.columns import Column
from obsplan.missions.tables.rows import Rows, is_number
from obsplan.types import ObsplanError

_SMALLEST = 0.5  # [m]; of a survey in metres, at its widest
_SMALL = 5.0  # [m]; of one that lies about its origin; in degrees, half a thousand kilometres
_OFFSET = (
    10.0  # a survey in metres lies no farther off than so many times its width, if it is small
)
_ADD = 'add a heading, such as "lat,lon" or "x,y"'


def looks_like_degrees(points: Float[np.ndarray, "n 2"]) -> bool:
    """Whether points fit on Earth as degrees, and make no sense as metres.

    They make none if they hardly spread, or are far off and either small or finer than 1 mm.
    """
    sizes = np.abs(points).max(axis=0)
    if sizes.min() > 90 or sizes.max() > 360:
        return False
    width = np.ptp(points, axis=0).max()
    far_off = sizes.max() > _OFFSET * width
    fine = not np.allclose(points, points.round(3), rtol=0.0, atol=1e-9)
    return bool(0 < width < _SMALLEST or (width > 0 and far_off and (width < _SMALL or fine)))


def guess_columns(table: Rows, found: Findings) -> dict[str, Column]:
    """Columns of a table without a heading by their values, which a remark says.

    Hemisphere letters tell latitude from longitude; else degrees are latitude first, unless that
    cannot be, and metres are east first. A first column that counts rows is passed over.

    Raises
    ------
    ObsplanError
        It is not clear which columns are the coordinates, or whether they are degrees or metres.
    """
    width = min(len(cells) for _, cells in table.rows)
    columns = [[cells[i] for _, cells in table.rows] for i in range(width)]
    numeric = [i for i in range(width) if all(map(is_number, columns[i]))]
    if len(numeric) > 2 and _counts(columns[numeric[0]]):
        del numeric[0]
    if not 2 <= len(numeric) <= 3:
        raise ObsplanError(
            f"{found.path} has no heading and {len(numeric)} columns of numbers: {_ADD}"
        )
    first, second = numeric[:2]
    roles = _roles(columns[first], columns[second], str(found.path))
    if not roles:
        raise ObsplanError(
            f"{found.path} has no heading, and its numbers may be degrees or metres: {_ADD}"
        )
    unit = "degrees" if "lat" in roles else "m"
    found.remarks.append(
        f"no heading: columns {first + 1} and {second + 1} are read as {roles[0]} and {roles[1]} "
        f"[{unit}]"
    )
    guessed = {
        role: Column(i, f"column {i + 1}") for role, i in zip(roles, (first, second), strict=True)
    }
    texts = [i for i in range(width) if not any(map(is_number, columns[i]))]
    if len(texts) == 1:
        guessed["name"] = Column(texts[0], f"column {texts[0] + 1}")
    for i in sorted(set(range(width)) - {column.index for column in guessed.values()}):
        found.passed_over("column", "passed over", f"column {i + 1}")
    return guessed


def _counts(cells: list[str]) -> bool:
    """Whether cells count rows one by one."""
    if not all(cell.isdecimal() and len(cell) < 10 for cell in cells):
        return False
    return all(int(cell) == int(cells[0]) + i for i, cell in enumerate(cells))


def _roles(first: list[str], second: list[str], where: str) -> tuple[str, ...]:
    """Roles of two columns; none if they are not clear."""
    angles = [[_value(cell, where) for cell in cells] for cells in (first, second)]
    letters = [{letter for _, letter in column if letter} for column in angles]
    if letters[0] <= {"N", "S"} and letters[1] <= {"E", "W"} and any(letters):
        return "lat", "lon"
    if letters[0] <= {"E", "W"} and letters[1] <= {"N", "S"} and any(letters):
        return "lon", "lat"
    points = np.array([[value for value, _ in column] for column in angles]).T
    if not np.isfinite(points).all():
        return ()
    if looks_like_degrees(points):
        return ("lon", "lat") if np.abs(points[:, 0]).max() > 90 else ("lat", "lon")
    return ("east", "north") if np.ptp(points, axis=0).max() >= _SMALL else ()


def _value(cell: str, where: str) -> tuple[float, str]:
    """Value of a cell, and the letter beside it."""
    if is_marked(cell):
        return read_angle(cell, where)
    return float(cell.replace(",", ".")), ""
