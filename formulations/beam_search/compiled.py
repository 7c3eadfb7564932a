"""Sequences of turns in machine code: ``beam.c`` around the formulas of a branching."""

import ctypes
import threading
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ..model.casadi import address
from ..model.compiler import compiled_library
from ..model.lanes import LANES, in_lanes, vectors
from ..model.ties import DROPPED
from .branching import AUV, STAGE, Kind, composed, of_one

INTEGER, POINTER = ctypes.c_int64, ctypes.c_void_p
ARGUMENTS = {  # of each function, as ``beam.c`` has them
    "begin": [POINTER] * 3,
    "branch": [INTEGER, *[POINTER] * 2],
    "follow": [INTEGER, *[POINTER] * 2],
    "search": [INTEGER, INTEGER, *[POINTER] * 2],
    "first": [INTEGER, INTEGER, *[POINTER] * 5],
}


@lru_cache(maxsize=16)
def machine_code(kind: Kind) -> Any:
    """The library of a search; None without a compiler."""
    path = compiled_library(source(kind), asked_for=False)
    if path is None:
        return None
    library = ctypes.CDLL(str(path))
    for name, arguments in ARGUMENTS.items():
        function = getattr(library, name)  # kept by the library
        function.argtypes, function.restype = arguments, None
    return library


def source(kind: Kind) -> str:
    """C of a search."""
    sizes = {
        "AUVS": kind.auvs,
        "TURNS": kind.turns,
        "HALF": kind.half,
        "AUV": len(AUV),
        "STAGE": len(STAGE),
        "SHARE": STAGE.index("share"),
        "WEIGHT": AUV.index("weight"),
        "DROPPED": DROPPED,
    }
    defined = "".join(f"#define {name} {size}\n" for name, size in sizes.items())
    poses = in_lanes(composed(kind.turns), shared=[1])
    known = in_lanes(of_one(kind), shared=[1, 4])
    driver = Path(__file__).with_name("beam.c").read_text(encoding="utf-8")
    return "".join([vectors(), defined, poses, known, driver])


class Compiled(threading.local):
    """A beam of sequences in memory that is kept, each thread's its own.

    `formulations.beam_search.interpreted.Interpreted` has the same methods.
    """

    def __init__(self, library: Any, kind: Kind, stages: int, width: int) -> None:
        self._library, self._turns = library, kind.turns
        turns, packed = kind.turns, kind.auvs * kind.half
        self._stages, self._width = stages, width
        blocks = -(-width // LANES)
        branches = blocks * LANES * turns
        self._beam = _aligned(blocks, 3 + packed + 1, LANES)
        self._cost = np.empty(branches)
        self._rank = np.empty(branches)
        self._kept = np.empty((stages, width), dtype=np.int64)
        self._other = [
            _aligned(blocks, 3 * turns + packed, LANES),
            np.empty(branches, dtype=np.int64),
            np.empty(branches, dtype=np.int64),
        ]
        parts = [self._beam, self._cost, self._rank, self._kept, *self._other]
        self._memory = (POINTER * len(parts))(*map(address, parts))
        self._start = np.empty(3)
        self._turns_taken = np.empty(stages, dtype=np.int64)
        self._found = np.empty(1 + 3 * (stages + 1))
        results = (self._start, self._turns_taken, self._found)
        self._results = [address(array) for array in results]

    def begin(self, pose: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "M half"]) -> None:
        """Make the beam of the one sequence without turns."""
        self._start[:] = pose
        self._count, self._stage = 1, 0
        self._library.begin(self._results[0], address(covariance), self._memory)

    @property
    def pose(self) -> Float[np.ndarray, "B 3"]:
        """Where the sequences of the beam end."""
        lanes = self._beam[:, :3].swapaxes(1, 2)
        return lanes.reshape(-1, 3)[: self._count]

    def branch(self, told: Float[np.ndarray, " n"]) -> Float[np.ndarray, " branches"]:
        """What all branches of a stage are ranked by, of one sequence after the other."""
        self._library.branch(self._count, address(told), self._memory)
        return self._rank[: self._count * self._turns]

    def follow(self, keep: Int[np.ndarray, " some"]) -> None:
        """Make the beam of some branches."""
        kept = self._kept[self._stage]
        kept[: keep.size] = keep
        self._count = keep.size
        self._stage += 1
        self._library.follow(self._count, address(kept), self._memory)

    def search(self, told: Float[np.ndarray, "S n"]) -> None:
        """Go through all stages, keeping the cheapest."""
        self._library.search(self._stages, self._width, address(told), self._memory)

    def first(
        self, told: Float[np.ndarray, "S n"]
    ) -> tuple[float, Int[np.ndarray, " S"], Float[np.ndarray, "nodes 3"]]:
        """Cost of the first sequence, its turns by number, and the poses it passes."""
        self._library.first(self._stages, self._width, address(told), self._memory, *self._results)
        cost, *_ = self._found.tolist()
        return cost, self._turns_taken, self._found[1:].reshape(-1, 3).copy()


def _aligned(*shape: int) -> np.ndarray:
    """An array that begins where a vector may."""
    size, vector = int(np.prod(shape)), 8 * LANES
    memory = np.empty(size + LANES)
    skipped = -address(memory) % vector // 8
    return memory[skipped : skipped + size].reshape(shape)
