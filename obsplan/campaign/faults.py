"""What is wrong with a campaign's folder or store, in one sentence with its remedy."""

import os
from pathlib import Path

from obsplan.types import ObsplanError

FILE = "campaign.sqlite"
TABLES = PARQUET, CSV = "campaign.parquet", "campaign.csv"  # beside it


def begun_store(path: Path) -> Path:
    """The name under which a store is made; one that was killed meanwhile leaves it."""
    return path.with_name(f".{FILE}.{os.getpid()}.part")


def is_begun_store(name: str) -> bool:
    """Whether a file is, or belongs to, a store that was not made to the end."""
    return name.startswith(f".{FILE}.") and ".part" in name


def empty(path: Path) -> str:
    """What to say of a store of no bytes, which no campaign leaves."""
    return (
        f"{path} is empty: what it held is lost; put a copy of it back, or remove it, and the same "
        "command begins anew"
    )


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
    if fault == "SQLITE_READONLY_ROLLBACK":
        return "holds half a commit, which is undone where it may be written: copy its whole folder"
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
        "SQLITE_NOTADB": "it is no campaign's, or damaged: choose another folder, or a copy",
        "SQLITE_CORRUPT": "it is damaged beyond mending: put a copy of it back, or remove it",
        "SQLITE_BUSY": "another program keeps it locked: end that one",
    }
    return next(
        (advice for name, advice in known.items() if fault.startswith(name)),
        "choose another folder, or a copy of this file",
    )
