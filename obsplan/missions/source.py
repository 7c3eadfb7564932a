"""Read the bytes or the text of a file a user names, or say in one sentence why not."""

import codecs
import difflib
import json
import os
from pathlib import Path
from typing import Any

from obsplan.types import ObsplanError

MOST_BYTES = 50_000_000  # some 500 000 waypoints
_WINDOWS = "cp1252"


def read_bytes(path: Path) -> bytes:
    """Read a file of at most `MOST_BYTES`.

    Raises
    ------
    ObsplanError
        No such file (the nearest name is suggested), a folder, not readable, too large, or empty.
    """
    if os.path.isdir(path):
        raise ObsplanError(f"{path} is a folder: give a mission file inside it")
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except FileNotFoundError as error:
        raise ObsplanError(f"{path} does not exist: {_suggest(path)}") from error
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise ObsplanError(
            f"{path} cannot be read ({getattr(error, 'strerror', None) or error}): check its name "
            "and permissions"
        ) from error
    if len(content) > MOST_BYTES:
        raise ObsplanError(
            f"{path} is larger than {MOST_BYTES / 1e6:.0f} MB: export the mission alone, without "
            "logs"
        )
    if not content.strip():
        raise ObsplanError(f"{path} is empty: export the mission again")
    return content


def read_text(path: Path) -> str:
    """Read a text file in UTF-8, with or without a byte order mark, or in UTF-16 with one.

    Raises
    ------
    ObsplanError
        As `read_bytes`; not text.
    """
    return _nonblank(path, _decode(path, read_bytes(path)))


def read_loose_text(path: Path) -> tuple[str, list[str]]:
    """Read text as `read_text` does, else in Windows' Western European encoding, with a remark.

    Raises
    ------
    ObsplanError
        As `read_bytes`; not text.
    """
    content = read_bytes(path)
    try:
        return _nonblank(path, _decode(path, content)), []
    except ObsplanError:
        try:
            text = content.decode(_WINDOWS)
        except UnicodeDecodeError:
            text = "\0"
        if "\0" in text:  # no text has it; pictures and UTF-16 without its mark do
            raise
    return text, [f"the file is not UTF-8: its letters are read as Windows text ({_WINDOWS})"]


def _decode(path: Path, content: bytes) -> str:
    """Decode text by its byte order mark, else as UTF-8."""
    utf16 = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return content.decode("utf-16" if utf16 else "utf-8-sig")
    except UnicodeDecodeError as error:
        byte = f"byte 0x{error.object[error.start]:02x} at position {error.start}"
        raise ObsplanError(
            f"{path} is not {'UTF-16' if utf16 else 'UTF-8'} text ({byte}): "
            "it is not what its extension says, export it again"
        ) from error


def _nonblank(path: Path, text: str) -> str:
    """Return a text that says something."""
    if not text.strip():
        raise ObsplanError(f"{path} is empty: export the mission again")
    return text


def _suggest(path: Path) -> str:
    """Nearest name in the same folder, else what to check."""
    names = [other.name for other in path.parent.iterdir()] if os.path.isdir(path.parent) else []
    near = difflib.get_close_matches(path.name.lower(), [name.lower() for name in names], n=1)
    if near:
        return f'did you mean "{next(name for name in names if name.lower() == near[0])}"?'
    return "check the name and the folder"


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file that holds one object.

    Raises
    ------
    ObsplanError
        As `read_text`; not JSON (line and column named), or not an object.
    """
    text = read_text(path)
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}: {error.msg}"
        raise ObsplanError(
            f"{path} is not valid JSON ({place}): it may be cut short, export it again"
        ) from error
    except ValueError as error:  # a number of thousands of digits
        raise ObsplanError(
            f"{path} is not JSON that can be read ({error}): export it again"
        ) from error
    if not isinstance(content, dict):
        raise ObsplanError(
            f"{path} holds a JSON {type(content).__name__} where an object is expected: export it "
            "again"
        )
    return content
