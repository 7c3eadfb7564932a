"""Extended Kalman filter, as CasADi expressions; Jacobians by differentiation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import casadi as ca

from formulations.model.covariance import propagate, symmetric
from obsplan.estimators.jacobian import jacobian


@runtime_checkable
class Sensor(Protocol):
    """What the filter needs of a sensor."""

    @property
    def sigma(self) -> float:
        """Standard deviation of the error, in the unit of the measurement."""
        ...

    @property
    def periodic(self) -> bool:
        """Whether the measurement is an angle [rad]."""
        ...

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Measurement of state x."""
        ...


@dataclass(frozen=True, kw_only=True)
class Ekf:
    r"""Extended Kalman filter for :math:`x^+ = f(x, u) + w`, :math:`z = h(x) + v` with scalar measurements, Joseph form.

    ``f(x, u)`` is the discrete model over one sample and ``Q`` the covariance of w over it.
    """

    f: Callable[[ca.SX, ca.SX], ca.SX]
    Q: ca.DM

    def predict(self, x: ca.SX, P: ca.SX, u: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Mean and covariance one sample later."""
        F = jacobian(lambda s: self.f(s, u), x)
        return self.f(x, u), propagate(P, F, self.Q)

    def update(
        self, x: ca.SX, P: ca.SX, z: ca.SX, sensor: Sensor, beacon: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Mean and covariance after the scalar measurement z."""
        H = jacobian(lambda s: sensor.measure(s, beacon), x)
        innovation = z - sensor.measure(x, beacon)
        if sensor.periodic:
            innovation = ca.atan2(ca.sin(innovation), ca.cos(innovation))
        R = sensor.sigma**2
        K = P @ H.T / (H @ P @ H.T + R)
        A = ca.SX.eye(x.numel()) - K @ H
        return x + K * innovation, symmetric(
            A @ P @ A.T + R * K @ K.T
        )  # Joseph form: P stays positive semidefinite
