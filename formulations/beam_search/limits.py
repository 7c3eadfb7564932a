"""Limits as numbers, so that machine code can look at branches: ``look.c``."""

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ..model.areas import LONG, Outline
from ..model.casadi import address
from ..model.compiler import compiled_library

ANYWHERE = (-np.inf, -np.inf, np.inf, np.inf)
POINTER, INTEGER = ctypes.c_void_p, ctypes.c_int64


class _Limits(ctypes.Structure):
    _fields_ = (
        *((name, INTEGER) for name in ("areas", "auvs", "points")),
        *((name, POINTER) for name in ("area", "first", "edge", "apart", "margin", "auv", "drift")),
    )


class _Branches(ctypes.Structure):
    _fields_ = (
        ("turns", INTEGER),
        *((name, POINTER) for name in ("x", "y", "cos", "sin", "ahead", "aside")),
    )


class Areas:
    """Keep-outs and a fence, each an outline or a disc (east, north, radius [m]).

    A sign turns the distance from the edge into a violation: -1 of a keep-out, 1 of a fence.
    """

    def __init__(
        self, shapes: Sequence[tuple[Outline | tuple[float, float, float], float]]
    ) -> None:
        rows, edges, first = [], [np.empty((0, 7))], [0]
        self.long = False  # whether an outline is better looked at in numpy
        for shape, sign in shapes:
            disc = (0.0, 0.0, 0.0)
            if isinstance(shape, Outline):
                edges.append(shape.edges[..., 0].T)
                box = (*shape.corners.min(axis=0), *shape.corners.max(axis=0))
                self.long |= len(shape.corners) > LONG
            else:
                disc = x, y, radius = shape
                box = (x - radius, y - radius, x + radius, y + radius)
            rows.append([sign, *disc, *(box if sign < 0 else ANYWHERE)])
            first.append(sum(map(len, edges)))
        self.area = np.array(rows, dtype=float).reshape(-1, 8)
        self.edge = np.concatenate(edges)
        self.first = np.array(first, dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What breaks a limit, and how far; the same as a `Violation` says, as numbers."""

    areas: Areas
    min_separation: float  # [m]
    max_separation: float  # [m]
    rounding: float  # [m] that a path is looked at farther than it reaches
    margin: Float[np.ndarray, " M"]  # [m] kept from each AUV besides
    expected: Callable[[Float[np.ndarray, " T"]], Float[np.ndarray, "T M 2"]]  # of AUVs [m]
    # how far the water that carries the vehicle goes in times from now [m]
    drift: Callable[[Float[np.ndarray, " T"]], Float[np.ndarray, "T 2"]]

    @property
    def apart(self) -> Float[np.ndarray, "4"]:
        """Least and greatest separation, whether there is one, and the rounding."""
        least, greatest = self.min_separation, self.max_separation
        return np.array([least, greatest, least > 0 or greatest < np.inf, self.rounding])


class Looking:
    """How far branches of one stage break limits, by machine code."""

    def __init__(
        self,
        limits: Limits,
        auvs: Float[np.ndarray, "T M 2"],
        drift: Float[np.ndarray, "T 2"],
        pose: Float[np.ndarray, "B 3"],
        ahead: Float[np.ndarray, "K T"],
        aside: Float[np.ndarray, "K T"],
    ) -> None:
        areas, apart = limits.areas, limits.apart
        x, y, heading = np.ascontiguousarray(pose.T)
        cos, sin = np.cos(heading), np.sin(heading)
        given = [areas.area, areas.first, areas.edge, apart, limits.margin, auvs, drift]
        self._kept = [*given, x, y, cos, sin, ahead, aside]
        pointers = [address(array) if array.size else None for array in self._kept]
        self._limits = _Limits(len(areas.area), limits.margin.size, len(auvs), *pointers[:7])
        self._branches = _Branches(len(ahead), *pointers[7:])

    def __call__(self, these: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """How far each of them does [m], 0 where it breaks none."""
        broken = np.empty(these.size)
        these = np.ascontiguousarray(these)
        function = look_function()
        branches, limits = ctypes.byref(self._branches), ctypes.byref(self._limits)
        function(these.size, address(these), branches, limits, address(broken))
        return broken


@cache
def look_function() -> Any:
    """The machine code; None without a compiler."""
    source = Path(__file__).with_name("look.c").read_text(encoding="utf-8")
    path = compiled_library(source, asked_for=False)
    if path is None:
        return None
    function = ctypes.CDLL(str(path)).look
    function.argtypes, function.restype = [INTEGER, *[POINTER] * 4], None
    return function
