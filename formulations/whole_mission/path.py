"""Paths of piecewise constant turns, sampled on exact arcs, and the gradient by the turns of what depends on the positions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Integer

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
        turn, chord, heading = self._steps(w)
        ahead = chord[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        moved = np.concatenate([np.zeros((1, 2)), np.cumsum(ahead, axis=0)])
        return np.column_stack(
            [
                self.mission.start[:2] + moved,
                self.mission.start[2] + np.concatenate([[0.0], np.cumsum(turn)]),
            ]
        )

    def gradient(
        self, w: Float[np.ndarray, " n"], by_position: Float[np.ndarray, "samples 2"]
    ) -> Float[np.ndarray, " n"]:
        """Gradient by the turns of what has the gradient ``by_position``: the reverse of `poses`."""
        turn, chord, heading = self._steps(w)
        later = np.cumsum(by_position[:0:-1], axis=0)[
            ::-1
        ]  # by the move of each step, which all later positions share
        cos, sin = np.cos(heading), np.sin(heading)
        by_chord = later[:, 0] * cos + later[:, 1] * sin
        by_heading = chord * (later[:, 1] * cos - later[:, 0] * sin)
        after = np.concatenate([np.cumsum(by_heading[:0:-1])[::-1], [0.0]])
        by_turn = (
            by_chord
            * self.mission.cna_speed
            * self.mission.time_step
            * 0.5
            * sinc_slope(0.5 * turn)
            + 0.5 * by_heading
            + after
        )
        return np.add.reduceat(by_turn, self._first) * (
            self.mission.max_turn_rate * self.mission.time_step
        )

    def of(self, turn_rate: Float[np.ndarray, " steps"]) -> Float[np.ndarray, " n"]:
        """Turns that keep the headings of turn rates [rad/s] given at each step."""
        held = np.minimum(self._first + self.hold, self.mission.steps) - self._first
        return np.clip(
            np.add.reduceat(turn_rate, self._first) / held / self.mission.max_turn_rate, -1.0, 1.0
        )

    def _steps(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Turn [rad], chord [m] and the chord's heading [rad] of every step."""
        dt = self.mission.time_step
        turn = np.repeat(w, self.hold)[: self.mission.steps] * (self.mission.max_turn_rate * dt)
        chord = self.mission.cna_speed * dt * np.sinc(0.5 * turn / np.pi)
        return turn, chord, self.mission.start[2] + np.cumsum(turn) - 0.5 * turn


def sinc_slope(z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Slope of sin(z)/z; its series near 0, where the quotient loses its digits and the next term, z^5/840, has none."""
    small = np.abs(z) < 1e-2
    safe = np.where(small, 1.0, z)
    return np.where(small, -z / 3 + z**3 / 30, (safe * np.cos(safe) - np.sin(safe)) / safe**2)
