"""How samples are weighed, in time and by their noise.

It is the same for every Gramian, so that Gramians compare entry by entry.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..model.quadrature import MIDDLE

RULES = ("left", "trapezoid", "simpson", "sum")


def quadrature_weights(samples: int, horizon: float, rule: str) -> Float[np.ndarray, " samples"]:
    """Weigh samples so that their weighted sum is the integral over the horizon.

    They are equally spaced on [0, horizon], both ends included.

    ``left``: first order, the last sample unused. ``trapezoid``: second order. ``simpson``: fourth
    order; an odd number of intervals ends in the 3/8 rule, so any number from two up will do.
    ``sum``: no integral, each sample counts once (measurements at instants). Raises ValueError for
    an unknown rule, a horizon that is not positive and finite, or fewer samples than the rule
    needs.
    """
    least = {"left": 2, "trapezoid": 2, "simpson": 3, "sum": 1}.get(rule)
    if least is None:
        raise ValueError(f"rule must be one of {', '.join(RULES)}, got {rule!r}")
    if samples < least:
        raise ValueError(
            f"rule {rule!r} needs at least {least} samples, got {samples}; "
            "take more steps or another rule"
        )
    if not (horizon > 0 and math.isfinite(horizon)):
        raise ValueError(f"horizon must be positive and finite [s], got {horizon}")
    weights = np.ones(samples)
    if rule == "sum":
        return weights
    if rule == "left":
        weights[-1] = 0.0
    elif rule == "trapezoid":
        weights[[0, -1]] = 0.5
    else:
        weights = _simpson(samples - 1)
    return weights * (horizon / (samples - 1))


def _simpson(intervals: int) -> Float[np.ndarray, " samples"]:
    """Simpson's 1/3 rule at unit spacing.

    An odd number of intervals ends in his 3/8 rule, of the same order.
    """
    weights = np.zeros(intervals + 1)
    even = intervals - 3 * (intervals % 2)
    for first in range(0, even, 2):
        weights[first : first + 3] += 2 * MIDDLE
    if intervals % 2:
        weights[even:] += np.array([1, 3, 3, 1]) * (3 / 8)
    return weights


def whitening_matrix(
    R: Float[np.ndarray, "y y"] | Sequence[Any] | None, outputs: int
) -> Float[np.ndarray, "{outputs} {outputs}"]:
    """Return S with S'S = R^(-1), the inverse of R's lower Cholesky factor; the identity without R.

    Raises ValueError unless R is a finite, symmetric, positive definite matrix of the outputs.
    """
    if R is None:
        return np.eye(outputs)
    R = np.asarray(R, dtype=float)
    if R.shape != (outputs, outputs):
        raise ValueError(
            f"R must be {outputs} x {outputs}, one row per output, got shape {R.shape}"
        )
    if not (np.isfinite(R).all() and np.allclose(R, R.T, rtol=1e-12, atol=0)):
        raise ValueError(f"R must be finite and symmetric, got {R.tolist()}; a covariance is")
    try:
        return np.linalg.inv(np.linalg.cholesky(R))
    except np.linalg.LinAlgError:
        raise ValueError(
            f"R must be positive definite, got {R.tolist()}; "
            "leave out an output rather than give it no noise"
        ) from None
