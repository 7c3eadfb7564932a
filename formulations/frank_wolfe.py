"""Frank-Wolfe: minimise a convex function over a convex set, with a certified lower bound."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

CURVATURE_DECREASE = 0.9  # of the backtracking, as in Pedregosa et al. (2020)
CURVATURE_INCREASE = 2.0
ROUNDING = 1e-12  # of a value, relative: decreases below it cannot be told

Progress = Callable[[float], None]  # of the share done


@dataclass(frozen=True, slots=True, kw_only=True)
class CertifiedBound:
    """What no point of a set can be below, with its certificate.

    ``value`` is the least mean square [m²] that was found, ``gap`` its duality gap: every point
    lies above ``bound`` = value − gap.
    """

    value: float
    gap: float
    iterations: int

    @property
    def bound(self) -> float:
        """Certified lower bound on the mean square position error [m²]."""
        return self.value - self.gap

    @property
    def bound_rms_m(self) -> float:
        """Certified lower bound on the root mean square position error [m]."""
        return float(np.sqrt(self.bound))


class Minimum(NamedTuple):
    """Where a search ended, and what no point of the set can be below."""

    value: float
    bound: float
    iterations: int
    point: np.ndarray
    gradient: np.ndarray

    @property
    def gap(self) -> float:
        """Value less bound."""
        return self.value - self.bound


def frank_wolfe(
    problem: Any,
    M: np.ndarray,
    vertex: Callable[[np.ndarray], np.ndarray],
    *,
    relative_gap: float,
    max_iterations: int,
    progress: Progress = lambda _share: None,
    enough: float = np.inf,
) -> Minimum:
    r"""Minimise from a point M of the set (Jaggi 2013; backtracking as Pedregosa et al. 2020).

    For any point M and every other one M',

    .. math:: f(M') \ge f(M) + \langle \nabla f(M), M' - M \rangle \ge f(M) - g(M), \quad
              g(M) = \max_{M''} \langle \nabla f(M), M - M'' \rangle ,

    so value less duality gap bounds the whole set from below. The best of all iterations is kept.

    Parameters
    ----------
    problem
        Gives value and what the gradient needs: ``evaluate(M) -> value, J, P`` and
        ``gradient(J, P)``. Values are at least zero.
    vertex
        Point of the set that minimises the scalar product with a gradient.
    relative_gap
        Of the value, at which to stop.
    enough
        Bound at which to stop.

    Raises
    ------
    ValueError
        The value is not finite.
    """
    value, J, P = problem.evaluate(M)
    if not np.isfinite(value):
        raise ValueError(
            "P0, F, Q, J_other and weights must be finite and not overflow, "
            f"got a mean square of {value}"
        )
    bound, curvature, iterations = 0.0, 0.0, 0  # a mean square is at least zero
    while True:
        iterations += 1
        gradient = problem.gradient(J, P)
        step = vertex(gradient) - M
        descent = -float(np.sum(gradient * step))
        bound = max(bound, value - descent)
        gap = value - bound
        progress(min(1.0, relative_gap * value / gap) if gap > 0 else 1.0)  # the gap goes as 1/k
        if gap <= relative_gap * value or bound >= enough or iterations >= max_iterations:
            return Minimum(value, bound, iterations, np.array(M), gradient)
        curvature = max(CURVATURE_DECREASE * curvature, descent)
        del J, P  # to make room for the next
        while True:
            length = min(1.0, descent / curvature)
            trial, J, P = problem.evaluate(M + length * step)
            model = value - length * descent + length**2 * curvature / 2
            if trial <= model + ROUNDING * value:
                break
            curvature *= CURVATURE_INCREASE
        M, value = M + length * step, trial
