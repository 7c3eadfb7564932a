"""CasADi Functions as machine code: the same arithmetic as in CasADi's virtual machine, to the last bit, several times faster."""

import hashlib
import logging
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import casadi as ca

FLAGS = (
    "-O2",
    "-ffp-contract=off",
    "-fPIC",
    "-shared",
)  # no fused multiply-add: the virtual machine has none

log = logging.getLogger("obsplan")


def native(function: ca.Function) -> ca.Function:
    """Compile a Function, or give it back as it is, with a message, where that is not possible.

    Libraries are kept by the content of their source in the user's cache folder (``OBSPLAN_CACHE`` names another), each built under a
    temporary name and renamed: processes may compile at once.
    """
    compiler = find_compiler()
    if compiler is None:
        return function
    source = generate(function)
    try:
        return ca.external(function.name(), str(cached_library(source, compiler)))
    except subprocess.CalledProcessError as error:
        detail = (error.stderr or str(error)).strip().splitlines()
        reason = f"{compiler} failed ({detail[-1] if detail else error})"
    except OSError as error:
        reason = f"it cannot be kept ({error}; OBSPLAN_CACHE names another folder)"
    log.warning("no generated code: %s; using CasADi's virtual machine", reason)
    return function


@cache
def find_compiler() -> str | None:
    """Path of the C compiler: ``CC`` in the environment, else cc, gcc or clang; says so once where there is none."""
    for name in filter(None, (os.environ.get("CC"), "cc", "gcc", "clang")):
        if path := shutil.which(name):
            return path
    log.warning(
        "no C compiler found: using CasADi's virtual machine, with the same results, about three times slower"
    )
    return None


def generate(function: ca.Function) -> str:
    """C source of a Function."""
    generator = ca.CodeGenerator(function.name())
    generator.add(function)
    return generator.dump()


def cached_library(source: str, compiler: str) -> Path:
    """Path of the shared library for a source, compiled unless it is there already."""
    folder = Path(
        os.environ.get("OBSPLAN_CACHE")
        or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "obsplan"
    )
    key = hashlib.sha256(
        "\0".join((source, compiler_version(compiler), *FLAGS)).encode()
    ).hexdigest()
    library = folder / f"{key}.so"
    if library.exists():
        return library
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as work:
        path = Path(work) / "step.c"
        path.write_text(source)
        command = [compiler, *FLAGS, str(path), "-o", str(path.with_suffix(".so")), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True)
        path.with_suffix(".so").replace(library)
    return library


@cache
def compiler_version(compiler: str) -> str:
    """What the compiler says it is: another one makes another library."""
    done = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
    return f"{compiler} {done.stdout}"
