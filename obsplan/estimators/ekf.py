"""Extended Kalman filter, as CasADi expressions; Jacobians by differentiation."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from formulations.model.covariance import propagate, symmetric
from obsplan.estimators.estimator import Process
from obsplan.estimators.jacobian import jacobian
from obsplan.sensors import Sensor
from obsplan.vehicles import States, Vehicle


@dataclass(frozen=True, kw_only=True)
class Ekf:
    r"""Extended Kalman filter for :math:`x^+ = f(x, u) + w` and scalar :math:`z = h(x) + v`.

    The covariance is updated in Joseph form. f is the vehicle's own model. A subclass with more
    states gives `states` and `step`; `predict` and `update` follow.
    """

    def states(self, model: Vehicle) -> States:
        """Components of x: the model's."""
        return model.states

    def step(self, x: ca.SX, u: ca.SX, process: Process) -> ca.SX:
        """State one sample later, f(x, u)."""
        return process.model.step(x, u, process.dt)

    def predict(self, x: ca.SX, P: ca.SX, u: ca.SX, process: Process) -> tuple[ca.SX, ca.SX]:
        """Mean and covariance one sample later."""
        F = jacobian(lambda s: self.step(s, u, process), x)
        Q = np.diag(np.array(process.noise) ** 2 * process.dt)
        return self.step(x, u, process), propagate(P, F, ca.DM(Q))

    def update(
        self, x: ca.SX, P: ca.SX, z: ca.SX, sensor: Sensor, beacon: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Mean and covariance after the scalar measurement z."""
        H = jacobian(lambda s: sensor.measure(s, beacon), x)
        innovation = z - sensor.measure(x, beacon)
        if sensor.periodic:
            innovation = ca.atan2(ca.sin(innovation), ca.cos(innovation))
        R = sensor.deviation(x, beacon) ** 2
        K = P @ H.T / (H @ P @ H.T + R)
        A = ca.SX.eye(x.numel()) - K @ H
        joseph = A @ P @ A.T + R * K @ K.T  # P stays positive semidefinite
        return x + K * innovation, symmetric(joseph)
