"""Certified bounds, each found once: planners of a comparison share that of the true tracks."""

from collections import OrderedDict
from collections.abc import Callable
from hashlib import blake2b
from threading import Lock

import numpy as np
from jaxtyping import Float, Int

from formulations.certified_bound import InformationBound, information_bound

KEPT_BYTES = (
    64 * 2**20
)  # of allocations and weights; one AUV with a range a second for a day: 10 MB

Progress = Callable[[float], None]  # of the share done


class KeptBounds:
    """The bounds last asked for, by the content of all that they depend on.

    That is the arrays, to the last bit: under one seed the AUVs' true tracks do not depend on
    where the aid vehicle goes, so planners share them; squared ranges depend on its start, and are
    shared by planners that begin there. The oldest are dropped where more than ``limit`` bytes
    would be kept.
    """

    def __init__(self, limit: int = KEPT_BYTES) -> None:
        self.limit = limit
        self._kept: OrderedDict[bytes, InformationBound] = OrderedDict()
        self._lock = Lock()  # threads share it

    def bound(
        self,
        P0: Float[np.ndarray, "n n"],
        F: Float[np.ndarray, "steps n n"],
        Q: Float[np.ndarray, "n n"],
        J: Float[np.ndarray, "steps n n"],
        *,
        pings: Int[np.ndarray, " pings"],
        sigma: Float[np.ndarray, " pings"],
        progress: Progress,
    ) -> InformationBound:
        """`information_bound` of these, found now or earlier."""
        key = content(P0, F, Q, J, pings, sigma)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        found = information_bound(P0, F, Q, J, pings=pings, sigma=sigma, progress=progress)
        with self._lock:
            self._kept[key] = found
            while sum(map(size, self._kept.values())) > self.limit:
                self._kept.popitem(last=False)
        return found


def content(*arrays: np.ndarray) -> bytes:
    """Digest of arrays: their shapes, types and numbers."""
    digest = blake2b()
    for array in arrays:
        digest.update(repr((array.shape, array.dtype.str)).encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.digest()


def size(bound: InformationBound) -> int:
    """How many bytes a bound takes."""
    return bound.allocation.nbytes + bound.weights.nbytes


KEPT = KeptBounds()  # of this process
