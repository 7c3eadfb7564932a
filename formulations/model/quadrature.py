"""Weights of Simpson's rule."""

import numpy as np
from jaxtyping import Float, Integer


def simpson(
    before: Integer[np.ndarray, "*batch"], after: Integer[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 3"]:
    """Weights of the ends and the inner point of intervals, of sum one, that integrate parabolas.

    ``before`` and ``after`` are the lengths of the parts that the inner point cuts.

    Where nothing is before the inner point they are the trapezoid's.
    """
    a, b = np.maximum(before, 1), after
    first = (2 * a - b) / (6 * a)
    inner = (a + b) ** 2 / (6 * a * b)
    last = (2 * b - a) / (6 * b)
    parabola = np.stack([first, inner, last], axis=-1)
    return np.where((before > 0)[..., None], parabola, [0.5, 0.0, 0.5])


MIDDLE = simpson(np.array(1), np.array(1))  # of intervals cut in the middle: 1/6, 4/6, 1/6
