"""Gramian of a model in plain numpy: the empirical one of its simulation.

It knows nothing of the model but its values, and is called as an exact one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from .empirical import EPSILON, empirical_gramian
from .exact import Model, given, runge_kutta, timed


@dataclass(frozen=True, kw_only=True)
class SimulatedGramian:
    """Empirical observability Gramian of dynamics f and a measurement h in plain Python.

    Central differences (thesis 2.9) of the outputs that the classical Runge-Kutta method finds:
    the Gramian of :func:`exact_gramian` but for O(epsilon^2) and for rounding over epsilon, with
    a relative error of about 1e-9. It takes 8·n·steps calls of f per state and control, and so
    some two hundred times as long.

    Raises ValueError where :func:`empirical_gramian` does, and for models that take other
    arguments.
    """

    # f(t, x, u, p) -> dx/dt and h(t, x, u, p) -> y, or f(x, u) and h(x, u), of arrays of one axis
    f: Model
    h: Model
    steps: int  # u is held over each; samples are one more
    rule: str = "simpson"  # left, trapezoid, simpson, sum: see `quadrature_weights`
    # displacement, in the unit of the state, of all or of each
    epsilon: float | Float[np.ndarray, " n"] | Sequence[float] = EPSILON
    # outputs that are angles [rad] and may wrap; others that do are refused
    angles: Sequence[int] = ()
    rounding: ClassVar[float] = 1e-9  # of entries, relative to the largest: over epsilon

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise ValueError(f"steps must be at least 1, got {self.steps}")
        timed("f", self.f)
        timed("h", self.h)

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
        """Evaluate W about the trajectory from ``x0``; arguments and units of an exact Gramian."""
        x0 = np.asarray(x0, dtype=float)
        u = given(u, "controls u", (1, 0))
        p = given(p, "parameters p", (0,))
        n = x0.shape[-1]
        batch = np.broadcast_shapes(x0.shape[:-1], u.shape[:-2], p.shape[:-1])
        states = np.broadcast_to(x0, (*batch, n))
        controls = np.broadcast_to(u, (*batch, self.steps, u.shape[-1]))
        parameters = np.broadcast_to(p, (*batch, p.shape[-1]))
        W = np.empty((*batch, n, n))
        for case in np.ndindex(batch):

            def simulate(x: np.ndarray, case: tuple[int, ...] = case) -> np.ndarray:
                return self._outputs(x, controls[case], parameters[case], t0, horizon)

            W[case] = empirical_gramian(
                simulate,
                states[case],
                horizon=horizon,
                epsilon=self.epsilon,
                rule=self.rule,
                R=R,
                angles=self.angles,
            )
        return W

    def _outputs(
        self, x: np.ndarray, u: np.ndarray, p: np.ndarray, t0: float, horizon: float
    ) -> Float[np.ndarray, "samples y"]:
        """Outputs of one trajectory; at the last sample under the last control."""
        f, h = timed("f", self.f), timed("h", self.h)
        dt = horizon / self.steps
        outputs = []
        for k, held in enumerate(u):
            t = t0 + k * dt
            outputs.append(_row(h(t, x, held, p)))
            x = runge_kutta(lambda t, x, held=held: _row(f(t, x, held, p)), t, x, dt)
        outputs.append(_row(h(t0 + horizon, x, u[-1], p)))
        return np.array(outputs)


def _row(value: Any) -> Float[np.ndarray, " entries"]:
    """Return what a model gave, a list, an array or CasADi's numbers, as one row."""
    return np.asarray(value, dtype=float).ravel()
