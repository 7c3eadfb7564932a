"""Classes by the names that scenarios have for them: a folder's own, or ``"package.module:Class"``.

A user's class comes from a module that Python can import, or from one in the current folder, as
with ``python -m``. Nothing is ever executed because it lies beside a scenario file. Naming a class
runs its module: read a stranger's scenario before you run it.
"""

import os
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from hashlib import sha256
from importlib import import_module
from inspect import getsourcefile
from pathlib import Path
from typing import Any

from obsplan.spelling import nearest

SEPARATOR = ":"  # between module and class
LONGEST = 200  # characters of what an exception says


def is_own(kind: object) -> bool:
    """Whether a kind names a user's class, and none of a folder's table."""
    return isinstance(kind, str) and SEPARATOR in kind


def class_of(kind: str, known: Mapping[str, type[Any]]) -> type[Any]:
    """Class of a kind that has been checked."""
    return loaded(kind) if is_own(kind) else known[kind]


def checked_class(kind: str, needs: tuple[str, ...]) -> type[Any]:
    """A user's dataclass that has what its role needs.

    Raises
    ------
    ValueError
        One sentence: what is wrong with the name, the module or the class, and the remedy.
    """
    cls = loaded(kind)
    if not is_dataclass(cls):
        raise ValueError(
            "is no dataclass; write @dataclass above the class: "
            "its fields become the keys of this table"
        )
    present = {*dir(cls), *(field.name for field in fields(cls))}
    missing = [need for need in needs if need not in present]
    if missing:
        raise ValueError(f"lacks {' and '.join(missing)}; add what docs/your-own.md says it needs")
    return cls


def loaded(kind: str) -> type[Any]:
    """Class of ``"package.module:Class"``.

    Raises
    ------
    ValueError
        As `checked_class`.
    """
    home, _, name = kind.partition(SEPARATOR)
    if not all(part.isidentifier() for part in (*home.split("."), name)):
        raise ValueError("must be a module and a class at its top, as in mypackage.module:Class")
    module = _module(home)
    found = getattr(module, name, None)
    if found is None:
        classes = [key for key, value in vars(module).items() if isinstance(value, type)]
        remedy = nearest(name, classes) if classes else "there is no class in it"
        raise ValueError(f"{home} has no class {name}; {remedy}")
    if not isinstance(found, type):
        raise ValueError(f"{name} is no class but a {type(found).__name__}; name its class")
    return found


def _module(home: str) -> Any:
    here = os.getcwd()
    if not {here, ""} & {*sys.path}:
        sys.path.append(here)  # last: what lies in a folder never stands in for an installed module
    try:
        return import_module(home)
    except ModuleNotFoundError as error:
        if not f"{home}.".startswith(f"{error.name}."):
            raise ValueError(f"{home} imports {error.name}, which is not installed") from error
        raise ValueError(
            f"there is no module {error.name} here; install it, put its folder into PYTHONPATH, "
            "or run obsplan in its folder"
        ) from None
    except (Exception, SystemExit) as error:  # whatever a user's module raises, or ends with
        said = in_words(error)
        raise ValueError(f"{home} cannot be imported: {said}; correct the module") from error


def in_words(error: BaseException) -> str:
    """What a user's class raised, on one line."""
    try:
        text = " ".join(str(error).split())
    except Exception:  # a user's own exception may fail to say anything
        text = ""
    printable = "".join(letter if letter.isprintable() else "?" for letter in text)
    if len(printable) > LONGEST:
        printable = f"{printable[:LONGEST]}..."
    return ": ".join(filter(None, (type(error).__name__, printable)))


def kind_of_object(given: object, known: Mapping[str, type[Any]]) -> str:
    """Kind of an object that was given instead of a table.

    Raises
    ------
    ValueError
        No file could name its class.
    """
    cls = type(given)
    if isinstance(given, type):
        raise ValueError(f"is a class; give an object of it, {given.__name__}(...)")
    for kind, ours in known.items():
        if cls is ours:
            return kind
    if "<locals>" in cls.__qualname__:
        raise ValueError(
            f"{cls.__name__} is made inside a function, where no file can name it; "
            "move it to the top of its module"
        )
    return f"{cls.__module__}{SEPARATOR}{cls.__qualname__}"


def fingerprint(kinds: list[str]) -> str:
    """SHA-256 of the files of users' classes and their base classes, not of what they import."""
    files = {
        getsourcefile(base)
        for kind in kinds
        for base in loaded(kind).__mro__
        if not base.__module__.startswith(("builtins", "obsplan.", "typing"))
    }
    contents = [Path(file).read_bytes() for file in sorted(filter(None, files))]
    return sha256(b"\0".join(contents)).hexdigest()
