"""Recordings that come with the package."""

import tomllib
from importlib.resources import files
from pathlib import Path

SHIPPED = Path(str(files("obsplan") / "recordings"))


def shipped() -> dict[str, str]:
    """Names of the shipped recordings, with whom each is from."""
    found = {}
    for path in sorted(SHIPPED.glob("*/recording.toml")):
        said = tomllib.loads(path.read_text(encoding="utf-8"))
        found[path.parent.name] = str(said.get("attribution", ""))
    return found


def find(name: str) -> Path:
    """Folder of a shipped recording by its name, or the path that is given."""
    return SHIPPED / name if name in shipped() else Path(name)
