"""A connection to SQLite that a signal ends even while it waits for another program."""

import logging
import sqlite3
from pathlib import Path
from time import monotonic, sleep
from typing import Any

PATIENCE = 600.0  # [s] to wait for another campaign's commit or export
PAUSE = 0.05  # [s] between two tries
SILENCE = 10.0  # [s] of waiting before it is said

log = logging.getLogger("obsplan")


class PatientConnection(sqlite3.Connection):
    """Repeat a statement while another program keeps the file locked.

    SQLite's own wait would be deaf: Python hears of a signal only when a statement returns.
    """

    path: Path  # to name in what is said

    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        """Carry out a statement.

        Raises
        ------
        sqlite3.Error
            It fails, or the file is locked for longer than `PATIENCE`.
        """
        began = monotonic()
        said = False
        while True:
            try:
                return super().execute(sql, parameters)
            except sqlite3.OperationalError as error:
                waited = monotonic() - began
                if not is_locked(error) or waited > PATIENCE:
                    raise
            if waited > SILENCE and not said:
                log.warning("%s is locked by another program; waiting for it", self.path)
                said = True
            sleep(PAUSE)


def connected(path: Path) -> PatientConnection:
    """Open a file that is there; without the right to write, SQLite opens it for reading."""
    place = f"{path.absolute().as_uri()}?mode=rw"
    connection = sqlite3.connect(
        place, uri=True, timeout=0.0, isolation_level=None, factory=PatientConnection
    )
    connection.path = path
    return connection


def is_locked(error: sqlite3.Error) -> bool:
    """Whether a statement may succeed when another program is done."""
    return getattr(error, "sqlite_errorname", "").startswith("SQLITE_BUSY")
