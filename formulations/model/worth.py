r"""What a range is worth by the distance at which it is taken.

A range r with :math:`r^2 = d^2 + h^2` and an error of standard deviation σ(r) tells of the relative
position ρ, whose horizontal part has the length d, by the Fisher information

.. math:: J = w(r^2) \, ρ ρ^\top, \quad
          w = \frac{1}{r^2 σ^2} + \frac{2 b^4}{σ^4}, \quad σ^2 = a^2 + b^2 r^2

(Kay 1993, eq. 3.31). The second term is what the growth of the error itself tells. A squared range
has 4 in place of 1/r². Along the horizontal line of sight J is :math:`d^2 w`. Over a height it
rises up to a distance and falls beyond it, for its derivative with respect to t = r² has the sign
of

.. math:: -b^2 c \, t^3 + (c a^2 - 2 b^2 (a^2 - c h^2)) \, t^2 + 3 a^2 b^2 h^2 \, t + a^4 h^2,
          \quad c = b^2 + 2 b^4,

whose coefficients change sign once, so that it has one positive root (Descartes). At h = 0 it is t²
times a linear function that falls.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from .casadi import SX, of_each, symbol
from .covariance import NEAREST
from .ranging import EDGE, NUMBERS, Form, Law, Ranging, law, near_share, variance

HALVINGS = 60  # of an interval of squared distances: down to its rounding


def per_square(law: Law, r2: Any) -> Any:
    """What a range tells, w: information per square of the relative position [1/m^4].

    It is nothing from the very place, which has no direction.
    """
    apart = r2 > 0
    slope = 4.0 if law.form.squared else 1 / ca.if_else(apart, r2, 1.0)
    error = variance(law, r2)
    told = slope / error
    if law.form.growing:
        told += 2 * (law.growth**2 / error) ** 2
    return ca.if_else(apart, told, 0.0)


def least_sigma(
    ranging: Ranging,
    nearest: float | Float[np.ndarray, "*#batch"],
    farthest: float | Float[np.ndarray, "*#batch"],
    height: float | Float[np.ndarray, "*#batch"] = 0.0,
) -> Float[np.ndarray, "*batch"]:
    r"""Bound what a range that comes can tell from below, by one of constant deviation [m].

    That is :math:`1 / \sqrt{\max d^2 w}` over the horizontal distances d that can be reached, and
    over which ranges come: a horizontal range of that standard deviation tells no less, along the
    line of sight, than any of the law's. It tells no less either where a variance is added that
    falls as 1/r², as that of a depth that is measured with error, while σ < r/√2: what is added
    takes more away than its own slope tells.

    Parameters
    ----------
    nearest, farthest
        Horizontal distances between which every path is as the range comes [m].
    height
        Between both transducers [m]; known. It counts where ranges are slant.

    Returns
    -------
    Infinite where no range tells anything: a slant one from right above.

    Raises
    ------
    ValueError
        Distances that are not finite, negative or in the wrong order.
    """
    shape = np.broadcast_shapes(np.shape(nearest), np.shape(farthest), np.shape(height))
    nearest, farthest, height = (np.broadcast_to(a, shape) for a in (nearest, farthest, height))
    wrong = ~((nearest >= 0) & (nearest <= farthest) & (farthest < np.inf))
    if wrong.any():
        raise ValueError(
            "distances must be finite, and the nearest from 0 to the farthest [m], "
            f"got {nearest[wrong][0]:g} and {farthest[wrong][0]:g}"
        )
    if ranging.squared and not ranging.growth:
        return ranging.sigma / (2 * farthest)
    if not (ranging.slant or ranging.growth):
        return np.full(shape, float(ranging.sigma))
    function = _most(ranging.form)
    most = of_each(function, np.array(ranging.numbers), nearest, farthest, height)[0]
    told = most > 0
    return np.where(told, 1 / np.sqrt(np.where(told, most, 1.0)), np.inf)


def best_distance(ranging: Ranging, height: Any) -> Any:
    r"""Horizontal distance [m] at which a range over a height [m] is expected to tell most.

    It maximises :math:`p(r) \, d^2 / (r^2 σ^2)`, in which p is the share that is not lost by
    distance, fading out at the reach as planners count on it; what the growth of the error itself
    tells is left out, as they leave it out. With growth alone it is

    .. math:: d^2 = h \sqrt{h^2 + a^2 / b^2}.

    It is 0 where nearer is never worse, as without heights, and infinite where farther always is
    better: for squared ranges, and for slant ones of a constant deviation that always arrive. The
    height is a number or an expression.
    """
    form = ranging.form
    if form.squared:
        return ca.inf
    if not form.slant:
        return 0.0
    return _best(form)(ca.DM(ranging.numbers), height)


def _squared(form: Form, d2: Any, height: Any) -> Any:
    """Squared range by the squared horizontal distance."""
    return d2 + height**2 if form.slant else d2


@cache
def _most(form: Form) -> ca.Function:
    """(law, nearest, farthest, height) -> most information along the line of sight [1/m^2]."""
    numbers, height = symbol("law", NUMBERS), symbol("height")
    nearest, farthest = symbol("nearest"), symbol("farthest")
    ranging = law(form, numbers)

    def told(d2: SX) -> SX:
        return d2 * per_square(ranging, _squared(form, d2, height))

    farthest2 = farthest**2
    if form.lossy:
        level2 = height**2 if form.slant else 0.0
        reached = ca.if_else(ranging.per_reach > 0, 1 / ranging.per_reach**2 - level2, ca.inf)
        farthest2 = ca.fmin(farthest2, reached)
    low = ca.fmax(nearest, NEAREST) ** 2  # information is the same at less, or less
    high = ca.fmax(low, farthest2)
    low, high = _peak(told, low, high)
    most = ca.fmax(told(low), told(high))
    return ca.Function("most", [numbers, nearest, farthest, height], [most])


@cache
def _best(form: Form) -> ca.Function:
    """(law, height) -> best distance [m] of slant ranges."""
    numbers, given = symbol("law", NUMBERS), symbol("height")
    ranging, height = law(form, numbers), ca.fabs(given)
    up2 = height**2

    def told(d2: SX) -> SX:
        r2 = d2 + up2
        near = near_share(ranging, r2, edge=EDGE) if form.lossy else 1.0
        return near * d2 / (r2 * variance(ranging, r2))

    # each of what speaks against distance has its own best one, and together they leave less
    most = ca.SX(ca.inf)
    if form.growing:
        most = height * ca.sqrt(up2 + (ranging.sigma / ranging.growth) ** 2)
    if form.lossy:
        decay = np.log(2.0) * ranging.per_half_distance**2
        fading = (height * ca.sqrt(up2 + 4 / decay) - up2) / 2
        most = ca.fmin(most, ca.if_else(decay > 0, fading, ca.inf))
        most = ca.fmin(most, 1 / ranging.per_reach**2)
    best = _peak(told, ca.SX(0.0), most)[1] if form.lossy else most
    return ca.Function("best_distance", [numbers, given], [ca.sqrt(best)])


def _peak(told: Callable[[SX], SX], low: SX, high: SX) -> tuple[SX, SX]:
    """Where a function rises no more, between numbers this far apart at last; by halving."""
    at = symbol("at")
    slope = ca.gradient(ca.log(told(at)), at)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        rises = ca.substitute(slope, at, middle) > 0
        low = ca.if_else(rises, middle, low)
        high = ca.if_else(rises, high, middle)
    return low, high
