"""What an AUV's filter is."""

from typing import NamedTuple, Protocol, runtime_checkable

import casadi as ca
import numpy as np

from obsplan.sensors import Sensor
from obsplan.vehicles import States, Vehicle


class Process(NamedTuple):
    """What a filter assumes of an AUV between two samples."""

    model: Vehicle
    noise: tuple[float, ...]  # of each of the filter's states, per square root of a second
    dt: float | ca.SX  # [s]
    walk_per_meter: tuple[float, ...] = ()  # besides, per square root of a metre travelled

    def covariance(self, x: ca.SX) -> ca.SX | ca.DM:
        """Of what is added to state x, which tells how fast the AUV is."""
        added = ca.DM(np.array(self.noise) ** 2) * self.dt
        if any(self.walk_per_meter):
            travelled = ca.fabs(x[3]) * self.dt
            added = added + ca.DM(np.array(self.walk_per_meter) ** 2) * travelled
        return ca.diag(added)


@runtime_checkable
class Estimator(Protocol):
    """A filter as CasADi expressions; a dataclass whose fields are keys of ``[estimator]``.

    Its first mean and covariance follow from its states: the scenario's first estimate for east,
    north, heading and speed, ``start`` and ``sigma`` of a `State` for the others, which are
    independent. It holds nothing that changes: mean x and covariance P are handed in and out.
    """

    def states(self, model: Vehicle) -> States:
        """Components of x by name: those of `STATES`, then any others."""
        ...

    def predict(self, x: ca.SX, P: ca.SX, u: ca.SX, process: Process) -> tuple[ca.SX, ca.SX]:
        """Mean and covariance one sample later; u as in `Vehicle.step`."""
        ...

    def innovation(
        self, x: ca.SX, P: ca.SX, z: ca.SX, sensor: Sensor, beacon: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Innovation of the scalar measurement z (a wrapped angle), its variance, and its slope H.

        H, 1 x n, is the measurement's derivative with respect to the state, as the filter takes it.
        """
        ...

    def update(
        self, x: ca.SX, P: ca.SX, z: ca.SX, sensor: Sensor, beacon: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Mean and covariance after the scalar measurement z, of the range or the heading."""
        ...
