"""The convex program behind path inertia, in one number: a soft threshold in a box.

With its multipliers and its certificate.
"""

import math
from typing import NamedTuple

from ..model.ties import TIE

Side = tuple[float, float]
"""An interval of turns to one hand."""


class Point(NamedTuple):
    """A turn and the multipliers that go with it."""

    x: float
    sign: float  # of τ|x|: a subgradient, within ±τ
    lower: float  # of lower <= x
    upper: float  # of x <= upper


class Certificate(NamedTuple):
    """Residuals of a point, from the program itself.

    Violated limits, Lagrangian gradient and duality gap.
    """

    primal: float
    dual: float
    gap: float


class TurnProgram(NamedTuple):
    r"""Minimise ½(x − c)² + τ|x| subject to lower ≤ x ≤ upper.

    x is a signed radius [m] or a curvature [1/m].

    Both objectives of path inertia are this one after division by half their second derivative.
    With multipliers v, μ, η of |x| and of the two limits, the Lagrangian's gradient is x − z, z = c
    − v + μ − η, and the duality gap a sum of terms that are each ≥ 0:

    .. math:: \tfrac12 (x - z)^2 + (\tau|x| - v x) + \mu (x - \mathrm{lower})
              + \eta (\mathrm{upper} - x)

    The objective being strongly convex, no feasible x is farther than √(2 gap) from the optimum.
    """

    center: float
    threshold: float
    lower: float
    upper: float

    @property
    def scale(self) -> float:
        """Size of the turns in it, which the tolerance is relative to."""
        return max(abs(self.center), self.threshold, self.lower, -self.upper) or 1.0

    @property
    def reach(self) -> float:
        """Distance from the centre that the optimum cannot exceed."""
        farthest = max(self.threshold, self.lower - self.center, self.center - self.upper)
        return farthest or abs(self.center) or 1.0

    def value(self, x: float) -> float:
        """The objective."""
        return 0.5 * (x - self.center) ** 2 + self.threshold * abs(x)

    def bounded(self) -> "TurnProgram":
        """Return the same program with limits cut at twice the reach, which no optimum touches."""
        most = 2 * self.reach
        lower = max(self.lower, self.center - most)
        upper = min(self.upper, self.center + most)
        return TurnProgram(self.center, self.threshold, lower, upper)

    def optimum(self) -> Point:
        """Solve by hand: shrink the centre by the threshold, then keep to the limits."""
        shrunk = math.copysign(max(abs(self.center) - self.threshold, 0.0), self.center)
        return self.with_multipliers(min(max(shrunk, self.lower), self.upper))

    def with_multipliers(self, x: float) -> Point:
        """Recover the multipliers at x.

        The subgradient of |x|, and what remains where a limit is touched.
        """
        pull = self.center - x
        if x:
            sign = math.copysign(self.threshold, x)
        else:
            sign = min(max(pull, -self.threshold), self.threshold)
        rest = pull - sign
        lower = max(-rest, 0.0) if x == self.lower else 0.0
        upper = max(rest, 0.0) if x == self.upper else 0.0
        return Point(x, sign, lower, upper)

    def certify(self, point: Point) -> Certificate:
        """Return the residuals of a point.

        Its multipliers are first made feasible, so that the gap bounds the error.
        """
        x = min(max(point.x, self.lower), self.upper)
        sign = min(max(point.sign, -self.threshold), self.threshold)
        lower, upper = max(point.lower, 0.0), max(point.upper, 0.0)
        gradient = x - self.center + sign - lower + upper
        slack = self.threshold * abs(x) - sign * x
        slack += lower and lower * (x - self.lower)  # 0 * inf is not 0
        slack += upper and upper * (self.upper - x)
        return Certificate(abs(point.x - x), abs(gradient), 0.5 * gradient**2 + slack)

    def presses(self, limit: float) -> bool:
        """Whether the objective still falls beyond this limit, by more than rounding."""
        slope = limit - self.center + math.copysign(self.threshold, limit)
        if limit == self.upper:
            slope = -slope
        return slope > TIE * self.scale

    def choose_side(self, x: float, sides: list[Side], rounding: float = 0.0) -> Side:
        """Return the side x is on.

        From the gap between two, the side whose end is the better turn, left (+) if equally good:
        the centre is known to ``rounding``.

        The objective falls towards the convex optimum x from both ends, so the better end is the
        exact optimum outside the gap. The comparison is the difference of the two objectives,
        factored: with a gap symmetric about zero it is the sign of c, to the last bit.
        """
        right, left = sides[0], sides[-1]
        if x <= right[1]:
            return right
        width, middle = left[0] - right[1], left[0] + right[1]
        center = self.center + rounding
        if x < left[0] and center * width < middle * (0.5 * width + self.threshold):
            return right
        return left


class Deviation(NamedTuple):
    r"""A turn program seen from its centre.

    Minimise ½y² + τ max(y, −y − fold) subject to lower ≤ y ≤ upper.

    x = c ± unit·y, mirrored where c < 0, so that |x| = |c| + unit·max(y, −y − fold). The unit being
    the reach of a bounded program, every number is of the order of one however far the AUVs are. (A
    threshold of a quarter metre among distances of kilometres takes OSQP thousands of iterations to
    notice.)
    """

    threshold: float
    lower: float
    upper: float
    fold: float
    unit: float
    center: float

    @classmethod
    def of(cls, program: TurnProgram) -> "Deviation":
        """Shift, mirror and scale a bounded program."""
        center, threshold, lower, upper = program
        unit = program.reach
        lower, upper = (lower - center) / unit, (upper - center) / unit
        if center < 0:
            lower, upper = -upper, -lower
        fold = min(2 * abs(center) / unit, 4.0)
        return cls(threshold / unit, lower, upper, fold, unit, center)

    def point(self, y: float, sign: float, lower: float, upper: float) -> Point:
        """Return a solution and its multipliers as the turn program has them."""
        unit = self.unit
        if self.center < 0:  # mirrored
            return Point(self.center - unit * y, -unit * sign, unit * upper, unit * lower)
        return Point(self.center + unit * y, unit * sign, unit * lower, unit * upper)


def radius_sides(lower: float, upper: float, min_radius: float) -> list[Side]:
    """Return the signed radii within limits that the vehicle can turn [m].

    Right, left, either or none.
    """
    right = lower, min(upper, -min_radius)
    left = max(lower, min_radius), upper
    return [side for side in (right, left) if side[0] <= side[1]]


def curvature_sides(sides: list[Side]) -> list[Side]:
    """Return the same turns as curvatures [1/m]; straight ahead is zero."""
    return [(1 / upper, 1 / lower) for lower, upper in sides]
