"""How a store is laid out, and the digests by which damage to it is told.

Every row carries a digest of its values; of a mission's row the key of its cell is one of them.
For the plan and for the missions the store keeps the number of rows and the exclusive or of their
digests, in the same transaction as the rows: a row that is lost is told, too.
"""

import hashlib
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from obsplan.campaign.worker import Outcome

DIGEST = 16  # bytes
FIGURES = (
    "rms_error_m",
    "rms_error_late_m",
    "max_error_m",
    "mean_nees",
    "pcrb_rms_m",
    "pcrb_rms_late_m",
    "separation_mean_m",
    "separation_max_m",
    "violation_max_m",
)
LAYOUT = (
    # as last planned
    "CREATE TABLE scenario (name TEXT PRIMARY KEY, base TEXT NOT NULL, digest BLOB NOT NULL) "
    "WITHOUT ROWID",
    "CREATE TABLE varied (key TEXT PRIMARY KEY, digest BLOB NOT NULL) WITHOUT ROWID",
    (
        "CREATE TABLE cell (id INTEGER PRIMARY KEY, key TEXT UNIQUE NOT NULL, base TEXT NOT NULL, "
        "scenario TEXT NOT NULL,\n"
        "       planner TEXT NOT NULL, content TEXT NOT NULL, digest BLOB NOT NULL)"
    ),
    (
        "CREATE TABLE mission (cell INTEGER NOT NULL REFERENCES cell, seed INTEGER NOT NULL, "
        "error TEXT,\n"
        f"       {', '.join(f'{name} REAL' for name in FIGURES)}, auv TEXT NOT NULL, "
        "status_counts TEXT NOT NULL,\n"
        "       digest BLOB NOT NULL, PRIMARY KEY (cell, seed)) WITHOUT ROWID"
    ),
    (
        "CREATE TABLE total (part TEXT PRIMARY KEY, number INTEGER NOT NULL, "
        "content BLOB NOT NULL,\n"
        "       digest BLOB NOT NULL) WITHOUT ROWID"
    ),
)
# how the file says that it is ours, and in this layout
FORMAT = zlib.crc32("".join(LAYOUT).encode()) >> 1
COLUMNS = ("cell", "seed", "error", *FIGURES, "auv", "status_counts", "digest")
# of each table, in the order in which they are read, the columns of its primary key
KEYS = {"scenario": ("name",), "varied": ("key",), "cell": ("id",), "mission": ("cell", "seed")}
PLAN, MISSIONS = "plan", "missions"  # the two parts that have a total


def sealed(*values: Any) -> tuple[Any, ...]:
    """A row and its digest."""
    return (*values, digest_of(*values))


def digest_of(*values: Any) -> bytes:
    """Digest of what SQLite holds; it tells faults of disks and copies, not forgery."""
    exact = repr(values).encode(errors="backslashreplace")
    return hashlib.blake2b(exact, digest_size=DIGEST).digest()


def mission_digest(key: str | None, row: tuple[Any, ...]) -> bytes:
    """Digest of a mission's row, as `COLUMNS` without the digest, of the cell of this key."""
    return digest_of(key, *row[1:])


def row_of(cell: int, key: str, outcome: Outcome) -> tuple[Any, ...]:
    """A mission as `COLUMNS`; of a failure there are no figures."""
    figures = [as_kept(outcome.figures.get(name)) for name in FIGURES]
    row = (cell, outcome.seed, outcome.error, *figures, outcome.auv, outcome.status_counts)
    return (*row, mission_digest(key, row))


def as_kept(figure: float | None) -> float | None:
    """A number as SQLite gives it back: without nan, and without the sign of 0."""
    if figure is None or figure != figure:
        return None
    return float(figure) + 0.0


@dataclass
class Total:
    """How many rows there are, and the exclusive or of their digests."""

    number: int = 0
    content: int = 0

    @classmethod
    def of(cls, digests: Iterable[bytes]) -> "Total":
        """The total of rows with these digests."""
        total = cls()
        for digest in digests:
            total.add(digest)
        return total

    @classmethod
    def read(cls, row: tuple[Any, ...]) -> "Total | None":
        """The total in a row of its table; None if the row is damaged."""
        if row != sealed(*row[:-1]):
            return None
        return cls(row[1], int.from_bytes(row[2], "big"))

    def add(self, digest: bytes) -> None:
        """Count a row."""
        self.number += 1
        self.content ^= int.from_bytes(digest, "big")

    def remove(self, digest: bytes) -> None:
        """Count a row no more."""
        self.number -= 1
        self.content ^= int.from_bytes(digest, "big")

    def row(self, part: str) -> tuple[Any, ...]:
        """The row of its table."""
        return sealed(part, self.number, self.content.to_bytes(DIGEST, "big"))
