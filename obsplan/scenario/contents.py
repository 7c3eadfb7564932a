"""What the contents of a scenario may be made of, whoever gives them: bounded depth, clean text."""

import re
import tomllib
from collections.abc import Iterator
from typing import Any

from obsplan.spelling import printable, visible
from obsplan.types import ObsplanError

DEEPEST = 16  # tables and lists within each other; a scenario has six
LONGEST_TEXT = 1000  # letters
LONGEST_KEY = 100  # letters of a key that is named
MOST_DIGITS = 400  # more than of the largest number that a computer holds
_DIGITS = re.compile(rf"[0-9][0-9_]{{{MOST_DIGITS},}}")
TOO_DEEP = f"is nested more than {DEEPEST} deep, and a scenario is not: remove the inner brackets"


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML within bounds on digits and depth.

    An integer of thousands of digits keeps the first `MOST_DIGITS`: no key may have so large a
    number, and what refuses it can name the key.

    Raises
    ------
    ValueError
        Not TOML, or lists and tables nested too deeply; says where.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:
        shorter = _DIGITS.sub(lambda number: number[0][:MOST_DIGITS], text)
        return parse_toml(shorter)
    except RecursionError:
        raise ValueError(f"{_deepest(text)} {TOO_DEEP}") from None


def _deepest(text: str) -> str:
    """Where brackets are first nested too deeply: the line and its key."""
    depth = 0
    for number, line in enumerate(text.splitlines(), start=1):
        for letter in line:
            depth += (letter in "[{") - (letter in "]}")
            if depth > DEEPEST:
                return f"line {number}: {visible(line.partition('=')[0].strip())[:80]}"
    return "the file"


def check_contents(data: Any, source: str) -> None:
    """Refuse contents that are too deep, and texts that are too long or cannot be printed.

    Raises
    ------
    ObsplanError
        Names the key.
    """
    if not isinstance(data, dict):
        raise ObsplanError(
            f"{source}: must be a table of keys and values, got {type(data).__name__}: give a dict"
        )
    for path, value in _walk(data):
        key = visible(".".join(path))[:LONGEST_KEY] or "the file"
        if len(path) > DEEPEST:
            raise ObsplanError(f"{source}: {visible('.'.join(path[:3]))[:LONGEST_KEY]} {TOO_DEEP}")
        for text in (*path[-1:], value):
            if isinstance(text, str) and not printable(text):
                shown = visible(text)[:80]
                raise ObsplanError(
                    f'{source}: {key} = "{shown}" has a character that cannot be printed: remove it'
                )
        if path and len(path[-1]) > LONGEST_KEY:
            raise ObsplanError(
                f"{source}: unknown key {path[-1][:40]}... of {len(path[-1])} letters: remove it"
            )
        if isinstance(value, str) and len(value) > LONGEST_TEXT:
            raise ObsplanError(
                f'{source}: {key} = "{value[:40]}..." has {len(value)} letters, and texts have at '
                f"most {LONGEST_TEXT}: shorten it"
            )


def _walk(data: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every value with its path, those of lists of numbers left out; no recursion."""
    stack: list[tuple[tuple[str, ...], Any]] = [((), data)]
    while stack:
        path, value = stack.pop()
        yield path, value
        if len(path) > DEEPEST:
            return
        if isinstance(value, dict):
            stack += [((*path, str(key)), below) for key, below in value.items()]
        elif isinstance(value, list | tuple):
            stack += [
                ((*path, str(i)), below)
                for i, below in enumerate(value)
                if not isinstance(below, int | float)
            ]
