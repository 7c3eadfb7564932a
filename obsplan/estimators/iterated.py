"""Iterated extended Kalman filter: the most probable state, by Gauss-Newton steps."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import casadi as ca

from obsplan.estimators.gaussian import Function, GaussianFilter, Linear, corrected, tangent
from obsplan.quantities import GAUSS_NEWTON, check_quantities
from obsplan.sensors import Sensor, residual

SHARES = (1.0, 0.5, 0.25, 0.125)  # of a step that are tried


@dataclass(frozen=True, kw_only=True)
class IteratedEkf(GaussianFilter):
    r"""EKF whose measurement is its tangent at the mean after it, not before it.

    The new mean is the most probable state, where

    .. math:: (\hat x - x)^\top P^{-1} (\hat x - x) + \nu(\hat x)^2 / \sigma^2

    is least, found by Gauss-Newton steps (Bell & Cathey 1993), each the share of itself that makes
    it least of those tried (Skoglund, Hendeby & Axehill 2015): whole steps may run to and fro where
    the beacon is near and P long. :math:`\sigma` is that at the last iterate. The innovation is
    that of the EKF.
    """

    iterations: Annotated[int, "Gauss-Newton steps at each measurement", GAUSS_NEWTON] = 5

    def __post_init__(self) -> None:
        check_quantities(self)

    def linearize(self, f: Function, x: ca.SX, P: ca.SX) -> Linear:  # noqa: ARG002 - tangents
        """Tangent at the mean."""
        return tangent(f, x)

    def update(
        self, x: ca.SX, P: ca.SX, z: ca.SX, sensor: Sensor, beacon: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Most probable state after the scalar measurement z, and the covariance there."""
        posterior = _Posterior(x, P, z, sensor, beacon)
        w = ca.SX.zeros(x.numel())
        for _ in range(self.iterations):
            w = posterior.nearer(w, self)
        best = posterior.at(w)
        _, after = corrected(P, self.expected(best, P, sensor, beacon))
        return best, after


class _Posterior(NamedTuple):
    """The density after a measurement, of states x + P w: w needs no inverse of P."""

    x: ca.SX
    P: ca.SX
    z: ca.SX
    sensor: Sensor
    beacon: ca.SX

    def at(self, w: ca.SX) -> ca.SX:
        return self.x + self.P @ w

    def nearer(self, w: ca.SX, kernel: IteratedEkf) -> ca.SX:
        """The best share of a Gauss-Newton step from w."""
        seen = kernel.expected(self.at(w), self.P, self.sensor, self.beacon)
        PH = self.P @ seen.H.T
        nu = residual(self.sensor, self.z, seen.mean) + ca.dot(PH, w)
        step = seen.H.T * nu / (seen.H @ PH + seen.error) - w
        best, least = w, self._cost(w, seen.error)
        for share in SHARES:
            tried = w + share * step
            cost = self._cost(tried, seen.error)
            better = cost < least
            best, least = ca.if_else(better, tried, best), ca.fmin(cost, least)
        return best

    def _cost(self, w: ca.SX, variance: ca.SX) -> ca.SX:
        """Twice the negative logarithm of the density, less a constant."""
        nu = residual(self.sensor, self.z, self.sensor.measure(self.at(w), self.beacon))
        return ca.bilin(self.P, w, w) + nu**2 / variance
