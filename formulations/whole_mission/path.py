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

    They are in units of the vehicle's limit, from -1 to 1. Of the first one ``begun`` samples are
    over already.
    """

    problem: Problem
    hold: int
    begun: int = 0

    @property
    def count(self) -> int:
        """Number of turns of each vehicle."""
        return -(-(self.problem.steps + self.begun) // self.hold)

    @property
    def size(self) -> int:
        """Number of turns of all."""
        return self.count * len(self.problem.vehicles)

    @cached_property
    def _first(self) -> Integer[np.ndarray, " n"]:
        """Step at which each turn of a vehicle begins."""
        return np.maximum(np.arange(self.count) * self.hold - self.begun, 0)

    @cached_property
    def samples(self) -> Integer[np.ndarray, " samples"]:
        """All samples."""
        return np.arange(self.problem.steps + 1)

    @cached_property
    def nodes(self) -> Integer[np.ndarray, " nodes"]:
        """Samples at which turns begin or ranges come; the first and the last are among them."""
        return np.union1d(self._first, self.problem.stages.end)

    def of_each(self, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, "vehicles count"]:
        """Each vehicle's turns."""
        return w.reshape(-1, self.count)

    def poses(
        self, w: Float[np.ndarray, " n"], at: Integer[np.ndarray, " some"] | None = None
    ) -> Float[np.ndarray, "vehicles some 3"]:
        """Poses of the aid vehicles at all samples, or at some that have all `nodes`.

        They are on exact arcs.
        """
        samples = self.samples if at is None else at
        lasts = np.diff(samples) * self.problem.time_step
        return np.stack(
            [
                path(vehicle.start, self._rates(vehicle, own, samples), vehicle.speed, lasts)
                for vehicle, own in zip(self.problem.vehicles, self.of_each(w), strict=True)
            ]
        )

    def gradient(
        self,
        w: Float[np.ndarray, " n"],
        by_position: Float[np.ndarray, "vehicles some 2"],
        at: Integer[np.ndarray, " some"] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Gradient by the turns of what has the gradient ``by_position``: reverses `poses`."""
        samples = self.samples if at is None else at
        lasts = np.diff(samples) * self.problem.time_step
        first = np.searchsorted(samples, self._first)
        gradient = np.empty((len(by_position), self.count))
        each = zip(self.problem.vehicles, self.of_each(w), by_position, strict=True)
        for k, (vehicle, own, slope) in enumerate(each):
            rates = self._rates(vehicle, own, samples)
            by_rate = path_gradient(vehicle.start, rates, vehicle.speed, lasts, slope[1:])
            gradient[k] = np.add.reduceat(by_rate, first) * vehicle.max_turn_rate
        return gradient.ravel()

    def of(
        self, turn_rate: Float[np.ndarray, " steps"], vehicle: AidVehicle
    ) -> Float[np.ndarray, " count"]:
        """Turns that keep the headings of turn rates [rad/s] given at each step."""
        end = np.append(self._first[1:], self.problem.steps)
        mean = np.add.reduceat(turn_rate, self._first) / (end - self._first)
        return np.clip(mean / vehicle.max_turn_rate, -1.0, 1.0)

    def _rates(
        self,
        vehicle: AidVehicle,
        w: Float[np.ndarray, " count"],
        samples: Integer[np.ndarray, " some"],
    ) -> Float[np.ndarray, " intervals"]:
        """Turn rate [rad/s] of a vehicle from each of some samples to the next."""
        turn = (samples[:-1] + self.begun) // self.hold
        return w[turn] * vehicle.max_turn_rate
