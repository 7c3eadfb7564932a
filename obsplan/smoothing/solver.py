"""Gauss-Newton with Levenberg's damping over a tape's `Problem`, through a loss made steeper."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from obsplan.smoothing.elimination import Elimination, Motion, Policies, elimination_of
from obsplan.smoothing.loss import GEMAN_MCCLURE, Loss
from obsplan.smoothing.rows import Problem, Seen, heading_is

TOLERANCE = 1e-6  # of the last step, in the units below: ten micrometres
GAIN = 1e-10  # or that of the cost, relative
UNITS = (10.0, 10.0, 0.2, 0.2)  # a step counts against [m, m, rad, m/s]; others against theirs
FIRST_DAMPING = 1e-3  # per sample, in squares of those units
LEAST_DAMPING, MOST_DAMPING = 1e-6, 1e9
FASTER, SLOWER = 0.1, 10.0
MOST_STEPS = 200
PARTS = 6  # 64 bits at most
PART_STEPS = 40  # which only are to begin from
LEAST_PART = 50  # samples


@dataclass(frozen=True, kw_only=True)
class Solved:
    """Where the search ended."""

    x: Float[np.ndarray, "samples n"]
    covariance: Float[np.ndarray, "samples n n"]
    cost: float  # the least sum of losses
    weights: Float[np.ndarray, " rows"]
    residual: Float[np.ndarray, " rows"]  # in standard deviations
    iterations: int
    converged: bool


@dataclass(frozen=True, kw_only=True)
class Point:
    """A trajectory on the way."""

    x: Float[np.ndarray, "samples n"]
    noise_cost: float  # half the sum of the squares of its noise; infinite of a first guess
    seen: Seen


@dataclass(frozen=True, kw_only=True)
class Solver:
    """A problem, its motion, and its loss."""

    problem: Problem
    motion: Motion
    loss: Loss
    unit: Float[np.ndarray, " n"]  # of a step
    noisy: tuple[int, ...]  # components to which any step adds noise

    @property
    def elimination(self) -> Elimination:
        """The compiled recursions."""
        return elimination_of(self.problem.model, self.noisy)

    def solve(self, x: Float[np.ndarray, "samples n"]) -> Solved:
        """Search from a trajectory."""
        point, steps, done = self.search(x)
        policies = self._policies(point, self.loss, 0.0)
        r = point.seen.residual / point.seen.sigma
        return Solved(
            x=point.x,
            covariance=self.elimination.covariances(point.x, self.motion, policies),
            cost=self._cost(point, self.loss, point),
            weights=self._weights(r, self.loss),
            residual=r,
            iterations=steps,
            converged=done,
        )

    def reckoned(self) -> Float[np.ndarray, "samples n"]:
        """A trajectory to begin from, where none is given: dead reckoning, prolonged bit by bit.

        Of dead reckoning alone the end may be far off. Each bit is as long as all before it, is
        reckoned from where they end, and is smoothed with them.
        """
        samples = len(self.motion.noise)
        x = self.elimination.reckoned(self.motion.first, self.motion)
        # the whole with that loss is the search itself, if it is its own
        whole = 1 if self.loss.kind == GEMAN_MCCLURE else 0
        for share in range(PARTS, whole - 1, -1):
            count = samples >> share
            if count < LEAST_PART:
                continue
            x[:count] = self._until(count).search(x[:count], PART_STEPS)[0].x
            rest = self.motion.after(count - 1)
            x[count - 1 :] = self.elimination.reckoned(x[count - 1], rest)
        return x

    def _until(self, count: int) -> "Solver":
        """The same of the first samples alone, with the loss that outliers pull least."""
        problem, motion = self.problem.until(count), self.motion.until(count)
        return replace(self, problem=problem, motion=motion, loss=Loss())

    def search(
        self, x: Float[np.ndarray, "samples n"], most: int = MOST_STEPS
    ) -> tuple[Point, int, bool]:
        """Where a search ends, after how many steps, and whether it came to rest."""
        point = self._at(x, np.inf)
        loss = self.loss.convex(self._gross(point))
        damping, done, steps = 0.0, False, 0
        while steps < most and not done and damping < MOST_DAMPING:
            steps += 1
            trial = self._follow(point, self._policies(point, loss, damping))
            before, after = (self._cost(one, loss, point) for one in (point, trial))
            small = self._step(point.x, trial.x) < TOLERANCE or 0 <= before - after < GAIN * after
            if after > before and not small:
                damping = max(FIRST_DAMPING, damping * SLOWER)
                continue
            done = small and loss.convexity == 1.0 and damping == 0.0
            damping = damping * FASTER if damping > LEAST_DAMPING else 0.0
            point, loss = trial, loss.steeper
        return point, steps, done

    def ranges_left(
        self, x: Float[np.ndarray, "samples n"], auv: int
    ) -> Float[np.ndarray, " some"]:
        """What is left of an AUV's measurements in a trajectory, in standard deviations."""
        seen, mine = self.problem.seen(x), self.robust & (self.problem.rows.auv == auv)
        return (seen.residual / seen.sigma)[mine]

    def _at(self, x: Float[np.ndarray, "samples n"], noise_cost: float) -> Point:
        return Point(x=x, noise_cost=noise_cost, seen=self.problem.seen(x))

    def _policies(self, point: Point, loss: Loss, damping: float) -> Policies:
        """The best noise about a trajectory, damped towards it."""
        weights = self._weights(point.seen.residual / point.seen.sigma, loss)
        information, vector = self.problem.normal(point.seen, weights)
        information = information + damping * np.diag(self.unit**-2.0)
        return self.elimination.policies(point.x, self.motion, information, vector)

    def _follow(self, point: Point, policies: Policies) -> Point:
        """The trajectory that follows it."""
        return self._at(*self.elimination.trajectory(point.x, self.motion, policies))

    def _cost(self, point: Point, loss: Loss, deviations: Point) -> float:
        """Sum of losses, by the deviations that another trajectory has."""
        r = point.seen.residual / deviations.seen.sigma
        robust = self.robust
        usual = replace(loss, kind="squares").cost(r[~robust])
        return point.noise_cost + float(loss.cost(r[robust]).sum() + usual.sum())

    def _weights(self, r: Float[np.ndarray, " rows"], loss: Loss) -> Float[np.ndarray, " rows"]:
        return np.where(self.robust, loss.weight(r), 1.0)

    def _gross(self, point: Point) -> Float[np.ndarray, " some"]:
        return (point.seen.residual / point.seen.sigma)[self.robust]

    @property
    def robust(self) -> np.ndarray:
        """Rows that may be gross errors: all but headings."""
        compasses = [k for k, one in enumerate(self.problem.sensors) if heading_is(one)]
        return ~np.isin(self.problem.rows.sensor, compasses)

    def _step(self, old: np.ndarray, new: np.ndarray) -> float:
        """Largest change of any component."""
        return float(np.max(np.abs(new - old) / self.unit))
