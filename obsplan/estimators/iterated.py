"""Iterated extended Kalman filter: the most probable state, by Gauss-Newton steps."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import casadi as ca

from obsplan.estimators.gaussian import (
    Function,
    GaussianFilter,
    Linear,
    bends,
    corrected,
    hessians,
    states_of,
    tangent,
)
from obsplan.quantities import GAUSS_NEWTON, check_quantities
from obsplan.sensors import Sensor, residual

SHARES = (1.0, 0.4, 0.1)  # of a step that are tried


@dataclass(frozen=True, kw_only=True)
class IteratedEkf(GaussianFilter):
    r"""EKF whose measurement is its tangent at the mean after it, not before it.

    The new mean is the most probable state, where

    .. math:: (\hat x - x)^\top P^{-1} (\hat x - x) + \nu(\hat x)^2 / \sigma^2

    is least, found by Gauss-Newton steps (Bell & Cathey 1993). A range that is precise, and shorter
    than expected, bends more than these know: they then run to and fro. So that share of a step is
    taken that makes it least of those tried (Skoglund, Hendeby & Axehill 2015), also of the step
    that counts the curvature, :math:`H^\top H + \max(-\nu, 0) B` with the Hessian B of the
    measurement. :math:`\sigma` is that at the last iterate. The innovation is that of the EKF, and
    so is all of a linear measurement.
    """

    iterations: Annotated[int, "steps at each measurement", GAUSS_NEWTON] = 6

    def __post_init__(self) -> None:
        check_quantities(self)

    def linearize(self, f: Function, x: ca.SX, P: ca.SX) -> Linear:  # noqa: ARG002 - tangents
        """Tangent at the mean."""
        return tangent(f, x)

    def update(
        self, x: ca.SX, P: ca.SX, z: ca.SX, sensor: Sensor, beacon: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Most probable state after the scalar measurement z, and the covariance there."""
        if not bends(lambda s: sensor.measure(s, beacon), x.numel()):
            return super().update(x, P, z, sensor, beacon)
        posterior = _Posterior(x, P, z, sensor, beacon)
        w = ca.SX.zeros(len(posterior.seen))
        for _ in range(self.iterations):
            w = posterior.nearer(w)
        best = posterior.at(w)
        _, after = corrected(P, self.expected(best, P, sensor, beacon))
        return best, after


class _Posterior(NamedTuple):
    """The density after a measurement, of states x + P w.

    So it needs no inverse of P, and w is 0 but for the states that the measurement depends on.
    """

    x: ca.SX
    P: ca.SX
    z: ca.SX
    sensor: Sensor
    beacon: ca.SX

    @property
    def seen(self) -> list[int]:
        """States that the measurement depends on: the rows of w."""
        return states_of(self._measure, self.x.numel())

    def at(self, w: ca.SX) -> ca.SX:
        return self.x + self.P[:, self.seen] @ w

    def nearer(self, w: ca.SX) -> ca.SX:
        """The best share of a step from w."""
        at, seen = self.at(w), self.seen
        H = tangent(self._measure, at).H[:, seen]
        B = hessians(self._measure, at)[0][seen, seen]
        R = ca.SX(self.sensor.deviation(at, self.beacon) ** 2)
        nu = residual(self.sensor, self.z, self._measure(at))
        force = H.T * nu / R - w
        best, least = w, self._cost(w, R)
        for bending in (H.T @ H, H.T @ H + ca.fmax(-nu, 0) * B):
            curvature = ca.SX.eye(len(seen)) + bending @ self.P[seen, seen] / R
            step = ca.solve(curvature, force)
            for share in SHARES:
                tried = w + share * step
                cost = self._cost(tried, R)
                better = cost < least
                best, least = ca.if_else(better, tried, best), ca.if_else(better, cost, least)
        return best

    def _measure(self, s: ca.SX) -> ca.SX:
        return self.sensor.measure(s, self.beacon)

    def _cost(self, w: ca.SX, R: ca.SX) -> ca.SX:
        """Twice the negative logarithm of the density, less a constant."""
        nu = residual(self.sensor, self.z, self._measure(self.at(w)))
        return ca.bilin(self.P[self.seen, self.seen], w, w) + nu**2 / R
