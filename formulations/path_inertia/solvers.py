"""Solvers of the turn program, compiled once and fed: OSQP and Clarabel directly, and either of them through cvxpy.

All take the program as a quadratic program in (x, y, t), with y = x − c as a variable of its own and |x| by its epigraph:

    minimise ½y² + τt  subject to  x − t ≤ 0,  −x − t ≤ 0,  lower ≤ x ≤ upper,  x − y = c

c, τ and the limits change from decision to decision, the matrices never do. Where τ is 0 by construction, t and its rows are left out.
Kept as an equality, c makes sure that OSQP's polishing always has an active row: without one it prints a line and returns unpolished.
"""

import warnings
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float

from formulations.path_inertia.program import Point, TurnProgram

OSQP_SETTINGS: dict[str, Any] = {
    "verbose": False,
    "polishing": True,  # from the 1e-7 of the iterations to the last digit
    "eps_abs": 1e-7,
    "eps_rel": 1e-7,
    "warm_starting": False,  # the answer must not depend on the decision before
    "adaptive_rho": False,  # for the same reason; adapting also failed on about 1 program in 2000
    "scaling": 0,  # the program is handed over scaled
}
CLARABEL_TOLERANCE = 1e-13
"""Of the duality gap: the square root of it, 3e-7, is what is left where a limit is touched but does not press."""
FAILED = Point(np.nan, np.nan, np.nan, np.nan)


class PersistentOSQP:
    """OSQP set up once; each decision updates vectors, solves and polishes."""

    def __init__(self, absolute: bool):
        sparse = import_module("scipy.sparse").csc_matrix
        P, self._q, A = _matrices(absolute)
        rows = A.shape[0]
        self._lower, self._upper = np.full(rows, -np.inf), np.zeros(rows)
        self._lower[-2:], self._upper[-2:] = (-1.0, 0.0), (1.0, 0.0)
        self._solver = import_module("osqp").OSQP()
        self._solver.setup(sparse(P), self._q, sparse(A), self._lower, self._upper, **OSQP_SETTINGS)

    def __call__(self, program: TurnProgram) -> Point:
        """Solve one program, already scaled."""
        if len(self._q) == 3:
            self._q[2] = program.threshold
        self._lower[-2:] = program.lower, program.center
        self._upper[-2:] = program.upper, program.center
        self._solver.update(q=self._q, l=self._lower, u=self._upper)
        result = self._solver.solve(raise_error=False)
        y = result.y.tolist()
        sign = y[0] - y[1] if len(y) == 4 else 0.0
        return Point(float(result.x[0]), sign, max(-y[-2], 0.0), max(y[-2], 0.0))


class PersistentClarabel:
    """Clarabel set up once; each decision updates vectors and solves by interior point."""

    def __init__(self, absolute: bool):
        clarabel, sparse = import_module("clarabel"), import_module("scipy.sparse").csc_matrix
        P, self._q, A = _matrices(absolute)
        one_sided = np.vstack([A[-1], A[:-1], -A[-2]])  # Clarabel: equality first, then rows <= b
        self._b = np.zeros(len(one_sided))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False  # it would refuse updates
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = CLARABEL_TOLERANCE
        cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(len(self._b) - 1)]
        self._solver = clarabel.DefaultSolver(sparse(P), self._q, sparse(one_sided), self._b, cones, settings)

    def __call__(self, program: TurnProgram) -> Point:
        """Solve one program, already scaled."""
        if len(self._q) == 3:
            self._q[2] = program.threshold
        self._b[0], self._b[-2], self._b[-1] = program.center, program.upper, -program.lower
        self._solver.update(q=self._q, b=self._b)
        result = self._solver.solve()
        sign = result.z[1] - result.z[2] if len(result.z) == 5 else 0.0
        return Point(result.x[0], sign, result.z[-1], result.z[-2])


class CompiledCvxpy:
    """The program as cvxpy reads it, canonicalised once (disciplined parametrised), solved by OSQP or Clarabel."""

    def __init__(self, absolute: bool, solver: str):
        cp = self._cvxpy = import_module("cvxpy")
        self._x, self._t = cp.Variable(name="turn"), cp.Variable(name="size")
        self._center, self._lower, self._upper = (cp.Parameter(name=name) for name in ("center", "lower", "upper"))
        self._threshold = cp.Parameter(name="threshold", nonneg=True)
        limits = [self._lower <= self._x, self._x <= self._upper]
        size = [self._x <= self._t, -self._x <= self._t] if absolute else []
        objective = 0.5 * cp.square(self._x - self._center) + (self._threshold * self._t if absolute else 0.0)
        self.problem = cp.Problem(cp.Minimize(objective), limits + size)
        if not self.problem.is_dcp(dpp=True):
            raise RuntimeError("the path-inertia program is not DPP in this version of cvxpy: it would be rebuilt at every decision")
        # cvxpy puts its own defaults over OSQP's, and keeps a warm solver that is not polished again
        exact = {f"tol_{name}": CLARABEL_TOLERANCE for name in ("gap_abs", "gap_rel", "feas")}
        self._options = {"solver": solver, "warm_start": False} | (OSQP_SETTINGS if solver == "OSQP" else exact)

    def __call__(self, program: TurnProgram) -> Point:
        """Solve one program, already scaled."""
        self._center.value, self._threshold.value = program.center, program.threshold
        self._lower.value, self._upper.value = program.lower, program.upper
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of inaccuracy: the certificate tells
                self.problem.solve(**self._options)
        except self._cvxpy.error.SolverError:
            return FAILED
        if self._x.value is None:
            return FAILED
        dual = [float(constraint.dual_value) for constraint in self.problem.constraints]
        return Point(float(self._x.value), dual[2] - dual[3] if len(dual) == 4 else 0.0, dual[0], dual[1])


SOLVERS: dict[str, Callable[[bool], Callable[[TurnProgram], Point]]] = {
    "closed-form": lambda _: TurnProgram.optimum,
    "osqp": PersistentOSQP,
    "clarabel": PersistentClarabel,
    "cvxpy-osqp": lambda absolute: CompiledCvxpy(absolute, "OSQP"),
    "cvxpy-clarabel": lambda absolute: CompiledCvxpy(absolute, "CLARABEL"),
}


def solve_scaled(solver: Callable[[TurnProgram], Point], program: TurnProgram, scale: float) -> Point:
    """Solve a program divided by a scale, and scale the answer back."""
    center, threshold, lower, upper = program
    x, sign, low, high = solver(TurnProgram(center / scale, threshold / scale, lower / scale, upper / scale))
    return Point(scale * x, scale * sign, scale * low, scale * high)


def _matrices(absolute: bool) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"], Float[np.ndarray, "rows n"]]:
    """Return P, q and the rows of the quadratic program; the last row but one is the box, the last the equality."""
    P = np.diag([0.0, 1.0, 0.0])
    A = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [1.0, 0.0, 0.0], [1.0, -1.0, 0.0]])
    if not absolute:
        P, A = P[:2, :2], A[2:, :2]
    return P, np.zeros(len(P)), A
