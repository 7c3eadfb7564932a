"""Hypotheses of one AUV between ranges: the unlikely are dropped, those of one place are merged."""

from itertools import combinations

import numpy as np
from jaxtyping import Float

from formulations.model.covariance import pack_array, unpack_array
from obsplan.estimators.filtering import GONE
from obsplan.types import Hypothesis

NEGLIGIBLE = 1e-6  # least share that is kept
SAME = 0.05  # two are merged that lose so little by it, by Runnalls's bound [nats per share]
COUNTED = 0.01  # least share of a position that fits
FEW = 4  # with room for so many a step takes less time than with room for all
APART = 9.0  # squared Mahalanobis distance from which on two positions are two
FARTHEST = 1e9  # of such distances: all beyond are alike


def tidied(bank: Float[np.ndarray, " rows"], states: int) -> tuple[np.ndarray, list[Hypothesis]]:
    """A bank with its living hypotheses first, and these; the others are marked as gone.

    Two are merged to one of the same mean and covariance where Runnalls's bound (2007) on what is
    lost allows it, of their positions.
    """
    kept = merged([one for one in hypotheses(bank, states) if one.share > NEGLIGIBLE])
    greatest = max(one.share for one in kept)
    rows = [_row(one, float(np.log(one.share / greatest))) for one in kept]
    rows += [_row(kept[0], GONE)] * (_room(bank, states) - len(kept))
    return np.concatenate([bank[:1], *rows]), kept


def room_for(living: int, room: int) -> int:
    """Room for the living hypotheses, of the sizes that filters are made in, not above ``room``."""
    return min(next(size for size in (1, FEW, room) if size >= min(living, room)), room)


def hypotheses(bank: Float[np.ndarray, " rows"], states: int) -> list[Hypothesis]:
    """All that a bank has room for, with their shares."""
    rows = bank[1:].reshape(_room(bank, states), -1).copy()  # the bank may be written on
    weights = np.exp(rows[:, -1] - rows[:, -1].max())
    shares = (weights / weights.sum()).tolist()
    covariances = unpack_array(rows[:, states:-1])
    return [Hypothesis(*one) for one in zip(shares, rows[:, :states], covariances, strict=True)]


def merged(known: list[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses of which those at one place are one."""
    found = list(known)
    while len(found) > 1:
        pairs = [*combinations(range(len(found)), 2)]
        losses = [_loss(found[i], found[j]) for i, j in pairs]
        least = int(np.argmin(losses))
        if losses[least] > SAME:
            break
        i, j = pairs[least]
        found[i] = _together(found[i], found[j])
        del found[j]
    return found


def places(known: list[Hypothesis]) -> int:
    """How many positions fit: hypotheses that overlap are of one."""
    likely = [one for one in known if one.share > COUNTED]
    group = list(range(len(likely)))
    for i, j in combinations(range(len(likely)), 2):
        if _apart(likely[i], likely[j]) < APART:
            group = [group[i] if one == group[j] else one for one in group]
    return len(set(group))


def _room(bank: np.ndarray, states: int) -> int:
    """For how many hypotheses a bank has room."""
    each = states + states * (states + 1) // 2 + 1
    return (bank.size - 1) // each


def _row(one: Hypothesis, weight: float) -> np.ndarray:
    """A hypothesis as a bank holds it."""
    return np.concatenate([one.mean, pack_array(one.covariance), [weight]])


def _together(one: Hypothesis, other: Hypothesis) -> Hypothesis:
    """Both as one Gaussian of the same mean and covariance."""
    share = one.share + other.share
    first, second = one.share / share, other.share / share
    apart = one.mean - other.mean
    spread = first * second * apart[:, None] * apart
    covariance = first * one.covariance + second * other.covariance + spread
    return Hypothesis(share, first * one.mean + second * other.mean, covariance)


def _loss(one: Hypothesis, other: Hypothesis) -> float:
    """What merging them loses at most, of their positions, per share [nats]."""
    both = _together(one, other)
    before = one.share * _log_area(one) + other.share * _log_area(other)
    return (_log_area(both) - before / both.share) / 2


def _log_area(one: Hypothesis) -> float:
    """Logarithm of the determinant of the position's covariance."""
    P = one.covariance
    return float(np.log(max(P[0, 0] * P[1, 1] - P[0, 1] ** 2, 1e-300)))


def _apart(one: Hypothesis, other: Hypothesis) -> float:
    """Squared distance of their positions in standard deviations of both."""
    S = one.covariance + other.covariance
    east, north = (one.mean - other.mean)[:2]
    determinant = max(S[0, 0] * S[1, 1] - S[0, 1] ** 2, 1e-300)
    weighed = S[1, 1] * east**2
    weighed -= 2 * S[0, 1] * east * north
    weighed += S[0, 0] * north**2
    if weighed >= determinant * FARTHEST:
        return FARTHEST
    return float(weighed / determinant)
