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
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from obsplan.campaign.connection import connected
from obsplan.campaign.faults import FILE, begun_store, empty, placed_wrong, remedy
from obsplan.campaign.integrity import Damage, damage_of, lay_out, rescue, write_total
from obsplan.campaign.layout import (
    COLUMNS,
    FORMAT,
    LAYOUT,
    MISSIONS,
    PLAN,
    Total,
    mission_digest,
    row_of,
    sealed,
)
from obsplan.campaign.plan import Cell
from obsplan.campaign.worker import Outcome
from obsplan.types import ObsplanError

BLOCK = 10_000  # seeds or rows looked at together: memory does not grow with the campaign
ADD = f"INSERT OR REPLACE INTO mission VALUES ({', '.join('?' * len(COLUMNS))})"
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
        self._keys: dict[int, str] = {}  # of cells by number
        with self._explained():
            if not self.path.exists():
                self._make()
            if self.path.is_file() and self.path.stat().st_size == 0:
                raise ObsplanError(empty(self.path))
            self._connection = connected(self.path)
            self._connection.text_factory = decoded
            try:
                self._recognise()
            except BaseException:
                self._connection.close()
                raise

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def _make(self) -> None:
        """Make an empty store, complete or not at all: an empty file is one that lost its content.

        Where another campaign was quicker, its store stays.
        """
        part = begun_store(self.path)
        try:
            with closing(sqlite3.connect(part, isolation_level=None)) as made:
                made.execute("BEGIN")
                lay_out(made)
                made.execute("COMMIT")
            put_in_place(part, self.path)
        except OSError as error:
            raise ObsplanError(
                f"{self.path} cannot be made ({error.strerror}); choose another folder"
            ) from error
        finally:
            with suppress(OSError):
                part.unlink()

    def _recognise(self) -> None:
        """Refuse what is no store, or one of another version."""
        # nothing is written there: it lets a file that was cut be opened, and saved in part
        self._connection.execute("PRAGMA writable_schema = ON")
        if self._one("PRAGMA application_id") == FORMAT:
            tables = "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY rowid"
            if tuple(sql for (sql,) in self._connection.execute(tables)) == LAYOUT:
                return
        raise ObsplanError(
            f"{self.path} is not a store of this version's campaigns; choose another folder, "
            "or put a copy back if it was damaged"
        )

    def damage(self) -> Damage | None:
        """What is not as it was written, after everything has been read; None if all is sound."""
        with self._explained(), self._read():
            return damage_of(self._connection)

    def check(self) -> None:
        """Read everything.

        Raises
        ------
        ObsplanError
            Something is not as it was written.
        """
        damage = self.damage()
        if damage is not None:
            raise ObsplanError(
                f"{self.path} is {damage.sentence}; the campaign's command flies again what is "
                "lost, and `obsplan campaign-check --mend` leaves it out"
            )

    def mend(self) -> Damage | None:
        """Leave out what is damaged, so that it is missing; says what was wrong."""
        damage = self.damage()
        if damage is None:
            return None
        with self._explained(), self._alone(), closing(rescue(self._connection)) as rescued:
            rescued.backup(self._connection)
        return damage

    def enter(self, cells: Iterable[Cell]) -> list[int]:
        """Note what is planned and return the cells' numbers.

        From now on earlier contents of these scenarios, and results of other code, are left out
        of tables.
        """
        with self._explained(), self._transaction():
            numbers = [self._enter(cell) for cell in cells]
            digests = " UNION ALL ".join(
                f"SELECT digest FROM {table}" for table in ("scenario", "varied", "cell")
            )
            planned = Total.of(digest for (digest,) in self._connection.execute(digests))
            write_total(self._connection, PLAN, planned)
            return numbers

    def _enter(self, cell: Cell) -> int:
        run = self._connection.execute
        run("INSERT OR REPLACE INTO scenario VALUES (?, ?, ?)", sealed(cell.scenario, cell.base))
        self._connection.executemany(
            "INSERT OR REPLACE INTO varied VALUES (?, ?)",
            [sealed(setting.partition("=")[0]) for setting in cell.settings],
        )
        number = self._number_of(cell.key)
        row = sealed(number, cell.key, cell.base, cell.scenario, cell.planner, cell.content)
        run("INSERT OR REPLACE INTO cell VALUES (?, ?, ?, ?, ?, ?, ?)", row)
        self._keys[number] = cell.key
        return number

    def _number_of(self, key: str) -> int:
        """The number of a cell that is there, or a new one."""
        there = self._connection.execute("SELECT id FROM cell WHERE key = ?", (key,)).fetchone()
        return int(there[0] if there else self._one("SELECT ifnull(max(id), 0) + 1 FROM cell"))

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
        """Keep outcomes of missions of cells that were entered, all or none.

        A success stays; a failure gives way to the next attempt.
        """
        rows = [row_of(cell, self._keys[cell], outcome) for cell, outcome in flown]
        with self._explained(), self._transaction():
            total = self._total()
            for row in rows:
                self._add(row, total)
            write_total(self._connection, MISSIONS, total)

    def _add(self, row: tuple[Any, ...], total: Total) -> None:
        query = "SELECT error, digest FROM mission WHERE cell = ? AND seed = ?"
        there = self._connection.execute(query, row[:2]).fetchone()
        if there is not None:
            error, digest = there
            if error is None:
                return
            total.remove(digest)
        self._connection.execute(ADD, row)
        total.add(row[-1])

    def _total(self) -> Total:
        """The total of the missions, as recorded."""
        query = "SELECT * FROM total WHERE part = ?"
        row = self._connection.execute(query, (MISSIONS,)).fetchone()
        total = None if row is None else Total.read(row)
        if total is None:
            raise ObsplanError(f"{self.path} was damaged while the campaign ran; repeat it")
        return total

    def failures(self, cell: int, seeds: range) -> list[tuple[int, str]]:
        """Seeds of a cell whose missions failed, with the reasons."""
        failed = (
            "SELECT seed, error FROM mission WHERE cell = ? AND seed BETWEEN ? AND ? "
            "AND error IS NOT NULL ORDER BY seed"
        )
        return self._all(failed, cell, seeds[0], seeds[-1])

    def size(self) -> tuple[int, int]:
        """Number of missions and of cells, whatever became of them."""
        counted = "SELECT (SELECT count(*) FROM mission), (SELECT count(*) FROM cell)"
        missions, cells = self._all(counted)[0]
        return missions, cells

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
        """Missions of a cell by seed, as `COLUMNS` from the seed on, without the digest."""
        key = self._all("SELECT key FROM cell WHERE id = ?", cell)[0][0]
        query = (
            f"SELECT {', '.join(COLUMNS)} FROM mission WHERE cell = ? AND seed > ? "
            f"ORDER BY seed LIMIT {BLOCK}"
        )
        after = -1
        while block := self._all(query, cell, after):
            for *values, digest in block:
                if digest != mission_digest(key, tuple(values)):
                    raise ObsplanError(f"{self.path} was damaged while it was read; repeat it")
                yield tuple(values[1:])
            after = block[-1][1]

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
    def _read(self) -> Iterator[None]:
        """See one state of the store, whatever another campaign writes meanwhile."""
        self._connection.execute("BEGIN")
        try:
            yield
        finally:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep every other campaign out, over several transactions."""
        self._connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        try:
            self._connection.execute("BEGIN EXCLUSIVE")
            self._connection.execute("COMMIT")
            yield
        finally:
            self._connection.execute("PRAGMA locking_mode = NORMAL")
            with suppress(sqlite3.Error):  # which lets the others in
                self._connection.execute("SELECT count(*) FROM sqlite_master")

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn SQLite's errors into one sentence."""
        try:
            yield
        except sqlite3.Error as error:
            fault = getattr(error, "sqlite_errorname", "")
            told = placed_wrong(self.path, fault) or f"{printable(str(error))}; {remedy(fault)}"
            raise ObsplanError(f"{self.path}: {told}") from error
        except UnicodeDecodeError as error:  # SQLite quotes what is damaged
            raise ObsplanError(f"{self.path}: {remedy('SQLITE_CORRUPT')}") from error


def printable(text: str) -> str:
    """A text without what a terminal would obey."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def decoded(text: bytes) -> str:
    """A text of a store; of a damaged one the digest is wrong, too."""
    return text.decode(errors="replace")


def put_in_place(part: Path, path: Path) -> None:
    """Give a store its name, unless another campaign has made one of that name meanwhile."""
    try:
        os.link(part, path)
    except FileExistsError:
        return
    except OSError:  # a file system without links: only there two may begin at the same instant
        part.replace(path)
