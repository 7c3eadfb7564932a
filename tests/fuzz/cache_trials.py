"""Damage the folder of generated code by seed, and print as JSON what became of its functions.

`python -m fuzz.cache_trials FOLDER SEED COUNT` in the folder of the tests. In a process of its own, which a library that
is not ours might crash.
"""

# ruff: noqa: ARG001 - all damages are given the same

import json
import os
import random
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np

from formulations.model import compiler as module
from formulations.model.casadi import machine_code
from formulations.model.compiler import find_compiler

PLACES = [np.random.default_rng(k).normal(size=3) for k in range(20)]


def pendulum(damping: float) -> ca.Function:
    """A Function with a root, trigonometry and sums of products."""
    x = ca.SX.sym("x", 3)
    root = ca.sqrt(x[0] ** 2 + x[1] ** 2 + 1) - damping * x[1]
    return ca.Function("step", [x], [ca.vertcat(x[0] * x[1] + ca.sin(x[2]), root)])


def values(function: ca.Function) -> np.ndarray:
    return np.array([function(x).full() for x in PLACES])


OURS, OTHERS = pendulum(0.1), pendulum(0.2)


# Damages to a folder that has our library and another function's


def empty(library: Path, other: Path, rng: random.Random) -> None:
    library.write_bytes(b"")


def cut(library: Path, other: Path, rng: random.Random) -> None:
    content = library.read_bytes()
    library.write_bytes(content[: rng.randrange(len(content))])


def flip(library: Path, other: Path, rng: random.Random) -> None:
    content = bytearray(library.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    library.write_bytes(content)


def garbage(library: Path, other: Path, rng: random.Random) -> None:
    library.write_bytes(b"\x7fELF" + rng.randbytes(rng.choice((10, 5000))))


def swap(library: Path, other: Path, rng: random.Random) -> None:
    library.write_bytes(other.read_bytes())


def plant(library: Path, other: Path, rng: random.Random) -> None:
    """Put the other under our key and its own digest."""
    key, digest = library.name.split("-")[0], other.name.split("-")[1]
    library.unlink()
    (library.parent / f"{key}-{digest}").write_bytes(other.read_bytes())


def folder_in_its_place(library: Path, other: Path, rng: random.Random) -> None:
    library.unlink()
    library.mkdir()


def dangling(library: Path, other: Path, rng: random.Random) -> None:
    library.unlink()
    library.symlink_to(library.parent / "none")


def open_to_others(library: Path, other: Path, rng: random.Random) -> None:
    swap(library, other, rng)
    library.parent.chmod(rng.choice((0o770, 0o707, 0o777)))


def folder_is_a_file(library: Path, other: Path, rng: random.Random) -> None:
    shutil.rmtree(library.parent)
    library.parent.write_bytes(b"x")


def no_folder_can_be(library: Path, other: Path, rng: random.Random) -> None:
    os.environ["OBSPLAN_CACHE"] = "/proc/cache"


def compiler_of(script: str) -> Callable[[Path, Path, random.Random], None]:
    """A program in the compiler's place."""

    def replace(library: Path, other: Path, rng: random.Random) -> None:
        path = library.parent.parent / f"cc{rng.randrange(10**9)}"
        path.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo 1 && exit\n{script}\n')
        path.chmod(0o700)
        os.environ["CC"] = str(path)

    return replace


PATIENCE, HANGS = module.PATIENCE, "compiler hangs"
INTO = 'while [ "$1" != -o ]; do shift; done; '
DAMAGES = {
    "empty": empty,
    "cut": cut,
    "flipped": flip,
    "garbage": garbage,
    "swapped": swap,
    "planted": plant,
    "a folder": folder_in_its_place,
    "dangling": dangling,
    "open to others": open_to_others,
    "folder is a file": folder_is_a_file,
    "no folder": no_folder_can_be,
    HANGS: compiler_of("exec sleep 60"),
    "compiler fails": compiler_of("echo out of patience >&2; exit 1"),
    "compiler is killed": compiler_of(f"{INTO}printf half > $2; kill -9 $$"),
    "compiler writes nothing": compiler_of("exit 0"),
    "compiler writes garbage": compiler_of(f"{INTO}printf garbage > $2"),
}


def attempt(folder: Path, name: str, rng: random.Random) -> str:
    """What our function computes after a damage, and again after that."""
    cache = folder / "cache"
    os.environ["OBSPLAN_CACHE"] = str(cache)
    os.environ.pop("CC", None)
    module.PATIENCE = PATIENCE
    find_compiler.cache_clear()
    machine_code(OURS)
    (library,) = cache.iterdir()
    machine_code(OTHERS)
    (other,) = set(cache.iterdir()) - {library}
    DAMAGES[name](library, other, rng)
    find_compiler.cache_clear()
    module.PATIENCE = 0.5 if name == HANGS else PATIENCE
    expected = values(OURS)
    try:
        for _ in range(2):
            if not np.array_equal(values(machine_code(OURS)), expected):
                return "wrong result"
    except Exception as error:
        return f"raised {error!r}"
    finally:
        shutil.rmtree(cache, ignore_errors=True)
        cache.unlink(missing_ok=True)
    return "same bits"


if __name__ == "__main__":
    place, seed, count = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    rng = random.Random(seed)
    outcomes: Counter[str] = Counter()
    for i in range(count):
        name = [*DAMAGES][i % len(DAMAGES)]
        became = attempt(place, name, rng)
        outcomes[became if became == "same bits" else f"{became} ({name})"] += 1
    print(json.dumps(outcomes))  # noqa: T201 - to the test
