"""Jacobians of models, by differentiation: as expressions for a filter, as arrays along a trajectory."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float


def jacobian(f: Callable[[ca.SX], ca.SX], x: ca.SX) -> ca.SX:
    """Jacobian of f at the expression x (which need not be a bare symbol)."""
    s = ca.SX.sym("s", x.numel())  # pyright: ignore[reportArgumentType, reportCallIssue]
    return ca.substitute(ca.jacobian(f(s), s), s, x)


def transitions(
    model: Any, states: Float[np.ndarray, "steps n"], dt: float
) -> Float[np.ndarray, "steps n n"]:
    """Jacobian of a model's ``step(x, u, dt)`` at each state of a trajectory, without control."""
    steps, n = states.shape
    x, F = np.ascontiguousarray(states, dtype=float), np.empty((steps, n, n))
    buffer, evaluate = _along(model, n, dt, steps).buffer()
    buffer.set_arg(0, x.data)  # pyright: ignore[reportCallIssue]
    buffer.set_res(0, F.data)  # pyright: ignore[reportCallIssue]
    evaluate()
    return F


@lru_cache(maxsize=16)
def _along(model: Any, n: int, dt: float, steps: int) -> ca.Function:
    """States side by side -> Jacobians side by side, transposed: the memory of row-major arrays."""
    x = ca.SX.sym("x", n)  # pyright: ignore[reportArgumentType, reportCallIssue]
    F = ca.densify(ca.jacobian(model.step(x, ca.SX.zeros(n), dt), x))
    return ca.Function("F", [x], [F.T]).map(steps)
