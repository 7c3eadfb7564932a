"""Empirical observability Gramian: central differences of any simulator's output.

Nothing need be known of the model inside.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .samples import quadrature_weights, whitening_matrix

# Near the cube root of a double's rounding, where truncation and rounding of a central difference
# meet.
EPSILON = 1e-5
# By which an angle or a line's direction wraps, in radians and degrees, and how near to it a jump
# is that is no noise.
WHOLE_TURNS = (np.pi, 2 * np.pi, 180.0, 360.0)
NEAR = 1e-5


def empirical_gramian(
    simulate: Callable[[Any], Any],
    x0: Float[np.ndarray, " n"] | Sequence[float],
    *,
    horizon: float,
    epsilon: float | Float[np.ndarray, " n"] | Sequence[float] = EPSILON,
    rule: str = "simpson",
    R: Float[np.ndarray, "y y"] | Sequence[Any] | None = None,
    angles: Sequence[int] = (),
) -> Float[np.ndarray, "... n n"]:
    r"""Return the empirical local observability Gramian of whatever ``simulate`` simulates.

    .. math:: W_{ij} = \frac{1}{4 \epsilon_i \epsilon_j}
              \int_0^T (y^{+i} - y^{-i})^\top R^{-1} (y^{+j} - y^{-j}) \, dt

    Equation (2.9) of the thesis, with one displacement per state if wanted and R as Fisher
    weighting. It differs from the exact Gramian by O(epsilon^2), and by O(rounding of y / epsilon)
    at the other end; outputs at most quadratic in the displaced states are exact for any epsilon.
    Samples, weights, R and units are those of :func:`exact_gramian`. An output that is not finite
    gives nan.

    Parameters
    ----------
    simulate
        x0 -> outputs (..., samples, y) at equally spaced times over the horizon, both ends
        included: plain Python or a CasADi Function. Leading axes (controls, say) come back as
        leading axes of W. An angle that wraps near ``x0`` and is not declared is refused.
    horizon
        T [s].
    epsilon
        Displacement, in the unit of the state; about 1e-5 of the length over which the output
        curves.
    rule
        ``left``, ``trapezoid``, ``simpson`` or ``sum``: see :func:`quadrature_weights`.
    angles
        Numbers of the outputs that are angles [rad], counted from 0: they may wrap.

    Raises
    ------
    ValueError
        If a displacement is not positive, the outputs are not samples x y, one jumps, as an angle
        does that wraps, a declared angle moves by more than a quarter turn or is no output, or
        rule, horizon or R are not valid.
    """
    x0 = np.asarray(x0, dtype=float)
    steps = np.broadcast_to(np.asarray(epsilon, dtype=float), x0.shape)
    if not np.all(steps > 0):
        raise ValueError(
            f"epsilon must be positive, got {epsilon}; "
            "about 1e-5 of the scale of the state is a good choice"
        )
    displacements = np.diag(steps)
    differences = []
    for i, (displacement, step) in enumerate(zip(displacements, steps, strict=True)):
        up, down = _outputs(simulate, x0 + displacement), _outputs(simulate, x0 - displacement)
        difference = _difference(up, down, angles, state=i)
        if (suspects := _far_apart(difference, up, down)).any():
            half = displacement / 2
            inner = _outputs(simulate, x0 + half), _outputs(simulate, x0 - half)
            nearer = _difference(*inner, angles, state=i)
            _refuse_jump(difference, nearer, suspects, state=i)
        differences.append(difference / (2 * step))
    J = np.stack(differences, axis=-1)
    samples, outputs, n = J.shape[-3:]
    weights = np.sqrt(quadrature_weights(samples, horizon, rule))[:, None, None]
    whitened = weights * (whitening_matrix(R, outputs) @ J)
    F = whitened.reshape(*J.shape[:-3], samples * outputs, n)
    return np.swapaxes(F, -1, -2) @ F


def _difference(
    up: np.ndarray, down: np.ndarray, angles: Sequence[int], *, state: int
) -> np.ndarray:
    """Return up - down, of declared angles the short way round."""
    difference = up - down
    outputs = difference.shape[-1]
    for angle in angles:
        if angle not in range(outputs):
            raise ValueError(
                f"angles must be numbers of outputs, 0 to {outputs - 1}, got {list(angles)}"
            )
        turned = np.remainder(difference[..., angle] + np.pi, 2 * np.pi) - np.pi
        if (furthest := np.abs(turned).max(initial=0.0)) > np.pi / 2:
            raise ValueError(
                f"output {angle}, declared an angle, moves by {furthest:.6g} rad where state "
                f"{state} is moved; return it in radians, or take a smaller epsilon"
            )
        difference[..., angle] = turned
    return difference


def _far_apart(difference: np.ndarray, up: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Where outputs differ by more than half of the greatest value of their kind."""
    greatest = np.maximum(np.abs(up), np.abs(down)).max(axis=-2, keepdims=True)
    return np.abs(difference) > 0.5 * greatest


def _refuse_jump(
    difference: np.ndarray, nearer: np.ndarray, suspects: np.ndarray, *, state: int
) -> None:
    """Refuse a difference that is not halved with the displacement, but for a whole turn."""
    excess = np.abs(difference - 2 * nearer)
    turns = np.isclose(excess[..., None], WHOLE_TURNS, rtol=NEAR, atol=0.0).any(axis=-1)
    jumps = suspects & turns
    if jumps.any():
        place = tuple(np.argwhere(jumps)[0])
        raise ValueError(
            f"output {place[-1]} jumps by {excess[place]:.6g} where state {state} is moved, as an "
            "angle does that wraps; return it unwrapped, or its sine and cosine"
        )


def _outputs(simulate: Callable[[Any], Any], x0: np.ndarray) -> np.ndarray:
    """Simulate once, and take the outputs out of CasADi if need be."""
    y = np.asarray(simulate(x0), dtype=float)
    if y.ndim < 2:
        raise ValueError(
            f"simulate must return outputs of shape (samples, outputs), got {y.shape}; "
            "one output is a column y[:, None]"
        )
    return y
