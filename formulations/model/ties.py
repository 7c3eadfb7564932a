"""When two numbers are the same but for rounding, so that rounding never decides between equals."""

import numpy as np
from jaxtyping import Float

# Relative to what the numbers are made of. Rounding is 1e-16 of that, some hundred times over, and
# no sensor tells a billionth.
TIE = 1e-9
DROPPED = 22  # bits of a double that `rounded` drops: what is left is 2^-30, about a `TIE`


def rounded(values: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """The nearest numbers of 30 bits, so that what differs by rounding is equal, and can be sorted.

    Two such numbers on both sides of a step stay apart; one tie in a hundred thousand is there.
    """
    half = np.int64(1 << (DROPPED - 1))
    with np.errstate(invalid="ignore"):
        bits = np.ascontiguousarray(values + 0.0).view(np.int64)  # of two zeros neither is less
    nearest = ((bits + half) & -(2 * half)).view(np.float64)
    return np.where(np.isfinite(values), nearest, values)
