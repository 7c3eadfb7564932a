"""One campaign at a time in a folder: two would fly the same missions twice."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from obsplan.types import ObsplanError

LOCK = ".campaign.lock"  # beside the store, while a campaign runs


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep a campaign's folder for this process.

    The system lets go of it when the process ends, however it ends. Where a file system has no
    locks, two campaigns are not told from each other, and SQLite keeps their store sound.

    Raises
    ------
    ObsplanError
        Another process has it; the sentence says which.
    """
    path = folder / LOCK
    try:
        file = locked(path, folder)
    except OSError:  # the store, which cannot be written either, says why
        yield
        return
    with file:
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}")
        file.flush()
        try:
            yield
        finally:
            with suppress(OSError):  # Windows removes no file that is open
                path.unlink()


def locked(path: Path, folder: Path) -> TextIO:
    """Open a file and lock it; anew if another process has removed it in between."""
    while True:
        file = path.open("a+", encoding="utf-8")
        try:
            take(file, folder)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                    return file
        except BaseException:
            file.close()
            raise
        file.close()


def take(file: TextIO, folder: Path) -> None:
    """Lock a file, or say who has."""
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.seek(0)
        who = file.read() or "it does not say which"
        raise ObsplanError(
            f"another campaign is at work in {folder} ({who}); let it finish or end it, "
            "and the same command goes on from there; `--scheduler` shares work among hosts"
        ) from None
    except OSError:  # no locks there
        return
