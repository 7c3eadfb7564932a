"""Information from ranges: Fisher information and Cramér-Rao bounds.

Time runs over samples k = 0 … steps. ``F[k]`` and ``Q[k]`` carry the state from sample k to k+1;
``J[k]`` is the information, in inverse units of the state squared, of what is measured on arriving
there (zero matrices where nothing is). Covariances have steps + 1 samples.
"""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from .metrics import EPS
from .model.casadi import of_each, symbol
from .model.covariance import propagate, symmetric
from .model.ranging import NUMBERS, Form, Ranging, arrival, law
from .model.recursion import Recursion
from .model.worth import per_square


def range_information(
    beacon: Float[np.ndarray, "*#batch d"],
    target: Float[np.ndarray, "*#batch d"],
    sigma: float | Float[np.ndarray, "..."],
) -> Float[np.ndarray, "... d d"]:
    r"""Return the Fisher information of each range about the target's position.

    It is of rank one, along the line of sight.

    .. math:: J = u u^\top / \sigma^2, \quad
              u = (p_\mathrm{beacon} - p_\mathrm{target}) / \lVert \cdot \rVert

    Positions [m] of d = 2 coordinates for horizontal ranges, 3 for slant ranges (the leading 2 x 2
    block is then what a target of known depth learns). ``sigma`` [m] is one number or one per
    range. A range between coincident points has no direction: zero information. Raises ValueError
    unless sigma is positive.
    """
    separation, squared = _separation(beacon, target)
    divisor = np.where(squared > 0, squared, 1.0) * positive(sigma) ** 2
    return _outer(separation) / divisor[..., None, None]


def squared_range_information(
    beacon: Float[np.ndarray, "*#batch d"],
    target: Float[np.ndarray, "*#batch d"],
    sigma: float | Float[np.ndarray, "..."],
) -> Float[np.ndarray, "... d d"]:
    r"""Return the Fisher information of each squared range (thesis 4.1).

    .. math:: J = 4 x x^\top / \sigma^2, \quad x = p_\mathrm{beacon} - p_\mathrm{target}

    ``sigma`` [m²] is of the squared range. It is worth a range of standard deviation σ / (2 d): the
    more the farther, nothing at d = 0. Raises ValueError unless sigma is positive.
    """
    separation, squared = _separation(beacon, target)
    variance = np.broadcast_to(positive(sigma) ** 2, squared.shape)
    return 4.0 * _outer(separation) / variance[..., None, None]


def ranging_information(
    x: Float[np.ndarray, "*#batch 2"],
    ranging: Ranging,
    height: float | Float[np.ndarray, "*#batch"] = 0.0,
    *,
    with_depth: bool = False,
    expected: bool = False,
) -> Float[np.ndarray, "*batch n n"]:
    r"""Return the Fisher information of each range under the law of a ranging.

    .. math:: J = \frac{\nabla z \nabla z^\top}{\sigma^2}
              + 2 \frac{\nabla \sigma \nabla \sigma^\top}{\sigma^2}

    (Kay 1993, eq. 3.31): what the range z tells of the target's position, and what the growth of
    its deviation tells. Where both vehicles move while the sound travels, it is as if they were at
    rest, and off by their speed over that of sound.

    Parameters
    ----------
    x
        Horizontal position of the beacon less the target's [m].
    height
        Depth of the target's transducer less the beacon's [m]; it counts where ranges are slant.
    with_depth
        Whether the target's depth, positive downwards, is a state beside east and north. Otherwise
        it is known.
    expected
        Times the probability that the range arrives, as for a forecast.

    Returns
    -------
    Of east and north [1/m²], or of east, north and depth; zero where there is no direction.
    """
    function = _ranging_information(ranging.form, with_depth, expected)
    return of_each(function, x, np.asarray(height, dtype=float), np.array(ranging.numbers))[0]


def posterior_cramer_rao(
    P0: Float[np.ndarray, "*#batch n n"],
    F: Float[np.ndarray, "*#batch steps n n"],
    Q: Float[np.ndarray, "*#any n n"],
    J: Float[np.ndarray, "*#batch _steps n n"],
) -> Float[np.ndarray, "... samples n n"]:
    r"""Return the posterior Cramér-Rao bound on the covariance at every sample, P0 first.

    .. math:: P_{k+1} = (M^{-1} + J_k)^{-1}, \quad M = F_k P_k F_k^\top + Q_k

    Tichavský, Muravchik & Nehorai (1998) with Jacobians along one trajectory: along the true one it
    bounds every unbiased estimator; along a predicted one it is the extended Kalman filter's own
    covariance prediction.

    No inverse of P is taken: J is factored and its factors enter one at a time, so P0 and Q may be
    singular, or zero. Leading axes (AUVs, candidate paths) are broadcast; Q is one matrix or one
    per step. P0, Q and J must be symmetric positive semidefinite. Raises ValueError unless F and J
    have as many steps.
    """
    n, steps = F.shape[-1], F.shape[-3]
    if J.shape[-3] != steps:
        raise ValueError(
            f"F and J must have as many steps, got {steps} and {J.shape[-3]}; "
            "give J zero matrices where nothing is measured"
        )
    Q = Q[..., None, :, :] if Q.ndim == 2 else Q
    batch = np.broadcast_shapes(P0.shape[:-2], F.shape[:-3], Q.shape[:-3], J.shape[:-3])
    P = np.empty((*batch, steps + 1, n, n))
    P[..., 0, :, :] = P0
    if steps == 0:
        return P
    F, Q, J = (np.broadcast_to(a, (*batch, steps, n, n)) for a in (F, Q, J))
    sweep = _riccati_sweep(n)
    for i in np.ndindex(*batch):
        sweep(P[i], F[i], Q[i], J[i])
    return P


def path_information(
    F: Float[np.ndarray, "*#batch steps n n"], J: Float[np.ndarray, "*#batch steps n n"]
) -> Float[np.ndarray, "... n n"]:
    r"""Return the Fisher information of a path about the initial state, without process noise.

    .. math:: \sum_k \Phi_{k+1}^\top J_k \Phi_{k+1}, \quad \Phi_{k+1} = F_k \cdots F_0

    It is the discrete observability Gramian weighted by the noise (thesis 2.4). Summed backwards,
    by the same sweep as the covariances.
    """
    # Backwards, Phi' J Phi sums like a covariance that each step moves by F' and then widens.
    Ft, backward_J = np.swapaxes(F, -1, -2)[..., ::-1, :, :], J[..., ::-1, :, :]
    gained = Ft @ backward_J @ np.swapaxes(Ft, -1, -2)
    nothing = np.zeros_like(gained)
    sums = posterior_cramer_rao(nothing[..., 0, :, :], Ft, gained, nothing)
    return sums[..., -1, :, :]


def position_rms(P: Float[np.ndarray, "*batch samples n n"]) -> Float[np.ndarray, "*batch"]:
    """Return the root mean square over time of the position error, states one and two [m]."""
    return np.asarray(np.sqrt(np.mean(P[..., 0, 0] + P[..., 1, 1], axis=-1)))


@cache
def _ranging_information(form: Form, with_depth: bool, expected: bool) -> ca.Function:
    """Make (x, height, law) -> information."""
    x, height, numbers = symbol("x", 2), symbol("height"), symbol("law", NUMBERS)
    up = height if form.slant else 0.0
    r2 = ca.sumsqr(x) + up**2
    ranging = law(form, numbers)
    told = per_square(ranging, r2)
    if expected:
        told *= arrival(ranging, r2)
    rho = ca.vertcat(-x, up) if with_depth else x  # deeper is farther from a beacon above
    J = ca.densify(told * rho @ rho.T)
    return ca.Function("ranging_information", [x, height, numbers], [J])


@cache
def _riccati_sweep(n: int) -> Recursion:
    """Make (P, F, Q, J) -> P of the next sample.

    F is given transposed, the memory of row-major arrays.
    """
    P, Ft, Q, J = (symbol(name, n, n) for name in ("P", "Ft", "Q", "J"))
    after = _update(propagate(P, Ft.T, Q), J)
    return Recursion(ca.Function("riccati", [P, Ft, Q, J], [after]))


def _update(P: ca.SX, J: ca.SX) -> ca.SX:
    """Add the information J to the covariance P.

    One factor of J = Σ c cᵀ / d (Cholesky, null pivots skipped) after the other.
    """
    n, rest = P.shape[0], J
    for i in range(n):
        pivot = rest[i, i]
        positive = pivot > n * EPS * J[i, i]  # below, it is rounding and so is its column
        d = ca.if_else(positive, pivot, 1.0)
        column = ca.vertcat(ca.SX(i, 1), rest[i:, i])
        c = ca.if_else(positive, 1.0, 0.0) * column
        rest = rest - c @ c.T / d
        Pc = P @ c
        P = symmetric(P - Pc @ Pc.T / (d + c.T @ Pc))
    return P


def _separation(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a − b and its squared length."""
    separation = np.asarray(a, dtype=float) - b
    return separation, np.sum(separation**2, axis=-1)


def _outer(x: np.ndarray) -> np.ndarray:
    return x[..., :, None] * x[..., None, :]


def positive(sigma: float | np.ndarray) -> np.ndarray:
    """Return standard deviations, once they are known to be positive."""
    sigma = np.asarray(sigma, dtype=float)
    wrong = sigma[~(sigma > 0)]
    if wrong.size:
        raise ValueError(
            f"sigma must be positive, got {wrong.flat[0]}; "
            "for no measurement give zero information instead"
        )
    return sigma
