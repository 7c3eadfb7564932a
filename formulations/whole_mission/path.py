"""Paths of piecewise constant turns, and the gradient by the turns of functions of positions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Integer

from ..model.arcs import path, path_gradient
from .problem import Problem


@dataclass(frozen=True, eq=False)
class Turns:
    """Turns each held for ``hold`` samples, in units of the vehicle's limit, from -1 to 1."""

    problem: Problem
    hold: int

    @property
    def count(self) -> int:
        """Number of turns."""
        return -(-self.problem.steps // self.hold)

    @cached_property
    def _first(self) -> Integer[np.ndarray, " n"]:
        """Step at which each turn begins."""
        return np.arange(self.count) * self.hold

    def poses(self, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, "samples 3"]:
        """Poses of the aid vehicle at all samples, on exact arcs."""
        problem = self.problem
        return path(problem.start, self._rates(w), problem.cna_speed, problem.time_step)

    def gradient(
        self, w: Float[np.ndarray, " n"], by_position: Float[np.ndarray, "samples 2"]
    ) -> Float[np.ndarray, " n"]:
        """Gradient by the turns of what has the gradient ``by_position``: reverses `poses`."""
        problem = self.problem
        by_rate = path_gradient(
            problem.start, self._rates(w), problem.cna_speed, problem.time_step, by_position[1:]
        )
        return np.add.reduceat(by_rate, self._first) * problem.max_turn_rate

    def of(self, turn_rate: Float[np.ndarray, " steps"]) -> Float[np.ndarray, " n"]:
        """Turns that keep the headings of turn rates [rad/s] given at each step."""
        end = np.minimum(self._first + self.hold, self.problem.steps)
        mean = np.add.reduceat(turn_rate, self._first) / (end - self._first)
        return np.clip(mean / self.problem.max_turn_rate, -1.0, 1.0)

    def _rates(self, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, " steps"]:
        """Turn rate [rad/s] of every step."""
        each = np.repeat(w, self.hold)
        return each[: self.problem.steps] * self.problem.max_turn_rate
