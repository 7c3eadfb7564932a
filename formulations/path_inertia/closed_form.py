"""Path inertia solved by hand: the circle about AUVs that are as observable along it as across it.

Thesis chapter 3. Everything here is written once in plain operators and accepts floats, numpy
arrays (element by element) and CasADi expressions, so that a compiled planner, a batch study and a
single decision run the same lines. Inputs are trusted: limits are checked where they are
configured.

Conventions: x = (x1, x2) is the aid vehicle's position minus the AUV's [m]; a positive radius r or
curvature k = 1/r turns left.
"""

import math
from typing import Any

import numpy as np

from ..model.frames import to_body
from ..model.ties import TIE

Scalar = Any
"""A float, a numpy array or a CasADi expression."""


def lateral_offset(x1: Scalar, x2: Scalar, heading: Scalar) -> Scalar:
    r"""Return b = sin ψ·x1 − cos ψ·x2 [m], how far the AUV lies to the left of the heading line."""
    _, lateral = offsets(x1, x2, heading)
    return lateral


def longitudinal_offset(x1: Scalar, x2: Scalar, heading: Scalar) -> Scalar:
    r"""Return s = cos ψ·x1 + sin ψ·x2 [m], how far the AUV lies behind.

    The squared distance is b² + s².
    """
    along, _ = offsets(x1, x2, heading)
    return along


def offsets(x1: Scalar, x2: Scalar, heading: Scalar) -> tuple[Scalar, Scalar]:
    """Return s and b [m]: the AUV is s behind and b to the left of the aid vehicle."""
    cos, sin = _cos_sin(heading)
    ahead, left = to_body(cos, sin, -x1, -x2)
    return -ahead, left


def circle_center(x1: Scalar, x2: Scalar, heading: Scalar, radius: Scalar) -> tuple[Scalar, Scalar]:
    r"""Return the centre ĉ = x + r(−sin ψ, cos ψ) of the circle ahead, relative to the AUV [m].

    ‖ĉ‖² = s² + (r − b)².
    """
    cos, sin = _cos_sin(heading)
    return x1 - radius * sin, x2 + radius * cos


def radius_threshold(gamma: Scalar) -> Scalar:
    r"""Return τ = γ / (2(1 + γ)) [m], what the penalty takes off the radius.

    It is below half a metre however large γ is.
    """
    return gamma / (2 * (1 + gamma))


def path_inertia_radius(
    mean_offset: Scalar, gamma: Scalar, min_radius: Scalar, distance: Scalar = 0.0
) -> tuple[Scalar, Scalar]:
    r"""Return the radius of least inertia difference, and whether the turning limit is applied.

    .. math:: r^* = \mathrm{sign}(\bar b)\,\max(|\bar b| - \tau,\ r_{\min}), \quad
              \tau = \frac{\gamma}{2(1 + \gamma)}

    The exact minimiser over |r| ≥ r_min of thesis (3.26), Σ w [(1 + γ)(r² − 2rb) + γ|r|], with b̄ =
    Σ w b, Σ w = 1. Where (3.22) rounds "to the nearest of ± minimum radius" this takes the sign of
    the mean offset, and left (+) where that is zero: the penalty can shrink the free optimum to 0,
    whose sign says nothing. γ ≥ 0 weighs the squared centre distance [m²] and, per metre, |r|.
    ``distance`` [m], of the AUVs' order, is what offsets are made of: one of less than `TIE` of it
    is zero, and so is one of less than `TIE` of the turning radius.
    """
    free = abs(mean_offset) - radius_threshold(gamma)
    below = free < min_radius
    side = leftward(mean_offset, distance + min_radius)
    radius = side * (free * (1 - below) + min_radius * below)
    return radius, free < min_radius * (1 - TIE)


def leftward(mean_offset: Scalar, size: Scalar) -> Scalar:
    """Return 1 for a mean offset [m] to the left, -1 for one to the right.

    It is 1 where the offset is zero but for rounding, which is relative to a size [m].
    """
    return (mean_offset >= -TIE * size) * 2 - 1


def path_inertia_curvature(
    mean_offset: Scalar, mean_square_distance: Scalar, min_radius: Scalar
) -> tuple[Scalar, Scalar]:
    r"""Return the curvature of least mean κ(J) [1/m], and whether the turning limit is applied.

    .. math:: k^* = \frac{\sum w b}{\sum w d^2}, \quad |k| \le 1 / r_{\min}

    The exact minimiser of Σ w κ(J) = 1 + 2 Σ w (d²k² − 2bk + 1), a convex quadratic, over a convex
    set: straight ahead (k = 0) is included and no rounding rule is needed. On top of every AUV (d
    below `TIE` of the turning radius) each turn is as good as any other: straight on.
    """
    on_top = mean_square_distance <= (TIE * min_radius) ** 2
    free = mean_offset * (1 - on_top) / (mean_square_distance + on_top)  # 0 / 1 on top
    beyond = abs(free) * min_radius > 1
    side = (mean_offset >= 0) * 2 - 1  # no tie: it is beyond
    curvature = free * (1 - beyond) + side * beyond / min_radius
    return curvature, abs(free) * min_radius > 1 + TIE


def inertia_condition_number(radius: Scalar, offset: Scalar, along: Scalar) -> Scalar:
    r"""Return κ(J) = 1 + 2‖ĉ‖²/r² of the circle's inertia about the AUV (thesis 3.19).

    The AUV is at lateral offset b and longitudinal offset s [m].
    """
    return 1 + 2 * (along**2 + (radius - offset) ** 2) / radius**2


def curvature_condition_number(
    curvature: Scalar, offset: Scalar, square_distance: Scalar
) -> Scalar:
    r"""Return κ(J) = 1 + 2(d²k² − 2bk + 1), the same as a function of the curvature.

    It is 3 straight ahead, where a radius is infinite.
    """
    return 1 + 2 * (square_distance * curvature**2 - 2 * offset * curvature + 1)


def _cos_sin(angle: Scalar) -> tuple[Scalar, Scalar]:
    """Return cosine and sine in the arithmetic the angle belongs to."""
    if isinstance(angle, (float, int)):
        return math.cos(angle), math.sin(angle)
    if isinstance(angle, np.ndarray):
        return np.cos(angle), np.sin(angle)
    import casadi  # only an expression needs it, and only then is it loaded

    return casadi.cos(angle), casadi.sin(angle)
