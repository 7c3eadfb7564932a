r"""Hypotheses from one range: a Gaussian prior and a ring about the beacon, as a Gaussian sum.

The range's likelihood is a ring of Gaussians of equal weight: each is narrow across it and wide
along it, where they overlap. A Gaussian prior times each is a Gaussian, with the weight of the
prior's density there. Along the ring of radius z a prior of standard deviation σ at distance d from
the beacon is von Mises with :math:`\kappa = z d / \sigma^2`, so the Gaussians need to cover only
where :math:`\kappa (1 - \cos \theta) < 3.5^2 / 2`; they may go all round.
"""

from typing import NamedTuple

import casadi as ca

from formulations.model.casadi import SX, symbol
from formulations.model.covariance import symmetric
from obsplan.sensors import Sensor

SPREAD = 3.5  # standard deviations of the prior along the ring, as of a Gaussian, are covered
OVERLAP = 0.65  # standard deviation of each along the ring, by the distance between two
NEWTON = 8  # steps to the ring's radius


class Ring(NamedTuple):
    """Hypotheses after one range."""

    means: list[SX]
    covariances: list[SX]
    weights: SX  # their logarithms, not normalised
    # whether the prior is too wide for one Gaussian: the ring bends by more than its own width
    bent: SX


def ring(x: SX, P: SX, z: SX, sensor: Sensor, told: SX, count: int) -> Ring:
    """``count`` hypotheses after one range z of the beacon ``told`` (`BEACON`); x and P before."""
    apart = x[:2] - told[:2]
    distance = ca.fmax(ca.norm_2(apart), 1e-3)
    towards = apart / distance
    radius, slope = _radius(x, z, sensor, told, towards, distance)
    widest = _widest(P)
    kappa = radius * distance / widest
    half = ca.acos(ca.fmax(1 - SPREAD**2 / (2 * kappa), -1.0))
    spacing = 2 * half / count
    along = OVERLAP * spacing * radius
    bulge = along**2 / (2 * radius)  # by how far a Gaussian on the tangent leaves the ring
    thickness = sensor.deviation(x, told) / slope
    across2 = thickness**2 + bulge**2
    means, covariances, weights = [], [], []
    for k in range(count):
        angle = (2 * k + 1 - count) / count * half
        cos, sin = ca.cos(angle), ca.sin(angle)
        out = ca.vertcat(towards[0] * cos - towards[1] * sin, towards[0] * sin + towards[1] * cos)
        normal = ca.vertcat(-out[1], out[0])
        C = across2 * out @ out.T + along**2 * normal @ normal.T
        place = told[:2] + (radius - bulge) * out
        mean, covariance, weight = _placed(x, P, place, C)
        means.append(mean)
        covariances.append(covariance)
        weights.append(weight)
    bent = widest > 2 * radius * thickness
    return Ring(means, covariances, ca.vertcat(*weights), bent)


def _widest(P: SX) -> SX:
    """Greatest variance of the position in any direction [m^2]."""
    middle, apart = (P[0, 0] + P[1, 1]) / 2, (P[0, 0] - P[1, 1]) / 2
    return middle + ca.sqrt(apart**2 + P[0, 1] ** 2)


def _radius(x: SX, z: SX, sensor: Sensor, told: SX, towards: SX, start: SX) -> tuple[SX, SX]:
    """Horizontal distance at which the sensor measures z, and how z grows with it there."""
    r, way, own, shown = symbol("r"), symbol("way", 2), symbol("x", x.numel()), symbol("z")
    seen = symbol("told", told.numel())
    place = ca.vertcat(seen[:2] + r * way, own[2:])
    measured = sensor.measure(place, seen)
    slope = ca.jacobian(measured, r)
    better = ca.fmax(r + (shown - measured) / slope, r / 4)
    newton = ca.Function("newton", [r, way, own, shown, seen], [better, slope])
    found = start
    for _ in range(NEWTON):
        found, _ = newton(found, towards, x, z, told)
    _, slope = newton(found, towards, x, z, told)
    return found, slope


def _placed(x: SX, P: SX, place: SX, C: SX) -> tuple[SX, SX, SX]:
    """The prior times a Gaussian of the position: mean, covariance, logarithm of the weight."""
    S = P[:2, :2] + C
    determinant = S[0, 0] * S[1, 1] - S[0, 1] ** 2
    adjugate = ca.vertcat(ca.horzcat(S[1, 1], -S[0, 1]), ca.horzcat(-S[0, 1], S[0, 0]))
    inverse = adjugate / determinant
    off = place - x[:2]
    K = P[:, :2] @ inverse
    left = ca.SX.eye(x.numel())
    left[:, :2] -= K
    joseph = left @ P @ left.T + K @ C @ K.T
    weight = -(off.T @ inverse @ off + ca.log(determinant)) / 2
    return x + K @ off, symmetric(joseph), weight
