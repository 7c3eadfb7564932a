"""When ranges come, and what a horizon is cut into.

Times that are multiples of an interval but for rounding are multiples.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

ROUNDING = 1e-6  # of an interval: a time this near to a multiple of it is the multiple


class Stages(NamedTuple):
    """The horizon cut into stages, ranges coming at the end of each."""

    duration: Float[np.ndarray, " S"]  # [s]
    pings: (
        Float[np.ndarray, " S"] | Float[np.ndarray, "S M"]
    )  # ranges to all AUVs alike, or to each


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """When one vehicle ranges to the AUVs, as it is planned: rounds, each AUV in its slot.

    Round k = 1, 2, ... begins at k intervals; an AUV's range comes ``offset`` after that.
    """

    interval: float = 15.0  # between rounds [s]
    offsets: tuple[float, ...] = ()  # of each AUV [s]; none: all at once as the round begins
    silent: tuple[tuple[float, float], ...] = ()  # from when to when there are no ranges [s]

    @property
    def plain(self) -> bool:
        """Whether every AUV has a range as each round begins."""
        return not any(self.offsets) and not self.silent

    def times(self, auv: int, begin: float, end: float) -> Float[np.ndarray, " pings"]:
        """When an AUV's ranges come, later than ``begin`` and not later than ``end`` [s]."""
        offset = self.offsets[auv] if self.offsets else 0.0
        first = max(1, int(intervals(begin - offset, self.interval)) + 1)
        last = int(intervals(end - offset, self.interval))
        times = np.arange(first, last + 1) * self.interval + offset
        return times[~is_silent(times, self.silent)]

    def span(self, time: float, loud: float) -> float:
        """How long it takes from a time on [s] until as long as ``loud`` [s] was not silent."""
        end = time + loud
        for start, stop in sorted(self.silent):
            if start < end and stop > time:
                end += stop - max(start, time)
        return end - time

    def pings(self, ends: Float[np.ndarray, " ends"], auvs: int) -> Float[np.ndarray, "S {auvs}"]:
        """Number of ranges to each AUV in stages that begin and end at given times [s]."""
        pings = np.zeros((len(ends) - 1, auvs))
        for auv in range(auvs):
            times = self.times(auv, float(ends[0]), float(ends[-1]))
            stage = np.searchsorted(ends[1:-1], times - ROUNDING * self.interval)
            np.add.at(pings[:, auv], stage, 1.0)
        return pings

    def time_to_slot(self, time: Any, auv: int) -> Any:
        """Time [s] until an AUV's next slot, silent or not; in it, until the one after it.

        Of a number, or of an expression.
        """
        offset = self.offsets[auv] if self.offsets else 0.0
        return time_to_next(time - offset, self.interval)

    def time_to_range(self, time: Any, auv: int) -> Any:
        """Time [s] until an AUV's next range."""
        wait = self.time_to_slot(time, auv)
        for start, stop in sorted(self.silent):
            slot = time + wait
            quiet = ca.logic_and(slot >= start, slot <= stop)
            after = stop + self.time_to_slot(stop, auv) - time
            wait = ca.if_else(quiet, after, wait)
        return wait

    def heard(self, times: Any) -> Any:
        """1 for times [s] at which ranges come, and 0 for silent ones."""
        heard = ca.DM.ones(*times.shape)
        for start, stop in self.silent:
            quiet = ca.logic_and(times >= start, times <= stop)
            heard = heard * ca.logic_not(quiet)
        return heard

    def stages(self, time: float, horizon: float, count: int, auvs: int) -> Stages:
        """Cut a horizon [s] from a time [s] on into stages that end at ranges.

        Ranges that are farther apart than horizon / count end a stage each; closer ones are counted
        together.
        """
        if self.plain:
            return ping_stages(time, self.interval, horizon, count)
        length = horizon / count
        if self.interval <= length and not self.silent:
            return Stages(np.full(count, length), np.full(count, length / self.interval))
        return self._cut(time, length, count, auvs)

    def _cut(self, time: float, length: float, count: int, auvs: int) -> Stages:
        """Stages that end at the last range within a length, or else at the next one."""
        quiet = sum(stop - start for start, stop in self.silent)
        end = time + 2 * count * (length + self.interval) + quiet
        ranges = np.unique(np.concatenate([self.times(auv, time, end) for auv in range(auvs)]))
        ends = [time]
        while len(ends) <= count:
            later = ranges[ranges > ends[-1] + ROUNDING * self.interval]
            if not later.size:
                ends.append(ends[-1] + length)
                continue
            near = later[later <= ends[-1] + length]
            ends.append(float(near[-1] if near.size else later[0]))
        return Stages(np.diff(ends), self.pings(np.array(ends), auvs))


def is_silent(
    times: Float[np.ndarray, "*batch"], silent: Sequence[tuple[float, float]]
) -> Bool[np.ndarray, "*batch"]:
    """Whether nothing is ranged at times [s], of silences from when to when [s], ends included."""
    quiet = np.zeros(times.shape, dtype=bool)
    for start, stop in silent:
        quiet |= (times >= start) & (times <= stop)
    return quiet


def time_to_next(time: Any, interval: float) -> Any:
    """Time [s] until the next multiple of an interval [s]; at a multiple, until the one after it.

    Of a number, or of an expression.
    """
    since = ca.fmod(time, interval)
    return interval - since * (since <= (1 - ROUNDING) * interval)


def intervals(time: Any, interval: float) -> Any:
    """How many whole intervals [s] there are in a time, or in times [s]."""
    return np.floor(np.asarray(time) / interval + ROUNDING)


def is_multiple(time: float, interval: float) -> bool:
    """Whether a time [s] is a whole number of intervals [s], at least one."""
    ratio = time / interval
    return bool(0.5 < ratio < np.inf and abs(ratio - round(ratio)) < ROUNDING)


def ping_stages(time: float, interval: float, horizon: float, count: int) -> Stages:
    """Cut a horizon [s] into stages that end at pings.

    Pings come every ``interval`` [s], counted from time 0.

    Pings farther apart than horizon / count make a stage each, the first one shorter; closer ones
    are counted together.
    """
    length = horizon / count
    if interval <= length:
        return Stages(np.full(count, length), np.full(count, length / interval))
    duration = np.full(count, interval)
    duration[0] = time_to_next(time, interval)
    return Stages(duration, np.ones(count))
