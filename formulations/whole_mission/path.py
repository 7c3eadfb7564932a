"""Paths of piecewise constant turns, sampled on exact arcs, and the gradient by the turns of what depends on the positions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Integer

from ..model.arcs import path, path_gradient
from .mission import Mission


@dataclass(frozen=True, eq=False)
class Turns:
    """A mission's samples, and turns each held for ``hold`` steps; turn rates are in units of the vehicle's limit, from -1 to 1."""

    mission: Mission
    hold: int

    @property
    def count(self) -> int:
        """Number of turns."""
        return -(-self.mission.steps // self.hold)

    @cached_property
    def _first(self) -> Integer[np.ndarray, " n"]:
        return np.arange(self.count) * self.hold

    def poses(self, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, "samples 3"]:
        """Poses of the aid vehicle at all samples."""
        mission = self.mission
        return path(mission.start, self._rates(w), mission.cna_speed, mission.time_step)

    def gradient(
        self, w: Float[np.ndarray, " n"], by_position: Float[np.ndarray, "samples 2"]
    ) -> Float[np.ndarray, " n"]:
        """Gradient by the turns of what has the gradient ``by_position``: the reverse of `poses`."""
        mission = self.mission
        by_rate = path_gradient(
            mission.start, self._rates(w), mission.cna_speed, mission.time_step, by_position[1:]
        )
        return np.add.reduceat(by_rate, self._first) * mission.max_turn_rate

    def of(self, turn_rate: Float[np.ndarray, " steps"]) -> Float[np.ndarray, " n"]:
        """Turns that keep the headings of turn rates [rad/s] given at each step."""
        held = np.minimum(self._first + self.hold, self.mission.steps) - self._first
        return np.clip(
            np.add.reduceat(turn_rate, self._first) / held / self.mission.max_turn_rate, -1.0, 1.0
        )

    def _rates(self, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, " steps"]:
        """Turn rate [rad/s] of every step."""
        return np.repeat(w, self.hold)[: self.mission.steps] * self.mission.max_turn_rate
