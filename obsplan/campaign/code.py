"""The code that flies, as one number: results of one planner are never taken for another's."""

import hashlib
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path

APART = {
    "obsplan": ("cli", "report", "thesis", "missions", "recording.py", "campaign"),
    "formulations": (),
}
SOURCES = (".py", ".c")
FLIES = ("obsplan/campaign/worker.py",)  # though its folder stands apart


@cache
def code_hash(*besides: str) -> str:
    """SHA-256 of the sources that can change what a mission gives; read once per process.

    These are all of ``formulations``, and all of ``obsplan`` but the modules in `APART`, which
    start missions, read surveys, and store, draw or report results. A mission file and a shipped
    scenario decide a mission, too, but the cell's content holds what they say. Versions of other
    packages do not count. ``besides`` are folders of `APART` that shall count, too.
    """
    packages = {name: Path(str(files(name))) for name in APART}
    return hash_of(packages, besides)


def hash_of(packages: Mapping[str, Path], besides: Collection[str] = ()) -> str:
    """SHA-256 of the sources of packages in these folders, wherever they lie."""
    found = {
        name: path
        for package, root in packages.items()
        for name, path in sources(package, root, besides)
    }
    digest = hashlib.sha256()
    for name in sorted(found):
        text = found[name].read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{name}\0{len(text)}\0".encode())
        digest.update(text)
    return digest.hexdigest()


def sources(package: str, root: Path, besides: Collection[str] = ()) -> Iterator[tuple[str, Path]]:
    """Names below the package and paths of its sources that fly."""
    for path in root.rglob("*.*"):
        if path.suffix not in SOURCES:
            continue
        below = path.relative_to(root)
        name = f"{package}/{below.as_posix()}"
        apart = below.parts[0] in APART[package] and below.parts[0] not in besides
        if not apart or name in FLIES:
            yield name, path
