"""Whether a filter's errors are as large as it says: the NEES test for one run.

Errors within a run depend on each other: a run is worth fewer independent ones than it has samples.
"""

import numpy as np
from jaxtyping import Float, Integer
from scipy.special import gammaincinv

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


def mean_nees_interval(samples: float, *, position: int = 2) -> tuple[float, float]:
    r"""Return the interval that holds the mean of N independent NEES with probability 0.95.

    N times the mean is chi-square with d N degrees if the filter is consistent (Bar-Shalom, Li &
    Kirubarajan 2001, 5.4); N, here ``samples``, need not be whole.
    """
    tail = (1.0 - CONFIDENCE) / 2
    # quantiles of the chi-square distribution with position * samples degrees of freedom
    low, high = 2 * gammaincinv(position * samples / 2, [tail, 1.0 - tail]) / samples
    return float(low), float(high)
