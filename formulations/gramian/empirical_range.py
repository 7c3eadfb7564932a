"""The thesis's Gramian planner taken at its word: central differences of simulated ranges.

They are CasADi expressions.
"""

from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..model.arcs import arcs
from .empirical import EPSILON
from .samples import quadrature_weights

# Of the trapezoid rule over the horizon: error 6e-4 of the largest entry over two thirds of a
# circle.
INTERVALS = 21

Expression = Any


def empirical_gramian_entries(
    x: tuple[Expression, Expression],
    *,
    turn_rates: Float[np.ndarray, " K"],
    speed: float,
    horizon: float,
) -> tuple[Expression, Expression, Expression, Expression, Expression, Expression]:
    r"""Return W11, W12, W13, W22, W23, W33, each K x M, by simulation from six perturbed states.

    .. math:: W_{ij} = \frac{1}{4 \epsilon^2}
              \int_0^T (y^{+i} - y^{-i})^\top (y^{+j} - y^{-j}) \, dt, \quad
              y = (\psi, x_1^2 + x_2^2)

    (thesis 4.4, with the heading's effect on later positions kept.) x is the pair of 1 x M rows of
    relative positions in the body frame [m]; turn rates in rad/s, speed in m/s, horizon in s.
    Trapezoid rule with ``INTERVALS`` intervals.
    """
    time = np.linspace(0.0, horizon, INTERVALS + 1)
    weights = quadrature_weights(time.size, horizon, "trapezoid")
    x1, x2 = x
    candidates = []
    for u in turn_rates:
        of_all = [_differences(x1[j], x2[j], u, speed, time) for j in range(x1.shape[1])]
        candidates.append(of_all)
    entries = []
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        # the measured heading sees its own perturbation only: (2ε)² / 4ε² over T
        heading = horizon if i == j == 2 else 0.0
        rows = []
        for of_all in candidates:
            of_ranges = [ca.dot(d[i] * ca.DM(weights), d[j]) for d in of_all]
            rows.append(ca.horzcat(*(w / (4 * EPSILON**2) + heading for w in of_ranges)))
        entries.append(ca.vertcat(*rows))
    return tuple(entries)


def _differences(
    x1: Expression, x2: Expression, turn_rate: float, speed: float, time: np.ndarray
) -> list[Expression]:
    """Squared ranges over time after each state was moved up, less after it was moved down."""

    def squared_range(d1: float = 0.0, d2: float = 0.0, turned: float = 0.0) -> Expression:
        pose = np.array([0.0, 0.0, turned])
        east, north, _ = arcs(pose, np.array(turn_rate), speed, time).T
        return (x1 + d1 + ca.DM(east)) ** 2 + (x2 + d2 + ca.DM(north)) ** 2

    return [
        squared_range(d1=EPSILON) - squared_range(d1=-EPSILON),
        squared_range(d2=EPSILON) - squared_range(d2=-EPSILON),
        squared_range(turned=EPSILON) - squared_range(turned=-EPSILON),
    ]
