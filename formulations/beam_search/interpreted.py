"""Sequences of turns as arrays: what runs without a compiler."""

import threading

import numpy as np
from jaxtyping import Float, Int

from ..model.casadi import Cases
from .selection import cheapest


class Interpreted(threading.local):
    """A beam of sequences, each thread's its own.

    `formulations.beam_search.compiled.Compiled` has the same methods.
    """

    def __init__(self, branching: Cases, turns: int, width: int) -> None:
        self._branching, self._turns, self._width = branching, turns, width

    def begin(self, pose: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "M half"]) -> None:
        """Make the beam of the one sequence without turns."""
        self.pose = pose[None]
        self._covariance = covariance[None]
        self._cost = np.zeros(1)
        self._taken: list[tuple[np.ndarray, np.ndarray]] = []

    def branch(self, told: Float[np.ndarray, " n"]) -> Float[np.ndarray, " branches"]:
        """What all branches of a stage are ranked by, of one sequence after the other."""
        costs, ranks, self._poses, self._predicted = self._branching(
            self.pose, self._covariance, self._cost, told
        )
        self._costs = costs.ravel()
        return ranks.ravel()

    def follow(self, keep: Int[np.ndarray, " some"]) -> None:
        """Make the beam of some branches."""
        self._taken.append((keep, self.pose))
        self.pose = self._poses.reshape(-1, 3).take(keep, axis=0)
        self._covariance = self._predicted.take(keep // self._turns, axis=0)
        self._cost = self._costs.take(keep)

    def search(self, told: Float[np.ndarray, "S n"]) -> None:
        """Go through all stages, keeping the cheapest."""
        for of_stage in told[:-1]:
            self.follow(cheapest(self.branch(of_stage), self._width))
        self.follow(cheapest(self.branch(told[-1]), 1))

    def first(
        self,
        told: Float[np.ndarray, "S n"],  # noqa: ARG002 - poses are kept
    ) -> tuple[float, Int[np.ndarray, " S"], Float[np.ndarray, "nodes 3"]]:
        """Cost of the first sequence, its turns by number, and the poses it passes."""
        turns, poses, k = [], [self.pose[0]], 0
        for keep, pose in reversed(self._taken):
            k, turn = divmod(int(keep[k]), self._turns)
            turns.append(turn)
            poses.append(pose[k])
        return float(self._cost[0]), np.array(turns[::-1]), np.array(poses[::-1])
