r"""Displacement moments of a Gramian whose ranges come at pings: sums over a few instants instead of an integral over the horizon.

.. math:: \sum_{k=0}^{N-1} \tau\, t_k^j\, (1, \Delta_1, \Delta_2, \Delta_1^2, \Delta_1 \Delta_2, \Delta_2^2)(t_k), \quad t_k = f + k \tau

f is the time until the first ping and may be an expression; all else is numbers. An arc goes on from where it was at f, turned by what it
had turned by then, Δ(f + s) = a + R Δ(s), so that the sums over s = kτ, which are numbers, are shifted and turned to those over t. The
factor τ makes the sum an integral by the rectangle rule: as τ goes to 0 the moments become those of `range`, of the same unit.
"""

from math import comb
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
) -> DisplacementMoments:
    """Moments at ``count`` pings, the first one ``first`` [s] from now and the others ``interval`` [s] apart, as columns over candidates.

    Speed in m/s, turn rates in rad/s; the body frame is that of now. Raises ValueError unless the interval is positive and there is a ping.
    """
    if not 0.0 < interval < np.inf:
        raise ValueError(f"time between pings must be finite and positive [s], got {interval}")
    if count < 1:
        raise ValueError(f"number of pings must be at least 1, got {count}")
    one, m1, m2, m11, m12, m22 = (
        _shifted(sums, first) for sums in _sums_from_a_ping(speed, turn_rates, interval, count)
    )
    a1, a2, c, s = _first_arc(speed, turn_rates, first)
    b1, b2 = (
        [c * x - s * y for x, y in zip(m1, m2, strict=True)],
        [s * x + c * y for x, y in zip(m1, m2, strict=True)],
    )
    return DisplacementMoments(
        one=one,
        d1=[a1 * n + x for n, x in zip(one, b1, strict=True)],
        d2=[a2 * n + y for n, y in zip(one, b2, strict=True)],
        d11=[
            a1 * a1 * one[j] + 2 * a1 * b1[j] + c * c * m11[j] - 2 * c * s * m12[j] + s * s * m22[j]
            for j in range(3)
        ],
        d12=[
            a1 * a2 * one[j]
            + a1 * b2[j]
            + a2 * b1[j]
            + c * s * (m11[j] - m22[j])
            + (c * c - s * s) * m12[j]
            for j in range(3)
        ],
        d22=[
            a2 * a2 * one[j] + 2 * a2 * b2[j] + s * s * m11[j] + 2 * c * s * m12[j] + c * c * m22[j]
            for j in range(3)
        ],
    )


def _sums_from_a_ping(
    speed: float, turn_rates: Float[np.ndarray, " K"], interval: float, count: int
) -> Float[np.ndarray, "6 3 K"]:
    """Moments of an arc that begins at a ping."""
    time = interval * np.arange(count)[:, None]
    d1, d2, _ = np.moveaxis(arcs(np.zeros(3), turn_rates, speed, time[:, 0]), -1, 0).swapaxes(1, 2)
    powers = interval * np.stack([time**0, time, time**2])
    return np.stack(
        [np.sum(powers * d, axis=1) for d in (np.ones_like(d1), d1, d2, d1 * d1, d1 * d2, d2 * d2)]
    )


def _shifted(sums: Float[np.ndarray, "3 K"], first: Expression) -> list[Expression]:
    """Sums of (first + s)^j from those of s^j, as columns."""
    columns = [ca.DM(row) for row in sums]
    return [sum(comb(j, i) * first ** (j - i) * columns[i] for i in range(j + 1)) for j in range(3)]


def _first_arc(
    speed: float, turn_rates: Float[np.ndarray, " K"], first: Expression
) -> tuple[Expression, ...]:
    """Displacement until the first ping, and cosine and sine of the turn by then, as columns."""
    origin = ca.DM.zeros(3, turn_rates.size)
    moved = arc(origin, ca.DM(turn_rates).T, speed, first)
    a1, a2, turned = ca.vertsplit(moved)
    return a1.T, a2.T, ca.cos(turned).T, ca.sin(turned).T
