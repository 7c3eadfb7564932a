"""When several positions fitted an AUV's ranges, and when one was left, in words."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight")
MOST = 6  # changes that are told one by one, the last among them


def announcements(
    names: Sequence[str],
    time: Float[np.ndarray, " samples"],
    fitting: Float[np.ndarray, "auvs samples"],
) -> tuple[str, ...]:
    """Say of each AUV that several positions fitted at a time since when, and until when.

    The truth has no part in it. Times are since the beginning, in hours, minutes and seconds.
    """
    told = []
    for name, counts in zip(names, fitting, strict=True):
        changed = np.flatnonzero(np.diff(counts, prepend=1.0))
        if not changed.size:
            continue
        parts = [_change(int(counts[k]), clock(float(time[k]))) for k in changed]
        if changed.size > MOST:
            between = changed.size - MOST
            word = "more change" if between == 1 else "more changes"
            parts[MOST - 1 : -1] = [f"{between} {word}"]
        if counts[-1] > 1:
            parts.append(f"{_number(int(counts[-1]))} are left at the end")
        told.append(f"{name}: {'; '.join(parts)}.")
    return tuple(told)


def _change(count: int, when: str) -> str:
    if count > 1:
        return f"{_number(count)} positions fit since {when}"
    return f"{_number(count)} left at {when}"


def _number(count: int) -> str:
    return WORDS[count] if count < len(WORDS) else str(count)


def clock(seconds: float) -> str:
    """A time as 00:03:10; parts of a second are dropped."""
    minutes, left = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02}:{minutes:02}:{left:02}"
