"""Whether a store says what was written into it, and what can be saved where it does not."""

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from obsplan.campaign.layout import (
    FORMAT,
    KEYS,
    LAYOUT,
    MISSIONS,
    PLAN,
    Total,
    digest_of,
    mission_digest,
)

SMALLEST_ROW = 16  # bytes, a digest: a torn file in which pages follow each other in a circle
Row = tuple[Any, ...]


@dataclass(frozen=True, kw_only=True)
class Damage:
    """What is wrong with a store."""

    kept: int  # missions that are as they were written
    lost: int | None  # missions that are not; None if their number is not known
    structure: str | None  # what SQLite says of the file

    @property
    def sentence(self) -> str:
        """What a user has to know, after "is" or "was"."""
        if self.lost is None:
            what = f"an unknown number of missions, besides {self.kept} that are sound"
        else:
            what = f"{self.lost} of {self.lost + self.kept} missions"
        if self.lost == 0:
            what = f"none of its {self.kept} missions, but what lies beside them"
        structure = f"; SQLite says: {self.structure}" if self.structure else ""
        return f"damaged: {what}{structure}"


def damage_of(connection: sqlite3.Connection) -> Damage | None:
    """What is wrong with a store; None if everything is as it was written."""
    structure = structural_fault(connection)
    found, all_sound = totals(connection)
    recorded = recorded_totals(connection)
    if structure is None and all_sound and found == recorded:
        return None
    rescued = rescue(connection)
    kept = int(rescued.execute("SELECT count(*) FROM mission").fetchone()[0])
    rescued.close()
    written = recorded.get(MISSIONS)
    lost = None if written is None else max(0, written.number - kept)
    return Damage(kept=kept, lost=lost, structure=structure)


def structural_fault(connection: sqlite3.Connection) -> str | None:
    """The first thing that SQLite's own check finds, or None."""
    try:
        said = str(connection.execute("PRAGMA integrity_check(1)").fetchone()[0])
    except sqlite3.Error as error:
        return str(error)
    return None if said == "ok" else " ".join(said.removeprefix("*** in database main ***").split())


def totals(connection: sqlite3.Connection) -> tuple[dict[str, Total], bool]:
    """The totals of the sound rows by part, and whether all rows are sound."""
    found = {PLAN: Total(), MISSIONS: Total()}
    all_sound = True
    for table, row, is_sound in rows(connection):
        if is_sound:
            found[part_of(table)].add(row[-1])
        else:
            all_sound = False
    return found, all_sound


def recorded_totals(connection: sqlite3.Connection) -> dict[str, Total]:
    """The totals by part as they were written, those left out that are damaged themselves."""
    recorded: dict[str, Total] = {}
    with suppress(sqlite3.Error):
        for row in connection.execute("SELECT * FROM total"):
            total = Total.read(row)
            if total is not None:
                recorded[row[0]] = total
    return recorded


def part_of(table: str) -> str:
    """The part to which a table's rows are counted."""
    return MISSIONS if table == "mission" else PLAN


def rows(connection: sqlite3.Connection) -> Iterator[tuple[str, Row, bool]]:
    """Table, row, and whether it is as it was written, of all that can be read."""
    keys: dict[int, str] = {}
    for table in KEYS:
        for row in readable(connection, table):
            if table == "mission":
                digest = mission_digest(keys.get(row[0]), row[:-1])
            else:
                digest = digest_of(*row[:-1])
            is_sound = row[-1] == digest
            if table == "cell" and is_sound:
                keys[row[0]] = row[1]
            yield table, row, is_sound


def readable(connection: sqlite3.Connection, table: str) -> Iterator[Row]:
    """Rows of a table, of a torn one those before the first tear and those after the last.

    Some of a torn one may come twice.
    """
    size = pragma(connection, "page_size") * pragma(connection, "page_count")
    most = size // SMALLEST_ROW
    for order in ("ASC", "DESC"):
        by = ", ".join(f"{column} {order}" for column in KEYS[table])
        try:
            yield from connection.execute(f"SELECT * FROM {table} ORDER BY {by} LIMIT {most}")
        except sqlite3.Error:
            continue
        return


def pragma(connection: sqlite3.Connection, name: str) -> int:
    """A number that SQLite has of the file."""
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])


def rescue(connection: sqlite3.Connection) -> sqlite3.Connection:
    """A new store, without a name, of all that is sound in another."""
    rescued = sqlite3.connect("", isolation_level=None)
    rescued.execute("BEGIN")
    lay_out(rescued)
    sound = ((table, row) for table, row, is_sound in rows(connection) if is_sound)
    for table, row in sound:
        values = ", ".join("?" * len(row))
        rescued.execute(f"INSERT OR IGNORE INTO {table} VALUES ({values})", row)
    found, _ = totals(rescued)
    for part, total in found.items():
        write_total(rescued, part, total)
    rescued.execute("COMMIT")
    return rescued


def lay_out(connection: sqlite3.Connection) -> None:
    """Make the tables of an empty store."""
    for statement in (*LAYOUT, f"PRAGMA application_id = {FORMAT}"):
        connection.execute(statement)
    for part in (PLAN, MISSIONS):
        write_total(connection, part, Total())


def write_total(connection: sqlite3.Connection, part: str, total: Total) -> None:
    """Record a part's total."""
    connection.execute("INSERT OR REPLACE INTO total VALUES (?, ?, ?, ?)", total.row(part))
