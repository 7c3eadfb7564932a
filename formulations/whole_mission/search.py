"""Search for the turns of a whole mission: descend from many starts, keep the best."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import cast

import numpy as np
from jaxtyping import Float, Integer

from formulations.solution import Status

from .covariance import PredictedVariance
from .mission import Mission
from .path import Turns
from .starts import Violation, shaken, starts

PENALTIES = (1.0, 30.0, 1000.0)  # of the mean square violation, one after the other [-]
PROBE = 1e-3  # [m]; by which positions are moved to see how the violation changes
PROBES = PROBE * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
FIRST, ITERATIONS, POLISH = (
    30,
    300,
    3000,
)  # of the descents from all starts, of the better ones' and of the best's
BETTER = 3  # one of so many starts is worth going on with
REDUCTION = 1e-8  # of the objective, relative to going straight on: where it falls by less, the descent is at its end
PAIRS = 20  # steps remembered as curvature
GRADIENT = 1e-7  # largest entry of the projected gradient, likewise relative, at which there is nothing to descend
ALIKE = 1e-3  # [m]; violations that differ by less are ranked by their scores


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Turns of a whole mission, each held for ``hold`` steps."""

    turn_rates: Float[np.ndarray, " n"]  # [rad/s]
    hold: int
    score: float  # time mean of the weighted position variance [m^2]
    violation: float  # how far the path breaks a limit at a sample [m], at least 0
    status: Status


@dataclass(frozen=True, eq=False)
class Objective:
    """Mean variance of turns, and with a penalty on the mean square violation."""

    turns: Turns
    variance: PredictedVariance
    violation: Violation | None
    margin: float  # kept from the limits [m]

    @cached_property
    def unit(self) -> float:
        """Mean variance of going straight on [m^2], which the descents' tolerances are relative to; 1 where all is known."""
        return self.score(np.zeros(self.turns.count)) or 1.0

    def score(self, w: Float[np.ndarray, " n"]) -> float:
        """Mean variance [m^2]."""
        return self.variance(self.turns.poses(w)[self.turns.mission.stages.end, :2])[0]

    def broken(self, w: Float[np.ndarray, " n"]) -> float:
        """How far the path breaks a limit at a sample [m], at least 0."""
        return (
            0.0
            if self.violation is None
            else max(0.0, float(self._violation(self.turns.poses(w)[:, :2]).max()))
        )

    def penalised(
        self, w: Float[np.ndarray, " n"], penalty: float
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Mean variance and penalty [m^2], and the gradient."""
        x, ends = self.turns.poses(w)[:, :2], self.turns.mission.stages.end
        by_position = np.zeros_like(x)
        value, by_position[ends] = self.variance(x[ends])
        if self.violation is not None:
            deep = np.maximum(self._violation(x) + self.margin, 0.0)
            value += penalty * float(np.mean(deep**2))
            broken = np.flatnonzero(deep > 0)
            by_position[1 + broken] += (
                (2 * penalty / deep.size) * deep[broken, None] * self._slope(x, broken)
            )
        return value, self.turns.gradient(w, by_position)

    def _violation(self, x: Float[np.ndarray, "samples 2"]) -> Float[np.ndarray, " steps"]:
        mission = self.turns.mission
        return cast(Violation, self.violation)(
            x[1:], np.arange(1, mission.steps + 1) * mission.time_step
        )  # the start is where it is

    def _slope(
        self, x: Float[np.ndarray, "samples 2"], steps: Integer[np.ndarray, " some"]
    ) -> Float[np.ndarray, "some 2"]:
        time = (steps + 1) * self.turns.mission.time_step
        east, west, north, south = cast(Violation, self.violation)(
            x[1 + steps] + PROBES[:, None], time
        )
        return np.stack([east - west, north - south], axis=-1) / (2 * PROBE)


@dataclass(frozen=True, eq=False)
class Try:
    """Turns, whether they are a local optimum, and what they are worth."""

    w: Float[np.ndarray, " n"]
    status: Status
    broken: float  # [m]
    score: float  # [m^2]


def rank(tried: Try) -> tuple[int, float]:
    """What is better comes first: less violation, in steps of `ALIKE` the first of which is none at all, then less variance."""
    return math.ceil(tried.broken / ALIKE), tried.score


def optimise(
    mission: Mission,
    *,
    hold: int,
    count: int,
    random: np.random.Generator,
    violation: Violation | None = None,
    margin: float = 0.0,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> Plan:
    """Find turns, each held for ``hold`` steps, for the least time mean of the AUVs' predicted position variance.

    From each start (`starts`) a bounded quasi-Newton method (L-BFGS-B: Byrd, Lu, Nocedal and Zhu 1995) descends along exact gradients: the
    covariance recursion's by CasADi, the path's in closed form; the better ones go on. What is left of ``count`` descents begins at the
    best, some of its turns shaken, and the best's own goes on to the end. Limits are penalties on the square of their violation at the
    mission's samples, plus ``margin`` [m], in rising weights; of the results those that violate least are kept, and of these the best.
    It is a local optimum: nothing is proven about the global one.

    Parameters
    ----------
    mission, hold, count, random
        What is known; steps that a turn lasts; number of descents, at least 1; where shaken and random turns come from.
    violation
        How far [m] positions at times [s] of the mission are on the wrong side of a limit, at most 0 where they are right.
    progress
        Called after each descent with (iterations allowed so far, iterations allowed in all).
    """
    turns = Turns(mission, hold)
    objective = Objective(turns, PredictedVariance(mission), violation, margin)
    begun = [
        assess(objective, w, Status.BEST_MANOEUVRE)
        for w in islice(starts(turns, random, violation), count)
    ]
    going_on, shakes = -(-len(begun) // BETTER), count - len(begun)
    allowed, done = FIRST * len(begun) + ITERATIONS * (going_on + shakes + 1), 0

    def descended(w: Float[np.ndarray, " n"], iterations: int = ITERATIONS) -> Try:
        nonlocal done
        found = descend(objective, w, iterations)
        done += min(iterations, ITERATIONS)  # the last descent is seldom longer than the others
        progress(done, allowed)
        return found

    rough = sorted((descended(one.w, FIRST) for one in begun), key=rank)
    best = min((*begun, *(descended(one.w) for one in rough[:going_on])), key=rank)
    for _ in range(shakes):
        best = min(best, descended(shaken(best.w, random)), key=rank)
    best = min(descended(best.w, POLISH), best, key=rank)
    return Plan(
        turn_rates=best.w * mission.max_turn_rate,
        hold=hold,
        score=best.score,
        violation=best.broken,
        status=Status.VIOLATED if best.broken > 0 else best.status,
    )


def assess(objective: Objective, w: Float[np.ndarray, " n"], status: Status) -> Try:
    """What turns are worth."""
    return Try(w, status, objective.broken(w), objective.score(w))


def descend(objective: Objective, w: Float[np.ndarray, " n"], iterations: int = ITERATIONS) -> Try:
    """A local minimiser, or where the iterations ended."""
    from scipy.optimize import minimize

    def scaled(w: np.ndarray, penalty: float) -> tuple[float, np.ndarray]:
        value, gradient = objective.penalised(w, penalty)
        return value / objective.unit, gradient / objective.unit

    success = True
    for penalty in (0.0,) if objective.violation is None else PENALTIES:
        result = minimize(
            scaled,
            w,
            args=(penalty,),
            jac=True,
            method="L-BFGS-B",
            bounds=[(-1.0, 1.0)] * w.size,
            options={
                "maxiter": iterations,
                "maxfun": 2 * iterations,
                "ftol": REDUCTION,
                "gtol": GRADIENT,
                "maxcor": PAIRS,
            },
        )
        w, success = np.clip(result.x, -1.0, 1.0), bool(result.success)
    return assess(objective, w, Status.OPTIMAL if success else Status.INACCURATE)
