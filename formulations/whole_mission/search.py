"""Search for the turns of a whole mission: multi-start descent along exact gradients."""

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Integer

from ..solution import Solution, Status
from .covariance import PredictedVariance
from .limits import Limits
from .path import Turns
from .problem import Problem
from .starts import perturbed, starts

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

PENALTIES = (1.0, 30.0, 1000.0)  # of the mean square violation, one after the other [-]
FIRST = 30  # iterations of the descents from all starts
ITERATIONS = 300  # of the better ones' descents
POLISH = 3000  # of the best's
RESUMED = 3  # more descents, where the last ended short of an optimum
BETTER = 3  # one of so many starts is worth going on with
REDUCTION = 1e-8  # of the objective, relative to going straight on, that a descent ends below
PAIRS = 20  # steps remembered as curvature
GRADIENT = 1e-7  # largest entry of the projected gradient, likewise relative, that ends a descent
# Largest decrease of the objective, likewise relative, that a step along the projected gradient
# finds from an optimum. It found 2e-7 at most where descents ended, 4e-6 at least where they began.
CERTIFIED = 1e-6
STEPS = 0.25 ** np.arange(10)  # along it, of the largest turn
SETTLED = 1e-4  # of the objective's unit; a plan that is better by less is no better
ALIKE = 1e-3  # [m]; violations that differ by less are ranked by their objectives

REMEDIES = {
    Status.INACCURATE: (
        "the best descent stopped short of a local optimum; more starts or longer turns may help"
    ),
    Status.BEST_MANOEUVRE: (
        "no descent improved on the best start, which is taken; more starts may help"
    ),
}

Progress = Callable[[int, int], None]


def untold(_done: int, _all: int) -> None:
    """Tell nobody how far the search is."""


@dataclass(frozen=True, eq=False)
class Objective:
    """Mean variance of turns, and with a penalty on the mean square violation."""

    turns: Turns

    @cached_property
    def variance(self) -> PredictedVariance:
        """Mean variance of positions."""
        return PredictedVariance(self.turns.problem)

    @cached_property
    def limits(self) -> Limits:
        """Limits of positions."""
        return Limits(self.turns.problem)

    @cached_property
    def unit(self) -> float:
        """Mean variance of going straight on [m^2], the descents' unit; 1 where all is known."""
        return self.value(np.zeros(self.turns.size)) or 1.0

    @property
    def penalties(self) -> tuple[float, ...]:
        """Penalties of the descents one after the other; none without limits."""
        return PENALTIES if self.limits else (0.0,)

    @cached_property
    def samples(self) -> Integer[np.ndarray, " some"]:
        """Samples at which poses are needed: limits hold at all of them."""
        return self.turns.samples if self.limits else self.turns.nodes

    @cached_property
    def _ends(self) -> Integer[np.ndarray, " S"]:
        """Which of them end stages."""
        return np.searchsorted(self.samples, self.turns.problem.stages.end)

    def value(self, w: Float[np.ndarray, " n"]) -> float:
        """Mean variance [m^2]."""
        at_ranges = self.turns.poses(w, self.samples)[:, self._ends, :2]
        return self.variance.value(at_ranges.swapaxes(0, 1))

    def primal_residual(self, w: Float[np.ndarray, " n"]) -> float:
        """How far the path breaks a limit at a sample [m], at least 0."""
        return self.limits.worst(self.turns.poses(w)[..., :2]) if self.limits else 0.0

    def dual_residual(self, w: Float[np.ndarray, " n"]) -> float:
        """Largest entry of the projected gradient [m^2] under the last penalty.

        The penalty's slope stands for the multipliers (Nocedal and Wright 2006, 17.1).
        """
        _, gradient = self.penalised(w, self.penalties[-1])
        return float(np.abs(np.clip(w - gradient, -1.0, 1.0) - w).max())

    def cauchy_decrease(self, w: Float[np.ndarray, " n"]) -> float:
        """Greatest decrease found along the projected gradient, relative to `unit`.

        It is that under the last penalty, and of the order of the projected gradient's square:
        next to nothing at a local optimum (Conn, Gould and Toint 2000, 12.1).
        """
        value, gradient = self.penalised(w, self.penalties[-1])
        steepest = float(np.abs(gradient).max())
        if steepest == 0.0:
            return 0.0
        tried = [
            self.penalised(np.clip(w - step * gradient / steepest, -1.0, 1.0), self.penalties[-1])
            for step in STEPS
        ]
        return max(value - least for least, _ in tried) / self.unit

    def penalised(
        self, w: Float[np.ndarray, " n"], penalty: float
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Mean variance and penalty [m^2], and the gradient."""
        x = self.turns.poses(w, self.samples)[..., :2]
        by_position = np.zeros_like(x)
        value, slope = self.variance(x[:, self._ends].swapaxes(0, 1))
        by_position[:, self._ends] = slope.swapaxes(0, 1)
        if self.limits:
            broken, slope = self.limits.penalty(x, penalty)
            value += broken
            by_position += slope
        return value, self.turns.gradient(w, by_position, self.samples)


@dataclass(frozen=True, eq=False)
class Candidate:
    """Turns, what is known of their optimality, and what they are worth."""

    w: Float[np.ndarray, " n"]
    status: Status
    violation: float  # [m], at least 0
    value: float  # mean variance [m^2]


def rank(candidate: Candidate) -> tuple[int, float]:
    """What is better comes first: less violation, in steps of `ALIKE`, then less variance.

    The first of these steps is no violation at all.
    """
    return math.ceil(candidate.violation / ALIKE), candidate.value


def multi_start(
    problem: Problem,
    *,
    hold: int,
    count: int,
    random: np.random.Generator,
    progress: Progress = untold,
    also: Sequence[Float[np.ndarray, " n"]] = (),
) -> Solution:
    """Find turns of all vehicles at once for the least time mean of the AUVs' position variance.

    From each start (`starts`) a bounded quasi-Newton method (L-BFGS-B: Byrd, Lu, Nocedal and Zhu
    1995) descends along exact gradients: the covariance recursion's by CasADi, the path's in closed
    form; the better ones go on. What is left of ``count`` descents begins at the best, some of its
    turns perturbed, and the best's own goes on to the end. Limits are penalties on the square of
    their violation at the mission's samples, plus a margin, in rising weights; of the results
    those that violate least are kept, and of these the best. It is a local optimum: nothing is
    proven about the global one.

    Parameters
    ----------
    problem
        What is known before the mission begins.
    hold
        Samples that a turn lasts.
    count
        Number of descents, at least 1.
    random
        Where perturbed and random turns come from.
    progress
        Called after each descent with (iterations allowed so far, iterations allowed in all).
    also
        Turns in units of the limits to begin with as well (`Turns`).

    Returns
    -------
    ``x``: turn rates [rad/s] of each vehicle, each held for ``hold`` samples. ``objective``: the
    mean variance [m^2]. Primal residual: how far a path breaks a limit at a sample [m]. Dual
    residual: largest entry of the projected gradient, by turns in units of the limits [m^2].
    """
    turns = Turns(problem, hold)
    objective = Objective(turns)
    begun = [
        assess(objective, w, Status.BEST_MANOEUVRE)
        for w in (*also, *islice(starts(turns, random), count))
    ]
    going_on = -(-len(begun) // BETTER)
    shakes = count + len(also) - len(begun)
    allowed = FIRST * len(begun) + ITERATIONS * (going_on + shakes + 1)
    done = 0

    def descended(w: Float[np.ndarray, " n"], iterations: int = ITERATIONS) -> Candidate:
        nonlocal done
        found = descend(objective, w, iterations)
        done += min(iterations, ITERATIONS)  # the last descent is seldom longer than the others
        progress(done, allowed)
        return found

    rough = sorted((descended(start.w, FIRST) for start in begun), key=rank)
    better = [descended(candidate.w) for candidate in rough[:going_on]]
    best = min((*begun, *better), key=rank)
    for _ in range(shakes):
        best = min(best, descended(perturbed(best.w, random)), key=rank)
    best = min(descended(best.w, POLISH), best, key=rank)
    best = _resumed(objective, best)
    return solution_of(objective, best)


def solution_of(objective: Objective, best: Candidate) -> Solution:
    """The best as `multi_start` returns it."""
    turns = objective.turns
    limits = np.array([[vehicle.max_turn_rate] for vehicle in turns.problem.vehicles])
    return Solution(
        x=turns.of_each(best.w) * limits,
        objective=best.value,
        status=_status(objective, best),
        primal_residual=best.violation,
        dual_residual=objective.dual_residual(best.w),
        remedies=REMEDIES,
    )


def better(objective: Objective, one: Candidate, other: Candidate) -> bool:
    """Whether it breaks limits less, or its mean variance is less by `SETTLED`."""
    (one_broken, one_value), (broken, value) = rank(one), rank(other)
    least = SETTLED * objective.unit
    return one_broken < broken or (one_broken == broken and one_value < value - least)


def assess(objective: Objective, w: Float[np.ndarray, " n"], status: Status) -> Candidate:
    """What turns are worth."""
    return Candidate(w, status, objective.primal_residual(w), objective.value(w))


def descend(
    objective: Objective,
    w: Float[np.ndarray, " n"],
    iterations: int = ITERATIONS,
    penalties: tuple[float, ...] | None = None,
) -> Candidate:
    """A local minimiser, or where the iterations ended.

    It is one under penalties one after the other; default: the objective's.
    """
    from scipy.optimize import minimize

    def scaled(w: np.ndarray, penalty: float) -> tuple[float, np.ndarray]:
        value, gradient = objective.penalised(w, penalty)
        return value / objective.unit, gradient / objective.unit

    options = {
        "maxiter": iterations,
        "maxfun": 2 * iterations,
        "ftol": REDUCTION,
        "gtol": GRADIENT,
        "maxcor": PAIRS,
    }
    bounds = [(-1.0, 1.0)] * w.size
    success, start = True, w
    try:
        for penalty in objective.penalties if penalties is None else penalties:
            with one_thread():
                result = minimize(
                    scaled,
                    w,
                    args=(penalty,),
                    jac=True,
                    method="L-BFGS-B",
                    bounds=bounds,
                    options=options,
                )
            found = np.asarray(result.x, dtype=float)
            if found.shape != w.shape or not np.isfinite(found).all():
                return _failed(objective, start)
            w, success = np.clip(found, -1.0, 1.0), bool(result.success)
    except Exception:  # whatever the minimiser stumbles over ends this descent alone
        return _failed(objective, start)
    return assess(objective, w, Status.OPTIMAL if success else Status.INACCURATE)


def one_thread() -> AbstractContextManager[object]:
    """Linear algebra by one thread meanwhile.

    The minimiser's matrices are of a few tens of rows: threads that wait for each other over them
    take more than all the rest.
    """
    return _linear_algebra().limit(limits=1, user_api="blas")


@cache
def _linear_algebra() -> "ThreadpoolController":
    """The libraries of linear algebra that are loaded by the first descent."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def _resumed(objective: Objective, best: Candidate) -> Candidate:
    """Descend again from what the minimiser calls an optimum and is none, a few times at most."""
    for _ in range(RESUMED):
        if best.status != Status.OPTIMAL or objective.cauchy_decrease(best.w) <= CERTIFIED:
            break
        best = min(descend(objective, best.w, POLISH), best, key=rank)
    return best


def _failed(objective: Objective, start: Float[np.ndarray, " n"]) -> Candidate:
    """What is left of a descent that failed: its start, which counts for less than itself."""
    return replace(assess(objective, start, Status.BEST_MANOEUVRE), value=math.inf)


def _status(objective: Objective, best: Candidate) -> Status:
    """How the best came about; what the minimiser says of an optimum is tried."""
    if best.violation > 0:
        return Status.VIOLATED
    if best.status == Status.OPTIMAL and not objective.cauchy_decrease(best.w) <= CERTIFIED:
        return Status.INACCURATE
    return best.status
