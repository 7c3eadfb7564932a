r"""Displacement moments of a Gramian whose ranges come at pings.

They are sums over a few instants instead of an integral over the horizon:

.. math:: \sum_{k=0}^{N-1} \tau\, t_k^j\,
          (1, \Delta_1, \Delta_2, \Delta_1^2, \Delta_1 \Delta_2, \Delta_2^2)(t_k), \quad
          t_k = f + k \tau

f is the time until the first ping and may be an expression; all else is numbers. An arc goes on
from where it was at f, turned by what it had turned by then, Δ(f + s) = a + R Δ(s), so that the
sums over s = kτ, which are numbers, are shifted and turned to those over t. The factor τ makes the
sum an integral by the rectangle rule: as τ goes to 0 the moments become those of `range`, of the
same unit.
"""

from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..model.arcs import arc, arcs
from .range import DisplacementMoments

Expression = Any  # CasADi SX, MX or DM, or a number


def ping_moments(
    speed: float,
    turn_rates: Float[np.ndarray, " K"],
    *,
    first: Expression,
    interval: float,
    count: int,
    heard: Expression | None = None,
) -> DisplacementMoments:
    """Moments at ``count`` pings, as columns over candidates.

    The first ping is ``first`` [s] from now; the others follow ``interval`` [s] apart. ``heard``, a
    column, says of each of them how much it counts; default: 1.

    Speed in m/s, turn rates in rad/s; the body frame is that of now. Raises ValueError unless the
    interval is positive and there is a ping.
    """
    if not 0.0 < interval < np.inf:
        raise ValueError(f"time between pings must be finite and positive [s], got {interval}")
    if count < 1:
        raise ValueError(f"number of pings must be at least 1, got {count}")
    terms = _terms_from_a_ping(speed, turn_rates, interval, count)
    shifted = [_shifted(_summed(powers, heard), first) for powers in terms]
    moved = _first_arc(speed, turn_rates, first)
    of_each_power = [_turned(sums, moved) for sums in zip(*shifted, strict=True)]  # of t
    return DisplacementMoments(*(list(moment) for moment in zip(*of_each_power, strict=True)))


def _turned(sums: tuple[Expression, ...], moved: tuple[Expression, ...]) -> tuple[Expression, ...]:
    """Sums of 1, Δ1, Δ2, Δ1², Δ1Δ2, Δ2² along an arc, from those of the arc after its first part.

    ``moved``: displacement by then, and cosine and sine of the turn.
    """
    one, m1, m2, m11, m12, m22 = sums
    a1, a2, c, s = moved
    b1 = c * m1 - s * m2
    b2 = s * m1 + c * m2
    b11 = c * c * m11 - 2 * c * s * m12 + s * s * m22
    b12 = c * s * (m11 - m22) + (c * c - s * s) * m12
    b22 = s * s * m11 + 2 * c * s * m12 + c * c * m22
    d11 = a1 * a1 * one + 2 * a1 * b1 + b11
    d12 = a1 * a2 * one + a1 * b2 + a2 * b1 + b12
    d22 = a2 * a2 * one + 2 * a2 * b2 + b22
    return one, a1 * one + b1, a2 * one + b2, d11, d12, d22


def _terms_from_a_ping(
    speed: float, turn_rates: Float[np.ndarray, " K"], interval: float, count: int
) -> list[Float[np.ndarray, "3 N K"]]:
    """What each ping adds to the moments of an arc that begins at the first one."""
    time = interval * np.arange(count)
    poses = arcs(np.zeros(3), turn_rates, speed, time)
    d1, d2 = poses[..., 0].T, poses[..., 1].T
    powers = interval * np.stack([time**0, time, time**2])[..., None]
    products = np.ones_like(d1), d1, d2, d1 * d1, d1 * d2, d2 * d2
    return [powers * product for product in products]


def _summed(terms: Float[np.ndarray, "3 N K"], heard: Expression | None) -> list[Expression]:
    """Sums over pings, as columns."""
    if heard is None:
        return [ca.DM(row) for row in np.sum(terms, axis=1)]
    return [ca.DM(of_pings.T) @ heard for of_pings in terms]


def _shifted(sums: list[Expression], first: Expression) -> list[Expression]:
    """Sums of (first + s)^j from those of s^j, as columns."""
    zeroth, linear, square = sums
    return [
        zeroth,
        first * zeroth + linear,
        first**2 * zeroth + 2 * first * linear + square,
    ]


def _first_arc(
    speed: float, turn_rates: Float[np.ndarray, " K"], first: Expression
) -> tuple[Expression, ...]:
    """Displacement until the first ping, and cosine and sine of the turn by then, as columns."""
    origin = ca.DM.zeros(3, turn_rates.size)
    moved = arc(origin, ca.DM(turn_rates).T, speed, first)
    a1, a2, turned = ca.vertsplit(moved)
    return a1.T, a2.T, ca.cos(turned).T, ca.sin(turned).T
