"""Exact observability Gramian: forward sensitivities carried along the trajectory.

It is compiled once for any dynamics f and measurement h.
"""

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..model.casadi import evaluate, mapped, matrix
from .samples import quadrature_weights, whitening_matrix

# Up to here the horizon is one straight-line function: twice as fast, and built in 0.2 s.
UNROLLED_INSTRUCTIONS = 500_000
MOST_DOUBLINGS = 12  # of the steps, before a Gramian is declared not to converge

Model = Callable[..., Any]  # (t, x, u, p) or (x, u) -> column


def exact_gramian(
    f: Model,
    h: Model,
    *,
    n: int,
    m: int = 0,
    q: int = 0,
    steps: int,
    rule: str | None = None,
    discrete: bool = False,
    substeps: int = 1,
) -> "ExactGramian":
    r"""Compile the observability Gramian of any dynamics and measurement about a trajectory.

    .. math:: W = \int_{t_0}^{t_0+T} J^\top R^{-1} J \, dt, \quad
              J(t) = \frac{\partial h}{\partial x} \Phi(t), \quad
              \dot\Phi = \frac{\partial f}{\partial x} \Phi, \quad \Phi(t_0) = 1

    Equation (2.4) of the thesis, linearised about the trajectory and weighted as Fisher
    information. The classical Runge-Kutta method (order 4) carries state and sensitivities
    together, so J is the derivative of the computed output to rounding, and the integral is a sum
    over the steps + 1 samples. With ``discrete`` the dynamics are a map, and W is by default the
    sum over the samples.

    Parameters
    ----------
    f, h
        f(t, x, u, p) -> dx/dt, or the next state if ``discrete``; h(t, x, u, p) -> y. Without time
        and parameters f(x, u) and h(x, u). Written in CasADi (``ca.sin``, not ``np.sin``). An
        angle among the outputs may wrap: its derivative does not.
    n, m, q
        Numbers of states, controls and parameters.
    steps
        Number of steps; u is held over each. h sees, at a sample, the control of the step that
        starts there; at the last, of the last. Where u jumps, the integrand has a kink: for Simpson
        to keep its order, hold each control over an even number of steps.
    rule
        ``left``, ``trapezoid``, ``simpson`` (default), ``sum`` (default if ``discrete``): see
        :func:`quadrature_weights`.
    substeps
        Runge-Kutta steps per step, for samples far apart (pings).

    Raises
    ------
    ValueError
        For an unknown rule, too few steps, substeps of a discrete map, or a model that is not
        written in CasADi, does not return a column of the right length, or takes other arguments.
    """
    rule = rule or ("sum" if discrete else "simpson")
    if min(n, steps, substeps) < 1 or min(m, q) < 0:
        raise ValueError(
            f"n, steps and substeps must be at least 1, m and q at least 0, got {n}, {steps}, "
            f"{substeps}, {m}, {q}"
        )
    if discrete and substeps != 1:
        raise ValueError(
            f"a discrete map takes one step per sample, got substeps={substeps}; leave substeps out"
        )
    timed_f, timed_h = timed("f", f), timed("h", h)
    step, sample = _stage(timed_f, timed_h, n, m, q, discrete, substeps)

    def refine(steps: int) -> ExactGramian:
        return exact_gramian(f, h, n=n, m=m, q=q, steps=steps, rule=rule, substeps=substeps)

    refinable = not discrete and rule != "sum"
    return ExactGramian(
        function=_horizon(step, sample, steps, rule), refine=refine if refinable else None
    )


def timed(name: str, model: Model) -> Model:
    """Return a model of (t, x, u, p), of one of these or of (x, u); raise ValueError for others."""
    needed, taken = _arguments(model)
    if needed == 4:
        return model
    if needed == 2 and taken < 4:
        return lambda _t, x, u, _p: model(x, u)
    raise ValueError(
        f"{name} must take (t, x, u, p), or (x, u), none of them by default; "
        f"got a function that needs {needed} and takes {taken} arguments"
    )


def _arguments(model: Model) -> tuple[int, int]:
    """How many arguments by position a model needs, and how many it takes."""
    if isinstance(model, ca.Function):
        return model.n_in(), model.n_in()
    parameters = inspect.signature(model).parameters.values()
    if any(parameter.kind is parameter.VAR_POSITIONAL for parameter in parameters):
        return 4, 4
    taken = [parameter for parameter in parameters if parameter.kind is not parameter.KEYWORD_ONLY]
    needed = [parameter for parameter in taken if parameter.default is parameter.empty]
    return len(needed), len(taken)


def _stage(
    f: Model, h: Model, n: int, m: int, q: int, discrete: bool, substeps: int
) -> tuple[ca.Function, ca.Function]:
    """Build one step of state and sensitivities, and one sample's rows of the factor.

    The rows are transposed, so that samples stack as columns.
    """
    t, dt, weight = matrix("t"), matrix("dt"), matrix("weight")
    x, u, p, Phi = matrix("x", n), matrix("u", m), matrix("p", q), matrix("Phi", n, n)
    y = _column("h", h(t, x, u, p))

    def rate(t, x):
        return _column("f", f(t, x, u, p), n)

    x_next = rate(t, x) if discrete else x
    for k in range(0 if discrete else substeps):
        x_next = runge_kutta(rate, t + k * dt / substeps, x_next, dt / substeps)
    Phi_next = ca.densify(ca.jtimes(x_next, x, Phi))
    step = ca.Function("step", [x, Phi, t, u, p, dt], [x_next, Phi_next])
    whitening = matrix("whitening", y.numel(), y.numel())
    rows = ca.densify((weight * whitening @ ca.jtimes(y, x, Phi)).T)
    sample = ca.Function("sample", [t, x, Phi, u, p, weight, whitening], [rows])
    return _straightened(step), _straightened(sample)


def runge_kutta(rate: Callable[[Any, Any], Any], t, x, dt):
    """Return the state after dt by the classical fourth-order method; rate(t, x) -> dx/dt."""
    k1 = rate(t, x)
    k2 = rate(t + dt / 2, x + dt / 2 * k1)
    k3 = rate(t + dt / 2, x + dt / 2 * k2)
    k4 = rate(t + dt, x + dt * k3)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _column(name: str, value: Any, rows: int | None = None) -> ca.MX:
    """Return a model's value as a dense column, or raise ValueError."""
    try:
        value = ca.densify(ca.MX(value))
    except NotImplementedError:
        raise ValueError(
            f"{name} must return a CasADi expression (ca.vertcat, ca.sin, ...), got a "
            f"{type(value).__name__}; a model in numpy goes to SimulatedGramian, which is slower"
        ) from None
    if value.shape[1] != 1 or value.shape[0] != (rows or value.shape[0]):
        wanted = f"{rows} x 1, one row per state" if rows else "a column, one row per output"
        raise ValueError(
            f"{name} must return {wanted}, got {value.shape[0]} x {value.shape[1]}; use ca.vertcat"
        )
    return value


def _straightened(function: ca.Function) -> ca.Function:
    """Return the function on scalars, which is many times faster.

    What calls functions that have no scalar form (tables, solvers) comes back as it is.
    """
    try:
        return function.expand()
    except RuntimeError:
        return function


def _horizon(step: ca.Function, sample: ca.Function, steps: int, rule: str) -> ca.Function:
    """Chain the steps: (x0, u, p, t0, horizon, whitening) -> (W, factor)."""
    n, m, q, outputs = step.size1_in(0), step.size1_in(3), step.size1_in(4), sample.size1_in(6)
    x0, u, p = matrix("x0", n), matrix("u", m, steps), matrix("p", q)
    t0, horizon = matrix("t0"), matrix("horizon")
    whitening = matrix("whitening", outputs, outputs)
    dt = horizon / steps
    t = t0 + dt * ca.DM(range(steps + 1)).T
    unit_weights = np.sqrt(quadrature_weights(steps + 1, float(steps), rule))
    weights = ca.DM(unit_weights).T * (1 if rule == "sum" else ca.sqrt(dt))
    each_step = ca.repmat(p, 1, steps), ca.repmat(dt, 1, steps)
    X, Phi = step.mapaccum("steps", steps, 2)(x0, ca.DM.eye(n), t[:-1], u, *each_step)
    X, Phi, U = ca.horzcat(x0, X), ca.horzcat(ca.DM.eye(n), Phi), ca.horzcat(u, u[:, -1])
    p_each, whitening_each = ca.repmat(p, 1, steps + 1), ca.repmat(whitening, 1, steps + 1)
    columns = sample.map(steps + 1)(t, X, Phi, U, p_each, weights, whitening_each)
    names = ["x0", "u", "p", "t0", "horizon", "whitening"], ["W", "factor"]
    function = ca.Function(
        "exact_gramian",
        [x0, u, p, t0, horizon, whitening],
        [columns @ columns.T, columns.T],
        *names,
    )
    small = steps * (step.n_instructions() + sample.n_instructions()) <= UNROLLED_INSTRUCTIONS
    return _straightened(function) if small else function


@dataclass(frozen=True, kw_only=True)
class ExactGramian:
    """Compiled observability Gramian.

    Made by :func:`exact_gramian`, called with the conditions it is wanted for.

    ``function`` is the CasADi Function (x0: n, u: m x steps, p, t0, horizon, whitening: R^(-1/2))
    -> (W: n x n, factor: rows x n) for use inside other expressions; ``refine(steps)`` compiles the
    same Gramian with another number of steps, where that has a meaning.
    """

    function: ca.Function
    refine: Callable[[int], "ExactGramian"] | None
    rounding: ClassVar[float] = 1e-14  # of entries, relative to the largest

    @property
    def steps(self) -> int:
        """Number of steps; the samples are one more."""
        return self.function.size2_in(1)

    def __call__(
        self,
        x0: Float[np.ndarray, "... n"] | Sequence[Any],
        u: Float[np.ndarray, "... m"] | Sequence[Any] | None = None,
        *,
        horizon: float,
        p: Float[np.ndarray, "... q"] | Sequence[Any] | None = None,
        t0: float = 0.0,
        R: Float[np.ndarray, "y y"] | Sequence[Any] | None = None,
    ) -> Float[np.ndarray, "... n n"]:
        """Evaluate W about the trajectory from ``x0`` at time ``t0`` [s] over ``horizon`` [s].

        W is symmetric positive semidefinite.

        ``u`` is (..., steps, m), each row held over one step, or (..., 1, m), held throughout;
        ``x0`` is (..., n), ``p`` (..., q). Leading axes are broadcast: ``x0[:, None]`` with
        ``u[None]`` gives every state under every control in one evaluation. ``R`` is the covariance
        of the measurement noise (where the rule is an integral, its density: unit y^2 s); without
        it, 1 in units of y. Unit of W_ij: 1 / (unit x_i · unit x_j) with R; without, times that of
        y^2, and of time unless the rule is ``sum``. A case whose inputs or entries are not finite
        (range has no derivative at zero distance) gives nan in every entry, never a plausible
        number; the others are not touched. Raises ValueError for shapes that do not fit, an R that
        is not a covariance, or a horizon that is not positive.
        """
        return self._evaluate("W", x0, u, horizon=horizon, p=p, t0=t0, R=R)

    def factor(
        self,
        x0: Float[np.ndarray, "... n"] | Sequence[Any],
        u: Float[np.ndarray, "... m"] | Sequence[Any] | None = None,
        **conditions: Any,
    ) -> Float[np.ndarray, "... rows n"]:
        """Evaluate the factor F of W = F'F; arguments as in a call.

        Its rows are sqrt(weight)·R^(-1/2)·dy/dx0, sample by sample.

        Its singular values, squared, are the eigenvalues of W with twice the digits: W loses those
        below 2e-16 of the largest, F those below 5e-32 (the square of a double's rounding).
        """
        return self._evaluate("factor", x0, u, **conditions)

    def converged(
        self,
        x0: Float[np.ndarray, "... n"] | Sequence[Any],
        u: Float[np.ndarray, "... m"] | Sequence[Any] | None = None,
        *,
        rtol: float,
        **conditions: Any,
    ) -> "ExactGramian":
        """Compile the Gramian with so many steps that half of them give the same W to ``rtol``.

        Units of the states do not matter.

        Steps are doubled until every entry changes by at most rtol·sqrt(W_ii·W_jj); the
        integrator's error and the quadrature's fall together. Controls keep their times:
        ``np.repeat(u, finer.steps // steps, axis=-2)``. Other arguments as in a call. Raises
        ValueError if the rule is ``sum`` or the dynamics discrete, or if 12 doublings do not
        suffice.
        """
        if self.refine is None:
            raise ValueError(
                "a sum over samples and discrete dynamics have no step to refine; "
                "use an integral rule of continuous dynamics"
            )
        u = None if u is None else np.asarray(u, dtype=float)
        coarse, W = self, self(x0, u, **conditions)
        for _ in range(MOST_DOUBLINGS):
            fine = self.refine(2 * coarse.steps)
            u = u if u is None or u.shape[-2] == 1 else np.repeat(u, 2, axis=-2)
            W_fine = fine(x0, u, **conditions)
            diagonal = np.sqrt(np.diagonal(W_fine, axis1=-2, axis2=-1))
            size = diagonal[..., :, None] * diagonal[..., None, :]
            if np.all(np.abs(W_fine - W) <= rtol * size):
                return fine
            coarse, W = fine, W_fine
        raise ValueError(
            f"W did not converge to {rtol} within {coarse.steps} steps; "
            "loosen rtol, shorten the horizon, or check f and h"
        )

    def _evaluate(
        self,
        output: str,
        x0: Any,
        u: Any = None,
        *,
        horizon: float,
        p: Any = None,
        t0: float = 0.0,
        R: Any = None,
    ) -> np.ndarray:
        """Evaluate one output of the Function for all cases at once, through one buffer."""
        if not (horizon > 0 and math.isfinite(horizon)):
            raise ValueError(f"horizon must be positive and finite [s], got {horizon}")
        n, m, q = (self.function.size1_in(i) for i in range(3))
        steps = self.steps
        x0 = np.asarray(x0, dtype=float)
        u = given(u, "controls u", (1, m))
        p = given(p, "parameters p", (q,))
        batch = np.broadcast_shapes(x0.shape[:-1], u.shape[:-2], p.shape[:-1])
        cases = [
            _cases("x0", x0, batch, (n,)),
            _cases("u", u, batch, (steps, m)),
            _cases("p", p, batch, (q,)),
        ]
        count = math.prod(batch)
        whitening = whitening_matrix(R, self.function.size1_in(5))
        shared = [
            np.full(count, float(t0)),
            np.full(count, float(horizon)),
            np.tile(whitening.T.ravel(), count),
        ]
        rows = self.function.size1_out(output)
        result = np.empty((count, n, rows))  # CasADi stores columns: each case comes out transposed
        if count:
            wanted = [result if name == output else None for name in self.function.name_out()]
            evaluate(mapped(self.function, count), [*cases, *shared], wanted)
        # The inputs are asked as well: an entry that does not depend on them would stay finite.
        finite = np.isfinite(t0) & np.logical_and.reduce(
            [np.isfinite(a).all(axis=1) for a in (*cases, result.reshape(count, n * rows))]
        )
        result[~finite] = np.nan
        return np.swapaxes(result, -1, -2).reshape(*batch, rows, n)


def given(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return the value, or an empty one if none is needed; raise ValueError if one is."""
    if value is not None:
        return np.asarray(value, dtype=float)
    if shape[-1]:
        raise ValueError(
            f"the model takes {shape[-1]} {name}, got none; "
            f"give an array of (..., {', '.join(map(str, shape))})"
        )
    return np.empty(shape)


def _cases(
    name: str, value: np.ndarray, batch: tuple[int, ...], core: tuple[int, ...]
) -> np.ndarray:
    """Return contiguous rows, one per case of the batch, or raise ValueError."""
    if value.shape[-1] != core[-1]:
        raise ValueError(
            f"{name} must have shape (..., {', '.join(map(str, core))}), got {value.shape}"
        )
    try:
        return np.ascontiguousarray(np.broadcast_to(value, batch + core), dtype=float).reshape(
            math.prod(batch), math.prod(core)
        )
    except ValueError:
        raise ValueError(f"{name} must broadcast to {batch + core}, got {value.shape}") from None
