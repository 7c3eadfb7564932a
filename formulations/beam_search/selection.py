"""Which branches are kept: the cheapest, or those that break limits least."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from ..model.arcs import arcs
from ..model.ties import rounded
from .limits import Limits, Looking, look_function

LOOKS = np.arange(1, 9) / 8  # parts of a stage after which it is held against the constraints

Look = Callable[[Int[np.ndarray, " n"]], Float[np.ndarray, " n"]]
Violation = Callable[
    [Float[np.ndarray, "*batch T 2"], Float[np.ndarray, " T"]], Float[np.ndarray, "*batch T"]
]


class Feasibility:
    """How far the sequences of a beam break limits, and which branches of them break least.

    ``first``: how far the first turn itself does [m]; ``worst``: how far the sequence does.
    """

    def __init__(
        self,
        violation: Violation | None,
        first_violation: Float[np.ndarray, " K"],
        *,
        turn_rates: Float[np.ndarray, " K"],
        speed: float,
        durations: Float[np.ndarray, " S"],
        limits: Limits | None = None,
    ) -> None:
        self.violation = violation
        native = limits is not None and not limits.areas.long and look_function() is not None
        self.limits = limits if native else None
        self.first = np.maximum(first_violation, 0.0)
        self.worst = np.zeros(1)
        self.turn_rates = turn_rates
        self.speed = speed
        self.durations = durations.tolist()
        begins = np.append(0.0, durations.cumsum()[:-1])
        self.times = begins[:, None] + durations[:, None] * LOOKS
        self.stage = 0
        if self.limits is not None:
            # contiguous: machine code reads them
            expected = np.ascontiguousarray(self.limits.expected(self.times.ravel()))
            drift = np.ascontiguousarray(self.limits.drift(self.times.ravel()))
            self._auvs = expected.reshape(*self.times.shape, -1, 2)
            self._drift = drift.reshape(*self.times.shape, 2)

    def best(
        self,
        pose: Float[np.ndarray, "B 3"],
        cost: Float[np.ndarray, " n"],
        width: int,
    ) -> Int[np.ndarray, " some"]:
        """Which branches are the beam of the next stage; `first` and `worst` become theirs."""
        turns = len(self.turn_rates)
        first = self.first if self.stage == 0 else np.repeat(self.first, turns)
        worst = np.repeat(self.worst, turns)
        look = None if self.violation is None else self._look(self.violation, pose)
        keep, worst = best(first, worst, cost, width, look)
        self.first, self.worst = first[keep], worst[keep]
        self.stage += 1
        return keep

    def _look(self, violation: Violation, pose: np.ndarray) -> Look:
        """How far the stage of some branches breaks a limit, at the points looked at."""
        rates, duration = tuple(self.turn_rates.tolist()), self.durations[self.stage]
        ahead, aside = _ways(rates, self.speed, duration)
        times = self.times[self.stage]
        if self.limits is not None:
            auvs, drift = self._auvs[self.stage], self._drift[self.stage]
            return Looking(self.limits, auvs, drift, pose, ahead, aside)
        x, y, heading = pose[..., None].swapaxes(0, 1)
        cos, sin = np.cos(heading), np.sin(heading)

        def look(these):
            parent, turn = np.divmod(these, len(self.turn_rates))
            c, s = cos[parent], sin[parent]
            forward, left = ahead[turn], aside[turn]
            along = np.empty((these.size, times.size, 2))
            along[..., 0] = x[parent] + c * forward - s * left
            along[..., 1] = y[parent] + s * forward + c * left
            broken = violation(along, times)
            return broken.max(axis=-1)

        return look


@lru_cache(maxsize=64)
def _ways(
    turn_rates: tuple[float, ...], speed: float, duration: float
) -> tuple[Float[np.ndarray, "K T"], Float[np.ndarray, "K T"]]:
    """How far [m] ahead and to the left turns lead by the points looked at, from every pose."""
    ways = arcs(np.zeros(3), np.array(turn_rates), speed, duration * LOOKS)
    return ways[..., 0].copy(), ways[..., 1].copy()


def cheapest(cost: Float[np.ndarray, " n"], count: int) -> Int[np.ndarray, " some"]:
    """The cheapest branches, in their own order; of equals, but for rounding, the first."""
    if cost.size <= count:
        return np.arange(cost.size)
    cost = rounded(cost)
    ordered = cost.copy()
    ordered.partition(count - 1)
    dearer = cost > ordered[count - 1]  # what is no number counts as dearest, and is not dearer
    (among,) = (~dearer).nonzero()
    if among.size > count:
        among = np.sort(among[cost[among].argsort(kind="stable")[:count]])
    return among


def best(
    first: Float[np.ndarray, " n"],
    worst: Float[np.ndarray, " n"],
    cost: Float[np.ndarray, " n"],
    count: int,
    look: Look | None,
) -> tuple[Int[np.ndarray, " count"], Float[np.ndarray, " n"]]:
    """The branches that break limits least, and how far each breaks one.

    No more are looked at than it takes to know the best.
    """
    first, cost = rounded(first), rounded(cost)
    order = np.lexsort((cost, worst, first))
    if look is None:
        return order[:count], worst
    worst, seen = worst.copy(), order[:0]
    least = first[order[0]]
    for begin in range(0, len(order), count):
        these = order[begin : begin + count]
        seen = order[: begin + count]
        worst[these] = np.maximum(worst[these], look(these))
        feasible = (first[seen] == least) & (worst[seen] == 0)
        if np.sum(feasible) >= count:
            break  # whatever comes later costs more, or breaks more
    ranked = np.lexsort((cost[seen], worst[seen], first[seen]))
    return seen[ranked[:count]], worst
