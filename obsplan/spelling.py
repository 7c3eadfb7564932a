"""The remedy for a misspelt word, and words that are safe to print."""

import difflib
import unicodedata
from collections.abc import Iterable
from typing import Any

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # begin a cell that a spreadsheet executes
LONGEST_GUESS = 100  # letters of a word that a near one is looked for


def nearest(word: str, known: Iterable[str]) -> str:
    """What was probably meant; all that is known where nothing is near."""
    words = list(known)
    close = difflib.get_close_matches(word[:LONGEST_GUESS], words, n=1, cutoff=0.5)
    return f'did you mean "{close[0]}"?' if close else f"known are {', '.join(sorted(words))}"


def printable(text: str) -> bool:
    """Whether a text has no character that a terminal acts on, and no half of one."""
    return all(_shows(letter) for letter in text)


def visible(text: str) -> str:
    """A text in one line, with what a terminal would act on spelt out, such as an escape."""
    return "".join(
        letter if _shows(letter) else " " if letter == "\n" else ascii(letter)[1:-1]
        for letter in text
    )


def _shows(letter: str) -> bool:
    return letter.isprintable() or unicodedata.category(letter) == "Zs"


def inert(cell: Any) -> Any:
    """A cell of a table that no spreadsheet takes for a formula (OWASP, CSV injection)."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA) else cell
