"""Jacobians of models, by differentiation: as expressions for a filter, as arrays along a trajectory."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float


def jacobian(f: Callable[[ca.SX], ca.SX], x: ca.SX) -> ca.SX:
    """Jacobian of f at the expression x (which need not be a bare symbol)."""
    s = ca.SX.sym("s", x.numel())  # pyright: ignore[reportArgumentType, reportCallIssue]
    return ca.substitute(ca.jacobian(f(s), s), s, x)


def transitions(model: Any, states: Float[np.ndarray, "steps n"], dt: float) -> Float[np.ndarray, "steps n n"]:
    """Jacobian of a model's ``step(x, u, dt)`` at each state of a trajectory, without control."""
    n = states.shape[1]
    x = ca.SX.sym("x", n)  # pyright: ignore[reportArgumentType, reportCallIssue]
    F = ca.densify(ca.jacobian(model.step(x, ca.SX.zeros(n), dt), x))
    along = ca.Function("F", [x], [F.T]).map(len(states))  # transposed: CasADi stores by columns
    return along(states.T).full().T.reshape(-1, n, n)
