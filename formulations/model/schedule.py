"""When ranges come, and what a horizon is cut into.

Times that are multiples of an interval but for rounding are multiples.
"""

from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

ROUNDING = 1e-6  # of an interval: a time this near to a multiple of it is the multiple


class Stages(NamedTuple):
    """The horizon cut into stages, ranges coming at the end of each."""

    duration: Float[np.ndarray, " S"]  # [s]
    pings: Float[np.ndarray, " S"]  # number of ranges to each AUV


def time_to_next(time: Any, interval: float) -> Any:
    """Time [s] until the next multiple of an interval [s]; at a multiple, until the one after it.

    Of a number, or of an expression.
    """
    since = ca.fmod(time, interval)
    return interval - since * (since <= (1 - ROUNDING) * interval)


def intervals(time: Any, interval: float) -> Any:
    """How many whole intervals [s] there are in a time, or in times [s]."""
    return np.floor(np.asarray(time) / interval + ROUNDING)


def is_multiple(time: float, interval: float) -> bool:
    """Whether a time [s] is a whole number of intervals [s], at least one."""
    ratio = time / interval
    return bool(0.5 < ratio < np.inf and abs(ratio - round(ratio)) < ROUNDING)


def ping_stages(time: float, interval: float, horizon: float, count: int) -> Stages:
    """Cut a horizon [s] into stages that end at pings.

    Pings come every ``interval`` [s], counted from time 0.

    Pings farther apart than horizon / count make a stage each, the first one shorter; closer ones
    are counted together.
    """
    length = horizon / count
    if interval <= length:
        return Stages(np.full(count, length), np.full(count, length / interval))
    duration = np.full(count, interval)
    duration[0] = time_to_next(time, interval)
    return Stages(duration, np.ones(count))
