"""Shared libraries of generated C: built once, kept in a private folder, loaded only if ours.

A library's name holds the digest of its source, compiler and flags, and that of its own content
under them. What is under a name that it does not fit, because it was cut, damaged or put there, is
never loaded: it is removed, and built anew.
"""

import ctypes
import hashlib
import logging
import os
import shutil
import stat
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from time import perf_counter

# No fused multiply-add: the virtual machine has none.
FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared")
PATIENCE = 300.0  # [s] for a compiler: a step of eight AUVs takes half a minute
PRIVATE = 0o700  # mode of the folder
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
ELSEWHERE = "OBSPLAN_CACHE names another folder"

log = logging.getLogger("obsplan")


def compiled_library(source: str, *, asked_for: bool, build: bool = True) -> Path | None:
    """Path of the shared library of a C source; None, with a message, where it cannot be made.

    That there is no compiler is said only to who has ``asked_for`` one. Where it need not be built
    now, not ``build``, it is None unless it was built before. Libraries are kept in the
    user's cache folder (``OBSPLAN_CACHE`` names another), each built under a temporary name and
    renamed: processes may compile at once.
    """
    compiler = find_compiler()
    if compiler is None:
        if asked_for:
            say_there_is_no_compiler()
        return None
    try:
        return cached_library(source, compiler, build=build)
    except subprocess.TimeoutExpired:
        reason = f"{compiler} did not end within {PATIENCE:.0f} s"
    except subprocess.CalledProcessError as error:
        detail = (error.stderr or str(error)).strip().splitlines()
        reason = f"{compiler} failed ({detail[-1] if detail else error})"
    except OSError as error:
        reason = f"it cannot be kept ({error}; {ELSEWHERE})"
    log.warning("no generated code: %s; using CasADi's virtual machine", reason)
    return None


@cache
def find_compiler() -> str | None:
    """Path of the C compiler: ``CC`` in the environment, else cc, gcc or clang.

    None where there is none.
    """
    names = filter(None, (os.environ.get("CC"), "cc", "gcc", "clang"))
    return next((path for name in names if (path := shutil.which(name))), None)


@cache
def say_there_is_no_compiler() -> None:
    """Say it once."""
    log.warning(
        "no C compiler found: "
        "using CasADi's virtual machine, with the same results, about three times slower"
    )


def cached_library(source: str, compiler: str, *, build: bool = True) -> Path | None:
    """Path of the shared library for a source; unless it is there, compiled or None.

    Raises
    ------
    OSError
        The folder cannot be used, or others can write into it.
    subprocess.SubprocessError
        The compiler fails, or does not end.
    """
    folder = private_folder()
    content = "\0".join((source, compiler_version(compiler), *FLAGS))
    key = hashlib.sha256(content.encode()).hexdigest()
    for library in folder.glob(f"{key}-*.so"):
        if library.name == name_of(key, library.read_bytes()):
            return library
        log.warning("generated code in %s is damaged; it is built anew", library)
        library.unlink(missing_ok=True)
    return _built(source, compiler, folder, key) if build else None


def _built(source: str, compiler: str, folder: Path, key: str) -> Path:
    began = perf_counter()
    with tempfile.TemporaryDirectory(dir=folder) as work:
        path, made, whole = (Path(work) / f"step.{end}" for end in ("c", "so", "kept"))
        path.write_text(source)
        command = [compiler, *FLAGS, str(path), "-o", str(made), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=PATIENCE)
        content = made.read_bytes()
        _check_it_loads(made, command)
        # a copy, since what a process has loaded must not change under it
        with whole.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())  # a power cut leaves the whole of it, or nothing
        library = folder / name_of(key, content)
        whole.replace(library)
    log.info("machine code compiled in %.1f s, and kept: %s", perf_counter() - began, library)
    return library


def _check_it_loads(library: Path, command: list[str]) -> None:
    """Refuse a library that cannot be loaded here, such as one for another kind of processor."""
    if os.name != "posix":  # where what is loaded cannot be removed
        return
    try:
        ctypes.CDLL(str(library))
    except OSError as error:
        reason = f"what it made cannot be loaded: {error}"
        raise subprocess.CalledProcessError(0, command, stderr=reason) from error


def name_of(key: str, content: bytes) -> str:
    """File name of a library: what it is made of, and what it is."""
    return f"{key}-{hashlib.sha256(key.encode() + content).hexdigest()[:32]}.so"


def private_folder() -> Path:
    """Where libraries are kept; made where it is missing.

    Raises
    ------
    OSError
        It cannot be made, is another user's, or others can write into it.
    """
    folder = cache_folder()
    folder.mkdir(mode=PRIVATE, parents=True, exist_ok=True)
    status = folder.stat()
    if hasattr(os, "getuid") and status.st_uid != os.getuid():
        raise PermissionError(f"{folder} belongs to another user")
    if os.name == "posix" and status.st_mode & OTHERS_WRITE:
        raise PermissionError(f"others can write into {folder}: chmod go-w it")
    return folder


def cache_folder() -> Path:
    """The folder as the environment names it."""
    named = os.environ.get("OBSPLAN_CACHE")
    if named:
        return Path(named)
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(caches) / "obsplan"


@cache
def compiler_version(compiler: str) -> str:
    """What the compiler says it is: another one makes another library."""
    done = subprocess.run(
        [compiler, "--version"], capture_output=True, text=True, check=False, timeout=PATIENCE
    )
    return f"{compiler} {done.stdout}"
