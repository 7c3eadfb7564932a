"""Write a file whole or not at all."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from obsplan.types import ObsplanError


def write_atomically(path: Path | str, content: str | bytes | Iterable[str]) -> None:
    """Write a file whole or not at all, as `open_atomically` does.

    Text is written as UTF-8 with its line ends untouched, so that the bytes are the same on every
    system. Long text can be given in pieces, which are written as they come.

    Raises
    ------
    ObsplanError
        The file cannot be written; nothing is left behind.
    """
    pieces = [content] if isinstance(content, str | bytes) else content
    with open_atomically(path) as file:
        for piece in pieces:
            file.write(piece.encode() if isinstance(piece, str) else piece)


@contextmanager
def open_atomically(path: Path | str) -> Iterator[BinaryIO]:
    """Give a file of a temporary name in the folder to write, then rename it.

    Nobody sees half of it.

    Raises
    ------
    ObsplanError
        The file cannot be written; nothing is left behind.
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as file:
            yield file
        part.replace(path)
    except OSError as error:
        raise ObsplanError(
            f"{path} cannot be written ({error.strerror}): choose another folder, or make this "
            "one writable"
        ) from error
    finally:
        with suppress(OSError):  # renamed, or never there
            part.unlink()
