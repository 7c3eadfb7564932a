r"""The Gramian of a unicycle that ranges to AUVs, in closed form.

All candidate turn rates and all AUVs come out of one evaluation.

The state is (x1, x2, ψ), the aid vehicle's position less the AUV's and its heading; the outputs are
y = (ψ, x1² + x2²). At a constant turn rate u and speed V, with Δ the aid vehicle's displacement, v
the AUV's constant velocity and p(t) = x + Δ(t) - v t,

.. math:: W = \int_0^T J^\top R^{-1} J\,dt, \quad
          J = \begin{bmatrix} 0 & 0 & 1 \\
          2 p_1 & 2 p_2 & 2 (p_2 \Delta_1 - p_1 \Delta_2) \end{bmatrix}

(thesis 4.3, whose Φ is [1 0 -Δ2; 0 1 Δ1; 0 0 1]). The entries of W are polynomials of degree 2 in x
and v. In the body frame, whose first axis is the heading at t = 0, their coefficients depend on V,
u and T alone: the displacement moments. The polynomials are written with plain operators and serve
numpy and CasADi alike.

Variants: ``exact``; ``thesis``, whose heading perturbation leaves the range unchanged (4.6), so
that W13 = W23 = 0; ``degrees``, exact with the heading in degrees, as state and as output, which is
D W D with D = diag(1, 1, π/180) and the heading's own information, 1 in either unit: the coupling
of heading into position shrinks by 57, nearly to what (4.6) prints. Each is scaled to information
by the variances R of the two outputs: of white noise in continuous time, a sample's variance times
the sampling interval. A range, not squared, has
this Jacobian over 2‖p(t)‖, which is no polynomial: freeze the distance d and take the variance 4 d²
σ².
"""

from functools import cache, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..metrics import BLEND_WEIGHT, position_schur_expression, score_expression
from ..model.casadi import matrix
from ..model.frames import to_body, turn_matrix

VARIANTS = ("exact", "thesis", "degrees")
DEGREE = np.pi / 180.0  # [rad]
# of the heading [rad²·s; ``degrees``: degree²·s], of the squared range [m⁴·s]
UNIT_VARIANCES = (1.0, 1.0)
SERIES_LIMIT = 2.0  # |uT| below which moments are summed as series: either way keeps about 1e-15
SERIES_TERMS = 40  # the last is of the size (2·SERIES_LIMIT)^40 / 40! = 1.5e-24

Array = Any  # numpy array, or CasADi SX, MX or DM
Moments = Float[np.ndarray, "3 K"] | list[Any]  # rows, or columns that are expressions


class DisplacementMoments(NamedTuple):
    """Integrals over the horizon of t^k times 1, Δ1, Δ2, Δ1², Δ1Δ2, Δ2² in the body frame.

    The first axis is k = 0, 1, 2; units are m^a·s^(k+1).

    The first of each alone serves an AUV at rest. Moments that are expressions come as three
    columns each (`formulations.gramian.pings`).
    """

    one: Moments
    d1: Moments
    d2: Moments
    d11: Moments
    d12: Moments
    d22: Moments


def displacement_moments(
    speed: float, turn_rates: Float[np.ndarray, " K"], horizon: float
) -> DisplacementMoments:
    r"""Integrate the displacement of exact arcs, Δ = V (sin ut, 1 - cos ut) / u, over the horizon.

    With z = uT and s = t/T, Δ = VT (sin zs, 1 - cos zs) / z, whose powers are sums of sin and cos
    of zs and 2zs: closed form by E_k(z) = ∫ s^k exp(izs) ds, or a Taylor series in z below
    ``SERIES_LIMIT``, where the closed form would lose digits as eps/z⁴.

    Speed in m/s, turn rates in rad/s, horizon in s. Raises ValueError if one is not finite, the
    speed negative or the horizon not positive.
    """
    if not 0.0 <= speed < np.inf:
        raise ValueError(f"speed must be finite and at least 0 [m/s], got {speed}")
    if not 0.0 < horizon < np.inf:
        raise ValueError(f"horizon must be finite and positive [s], got {horizon}")
    if not np.isfinite(turn_rates).all():
        raise ValueError(f"turn rates must be finite [rad/s], got {turn_rates.tolist()}")
    z = turn_rates * horizon
    short = np.abs(z) < SERIES_LIMIT
    unit = np.where(
        short,
        _moments_by_series(np.where(short, z, 0.0)),
        _moments_by_parts(np.where(short, SERIES_LIMIT, z)),
    )
    order = np.arange(1.0, 4.0)[:, None]
    time = horizon**order
    one = np.repeat(time / order, len(z), axis=1)
    reach = speed * horizon
    lengths = np.array([reach, reach, reach**2, reach**2, reach**2])
    return DisplacementMoments(one, *(unit * (lengths[:, None, None] * time)))


def _moments_by_parts(z: Float[np.ndarray, " K"]) -> Float[np.ndarray, "5 3 K"]:
    """Return the moments of a unit displacement, by integration by parts.

    E_k = (exp(iz) - k E_{k-1}) / (iz).
    """

    def integrate(z: Float[np.ndarray, " K"]) -> np.ndarray:
        turned = np.exp(1j * z)
        e0 = (turned - 1.0) / (1j * z)
        e1 = (turned - e0) / (1j * z)
        return np.stack([e0, e1, (turned - 2.0 * e1) / (1j * z)])

    single, double = integrate(z), integrate(2.0 * z)
    cos1, sin1 = np.real(single), np.imag(single)
    cos2, sin2 = np.real(double), np.imag(double)
    one = 1.0 / np.arange(1.0, 4.0)[:, None]
    sin_sin = (one - cos2) / 2
    sin_versine = sin1 - sin2 / 2
    versine_versine = 1.5 * one - 2 * cos1 + cos2 / 2
    first = np.stack([sin1, one - cos1]) / z
    second = np.stack([sin_sin, sin_versine, versine_versine]) / z**2
    return np.concatenate([first, second])


def _moments_by_series(z: Float[np.ndarray, " K"]) -> Float[np.ndarray, "5 3 K"]:
    """Return the moments of a unit displacement from its Taylor series in z."""
    return _series_coefficients() @ z ** np.arange(SERIES_TERMS)[:, None]


@cache
def _series_coefficients() -> Float[np.ndarray, "5 3 N"]:
    """Integrate sin θ, 1 - cos θ and their products term by term.

    θ = zs; all are times s^k, and over z, the products over z².
    """
    n = np.arange(SERIES_TERMS + 2)
    sign, even, doubled = (-1.0) ** (n // 2), n % 2 == 0, 2.0 ** (n - 1.0)
    sin = np.where(even, 0.0, sign)
    versine = np.where(even & (n >= 2), -sign, 0.0)  # 1 - cos θ
    sin_sin = np.where(even & (n >= 2), -sign * doubled, 0.0)  # (1 - cos 2θ) / 2
    sin_versine = np.where(even, 0.0, sign * (1.0 - doubled))  # sin θ - sin 2θ / 2
    # 3/2 - 2 cos θ + cos 2θ / 2
    versine_versine = np.where(even & (n >= 4), sign * (doubled - 2.0), 0.0)
    taylor = np.stack([sin, versine, sin_sin, sin_versine, versine_versine])
    factorial = np.cumprod(np.maximum(n, 1), dtype=float)
    integrated = taylor[:, None, :] / factorial / (n + np.arange(1, 4)[:, None])
    return np.concatenate([integrated[:2, :, 1:-1], integrated[2:, :, 2:]])


def gramian_entries(
    moments: DisplacementMoments,
    x: tuple[Array, Array],
    v: tuple[Array, Array] | None = None,
    *,
    variant: str = "exact",
    variances: tuple[float, float] = UNIT_VARIANCES,
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return W11, W12, W13, W22, W23, W33 in the body frame, each K x M.

    They are of M relative positions x and AUV velocities v.

    x and v are pairs of 1 x M rows in the body frame, numpy or CasADi; None is an AUV at rest.
    Variants and variances: see the module. Raises ValueError for another variant, or a variance
    that is not positive.
    """
    _check_model(variant, variances)
    one, d1, d2, d11, d12, d22 = (
        [m[:, None] if isinstance(m, np.ndarray) else m for m in moment] for moment in moments
    )
    x1, x2 = x
    # coefficients of 1, t and t² of x - vt and its products; of 1 alone at rest
    first, second = [x1], [x2]
    q11, q12, q22 = [x1 * x1], [x1 * x2], [x2 * x2]
    if v is not None:
        v1, v2 = v
        first += [-v1]
        second += [-v2]
        q11 += [-2.0 * x1 * v1, v1 * v1]
        q12 += [-x1 * v2 - x2 * v1, v1 * v2]
        q22 += [-2.0 * x2 * v2, v2 * v2]
    heading, output = variances
    gain = 4.0 / output
    w11 = gain * (_dot(one, q11) + 2.0 * _dot(d1, first) + d11[0])
    w12 = gain * (_dot(one, q12) + _dot(d1, second) + _dot(d2, first) + d12[0])
    w22 = gain * (_dot(one, q22) + 2.0 * _dot(d2, second) + d22[0])
    seen = one[0] / heading  # of the heading, by its own measurement
    if variant == "thesis":
        return w11, w12, 0.0 * w11, w22, 0.0 * w11, seen + 0.0 * w11
    w13 = gain * (_dot(d1, q12) - _dot(d2, q11) + _dot(d11, second) - _dot(d12, first))
    w23 = gain * (_dot(d1, q22) - _dot(d2, q12) + _dot(d12, second) - _dot(d22, first))
    w33 = gain * (_dot(d11, q22) - 2.0 * _dot(d12, q12) + _dot(d22, q11))
    if variant == "degrees":
        w13, w23, w33 = DEGREE * w13, DEGREE * w23, DEGREE**2 * w33
    return w11, w12, w13, w22, w23, w33 + seen


def _dot(moments: list[Array], coefficients: list[Array]) -> Array:
    """Sum moment k, a column over candidates, times coefficient k, a row over AUVs."""
    pairs = zip(moments, coefficients, strict=False)  # fewer coefficients: an AUV at rest
    return sum(moment @ coefficient for moment, coefficient in pairs)


def _check_model(variant: str, variances: tuple[float, float]) -> None:
    if variant not in VARIANTS:
        raise ValueError(f"variant {variant!r} is not known; choose one of {', '.join(VARIANTS)}")
    if not all(0.0 < variance < np.inf for variance in variances):
        raise ValueError(
            f"variances of heading and squared range must be finite and positive, got {variances}"
        )


def range_gramians(
    positions: Float[np.ndarray, "M 2"],
    heading: float,
    *,
    turn_rates: Float[np.ndarray, " K"],
    speed: float,
    horizon: float,
    velocities: Float[np.ndarray, "M 2"] | None = None,
    variant: str = "exact",
    variances: tuple[float, float] = UNIT_VARIANCES,
) -> Float[np.ndarray, "K M 3 3"]:
    """Return the Gramian of every candidate turn rate and every AUV, in east and north.

    The state is (x1, x2, ψ) [m, m, rad; variant ``degrees``: m, m, degree].

    Parameters
    ----------
    positions
        Of the aid vehicle relative to each AUV, now [m].
    heading
        Of the aid vehicle, now [rad].
    turn_rates, speed, horizon
        Candidates [rad/s], the aid vehicle's speed [m/s] and how long it holds either [s].
    velocities
        Of the AUVs, constant [m/s]; None: at rest.
    variant, variances
        As for ``gramian_entries``.
    """
    body = partial(to_body, np.cos(heading), np.sin(heading))
    moments = displacement_moments(speed, turn_rates, horizon)
    v = None if velocities is None else body(velocities.T[:1], velocities.T[1:])
    x = body(positions.T[:1], positions.T[1:])
    w11, w12, w13, w22, w23, w33 = gramian_entries(
        moments, x, v, variant=variant, variances=variances
    )
    rows = (w11, w12, w13), (w12, w22, w23), (w13, w23, w33)
    W = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    turn = np.eye(3)
    turn[:2, :2] = turn_matrix(heading).T
    W = turn @ W @ turn.T
    return 0.5 * (W + np.swapaxes(W, -1, -2))


def range_score_expression(
    pose: Array,
    positions: Array,
    velocities: Array | None = None,
    *,
    moments: DisplacementMoments,
    metric: str = "condition-number",
    variant: str = "exact",
    variances: tuple[float, float] = UNIT_VARIANCES,
    heading_is_nuisance: bool = False,
    blend_weight: float = BLEND_WEIGHT,
) -> Array:
    """Return the K x M scores of every candidate for every AUV as a CasADi expression.

    Lower is better.

    The pose is the aid vehicle's (x, y, ψ); positions and velocities are the AUVs', M x 2, east and
    north. Each may be SX, MX or DM. Metrics do not change under rotation, so W stays in the body
    frame. ``heading_is_nuisance`` scores the Schur complement of the position.
    """
    body = partial(to_body, ca.cos(pose[2]), ca.sin(pose[2]))
    x = body(pose[0] - positions[:, 0].T, pose[1] - positions[:, 1].T)
    v = None if velocities is None else body(velocities[:, 0].T, velocities[:, 1].T)
    entries = gramian_entries(moments, x, v, variant=variant, variances=variances)
    if heading_is_nuisance:
        entries = position_schur_expression(entries)
    return score_expression(metric, entries, blend_weight=blend_weight)


def range_gramian_function(n_auvs: int, *, moving: bool = False, **options) -> ca.Function:
    """Compile ``range_score_expression`` for a number of AUVs.

    (pose: 3, positions: M x 2[, velocities: M x 2]) -> scores: K x M

    Options are those of ``range_score_expression``. Read it through ``buffer()``; matrices are
    stored by columns.
    """
    # Each of some 250 operations runs over the whole K x M matrix, two to four times as fast as
    # scalar by scalar.
    inputs = {"pose": matrix("pose", 3), "positions": matrix("positions", n_auvs, 2)}
    if moving:
        inputs["velocities"] = matrix("velocities", n_auvs, 2)
    scores = range_score_expression(*inputs.values(), **options)
    return ca.Function("range_gramian", [*inputs.values()], [ca.cse(scores)], [*inputs], ["scores"])
