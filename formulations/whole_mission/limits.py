"""How far paths of aid vehicles break limits, and the slope of it.

Each vehicle's own limits hold at the mission's samples. So do the distances between vehicles, to
which half of both vehicles' ways between samples is added, so that nothing in between is missed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import cast

import numpy as np
from jaxtyping import Float, Integer

from .problem import AidVehicle, Problem, Violation

PROBE = 1e-3  # [m]; by which positions are moved to see how the violation changes
PROBES = PROBE * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
Paths = Float[np.ndarray, "vehicles samples 2"]


@dataclass(frozen=True, eq=False)
class Limits:
    """The limits of a problem's vehicles; of the first sample nothing is said: they are there."""

    problem: Problem

    def __bool__(self) -> bool:
        """Whether there are any."""
        least, greatest = self.problem.separation
        apart = len(self.problem.vehicles) > 1 and bool(least > 0 or greatest < np.inf)
        return apart or bool(self._limited)

    def worst(self, x: Paths) -> float:
        """How far any sample breaks a limit [m], at least 0."""
        own = [float(self._violation(vehicle, x[k]).max()) for k, vehicle in self._limited]
        between = [float(broken.max()) for _, _, broken, _ in self._between(x)]
        return max(0.0, *own, *between)

    def penalty(self, x: Paths, weight: float) -> tuple[float, Paths]:
        """Weighted mean square violations, margins added, and the gradient."""
        value, gradient = 0.0, np.zeros_like(x)
        for k, vehicle in self._limited:
            deep = np.maximum(self._violation(vehicle, x[k]) + vehicle.margin, 0.0)
            value += weight * float(np.mean(deep**2))
            broken = np.flatnonzero(deep > 0)
            steepness = (2 * weight / deep.size) * deep[broken, None]
            gradient[k, 1 + broken] += steepness * self._slope(vehicle, x[k], broken)
        for one, other, broken, slope in self._between(x):
            margin = max(self.problem.vehicles[k].margin for k in (one, other))
            deep = np.maximum(broken + margin, 0.0)
            value += weight * float(np.mean(deep**2))
            pushed = (2 * weight / deep.size) * deep[:, None] * slope
            gradient[one, 1:] += pushed
            gradient[other, 1:] -= pushed
        return value, gradient

    @property
    def _limited(self) -> list[tuple[int, AidVehicle]]:
        return [(k, v) for k, v in enumerate(self.problem.vehicles) if v.violation is not None]

    def _violation(
        self, vehicle: AidVehicle, x: Float[np.ndarray, "samples 2"]
    ) -> Float[np.ndarray, " steps"]:
        """How far each sample but the first breaks a vehicle's own limit [m]."""
        time = np.arange(1, self.problem.steps + 1) * self.problem.time_step
        return cast(Violation, vehicle.violation)(x[1:], time)

    def _slope(
        self,
        vehicle: AidVehicle,
        x: Float[np.ndarray, "samples 2"],
        steps: Integer[np.ndarray, " some"],
    ) -> Float[np.ndarray, "some 2"]:
        """Gradient of the violation at some samples, by central differences."""
        time = (steps + 1) * self.problem.time_step
        around = x[1 + steps] + PROBES[:, None]
        east, west, north, south = cast(Violation, vehicle.violation)(around, time)
        return np.stack([east - west, north - south], axis=-1) / (2 * PROBE)

    def _between(
        self, x: Paths
    ) -> Iterator[tuple[int, int, Float[np.ndarray, " steps"], Float[np.ndarray, "steps 2"]]]:
        """For each two vehicles how far their distance breaks a limit [m], and its slope.

        The slope is by the first one's position; by the other's it is the opposite.
        """
        least, greatest = self.problem.separation
        if least <= 0 and greatest == np.inf:
            return
        for one, other in combinations(range(len(x)), 2):
            broken, slope = apart(x[one, 1:] - x[other, 1:], least, greatest)
            speeds = sum(self.problem.vehicles[k].speed for k in (one, other))
            yield one, other, broken + 0.5 * speeds * self.problem.time_step, slope


def apart(
    away: Float[np.ndarray, "*batch 2"], least: float, greatest: float
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch 2"]]:
    """How far a relative position is too near or too far [m], and the gradient."""
    distance = np.hypot(away[..., 0], away[..., 1])
    unit = away / np.maximum(distance, PROBE)[..., None]
    near, far = least - distance, distance - greatest
    return np.maximum(near, far), np.where((near > far)[..., None], -unit, unit)
