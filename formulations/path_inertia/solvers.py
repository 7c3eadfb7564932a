"""Solvers, compiled once and fed: OSQP and Clarabel of the turn program, cvxpy of the printed sum.

The first two take the program seen from its centre (``Deviation``) as a quadratic program in
(u, y, t), the absolute value by its epigraph:

    minimise ½y² + τt  subject to  u − t ≤ 0,  −u − t ≤ fold,  lower ≤ u ≤ upper,  u − y = 0

τ, the fold and the limits change from decision to decision, the matrices never do. Where τ is 0 by
construction, t and its rows are left out. The copy y of u is there for OSQP's polishing: without an
active row it prints a line and returns unpolished.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float

from formulations.path_inertia.printed import FAILED, Cvxpy
from formulations.path_inertia.program import Deviation, Point, TurnProgram

OSQP_SETTINGS: dict[str, Any] = {
    "verbose": False,
    "polishing": True,  # from the 1e-7 of the iterations to the last digit
    "eps_abs": 1e-7,
    "eps_rel": 1e-7,
    "warm_starting": False,  # the answer must not depend on the decision before
    # for the same reason; adapting also left two programs in 3000 wrong by half, fixed none by more
    # than 1e-10
    "adaptive_rho": False,
    "rho": 0.3,  # the quickest of 0.1 to 2
    "scaling": 0,  # the program is handed over scaled
}
# Of the duality gap; its square root, 3e-7, is what is left where a limit is touched but does not
# press.
CLARABEL_TOLERANCE = 1e-13
Compiled = Callable[[TurnProgram], Point]
"""What a solver is once set up."""


class PersistentOSQP:
    """OSQP set up once; each decision updates vectors, solves and polishes."""

    def __init__(self, absolute: bool):
        sparse = import_module("scipy.sparse").csc_matrix
        P, self._q, A = _matrices(absolute)
        self._lower, self._upper = np.full(len(A), -np.inf), np.zeros(len(A))
        self._lower[-2:], self._upper[-2] = (-1.0, 0.0), 1.0
        self._solver = import_module("osqp").OSQP()
        self._solver.setup(sparse(P), self._q, sparse(A), self._lower, self._upper, **OSQP_SETTINGS)
        self._absolute, self._given = absolute, ()

    def __call__(self, program: TurnProgram) -> Point:
        """Solve one bounded program."""
        deviation = Deviation.of(program)
        # far from every limit all decisions are the same program, up to scale
        if deviation[:4] != self._given:
            self._update(deviation)
        result = self._solver.solve(raise_error=False)
        dual = result.y.tolist()
        sign = dual[0] - dual[1] if self._absolute else 0.0
        return deviation.point(float(result.x[0]), sign, max(-dual[-2], 0.0), max(dual[-2], 0.0))

    def _update(self, deviation: Deviation) -> None:
        self._lower[-2], self._upper[-2] = deviation.lower, deviation.upper
        if self._absolute:
            self._q[2], self._upper[1] = deviation.threshold, deviation.fold
        self._solver.update(q=self._q, l=self._lower, u=self._upper)
        self._given = deviation[:4]


class PersistentClarabel:
    """Clarabel set up once; each decision updates vectors and solves by interior point."""

    def __init__(self, absolute: bool):
        clarabel, sparse = import_module("clarabel"), import_module("scipy.sparse").csc_matrix
        P, self._q, A = _matrices(absolute)
        one_sided = np.vstack([A[-1], A[:-1], -A[-2]])  # the equality first, then rows <= b
        self._b = np.zeros(len(one_sided))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False  # it would refuse updates
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = CLARABEL_TOLERANCE
        cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(len(self._b) - 1)]
        self._solver = clarabel.DefaultSolver(
            sparse(P), self._q, sparse(one_sided), self._b, cones, settings
        )
        self._absolute = absolute

    def __call__(self, program: TurnProgram) -> Point:
        """Solve one bounded program."""
        deviation = Deviation.of(program)
        self._b[-2], self._b[-1] = deviation.upper, -deviation.lower
        if self._absolute:
            self._q[2], self._b[2] = deviation.threshold, deviation.fold
        self._solver.update(q=self._q, b=self._b)
        result = self._solver.solve()
        sign = result.z[1] - result.z[2] if self._absolute else 0.0
        return deviation.point(result.x[0], sign, result.z[-1], result.z[-2])


# cvxpy puts its own defaults over OSQP's, and keeps a warm solver that is not polished again
CVXPY_OPTIONS: dict[str, dict[str, Any]] = {
    "cvxpy-osqp": {"solver": "OSQP", "warm_start": False} | OSQP_SETTINGS,
    "cvxpy-clarabel": {
        "solver": "CLARABEL",
        "warm_start": False,
        "tol_gap_abs": CLARABEL_TOLERANCE,
        "tol_gap_rel": CLARABEL_TOLERANCE,
        "tol_feas": CLARABEL_TOLERANCE,
    },
}
# of the program reduced to one number
REDUCED: dict[str, Callable[[bool], Compiled]] = {
    "closed-form": lambda _: TurnProgram.optimum,
    "osqp": PersistentOSQP,
    "clarabel": PersistentClarabel,
}
SOLVERS = (*REDUCED, *CVXPY_OPTIONS)


def set_up(solver: str, objective: str, gamma: float) -> Compiled | Cvxpy:
    """Set a solver up; one that cannot be for want of memory, say, fails at each decision.

    Raises
    ------
    ImportError
        It is not installed.
    NotImplementedError
        Its version does not do what is needed.
    """
    try:
        if solver in CVXPY_OPTIONS:
            return Cvxpy(objective, gamma, CVXPY_OPTIONS[solver])
        return REDUCED[solver](objective == "difference" and gamma > 0)
    except (ImportError, NotImplementedError):
        raise
    except Exception:
        return lambda _: FAILED


def _matrices(
    absolute: bool,
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"], Float[np.ndarray, "rows n"]]:
    """Return P, q and the rows of the quadratic program.

    The last row but one is the box, the last the equality.
    """
    P = np.diag([0.0, 1.0, 0.0])
    A = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [1.0, 0.0, 0.0], [1.0, -1.0, 0.0]])
    if not absolute:
        P, A = P[:2, :2], A[2:, :2]
    return P, np.zeros(len(P)), A
