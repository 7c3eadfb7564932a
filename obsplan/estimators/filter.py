"""A filter of one AUV that is called with numbers, one event after the other.

It evaluates the expressions of `Filtering`, which the simulator's step is made of too.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, cast

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.casadi import SX, Call, symbol
from formulations.model.covariance import pack, pack_array, unpack_array
from obsplan.estimators.estimator import Process
from obsplan.estimators.filtering import GONE, Filtering, Memory, Seen
from obsplan.estimators.hidden import Around
from obsplan.estimators.hypotheses import hypotheses, places, room_for, tidied
from obsplan.sensors import BEACON, Sensor
from obsplan.types import Hypothesis


class Outcome(NamedTuple):
    """What became of a range."""

    fate: int  # code of a `Fate`
    innovation: float
    variance: float


@dataclass(frozen=True, kw_only=True)
class Stated(Around):
    """A sensor whose deviation may be stated with the measurement, or larger by another's error.

    After the rows of `BEACON` it is told the standard deviation, nan being the sensor's own, and a
    variance besides.
    """

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """As the sensor."""
        return self.sensor.measure(x, beacon[: len(BEACON)])

    def deviation(self, x: ca.SX, beacon: ca.SX) -> ca.SX | float:
        """As stated, or the sensor's."""
        own = self.sensor.deviation(x, beacon[: len(BEACON)])
        stated, more = beacon[len(BEACON)], beacon[len(BEACON) + 1]
        known = ca.if_else(stated > 0, stated, own)
        return ca.if_else(more > 0, ca.sqrt(known**2 + more), known)


@dataclass(kw_only=True)
class Filter:
    """What an AUV's filter holds, and the verbs that change it.

    ``process`` gives what is assumed between samples some seconds apart. Mean and covariance are
    those of all hypotheses together.
    """

    filtering: Filtering
    process: Callable[[SX], Process]
    mean: Float[np.ndarray, " m"]
    covariance: Float[np.ndarray, "m m"]

    def __post_init__(self) -> None:
        lower = pack_array(self.covariance)
        room = self.filtering.hypotheses
        there = np.concatenate([self.mean, lower, [0.0]])
        empty = np.concatenate([self.mean, lower, [GONE]])
        several = [np.ones(1), there, *[empty] * (room - 1)] if room > 1 else []
        misses = np.zeros(self.filtering.counted)
        self._held = np.concatenate([self.mean, lower, *several, misses])
        self._known = {room: _Verbs(self.filtering, self.process)}

    def predict(self, u: Float[np.ndarray, " 3"], dt: float) -> None:
        """Move on by dt seconds; u: turn [rad], change of speed [m/s], moved to the left [m]."""
        self._told(self._verbs.predict, (*u, dt))

    def update(self, z: float, sensor: Sensor, told: Float[np.ndarray, " 10"]) -> None:
        """Take a measurement that no gate looks at."""
        self._told(self._verbs.update(sensor), (z, *told, np.nan, 0.0))

    def innovation(
        self,
        z: float,
        sensor: Sensor,
        told: Float[np.ndarray, " 10"],
        *,
        sigma: float = np.nan,
        more: float = 0.0,
    ) -> tuple[float, float, np.ndarray]:
        """Innovation of a measurement, its variance, and its derivative; of the first hypothesis.

        ``sigma`` is its standard deviation, nan the sensor's own; ``more`` a variance besides.
        """
        found = self._called(self._verbs.innovation(sensor), (z, *told, sigma, more))
        return float(found[0]), float(found[1]), found[2:].copy()

    def range(
        self,
        z: float,
        sensor: Sensor,
        told: Float[np.ndarray, " 10"],
        beacon: int,
        *,
        sigma: float = np.nan,
        more: float = 0.0,
    ) -> Outcome:
        """Take a range of a beacon, unless the gate rejects it; as `innovation`.

        Once all that came at that time is taken, `tidy` follows.
        """
        found = self._told(self._verbs.range(sensor, beacon), (z, *told, sigma, more))
        fate, nu, S = found[-3:].tolist()
        return Outcome(int(fate), nu, S)

    @cached_property
    def _states(self) -> int:
        return self.filtering.count

    @property
    def _verbs(self) -> "_Verbs":
        return self._known[self.filtering.hypotheses]

    def _called(self, call: Call, given: tuple[float, ...]) -> np.ndarray:
        call.given[: self._held.size] = self._held
        call.given[self._held.size :] = given
        return call()

    def _told(self, call: Call, given: tuple[float, ...]) -> np.ndarray:
        """What a verb gives; what is held has changed."""
        found = self._called(call, given)
        self._held[...] = found[: self._held.size]
        m, half = self._states, self._states * (self._states + 1) // 2
        self.mean, self.covariance = found[:m].copy(), unpack_array(found[m : m + half])
        return found

    @property
    def _bank(self) -> slice:
        """Where hypotheses are held."""
        m = self._states
        first = m + m * (m + 1) // 2
        return slice(first, first + self.filtering.rows)

    @property
    def hypotheses(self) -> list[Hypothesis]:
        """Where the AUV may be."""
        if self.filtering.hypotheses == 1 or self._held[self._bank][0]:
            return [Hypothesis(1.0, self.mean, self.covariance)]
        return hypotheses(self._held[self._bank], self._states)

    @property
    def fitting(self) -> int:
        """How many positions fit."""
        return places(self.hypotheses)

    def tidy(self) -> None:
        """Drop and merge hypotheses, and keep no more room than they need."""
        bank = self._held[self._bank]
        if not bank.size or bank[0]:
            return
        rows, known = tidied(bank, self._states)
        room = room_for(len(known), self.filtering.hypotheses)
        before, after = self._held[: self._bank.start], self._held[self._bank.stop :]
        self.filtering = replace(self.filtering, hypotheses=room)
        self._known.setdefault(room, _Verbs(self.filtering, self.process))
        self._held = np.concatenate([before, rows[: self.filtering.rows], after])


class _Verbs:
    """The Functions of a filter with room for some hypotheses."""

    def __init__(self, filtering: Filtering, process: Callable[[SX], Process]) -> None:
        self.filtering, self.process = filtering, process
        m = filtering.count
        sizes = [m, m * (m + 1) // 2, filtering.rows, filtering.counted]
        self._parts = [
            symbol(name, size)
            for name, size in zip(("x", "P", "bank", "misses"), sizes, strict=True)
        ]
        self._sensed: dict[tuple[object, ...], Call] = {}

    @property
    def _memory(self) -> Memory:
        return self.filtering.memory(*self._parts)

    @cached_property
    def predict(self) -> Call:
        """(held, u, dt) -> held."""
        u, dt = symbol("u", 3), symbol("dt")
        after = self.filtering.predicted(self._memory, u, self.process(dt))
        return self._call([u, dt], self._packed(after))

    def update(self, sensor: Sensor) -> Call:
        """(held, z, told, sigma, more) -> held."""
        return self._of(("update", sensor), lambda: self._update(sensor))

    def innovation(self, sensor: Sensor) -> Call:
        """(held, z, told, sigma, more) -> innovation, variance, derivative."""
        return self._of(("innovation", sensor), lambda: self._innovation(sensor))

    def range(self, sensor: Sensor, beacon: int) -> Call:
        """(held, z, told, sigma, more) -> held, fate, innovation, variance."""
        return self._of(("range", sensor, beacon), lambda: self._range(sensor, beacon))

    def _of(self, key: tuple[object, ...], made: Callable[[], Call]) -> Call:
        if key not in self._sensed:
            self._sensed[key] = made()
        return self._sensed[key]

    def _update(self, sensor: Sensor) -> Call:
        given, seen = _measured(sensor)
        return self._call(given, self._packed(self.filtering.observed(self._memory, seen)))

    def _innovation(self, sensor: Sensor) -> Call:
        given, seen = _measured(sensor)
        x, P = self._memory.means[0], self._memory.covariances[0]
        nu, S, H = self.filtering.estimator.innovation(x, P, *seen)
        return self._call(given, [nu, S, H.T])

    def _range(self, sensor: Sensor, beacon: int) -> Call:
        given, seen = _measured(sensor)
        after, taken = self.filtering.ranged(self._memory, seen, beacon, ca.SX(1.0))
        return self._call(given, [*self._packed(after), *taken])

    def _packed(self, memory: Memory) -> list[SX]:
        x, P = self.filtering.moments(memory)
        return [x, pack(P), self.filtering.bank(memory), memory.misses]

    def _call(self, given: list[SX], found: list[SX]) -> Call:
        column = ca.vertcat(*self._parts, *given)
        result = ca.densify(ca.vertcat(*found))
        return Call(ca.Function("verb", [column], [result], {"cse": True}))


def _measured(sensor: Sensor) -> tuple[list[SX], Seen]:
    """Symbols of a measurement, and the measurement."""
    z, told = symbol("z"), symbol("told", len(BEACON) + 2)
    stated = cast(Sensor, Stated(sensor=sensor))  # whose `periodic` is no class's
    return [z, told], Seen(z, stated, told)
