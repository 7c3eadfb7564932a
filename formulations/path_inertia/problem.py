"""Path inertia as a convex problem that is compiled once and then solved decision by decision."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from formulations.model.ties import TIE
from formulations.path_inertia.closed_form import lateral_offset, offsets
from formulations.path_inertia.printed import Cvxpy, Sum
from formulations.path_inertia.program import (
    Certificate,
    Point,
    Side,
    TurnProgram,
    curvature_sides,
    radius_sides,
)
from formulations.path_inertia.solvers import SOLVERS, set_up
from formulations.solution import Solution, Status

WRONG = 1e-2  # likewise relative; an answer that may be off by more is not inaccurate but wrong

REMEDIES = {
    Status.INFEASIBLE: (
        "no turn satisfies every limit; relax the largest radius, the largest centre distance "
        "or the turning radius"
    ),
    Status.SOLVER_FAILED: (
        "the solver failed and the closed form's turn is taken; check the scale of the problem"
    ),
}

Objective = Literal["difference", "condition-number"]
Solver = Literal["closed-form", "osqp", "clarabel", "cvxpy-osqp", "cvxpy-clarabel"]


class Criterion(NamedTuple):
    """One decision's objective, scale·(½(x − center)² + threshold·|x|) + constant."""

    center: float
    threshold: float
    scale: float
    constant: float
    rounding: float  # of the center


class Turn(NamedTuple):
    """A turn within the limits, whether the objective still falls beyond them, and residuals."""

    x: float
    pressed: bool
    residuals: Certificate

    def error(self, excess: float) -> float:
        """The largest residual, the gap as the distance that it allows; nan if one is.

        ``excess``: of the objective over that of the other side's best turn, a gap as well.
        """
        primal, dual, gap = self.residuals
        if not math.isfinite(primal + dual + gap + excess):
            return math.nan
        return max(primal, dual, math.sqrt(2 * max(gap, excess, 0.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PathInertiaProblem:
    r"""Choose the circle that makes AUVs observable, within limits on it and on its change.

    With b, s, d the offsets and distance of each AUV (``lateral_offset``, ``longitudinal_offset``),
    w its share of the weights and ĉ the circle's centre relative to it, ``difference`` minimises
    thesis (3.26) over the signed radius r [m],

    .. math:: \sum w\,[r^2 - 2 r b + \gamma(\|\hat c\|^2 + |r|)] + \rho\,(r - r_{\mathrm{last}})^2

    and ``condition-number`` minimises the mean condition number of the inertia over the curvature k
    = 1/r [1/m],

    .. math:: \sum w\,[1 + 2(d^2 k^2 - 2 b k + 1)] + \rho\,(k - k_{\mathrm{last}})^2

    both subject to r_min ≤ |r| ≤ max_radius and ‖ĉ‖² = s² + (r − b)² ≤ max_center_distance² for
    each AUV. Bounds on the centre distance are an interval of radii. What is left is two intervals,
    right turns and left turns; the convex problem is solved over the interval that spans them, and
    a turn in the gap between them goes to the better of its two ends: last, exactly, and by the
    sign of the mean offset b̄ (with ρ: of the centre it shares with the last turn), left where that
    is zero but for rounding. The turning limit itself is such a gap for radii and a true constraint
    for curvatures.

    ``closed-form``, ``osqp`` and ``clarabel`` solve the sum reduced to one number (`TurnProgram`);
    ``cvxpy-osqp`` and ``cvxpy-clarabel`` take it as it is printed (`PrintedProgram`).

    γ ≥ 0 weighs distance against observability in ``difference`` and has no part in the other,
    whose optimum already weighs them. ρ ≥ 0 is ``change_weight``: a number for radii, in m² for
    curvatures.

    The turn is certified to ``tolerance``, relative to the largest of limit, offset and threshold,
    or the status is ``INACCURATE``. Where a solver raises, or what it says is off by more than
    `WRONG`, the closed form's turn is taken and the status is ``SOLVER_FAILED``.
    """

    min_radius: float  # [m]
    gamma: float = 0.0
    change_weight: float = 0.0
    max_radius: float = math.inf  # [m]
    max_center_distance: float | Sequence[float] = math.inf  # [m], of all or of each in order
    objective: Objective = "difference"
    solver: Solver = "closed-form"
    tolerance: float = 1e-6  # of the turn, see below
    compiled: Any = field(init=False, repr=False, compare=False)  # the solver, set up

    def __post_init__(self):
        for name, unit in (("min_radius", " [m]"), ("max_radius", " [m]"), ("tolerance", "")):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive{unit}, got {getattr(self, name)}")
        for name in ("gamma", "change_weight"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(
                    f"{name} must be zero or positive and finite, got {getattr(self, name)}"
                )
        if self.max_radius < self.min_radius:
            raise ValueError(
                f"max_radius {self.max_radius} m is below min_radius {self.min_radius} m: "
                "no turn is left, raise it"
            )
        if not np.all(np.asarray(self.max_center_distance) > 0):
            raise ValueError(
                f"max_center_distance must be positive [m], got {self.max_center_distance}"
            )
        if self.objective not in ("difference", "condition-number"):
            raise ValueError(
                f"objective must be 'difference' or 'condition-number', got {self.objective!r}"
            )
        if self.solver not in SOLVERS:
            raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, got {self.solver!r}")
        compiled = set_up(self.solver, self.objective, self.gamma)
        object.__setattr__(self, "compiled", compiled)

    def solve(
        self,
        positions: Float[np.ndarray, "auvs 2"],
        heading: float,
        weights: Float[np.ndarray, " weights"] | None = None,
        *,
        last_radius: float | None = None,
    ) -> Solution:
        """Decide for the aid vehicle's positions relative to each AUV [m] and heading [rad].

        Weights (≥ 0, all equal if not given) are normalised. ``last_radius`` is the signed radius
        turned before, infinite if straight; with none (for radii: or an infinite one) there is no
        change to penalise. The solution's ``x`` is the signed radius or the curvature.

        Raises
        ------
        ValueError
            Negative weights, a last radius of zero, limits or weights that are not one per AUV.
        """
        if last_radius == 0:
            raise ValueError(
                "last_radius must not be zero: no vehicle turned so; "
                "leave it out before the first decision"
            )
        n = len(positions)
        shares = _equal_shares(n) if weights is None else _normalise(weights, n)
        if shares is None:
            return Solution.missing(Status.NO_TARGETS)
        total = float(np.vdot(positions, positions))
        if not math.isfinite(heading + total):  # a sum of squares: what is not finite stays
            return Solution.missing(Status.INVALID_INPUT)
        if total <= (TIE * self.min_radius) ** 2:  # on top of every AUV: rounding says no side
            positions = np.zeros_like(positions)
        criterion = self._criterion(positions, heading, shares, last_radius)
        if not math.isfinite(criterion.center):
            return Solution.missing(Status.INVALID_INPUT)
        sides = self._turns(positions, heading)
        if not sides:
            return Solution.missing(Status.INFEASIBLE, remedies=REMEDIES)
        solve = self.compiled
        if isinstance(solve, Cvxpy):
            solve = partial(solve, self._sum(criterion, positions, heading, shares, last_radius))
        return self._decide(criterion, sides, solve)

    def _sum(
        self,
        criterion: Criterion,
        positions: Float[np.ndarray, "auvs 2"],
        heading: float,
        shares: Float[np.ndarray, " auvs"],
        last_radius: float | None,
    ) -> Sum:
        """What is summed, as it is printed."""
        rho, last = self._change(last_radius)
        offset = lateral_offset(positions[:, 0], positions[:, 1], heading)
        square_distance = np.sum(positions**2, axis=1)
        return Sum(shares, offset, square_distance, rho, last, criterion.scale / 2)

    def _change(self, last_radius: float | None) -> tuple[float, float]:
        """Weight of a change and the turn before, a radius or a curvature; 0 if there is none."""
        if last_radius is None:
            return 0.0, 0.0
        if self.objective == "condition-number":
            return self.change_weight, 1 / last_radius
        return (0.0, 0.0) if math.isinf(last_radius) else (self.change_weight, last_radius)

    def _criterion(
        self,
        positions: Float[np.ndarray, "auvs 2"],
        heading: float,
        shares: Float[np.ndarray, " auvs"],
        last_radius: float | None,
    ) -> Criterion:
        """The sum over AUVs reduced to one number, its two moments being all that it hangs on."""
        x1, x2 = (shares @ positions).tolist()
        offset = lateral_offset(x1, x2, heading)  # linear: that of the mean is the mean one
        square_distance = float(np.vdot(shares[:, None] * positions, positions))
        if self.objective == "difference":
            return self._inertia_difference(offset, square_distance, last_radius)
        return self._condition_number(offset, square_distance, last_radius)

    def _inertia_difference(
        self, offset: float, square_distance: float, last_radius: float | None
    ) -> Criterion:
        rho, last = self._change(last_radius)
        half_curve = 1 + self.gamma + rho
        center = ((1 + self.gamma) * offset + rho * last) / half_curve
        constant = self.gamma * square_distance + rho * last**2 - half_curve * center**2
        size = (1 + self.gamma) * (math.sqrt(square_distance) + self.min_radius)
        rounding = TIE * (size + rho * abs(last)) / half_curve
        threshold = self.gamma / (2 * half_curve)
        return Criterion(center, threshold, 2 * half_curve, constant, rounding)

    def _condition_number(
        self, offset: float, square_distance: float, last_radius: float | None
    ) -> Criterion:
        rho, last = self._change(last_radius)
        half_curve = 2 * square_distance + rho
        center, rounding = 0.0, TIE / self.min_radius  # on top of every AUV: straight on
        if half_curve:
            center = (2 * offset + rho * last) / half_curve
            rounding += TIE * (2 * math.sqrt(square_distance) + rho * abs(last)) / half_curve
        constant = 3 + rho * last**2 - half_curve * center**2
        return Criterion(center, 0.0, 2 * half_curve, constant, rounding)

    def _turns(self, positions: Float[np.ndarray, "auvs 2"], heading: float) -> list[Side]:
        """Return what the limits leave of right and left turns, as radii or curvatures."""
        lower, upper = -self.max_radius, self.max_radius
        limit = self.max_center_distance
        if not (isinstance(limit, float) and math.isinf(limit)):
            limits = np.asarray(limit, dtype=float)
            if limits.ndim and len(limits) != len(positions):
                raise ValueError(
                    f"max_center_distance has {len(limits)} values for {len(positions)} AUVs: "
                    "give one each, or one for all"
                )
            along, offset = offsets(positions[:, 0], positions[:, 1], heading)
            square_reach = limits**2 - along**2
            if (square_reach < 0).any():
                return []
            reach = np.sqrt(square_reach)
            lower = max(lower, float((offset - reach).max()))
            upper = min(upper, float((offset + reach).min()))
        sides = radius_sides(lower, upper, self.min_radius)
        return sides if self.objective == "difference" else curvature_sides(sides)

    def _decide(
        self, criterion: Criterion, sides: list[Side], solve: Callable[[TurnProgram], Point]
    ) -> Solution:
        """Solve over the interval that spans both sides, then clip to one of them."""
        center, threshold = criterion.center, criterion.threshold
        hull = TurnProgram(center, threshold, sides[0][0], sides[-1][1]).bounded()
        reach = max(self.tolerance * hull.scale, criterion.rounding)
        better = partial(_turn, hull, sides, reach=reach, rounding=criterion.rounding)
        by_hand = better(hull.optimum())
        turn = _asked(solve, hull, better) or by_hand
        error = turn.error(hull.value(turn.x) - hull.value(by_hand.x))
        failed = not error <= max(WRONG * hull.scale, reach)
        if failed:
            turn, status = by_hand, Status.SOLVER_FAILED
        elif error > reach:
            status = Status.INACCURATE
        else:
            clipped = turn.pressed and self._is_limit(turn.x)
            status = Status.CLIPPED if clipped else Status.OPTIMAL
        x, (primal, dual, gap) = turn.x, turn.residuals
        value = hull.value(x)
        return Solution(
            x=np.array([x]),
            objective=criterion.scale * value + criterion.constant,
            status=status,
            primal_residual=primal,
            dual_residual=criterion.scale * dual,
            duality_gap=criterion.scale * gap,
            remedies=REMEDIES,
        )

    def _is_limit(self, x: float) -> bool:
        """Whether a turn is the tightest that the vehicle can make."""
        limit = self.min_radius if self.objective == "difference" else 1 / self.min_radius
        return abs(x) == limit


def _asked(
    solve: Callable[[TurnProgram], Point], hull: TurnProgram, better: Callable[[Point], Turn]
) -> Turn | None:
    """The solver's turn, of nan if it raised; None where there is no solver."""
    if solve is TurnProgram.optimum:
        return None
    try:
        point = solve(hull)
        if math.isfinite(point.x):
            return better(point)
    except Exception:  # whatever a solver stumbles over, the closed form does not
        pass
    return Turn(math.nan, False, Certificate(math.nan, math.nan, math.nan))


def _turn(
    hull: TurnProgram, sides: list[Side], point: Point, *, reach: float, rounding: float
) -> Turn:
    """Clip a solution of the hull to the better side, and certify what comes of it."""
    taken = hull.choose_side(point.x, sides, rounding)
    side = TurnProgram(hull.center, hull.threshold, *taken)
    x = min(max(point.x, side.lower), side.upper)
    end = side.lower if x - side.lower < side.upper - x else side.upper
    pressed = abs(x - end) <= reach and side.presses(end)
    if pressed:
        x = end
    if pressed or abs(x - point.x) > reach:
        residuals = side.certify(side.with_multipliers(x))
    else:
        residuals = hull.certify(point)
    return Turn(x, pressed, residuals)


@cache
def _equal_shares(n: int) -> Float[np.ndarray, " weights"] | None:
    return np.full(n, 1 / n) if n else None


def _normalise(
    weights: Float[np.ndarray, " weights"], n: int
) -> Float[np.ndarray, " weights"] | None:
    """Return weights that sum to one, or nothing if no AUV counts.

    They are all nan if one of them is not finite.
    """
    if len(weights) != n:
        raise ValueError(f"there are {len(weights)} weights for {n} AUVs: give one for each")
    if (weights < 0).any():
        raise ValueError(f"weights must be zero or positive, got {weights.tolist()}")
    total = float(weights.sum())
    if total == 0:
        return None
    return weights / total if math.isfinite(total) else np.full(n, math.nan)
