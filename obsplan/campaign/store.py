"""The embedded store of a campaign: SQLite, one file, ``campaign.sqlite``.

SQLite because a commit in it is all or nothing and, once made, outlives a kill or a loss of power
at any instant (it is tested for just that), because two processes may use it at once, because
Python brings it, and because every language reads it. It keeps its rollback journal rather than a
write-ahead log: the log needs memory shared between processes, which the network folders of
clusters do not have.
"""

import json
import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from obsplan.campaign.plan import Cell
from obsplan.campaign.worker import Outcome
from obsplan.types import ObsplanError

FILE = "campaign.sqlite"
TABLES = PARQUET, CSV = "campaign.parquet", "campaign.csv"  # beside it
PATIENCE = 600.0  # [s] to wait for another campaign's commit or export
BLOCK = 10_000  # seeds or rows looked at together: memory does not grow with the campaign
FIGURES = (
    "rms_error_m",
    "max_error_m",
    "mean_nees",
    "pcrb_rms_m",
    "separation_mean_m",
    "separation_max_m",
    "violation_max_m",
)

LAYOUT = (
    "CREATE TABLE scenario (name TEXT PRIMARY KEY, base TEXT NOT NULL)",  # as last planned
    "CREATE TABLE varied (key TEXT PRIMARY KEY)",
    (
        "CREATE TABLE cell (id INTEGER PRIMARY KEY, key TEXT UNIQUE NOT NULL, base TEXT NOT NULL, "
        "scenario TEXT NOT NULL,\n"
        "       planner TEXT NOT NULL, content TEXT NOT NULL)"
    ),
    (
        "CREATE TABLE mission (cell INTEGER NOT NULL REFERENCES cell, seed INTEGER NOT NULL, "
        "error TEXT,\n"
        f"       {', '.join(f'{name} REAL' for name in FIGURES)}, auv TEXT NOT NULL, "
        "status_counts TEXT NOT NULL,\n"
        "       PRIMARY KEY (cell, seed)) WITHOUT ROWID"
    ),
)
# how the file says that it is ours, and in this layout
FORMAT = zlib.crc32("".join(LAYOUT).encode()) >> 1
COLUMNS = ("cell", "seed", "error", *FIGURES, "auv", "status_counts")
ANEW = ", ".join(f"{name} = excluded.{name}" for name in COLUMNS[2:])
# a success stays; a failure gives way to the next attempt
ADD = f"""INSERT INTO mission ({", ".join(COLUMNS)}) VALUES ({", ".join("?" * len(COLUMNS))})
    ON CONFLICT DO UPDATE SET {ANEW} WHERE mission.error IS NOT NULL"""
# not those of a scenario, or of code that flies, since changed
CURRENT = "cell JOIN scenario ON scenario.name = cell.scenario AND scenario.base = cell.base"


class Store:
    """Results of missions by cell and seed; used as a context manager.

    Raises
    ------
    ObsplanError
        From any method: the file cannot be opened, read or written, or is not a campaign's.
    """

    def __init__(self, folder: Path):
        self.path = folder / FILE
        with self._explained():
            self._connection = sqlite3.connect(self.path, timeout=PATIENCE, isolation_level=None)
            try:
                if self._one("PRAGMA application_id") != FORMAT:
                    self._lay_out()
            except BaseException:
                self._connection.close()
                raise

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def _lay_out(self) -> None:
        with self._transaction():
            if self._one("PRAGMA application_id") == FORMAT:  # another campaign was quicker
                return
            if self._one("SELECT count(*) FROM sqlite_master"):
                raise ObsplanError(
                    f"{self.path} is not a store of this version's campaigns; choose another folder"
                )
            for statement in (*LAYOUT, f"PRAGMA application_id = {FORMAT}"):
                self._connection.execute(statement)

    def enter(self, cells: Iterable[Cell]) -> list[int]:
        """Note what is planned and return the cells' numbers.

        From now on earlier contents of these scenarios, and results of other code, are left out
        of tables.
        """
        with self._explained(), self._transaction():
            return [self._enter(cell) for cell in cells]

    def _enter(self, cell: Cell) -> int:
        run = self._connection.execute
        run("INSERT OR REPLACE INTO scenario VALUES (?, ?)", (cell.scenario, cell.base))
        self._connection.executemany(
            "INSERT OR IGNORE INTO varied VALUES (?)",
            [(setting.partition("=")[0],) for setting in cell.settings],
        )
        run(
            "INSERT INTO cell (key, base, scenario, planner, content) VALUES (?, ?, ?, ?, ?) "
            "ON CONFLICT (key) DO UPDATE SET base = excluded.base",
            (cell.key, cell.base, cell.scenario, cell.planner, cell.content),
        )
        return int(self._one("SELECT id FROM cell WHERE key = ?", cell.key))

    def missing(self, cell: int, seeds: range) -> Iterator[int]:
        """Seeds not yet flown, or flown in vain, looked up a block at a time."""
        for start in range(seeds.start, seeds.stop, BLOCK):
            block = range(start, min(start + BLOCK, seeds.stop))
            done = (
                "SELECT seed FROM mission WHERE cell = ? AND seed BETWEEN ? AND ? AND error IS NULL"
            )
            there = {seed for (seed,) in self._all(done, cell, block[0], block[-1])}
            yield from (seed for seed in block if seed not in there)

    def count(self, cell: int, seeds: range) -> int:
        """Number of missions flown with success."""
        done = (
            "SELECT count(*) FROM mission WHERE cell = ? AND seed BETWEEN ? AND ? AND error IS NULL"
        )
        return int(self._all(done, cell, seeds[0], seeds[-1])[0][0])

    def add(self, flown: Sequence[tuple[int, Outcome]]) -> None:
        """Keep outcomes of missions of cells, all or none."""
        rows = [row_of(cell, outcome) for cell, outcome in flown]
        with self._explained(), self._transaction():
            self._connection.executemany(ADD, rows)

    def failures(self, cell: int, seeds: range) -> list[tuple[int, str]]:
        """Seeds of a cell whose missions failed, with the reasons."""
        failed = (
            "SELECT seed, error FROM mission WHERE cell = ? AND seed BETWEEN ? AND ? "
            "AND error IS NOT NULL ORDER BY seed"
        )
        return self._all(failed, cell, seeds[0], seeds[-1])

    def current_cells(self) -> list[tuple[int, str, str, dict[str, Any]]]:
        """Number, scenario, planner and content of the cells of scenarios as last planned."""
        rows = self._all(f"SELECT id, cell.scenario, planner, content FROM {CURRENT}")
        return [
            (number, scenario, planner, json.loads(content))
            for number, scenario, planner, content in rows
        ]

    def set_aside(self) -> int:
        """Number of missions flown by other code, or in scenarios as they were before."""
        others = f"SELECT count(*) FROM mission WHERE cell NOT IN (SELECT id FROM {CURRENT})"
        return int(self._all(others)[0][0])

    def varied_keys(self) -> list[str]:
        """Keys that were ever varied, in order."""
        return [key for (key,) in self._all("SELECT key FROM varied ORDER BY key")]

    def rows(self, cell: int) -> Iterator[tuple[Any, ...]]:
        """Missions of a cell by seed, as `COLUMNS` from the seed on."""
        query = (
            f"SELECT {', '.join(COLUMNS[1:])} FROM mission WHERE cell = ? AND seed > ? "
            f"ORDER BY seed LIMIT {BLOCK}"
        )
        after = -1
        while block := self._all(query, cell, after):
            yield from block
            after = block[-1][0]

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Keep other campaigns from writing meanwhile: of two exports the later has everything."""
        with self._explained(), self._transaction():
            yield

    def _one(self, query: str, *values: Any) -> Any:
        return self._connection.execute(query, values).fetchone()[0]

    def _all(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        with self._explained():
            return self._connection.execute(query, values).fetchall()

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """All that is done inside, or nothing."""
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:  # some faults have rolled it back already
                self._connection.execute("ROLLBACK")
            raise

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn SQLite's errors into one sentence."""
        try:
            yield
        except sqlite3.Error as error:
            fault = getattr(error, "sqlite_errorname", "")
            told = placed_wrong(self.path, fault) or f"{error}; {remedy(fault)}"
            raise ObsplanError(f"{self.path}: {told}") from error


def row_of(cell: int, outcome: Outcome) -> tuple[Any, ...]:
    """A mission as `COLUMNS`; of a failure there are no figures."""
    figures = [outcome.figures.get(name) for name in FIGURES]
    return (cell, outcome.seed, outcome.error, *figures, outcome.auv, outcome.status_counts)


def no_store(folder: Path, otherwise: str, remedy: str) -> ObsplanError:
    """What is wrong with a folder that has no store.

    Where a campaign's table is left, the store was moved; else it is what ``otherwise`` says.
    """
    if any((folder / name).exists() for name in TABLES):
        return ObsplanError(
            f"{folder} has a campaign's table but not its store, which was moved or removed: "
            f"put {FILE} back, or {remedy}"
        )
    return ObsplanError(f"{folder} {otherwise}; {remedy}")


def placed_wrong(path: Path, fault: str) -> str | None:
    """What is wrong with a store's place, and the remedy, where a fault of SQLite comes of that."""
    if fault == "SQLITE_READONLY_DBMOVED":
        return (
            "was moved or removed while the campaign ran; "
            "put it back, and the same command goes on from there"
        )
    if not fault.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN", "SQLITE_PERM")):
        return None
    if path.is_dir():
        return "is a folder, and a campaign's store is a file; choose another folder"
    if path.exists() and not os.access(path, os.R_OK):
        return "may not be read; make it readable and writable, or choose another folder"
    if path.exists() and not os.access(path, os.W_OK):
        return "is read-only; make it writable, or choose another folder"
    if not os.access(path.parent, os.W_OK):
        return "lies in a folder that is read-only; make that writable, or choose another folder"
    return None


def remedy(fault: str) -> str:
    """What to do about a fault of SQLite, by its name."""
    kept = "what was flown is kept, and the same command goes on from there"
    known = {
        "SQLITE_FULL": f"free some space: {kept}",
        "SQLITE_IOERR": f"see that the disk has space and works: {kept}",
        "SQLITE_READONLY": "make it and its folder writable, or choose another folder",
        "SQLITE_CANTOPEN": "make its folder writable, or choose another folder",
        "SQLITE_NOTADB": "this file is no campaign's: choose another folder",
        "SQLITE_BUSY": "another program keeps it locked: end that one",
    }
    return next(
        (advice for name, advice in known.items() if fault.startswith(name)),
        "choose another folder, or a copy of this file",
    )
