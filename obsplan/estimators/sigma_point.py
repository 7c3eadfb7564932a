"""Sigma-point (unscented) Kalman filter: functions by their values about the mean."""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsplan.estimators.gaussian import Function, GaussianFilter, Linear, bends, tangent
from obsplan.sensors import Sensor, residual

GAUSSIAN = 3  # squared distance of points that has a Gaussian's fourth moment in each direction


@dataclass(frozen=True, kw_only=True)
class SigmaPoint(GaussianFilter):
    r"""Unscented Kalman filter whose weights are never negative.

    With n states in which a function bends, a square root :math:`P = L L^\top` of their covariance
    and :math:`c^2 = \max(3, n)`, the function is known at the mean and at
    :math:`\hat x \pm c L_i`. Halves of sums and differences from its value at the mean,

    .. math:: o_i = (\Delta_i^+ - \Delta_i^-) / 2c, \quad e_i = (\Delta_i^+ + \Delta_i^-) / 2c,

    give the unscented mean, slope and covariance (weights :math:`1/2c^2`, the rest at the mean):

    .. math:: \mathrm{E}[f] = f(\hat x) + \tfrac{1}{c} \sum_i e_i, \quad H L = (o_1, \dots, o_n),

    .. math:: \operatorname{cov}[f] = H P H^\top + \sum_i e_i e_i^\top
              - \tfrac{1}{c^2} \sum_i e_i \sum_j e_j^\top.

    In the other states it is linear, and H is its Jacobian: how many they are changes nothing. c is
    that of Julier & Uhlmann (2004), :math:`n + \kappa = 3`, and from four states on that of the
    cubature filter (Arasaratnam & Haykin 2009). Angles are held against that at the mean. A
    measurement's own variance is its mean over the points.
    """

    def linearize(self, f: Function, x: ca.SX, P: ca.SX) -> Linear:
        """Regression of f over the points."""
        return _regression(f, x, P, lambda value, center: value - center)

    def expected(self, x: ca.SX, P: ca.SX, sensor: Sensor, beacon: ca.SX) -> Linear:
        """The measurement, its own error counted."""

        def measure(s: ca.SX) -> ca.SX:
            return sensor.measure(s, beacon)

        def variance(s: ca.SX) -> ca.SX:
            return ca.SX(sensor.deviation(s, beacon) ** 2)

        seen = _regression(measure, x, P, lambda value, center: residual(sensor, value, center))
        noise = self.linearize(variance, x, P).mean
        return seen._replace(error=noise + seen.error)


def _regression(
    f: Function, x: ca.SX, P: ca.SX, difference: Callable[[ca.SX, ca.SX], ca.SX]
) -> Linear:
    """Statistical linear regression of f over sigma points of the states in which it bends."""
    flat = tangent(f, x)
    bent = bends(f, x.numel())
    if not bent:
        return flat
    L = square_root(P[bent, bent])
    c = float(np.sqrt(max(GAUSSIAN, len(bent))))
    odd, even = [], []
    for i in range(len(bent)):
        away = ca.SX.zeros(x.numel())
        away[bent] = c * L[:, i]
        ahead = difference(f(x + away), flat.mean)
        behind = difference(f(x - away), flat.mean)
        odd.append((ahead - behind) / (2 * c))
        even.append((ahead + behind) / (2 * c))
    E = ca.horzcat(*even)
    drift = ca.sum2(E) / c
    H = ca.SX(flat.H)
    H[:, bent] = _slope(L, ca.horzcat(*odd), flat.H[:, bent])
    return Linear(flat.mean + drift, H, E @ E.T - drift @ drift.T)


def square_root(P: ca.SX) -> ca.SX:
    """Lower triangular L with L Lᵀ = P, which may be singular (Cholesky).

    A pivot that is no more than what rounding leaves of zero counts as zero, with its column.
    """
    n = P.shape[0]
    L = ca.SX.zeros(n, n)
    for j in range(n):
        pivot = P[j, j] - ca.sumsqr(L[j, :j])
        certain = pivot <= n * np.finfo(float).eps * P[j, j]
        root = ca.sqrt(ca.if_else(certain, 1.0, pivot))
        L[j, j] = ca.if_else(certain, 0.0, root)
        for i in range(j + 1, n):
            rest = P[i, j] - ca.dot(L[i, :j], L[j, :j])
            L[i, j] = ca.if_else(certain, 0.0, rest / root)
    return L


def _slope(L: ca.SX, odd: ca.SX, H: ca.SX) -> ca.SX:
    """Solution of slope @ L = odd from the last column on; of H where a column of L is zero."""
    slope = ca.SX(H)
    for j in reversed(range(L.shape[0])):
        rest = odd[:, j] - slope[:, j + 1 :] @ L[j + 1 :, j]
        certain = L[j, j] == 0
        pivot = ca.if_else(certain, 1.0, L[j, j])
        slope[:, j] = ca.if_else(certain, H[:, j], rest / pivot)
    return slope
