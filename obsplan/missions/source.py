"""Read the text of a file a user names, or say in one sentence why not."""

import difflib
import json
from pathlib import Path
from typing import Any

from obsplan.types import ObsplanError


def read_text(path: Path) -> str:
    """Read a UTF-8 text file, with or without a byte order mark.

    Raises
    ------
    ObsplanError
        No such file (the nearest name is suggested), a folder, not readable, not text, or empty.
    """
    if path.is_dir():
        raise ObsplanError(f"{path} is a folder: give a mission file inside it")
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError as error:
        raise ObsplanError(f"{path} does not exist: {_suggest(path)}") from error
    except UnicodeDecodeError as error:
        byte = f"byte 0x{error.object[error.start]:02x} at position {error.start}"
        raise ObsplanError(
            f"{path} is not UTF-8 text ({byte}): it is not what its extension says, export it again"
        ) from error
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise ObsplanError(
            f"{path} cannot be read ({getattr(error, 'strerror', None) or error}): check its name and permissions"
        ) from error
    if not text.strip():
        raise ObsplanError(f"{path} is empty: export the mission again")
    return text


def _suggest(path: Path) -> str:
    """Nearest name in the same folder, else what to check."""
    names = [other.name for other in path.parent.iterdir()] if path.parent.is_dir() else []
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
            f"{path} holds a JSON {type(content).__name__} where an object is expected: export it again"
        )
    return content
