"""Paths of piecewise constant turns, and the gradient by the turns of functions of positions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Integer

from ..model.arcs import path, path_gradient
from .problem import AidVehicle, Problem


@dataclass(frozen=True, eq=False)
class Turns:
    """Turns of all aid vehicles, each held for ``hold`` samples, one vehicle's after another's.

    They are in units of the vehicle's limit, from -1 to 1.
    """

    problem: Problem
    hold: int

    @property
    def count(self) -> int:
        """Number of turns of each vehicle."""
        return -(-self.problem.steps // self.hold)

    @property
    def size(self) -> int:
        """Number of turns of all."""
        return self.count * len(self.problem.vehicles)

    @cached_property
    def _first(self) -> Integer[np.ndarray, " n"]:
        """Step at which each turn of a vehicle begins."""
        return np.arange(self.count) * self.hold

    def of_each(self, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, "vehicles count"]:
        """Each vehicle's turns."""
        return w.reshape(-1, self.count)

    def poses(self, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, "vehicles samples 3"]:
        """Poses of the aid vehicles at all samples, on exact arcs."""
        dt = self.problem.time_step
        return np.stack(
            [
                path(vehicle.start, self._rates(vehicle, own), vehicle.speed, dt)
                for vehicle, own in zip(self.problem.vehicles, self.of_each(w), strict=True)
            ]
        )

    def gradient(
        self, w: Float[np.ndarray, " n"], by_position: Float[np.ndarray, "vehicles samples 2"]
    ) -> Float[np.ndarray, " n"]:
        """Gradient by the turns of what has the gradient ``by_position``: reverses `poses`."""
        dt = self.problem.time_step
        gradient = np.empty((len(by_position), self.count))
        each = zip(self.problem.vehicles, self.of_each(w), by_position, strict=True)
        for k, (vehicle, own, slope) in enumerate(each):
            rates = self._rates(vehicle, own)
            by_rate = path_gradient(vehicle.start, rates, vehicle.speed, dt, slope[1:])
            gradient[k] = np.add.reduceat(by_rate, self._first) * vehicle.max_turn_rate
        return gradient.ravel()

    def of(
        self, turn_rate: Float[np.ndarray, " steps"], vehicle: AidVehicle
    ) -> Float[np.ndarray, " count"]:
        """Turns that keep the headings of turn rates [rad/s] given at each step."""
        end = np.minimum(self._first + self.hold, self.problem.steps)
        mean = np.add.reduceat(turn_rate, self._first) / (end - self._first)
        return np.clip(mean / vehicle.max_turn_rate, -1.0, 1.0)

    def _rates(
        self, vehicle: AidVehicle, w: Float[np.ndarray, " count"]
    ) -> Float[np.ndarray, " steps"]:
        """Turn rate [rad/s] of a vehicle at every step."""
        each = np.repeat(w, self.hold)
        return each[: self.problem.steps] * vehicle.max_turn_rate
