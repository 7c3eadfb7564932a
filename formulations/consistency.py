"""Whether a filter's errors and innovations are as large as it says: NEES, NIS and runs of signs.

Errors within a run depend on each other: a run is worth fewer independent ones than it has samples.
A consistent filter's innovations are independent, and of either sign alike.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Integer

CONFIDENCE = 0.95  # of the interval
INSTANTS = 400  # of a run that are looked at: errors change little between them


def effective_samples(
    P: Float[np.ndarray, "samples n n"],
    F: Float[np.ndarray, "steps n n"],
    Q: Float[np.ndarray, "n n"],
    *,
    position: int = 2,
) -> float:
    r"""Return how many independent errors the mean NEES over a run is worth, if it is consistent.

    A consistent filter's covariances say how its errors depend on each other (Anderson & Moore
    1979, 5.3):

    .. math:: \mathrm{E}[e_t e_s^\top] = M_{t-1} \cdots M_s P_s, \quad
              M_k = P_{k+1} (F_k P_k F_k^\top + Q)^{-1} F_k

    With :math:`C_{ts}` that of two errors whitened by their own covariances, NEES of d coordinates
    have covariance :math:`2 \lVert C_{ts} \rVert_F^2`, so that their mean over N instants has the
    variance of a mean over

    .. math:: N_\mathrm{eff} = d N^2 / \sum_{t,s} \lVert C_{ts} \rVert_F^2

    independent ones. At most `INSTANTS` evenly spaced instants are looked at: of a run with more
    samples the number is rather too low.

    Parameters
    ----------
    P
        The filter's covariance at every sample; NEES are of its first ``position`` coordinates.
    F, Q
        Transition over each step, and covariance of the process noise over one.
    position
        Number d of coordinates of the NEES.

    Returns
    -------
    Number between 1 and `INSTANTS`; nan where a covariance of the position is singular.
    """
    stride = -(-P.shape[0] // INSTANTS)
    at = np.arange(0, P.shape[0], stride)
    blocks = P[at, :position, :position]
    if not np.isfinite(blocks).all() or (np.linalg.eigvalsh(blocks)[:, 0] <= 0).any():
        return float("nan")
    whiten = np.linalg.inv(np.linalg.cholesky(blocks))
    ahead = np.broadcast_to(np.eye(P.shape[-1]), (at.size - 1, *P.shape[1:]))
    for k in range(stride):
        ahead = _error_transitions(P, F, Q, at[:-1] + k) @ ahead
    dependence = float(position * at.size)  # of each error on itself
    joint = P[at]
    for lag in range(1, at.size):
        joint = ahead[lag - 1 :] @ joint[:-1]
        C = whiten[lag:] @ joint[:, :position, :position] @ np.swapaxes(whiten[:-lag], -1, -2)
        dependence += 2.0 * float(np.sum(C**2))
    return position * at.size**2 / dependence


def _error_transitions(
    P: Float[np.ndarray, "samples n n"],
    F: Float[np.ndarray, "steps n n"],
    Q: Float[np.ndarray, "n n"],
    k: Integer[np.ndarray, " chosen"],
) -> Float[np.ndarray, "chosen n n"]:
    """How errors become the next, over the steps k.

    That is M, with the pseudo-inverse where something is certain.
    """
    predicted = F[k] @ P[k] @ np.swapaxes(F[k], -1, -2) + Q
    return P[k + 1] @ np.linalg.pinv(predicted, hermitian=True) @ F[k]


def mean_interval(
    samples: float | int, *, degrees: int, probability: float = CONFIDENCE
) -> tuple[float, float]:
    r"""Return the interval that holds a consistent filter's mean NEES or NIS with a probability.

    N times the mean of N independent values is chi-square with d N degrees of freedom; both tails
    outside are equally probable (Bar-Shalom, Li & Kirubarajan 2001, 5.4.2).

    Parameters
    ----------
    samples
        Number N of independent values, which need not be whole (see `effective_samples`).
    degrees
        Number d of coordinates of each: 2 of a position, 1 of a range's innovation.
    probability
        Of the interval, between 0 and 1.

    Returns
    -------
    Both ends; nan where N is 0 or nan, so that no mean is found outside.

    Raises
    ------
    ValueError
        A negative number of values, no degrees, or a probability out of range.
    """
    if samples < 0 or degrees < 1 or not 0 < probability < 1:
        raise ValueError(
            "needs samples >= 0, degrees >= 1 and a probability between 0 and 1, "
            f"got {samples}, {degrees} and {probability}"
        )
    if not samples > 0:
        return float("nan"), float("nan")
    from scipy.special import gammaincinv  # takes as long to import as half a mission

    tail = (1.0 - probability) / 2
    # quantiles of the chi-square distribution
    low, high = 2 * gammaincinv(degrees * samples / 2, [tail, 1.0 - tail]) / samples
    return float(low), float(high)


class Runs(NamedTuple):
    """Runs of like signs in a series, and whether chance makes them so."""

    positive: int  # values
    negative: int
    runs: int
    z: float  # standard normal if the order is chance: below 0 for too few runs
    p: float  # probability of as odd a number of runs, or odder, in either direction


def runs_of_signs(values: Float[np.ndarray, " n"]) -> Runs:
    r"""Test whether the signs of innovations follow each other by chance.

    Of :math:`n_+` positive and :math:`n_-` negative values in random order the number of runs has
    (Wald & Wolfowitz 1940)

    .. math:: \mu = 1 + \frac{2 n_+ n_-}{n}, \quad
              \sigma^2 = \frac{2 n_+ n_- (2 n_+ n_- - n)}{n^2 (n - 1)},

    and is about normal from ten of each sign on. An error that lasts for a while makes runs long
    and few: z is negative. It is a test of whiteness, as is that of Bar-Shalom, Li & Kirubarajan
    (2001), 5.4.2, and needs no variance. A constant bias changes how many signs there are of each
    kind, not their order: the mean NIS tells it, this test does not.

    Values that are nan, where nothing was measured, or exactly 0 have no sign and are left out.
    Where every order has as many runs z is nan: of two different signs, where p is 1, and of signs
    that are all the same, where p is the probability :math:`2^{1-n}` that fair ones are. Without
    any sign both are nan.
    """
    known = np.asarray(values)[~np.isnan(values)]
    up = known[known != 0] > 0
    n = up.size
    positive = int(up.sum())
    negative = n - positive
    runs = int(np.count_nonzero(up[1:] != up[:-1])) + min(n, 1)
    pairs = 2.0 * positive * negative
    if pairs > n:
        from scipy.special import erfc

        variance = pairs * (pairs - n) / (n**2 * (n - 1.0))
        z = float((runs - 1 - pairs / n) / np.sqrt(variance))
        return Runs(positive, negative, runs, z, float(erfc(abs(z) / np.sqrt(2))))
    p = 1.0 if pairs else 2.0 ** (1 - n)
    return Runs(positive, negative, runs, float("nan"), p if n else float("nan"))
