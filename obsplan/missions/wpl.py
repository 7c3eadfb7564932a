"""Waypoint files (`QGC WPL 110`), as Mission Planner, MAVProxy, QGroundControl and we write."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from obsplan.missions.mavlink import build_mission
from obsplan.missions.mavlink.commands import FLOWN, LARGEST, Command
from obsplan.missions.mavlink.items import Item, collect, whole_number
from obsplan.missions.mission import Mission
from obsplan.missions.source import read_text
from obsplan.types import ObsplanError

_HEADING = ["QGC", "WPL"]
_WITH_HOME, _WITHOUT_HOME = "110", "120"  # 120: by QGroundControl for a while, without a home
_COLUMNS = 12  # index, current, frame, command, seven parameters, autocontinue
_COMMENT = re.compile(r"(#|//).*")
_GLOBAL = 0  # MAV_FRAME
_NO_COMMAND = 0  # Mission Planner's, at times, in the row of the home


def read_wpl(path: Path | str) -> Mission:
    """Read the mission or the fence of a waypoint file.

    Tabs or blanks separate the columns; blank lines and comments after # or // are passed over.
    Row 0 is the home if the version is 110 and it is a waypoint (command 16) in frame 0, or has
    command 0, as ground stations write it. The home is neither flown to nor the origin: it is
    where the vehicle was when the file was saved. Any other row 0 is an item like the others.

    Raises
    ------
    ObsplanError
        Not such a file, a row that is none, or a value that is not what it should be; names the
        line.
    """
    path = Path(path)
    lines = _lines(read_text(path))
    version = _version(path, next(lines, (1, ""))[1])
    rows = collect((_read_row(path, number, text) for number, text in lines), path)
    items, renumbered = _in_order(rows)
    doubts: tuple[str, ...] = ()
    if items and _is_home(version, items[0]):
        doubts = (f"{items.pop(0).place}, row 0, is the home, where the vehicle was: not flown to",)
    elif items and version == _WITH_HOME and items[0].number == 0 and items[0].command in FLOWN:
        doubts = (f"{items[0].place}, row 0, is not a home (command 16, frame 0), and flown to",)
    return build_mission(path, items, remarks=(*renumbered, *doubts))


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Numbered lines without their comments; blank ones are left out."""
    for number, line in enumerate(text.splitlines(), start=1):
        content = _COMMENT.sub("", line).strip()
        if content:
            yield number, content


def _version(path: Path, heading: str) -> str:
    """Version in the first line."""
    words = heading.upper().split()
    if words[:2] != _HEADING:
        raise ObsplanError(
            f'{path} does not begin with "QGC WPL 110": it is not a waypoint file of Mission '
            "Planner or QGroundControl, save the mission again or rename the file to what it is, "
            "say .csv"
        )
    version = " ".join(words[2:])
    if version not in (_WITH_HOME, _WITHOUT_HOME):
        raise ObsplanError(
            f"{path} is a waypoint file of version {version[:20]!r}, and 110 can be read: "
            "load it in Mission Planner or QGroundControl, and save it again"
        )
    return version


def _read_row(path: Path, line: int, text: str) -> Item:
    """One row; the columns current and autocontinue say nothing of where the vehicle goes."""
    place = f"line {line}"
    where = f"{path}: {place}"
    cells = text.split()
    if len(cells) != _COLUMNS:
        raise ObsplanError(
            f"{where} has {len(cells)} columns, and a row has {_COLUMNS}: "
            "it may be cut short, save the mission again"
        )
    index, _, frame, command, *values = (
        _number(cell, f"{where}, column {column},")
        for column, cell in enumerate(cells[:-1], start=1)
    )
    return Item(
        path=path,
        place=place,
        command=whole_number(command, f"{where}, command,", LARGEST),
        frame=whole_number(frame, f"{where}, frame,", LARGEST),
        values=tuple(values),
        number=whole_number(index, f"{where}, index,", LARGEST),
    )


def _number(cell: str, where: str) -> float:
    """Number in a cell, nan and infinities as well; they are refused where they are used."""
    try:
        if cell.isascii() and "_" not in cell:  # digits of other scripts, and 1_000
            return float(cell)
    except ValueError:
        pass
    raise ObsplanError(f"{where} must be a number, got {cell[:40]!r}: correct it")


def _in_order(items: list[Item]) -> tuple[list[Item], tuple[str, ...]]:
    """Number items by their order, as ground stations do; say so if the file's order differs."""
    first = items[0].number or 0 if items else 0
    numbers = range(first, first + len(items))
    if [item.number for item in items] == list(numbers):
        return items, ()
    ordered = [replace(item, number=n) for item, n in zip(items, numbers, strict=True)]
    return ordered, ("rows are not numbered one after the other, taken in the order of the file",)


def _is_home(version: str, row: Item) -> bool:
    """Whether the first row is the home."""
    waypoint = row.command == Command.NAV_WAYPOINT and row.frame == _GLOBAL
    return version == _WITH_HOME and row.number == 0 and (waypoint or row.command == _NO_COMMAND)
