"""What a solver returns: the solution with its own residuals, and a status that says what to do."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from jaxtyping import Float

NAN = float("nan")


class Status(IntEnum):
    """How a decision or a solution came about; ``advice`` says what a user can do about it.

    The integer codes travel through compiled functions; they never change their meaning.
    """

    OPTIMAL = 0
    CLIPPED = 1
    INACCURATE = 2
    INFEASIBLE = 3
    UNOBSERVABLE = 4
    NO_TARGETS = 5
    INVALID_INPUT = 6
    SOLVER_FAILED = 7
    VIOLATED = 8
    RESTARTED = 9
    SECOND_SOLVER = 10
    BEST_MANOEUVRE = 11
    SOFTENED = 12
    LIMITED = 13
    PLANNER_FAILED = 14
    INVALID_DECISION = 15
    TOO_FAST = 16

    @property
    def advice(self) -> str:
        """What happened and what to change, in one sentence that is true of every planner."""
        return _ADVICE[self]

    @property
    def label(self) -> str:
        """Name as written in files: lower case with hyphens."""
        return self.name.lower().replace("_", "-")


_ADVICE = {
    Status.OPTIMAL: "solved as stated; nothing to do",
    Status.CLIPPED: (
        "the turn wanted is beyond the vehicle's turning limit, which was applied; "
        "a smaller turning radius would help"
    ),
    Status.INACCURATE: (
        "the search for the optimum stopped short of its tolerance; "
        "allow it more iterations or starts, or loosen the tolerance"
    ),
    Status.INFEASIBLE: (
        "no solution satisfies every limit; relax the tightest, or take a smaller turning radius"
    ),
    Status.UNOBSERVABLE: (
        "no candidate makes every AUV observable over the horizon; "
        "lengthen the horizon or move the aid vehicle"
    ),
    Status.NO_TARGETS: "there is no AUV to plan for; the aid vehicle goes straight on",
    Status.INVALID_INPUT: (
        "a pose or a belief is not finite; the aid vehicle goes straight on; check the estimator"
    ),
    Status.SOLVER_FAILED: (
        "the solver failed and a fallback is taken; check the scale of the problem"
    ),
    Status.VIOLATED: (
        "no feasible candidate was found; the one that violates the limits least is taken; "
        "widen the limits or start elsewhere"
    ),
    Status.RESTARTED: (
        "solved as stated, but not from the last trajectory, which was no good start; "
        "nothing to do unless it happens often"
    ),
    Status.SECOND_SOLVER: (
        "solved as stated, but by the slower solver, since the first one failed; "
        "a smaller problem, as of fewer stages, may help if it happens often"
    ),
    Status.BEST_MANOEUVRE: (
        "no solver improved on the best candidate tried, which is taken; "
        "more iterations, or a smaller problem, may help"
    ),
    Status.SOFTENED: (
        "no feasible solution was found; the optimum with the limits softened is taken; "
        "widen the limits"
    ),
    Status.LIMITED: (
        "the turn wanted breaks a limit; the nearest turn that does not is taken; "
        "nothing to do unless it happens often"
    ),
    Status.PLANNER_FAILED: (
        "the planner raised an exception; the aid vehicle holds its turn, or circles; "
        "correct the planner"
    ),
    Status.INVALID_DECISION: (
        "what the planner returned is no valid decision; for a command that is none the aid "
        "vehicle holds its turn, or circles, and a figure that is none is left out; "
        "correct the planner"
    ),
    Status.TOO_FAST: (
        "the speed wanted by the planner is beyond the vehicle's own, which is taken; "
        "correct the planner, or give the vehicle its true speed"
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    r"""What a solver or a search found for: minimise f(x) subject to g(x) ≤ 0.

    The residuals are computed from the problem itself, never taken from a solver:

    .. math:: r_\mathrm{primal} = \max_i \max(0, g_i(x)), \quad
              r_\mathrm{dual} = \lVert \nabla_x L(x, \lambda) \rVert_\infty, \quad
              r_\mathrm{gap} = f(x) - \inf_y L(y, \lambda),

    with the Lagrangian :math:`L(x, \lambda) = f(x) + \lambda^\top g(x)` and multipliers λ ≥ 0. Each
    has the unit of what it measures. A method without multipliers has no dual residual, one that is
    not convex no gap: those are nan. Without limits the primal residual is 0. Where there is no
    solution all numbers are nan, and ``status`` says why.
    """

    x: Float[np.ndarray, "*n"]  # what was chosen; the solver says in which unit and order
    objective: float  # f(x)
    status: Status
    primal_residual: float = 0.0
    dual_residual: float = NAN
    duality_gap: float = NAN
    # of a path: east, north [m], heading [rad]; none where there is no path
    poses: Float[np.ndarray, "nodes 3"] = field(default_factory=lambda: np.empty((0, 3)))
    # number of each AUV's Gramian, where there is one
    condition: Float[np.ndarray, " M"] = field(default_factory=lambda: np.empty(0))
    remedies: Mapping[Status, str] | None = None  # advice of this solver in particular

    @classmethod
    def missing(
        cls, status: Status, n: int = 1, remedies: Mapping[Status, str] | None = None
    ) -> "Solution":
        """Stand for a solution where there is none."""
        return cls(
            x=np.full(n, NAN), objective=NAN, status=status, primal_residual=NAN, remedies=remedies
        )

    @property
    def advice(self) -> str:
        """What happened and what to change, in the words of this solver's options."""
        return (self.remedies or {}).get(self.status, self.status.advice)
