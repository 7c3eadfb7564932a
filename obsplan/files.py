"""Write a file whole or not at all."""

import os
from contextlib import suppress
from pathlib import Path

from obsplan.types import ObsplanError


def write_atomically(path: Path | str, content: str | bytes) -> None:
    """Write a file under a temporary name in its folder, then rename it: nobody sees half of it.

    Text is written as UTF-8 with its line ends untouched, so that the bytes are the same on every
    system.

    Raises
    ------
    ObsplanError
        The file cannot be written; nothing is left behind.
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content.encode() if isinstance(content, str) else content)
        part.replace(path)
    except OSError as error:
        raise ObsplanError(
            f"{path} cannot be written ({error.strerror}): choose another folder, or make this "
            "one writable"
        ) from error
    finally:
        with suppress(OSError):  # renamed, or never there
            part.unlink()
