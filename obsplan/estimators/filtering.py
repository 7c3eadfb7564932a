"""A filter with its gate and its hypotheses, as expressions: what a step and a replay both call.

One hypothesis is the filter itself. Several are a Gaussian sum (Alspach and Sorenson 1972): each is
predicted and updated by the filter, and weighed by how well it foretold what was measured.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import SX, symbol
from formulations.model.covariance import pack, symmetric, unpack
from obsplan.estimators.estimator import Estimator, Process
from obsplan.estimators.ring import ring
from obsplan.fates import Fate
from obsplan.sensors import BEACON, Sensor

# the likelihood falls no further than at so many standard deviations: one false range outweighs
# no hypothesis for good
FAR = 4.0
LIVING = 1e-3  # least share of a hypothesis that has a say in what is rejected
GONE = -1e30  # logarithm of the weight of one that is not there
ACROSS = 0.5  # of how far it was off along a range, the position may be off across it, too
LEAST = 1e-12  # variance of what is expected of a range, where it is enlarged


class Memory(NamedTuple):
    """What a filter holds of an AUV: expressions."""

    means: list[SX]  # of each hypothesis
    covariances: list[SX]  # m x m
    weights: SX  # their logarithms, the greatest 0; of one hypothesis none
    # 1 until the first range has put several hypotheses in the place of the first estimate
    whole: SX
    misses: SX  # of each beacon, how many ranges were rejected in a row; none without a gate


class Taken(NamedTuple):
    """What became of a range."""

    fate: SX  # code of a `Fate`
    innovation: SX  # in the sensor's unit
    variance: SX  # of the innovation, as expected


class Seen(NamedTuple):
    """A measurement as the filter takes it."""

    z: SX
    sensor: Sensor
    told: SX  # the other vehicle (`BEACON`)


@dataclass(frozen=True, kw_only=True)
class Filtering:
    """The AUVs' filter.

    ``gate``: ranges that differ from what is expected by more standard deviations are rejected; 0:
    none is. After ``patience`` in a row the next is believed, and the estimate doubted.
    ``hypotheses``: how many there is room for.
    """

    estimator: Estimator
    count: int  # of states
    gate: float = 0.0
    patience: int = 2
    hypotheses: int = 1
    beacons: int = 1
    reach: float = np.inf  # greatest range [m]
    slant: bool = False  # whether a range cannot be shorter than depths are apart

    @property
    def rows(self) -> int:
        """In how many numbers several hypotheses are held."""
        m = self.count
        each = m + m * (m + 1) // 2 + 1
        return 1 + self.hypotheses * each if self.hypotheses > 1 else 0

    @property
    def counted(self) -> int:
        """Of how many beacons rejections are counted."""
        return self.beacons if self.gate else 0

    def memory(self, mean: SX, covariance: SX, bank: SX, misses: SX) -> Memory:
        """What is held, of its parts; covariances are packed."""
        m = self.count
        if self.hypotheses == 1:
            return Memory([mean], [unpack(covariance, m)], ca.SX(0.0), ca.SX(0.0), misses)
        each = (self.rows - 1) // self.hypotheses
        parts = ca.vertsplit(bank[1:], each)
        means = [part[:m] for part in parts]
        covariances = [unpack(part[m:-1], m) for part in parts]
        return Memory(means, covariances, ca.vertcat(*(p[-1] for p in parts)), bank[0], misses)

    def bank(self, memory: Memory) -> SX:
        """Several hypotheses in one column."""
        if self.hypotheses == 1:
            return ca.SX(0, 1)
        weights = ca.vertsplit(memory.weights)
        known = zip(memory.means, memory.covariances, weights, strict=True)
        parts = [ca.vertcat(x, pack(P), weight) for x, P, weight in known]
        return ca.vertcat(memory.whole, *parts)

    def moments(self, memory: Memory) -> tuple[SX, SX]:
        """Mean and covariance of all hypotheses together."""
        if self.hypotheses == 1:
            return memory.means[0], memory.covariances[0]
        weights = ca.vertsplit(shares(memory.weights))
        x = sum((w * x for w, x in zip(weights, memory.means, strict=True)), ca.SX(0.0))
        P = ca.SX.zeros(self.count, self.count)
        for w, one, own in zip(weights, memory.means, memory.covariances, strict=True):
            P += w * (own + (one - x) @ (one - x).T)
        return x, symmetric(P)

    def predicted(self, memory: Memory, u: SX, process: Process) -> Memory:
        """What is held one sample later."""

        def predict(x: SX, P: SX, u: SX, dt: SX) -> tuple[SX, ...]:
            return self.estimator.predict(x, P, u, process._replace(dt=dt))

        found = self._of_each(predict, memory, u, process.dt)
        return _with(memory, found)

    def observed(self, memory: Memory, seen: Seen) -> Memory:
        """What is held after a measurement that no gate looks at."""
        weights = memory.weights
        if self.hypotheses > 1:
            nu, S = self._innovations(memory, seen)
            weights = weighed(weights, nu**2 / S, S)
        return _with(memory, self._updates(memory, seen))._replace(weights=weights)

    def ranged(self, memory: Memory, seen: Seen, beacon: int, came: SX) -> tuple[Memory, Taken]:
        """What is held after a range of a beacon, if it came.

        A range that is rejected changes nothing. After some in a row the estimate is taken to be
        wrong: until a range fits again, each is believed, the covariance being enlarged until it is
        as expected.
        """
        nu, S = self._innovations(memory, seen)
        expected, variance = self._mixed(memory, nu, S)
        reason = self._reason(memory, seen, nu**2 / S)
        rejected, reopened, before = ca.SX(0.0), ca.SX(0.0), memory
        if self.gate:
            lost = memory.misses[beacon] >= self.patience
            reopened = ca.logic_and(lost, reason == Fate.INNOVATION)
            rejected = ca.logic_and(reason != Fate.ACCEPTED, ca.logic_not(reopened))
            before = self._enlarged(memory, seen, nu, S, reopened)
        after = self._taken(before, seen, nu, S, reopened)
        take = ca.logic_and(came, ca.logic_not(rejected)) if self.gate else came
        if self.hypotheses > 1:
            after = self._split(memory, seen, after)
        result = chosen(take, after, memory)
        if self.gate:
            fits = reason == Fate.ACCEPTED
            missed = ca.if_else(fits, 0.0, memory.misses[beacon] + rejected)
            misses = ca.SX(memory.misses)
            misses[beacon] = ca.if_else(came, missed, misses[beacon])
            result = result._replace(misses=misses)
        fate = ca.if_else(reopened, float(Fate.REOPENED), reason)
        return result, Taken(fate, expected, variance)

    def _reason(self, memory: Memory, seen: Seen, ratios: SX) -> SX:
        """Why a range is rejected, by squared innovations over their variances."""
        if not self.gate:
            return ca.SX(float(Fate.ACCEPTED))
        outside = ratios > self.gate**2
        if self.hypotheses > 1:
            living = shares(memory.weights) > LIVING
            outside = 1 - ca.mmax(ca.logic_and(living, ca.logic_not(outside)))
            outside = ca.logic_and(outside, ca.logic_not(memory.whole))
        reason = ca.if_else(outside, float(Fate.INNOVATION), float(Fate.ACCEPTED))
        margin = self.gate * seen.sensor.deviation(memory.means[0], seen.told)
        if self.slant:
            rows = [seen.told[BEACON.index(name)] for name in ("auv_depth", "depth")]
            shallow = seen.z + margin < ca.fabs(rows[0] - rows[1])
            reason = ca.if_else(shallow, float(Fate.SHORTER_THAN_DEPTH), reason)
        if np.isfinite(self.reach):
            far = seen.z - margin > self.reach
            reason = ca.if_else(far, float(Fate.OUT_OF_REACH), reason)
        return reason

    def _enlarged(self, memory: Memory, seen: Seen, nu: SX, S: SX, reopened: SX) -> Memory:
        """Covariances so large that the range is as expected, where that is asked for.

        They grow along the gain. Across the range the position's deviation is made half as large,
        and no larger, however often that happens: an estimate that is far off to the side is not
        found by a range that only sees part of it. What else it does not tell of stays as it is.
        """

        def direction(x: SX, P: SX, z: SX, told: SX) -> tuple[SX, ...]:
            H = self.estimator.innovation(x, P, z, seen.sensor, told)[2]
            along = P @ H.T
            slope = ca.fmax(ca.norm_2(H[:2]), LEAST)
            across = ca.vertcat(-H[1], H[0], ca.SX.zeros(x.numel() - 2)) / slope
            return along / ca.fmax(H @ along, LEAST), across, slope

        more = ca.if_else(reopened, ca.fmax(nu**2 - S, 0.0), 0.0)
        ways = self._of_each(direction, memory, seen.z, seen.told)
        known = zip(memory.covariances, ways, ca.vertsplit(more), strict=True)
        larger = []
        for P, (along, across, slope), m in known:
            variance = across.T @ P @ across
            missing = ca.fmax(ACROSS**2 * m / slope**2 - variance, 0.0)
            missing = ca.if_else(m > 0, missing, 0.0)
            larger.append(symmetric(P + m * along @ along.T + missing * across @ across.T))
        return memory._replace(covariances=larger)

    def _taken(self, memory: Memory, seen: Seen, nu: SX, S: SX, reopened: SX) -> Memory:
        """Hypotheses after a range that is not rejected.

        One that did not expect it is left as it is, and loses weight.
        """
        after = _with(memory, self._updates(memory, seen))
        if self.hypotheses == 1:
            return after
        ratios = nu**2 / S
        if self.gate:
            outside = ca.logic_and(ratios > self.gate**2, ca.logic_not(reopened))
            kept = [_either(outside[k], memory, after, k) for k in range(self.hypotheses)]
            after = _with(after, kept)
        return after._replace(weights=weighed(memory.weights, ratios, S))

    def _split(self, memory: Memory, seen: Seen, after: Memory) -> Memory:
        """The first range in the place of a first estimate that is too wide for one Gaussian."""
        x, P = memory.means[0], memory.covariances[0]
        found = ring(x, P, seen.z, seen.sensor, seen.told, self.hypotheses)
        weights = ca.fmax(found.weights - ca.mmax(found.weights), GONE)
        several = Memory(found.means, found.covariances, weights, ca.SX(0.0), memory.misses)
        split = ca.logic_and(memory.whole, found.bent)
        return chosen(split, several, after._replace(whole=ca.SX(0.0)))

    def _mixed(self, memory: Memory, nu: SX, S: SX) -> tuple[SX, SX]:
        """Innovation of all hypotheses together, and its variance."""
        if self.hypotheses == 1:
            return nu, S
        share = shares(memory.weights)
        mean = ca.dot(share, nu)
        return mean, ca.dot(share, S + (nu - mean) ** 2)

    def _innovations(self, memory: Memory, seen: Seen) -> tuple[SX, SX]:
        """Innovation of each hypothesis, and its variance."""

        def of(x: SX, P: SX, z: SX, told: SX) -> tuple[SX, ...]:
            return self.estimator.innovation(x, P, z, seen.sensor, told)[:2]

        found = self._of_each(of, memory, seen.z, seen.told)
        nu, S = zip(*found, strict=True)
        return ca.vertcat(*nu), ca.vertcat(*S)

    def _updates(self, memory: Memory, seen: Seen) -> list[tuple[SX, ...]]:
        """Each hypothesis after a measurement."""
        update = partial(self._update, sensor=seen.sensor)
        return self._of_each(update, memory, seen.z, seen.told)

    def _update(self, x: SX, P: SX, z: SX, told: SX, sensor: Sensor) -> tuple[SX, ...]:
        return self.estimator.update(x, P, z, sensor, told)

    def _of_each(
        self, f: Callable[..., tuple[SX, ...]], memory: Memory, *given: SX | float
    ) -> list[tuple[SX, ...]]:
        """What f makes of each hypothesis; it is differentiated once."""
        if self.hypotheses == 1:
            return [f(memory.means[0], memory.covariances[0], *given)]
        m = self.count
        x, half = symbol("x", m), symbol("P", m * (m + 1) // 2)
        symbols = [symbol(f"given_{i}", ca.SX(a).numel()) for i, a in enumerate(given)]
        one = ca.Function("one", [x, half, *symbols], [*f(x, unpack(half, m), *symbols)])
        known = zip(memory.means, memory.covariances, strict=True)
        return [tuple(one.call([x, pack(P), *given])) for x, P in known]


def is_taken(fate: SX) -> SX:
    """Whether a range of this fate was used; what came with it is believed then, too."""
    return ca.logic_or(ca.eq(fate, float(Fate.ACCEPTED)), ca.eq(fate, float(Fate.REOPENED)))


def shares(weights: SX) -> SX:
    """Weights that add up to 1, of their logarithms."""
    found = ca.exp(weights - ca.mmax(weights))
    return found / ca.sum1(found)


def weighed(weights: SX, ratios: SX, variances: SX) -> SX:
    """Logarithms of weights after a measurement, the greatest 0."""
    less = (ca.fmin(ratios, FAR**2) + ca.log(variances)) / 2
    found = weights - less
    return ca.fmax(found - ca.mmax(found), GONE)


def _with(memory: Memory, found: list[tuple[SX, ...]]) -> Memory:
    """Memory with other means and covariances."""
    means, covariances = ([*column] for column in zip(*found, strict=True))
    return memory._replace(means=means, covariances=covariances)


def _either(first: SX, one: Memory, other: Memory, k: int) -> tuple[SX, SX]:
    """Hypothesis k of one memory, or of another."""
    x = ca.if_else(first, one.means[k], other.means[k])
    packed = ca.if_else(first, pack(one.covariances[k]), pack(other.covariances[k]))
    return x, unpack(packed, x.numel())


def chosen(first: SX, one: Memory, other: Memory) -> Memory:
    """One memory, or another; rejections are counted as in the other."""
    found = [_either(first, one, other, k) for k in range(len(one.means))]
    weights = ca.if_else(first, one.weights, other.weights)
    whole = ca.if_else(first, one.whole, other.whole)
    return _with(other, found)._replace(weights=weights, whole=whole)
