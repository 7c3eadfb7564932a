"""Jacobians of models, by differentiation: as expressions for a filter, as arrays along a trajectory."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.casadi import of_each, symbol


def jacobian(f: Callable[[ca.SX], ca.SX], x: ca.SX) -> ca.SX:
    """Jacobian of f at the expression x (which need not be a bare symbol)."""
    s = symbol("s", x.numel())
    return ca.substitute(ca.jacobian(f(s), s), s, x)


def transitions(
    model: Any, states: Float[np.ndarray, "steps n"], dt: float
) -> Float[np.ndarray, "steps n n"]:
    """Jacobian of a model's ``step(x, u, dt)`` at each state of a trajectory, without control."""
    return of_each(_transition(model, states.shape[1], dt), states)[0]


@lru_cache(maxsize=16)
def _transition(model: Any, n: int, dt: float) -> ca.Function:
    """State -> Jacobian, transposed: the memory of a row-major array."""
    x = symbol("x", n)
    F = ca.densify(ca.jacobian(model.step(x, ca.SX.zeros(n), dt), x))
    return ca.Function("F", [x], [F.T])
