"""What a solver returns: the solution with its own residuals, and a status that says what to do about it."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Float


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

    @property
    def advice(self) -> str:
        """One sentence: what happened and what to change."""
        return _ADVICE[self]

    @property
    def label(self) -> str:
        """Name as written in files: lower case with hyphens."""
        return self.name.lower().replace("_", "-")


_ADVICE = {
    Status.OPTIMAL: "the optimum of the stated problem; nothing to do",
    Status.CLIPPED: "the optimum lies beyond the vehicle's turning limit, which was applied; a smaller turning radius would help",
    Status.INACCURATE: "the solver stopped short of its tolerance; allow more iterations or loosen the tolerance",
    Status.INFEASIBLE: "no solution satisfies every limit; relax the largest radius, the largest centre distance or the turning radius",
    Status.UNOBSERVABLE: "no manoeuvre makes every AUV observable over the horizon; lengthen the horizon or move the aid vehicle",
    Status.NO_TARGETS: "there is no AUV to plan for; the aid vehicle goes straight on",
    Status.INVALID_INPUT: "a pose or a belief is not finite; the aid vehicle goes straight on; check the estimator",
    Status.SOLVER_FAILED: "the solver failed; the substitute manoeuvre is the closed form's; check the scale of the problem",
    Status.VIOLATED: "no manoeuvre keeps within every limit; the one that violates least is taken; widen the limits or start elsewhere",
    Status.RESTARTED: "the optimum, but found anew: the last trajectory was no good start; nothing to do unless it happens often",
    Status.SECOND_SOLVER: "the optimum, but the first solver failed and a slower one found it; fewer stages may help if it happens often",
    Status.BEST_MANOEUVRE: "no solver improved on the best manoeuvre tried, which is taken; fewer stages or more iterations may help",
    Status.SOFTENED: "no trajectory found keeps within every limit; the optimum with the limits softened is taken; widen the limits",
    Status.LIMITED: "the manoeuvre wanted breaks a limit; the nearest turn that does not is taken; nothing to do unless it happens often",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Minimiser of a convex problem, with residuals computed from the problem itself and not taken from the solver.

    ``primal_residual`` is the largest violation of a constraint, ``dual_residual`` the norm of the Lagrangian's gradient, ``duality_gap``
    the primal less the dual objective, each in the unit of what it measures. All are nan where ``status`` says there is no solution.
    """

    x: Float[np.ndarray, " n"]
    objective: float
    primal_residual: float
    dual_residual: float
    duality_gap: float
    status: Status

    @classmethod
    def missing(cls, status: Status, n: int = 1) -> "Solution":
        """Return what stands for a solution where there is none: nan throughout, and why."""
        nothing = float("nan")
        unknown = np.full(n, nothing)
        return cls(
            x=unknown,
            objective=nothing,
            primal_residual=nothing,
            dual_residual=nothing,
            duality_gap=nothing,
            status=status,
        )
