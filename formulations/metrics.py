"""How observable a Gramian is, in one number: metrics of arrays and of CasADi expressions.

All are of W itself, symmetric positive semidefinite, not of its square root (thesis 2.1.3; Krener &
Ide 2009). One rule decides what is singular, for every metric: the smallest eigenvalue is at most
n·eps times the largest, eps = 2.2e-16, below which it is rounding. No eigenvalue is ever dropped
from a ratio, so an unobservable system cannot score well. A matrix holding a nan or an infinity
counts as singular: the worst value.

Arrays are batched over leading axes, and only the lower triangle of W is read. Expressions are of 2
x 2 and 3 x 3 Gramians, given by the entries of the upper triangle row by row, (w11, w12, w22) or
(w11, w12, w13, w22, w23, w33). Each entry may be a scalar or a matrix holding that entry for many
Gramians at once: SX, MX or DM. There W is factored as L D Lᵀ. The largest eigenvalues of W and of
W⁻¹ = L⁻ᵀ D⁻¹ L⁻¹ come from the trigonometric solution of the characteristic cubic; λmin is one over
the latter, so nothing cancels. Two nearly equal eigenvalues cost that formula half of its digits:
the relative error is 1e-8 plus that of W itself, n·eps·κ.
"""

from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

EPS = float(np.finfo(float).eps)  # spacing of doubles at 1
BLEND_WEIGHT = 1.0  # of log(unobservability index) beside log(condition number)

Expression = Any  # SX, MX or DM
Entries = tuple[Any, ...]


def condition_number(W: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch"]:
    """Return the estimation condition number λmax/λmin, at least 1; inf where singular.

    It depends on the units of the states. Relative error about eps·κ: take singular values of a
    square-root factor of W beyond 1e8.
    """
    eigenvalues, singular = _spectrum(W)
    return np.where(singular, np.inf, eigenvalues[..., -1] / eigenvalues[..., 0])


def unobservability_index(W: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch"]:
    """Return 1/λmin, the worst amplification of measurement energy into state error.

    It is inf where W is singular.
    """
    eigenvalues, singular = _spectrum(W)
    with np.errstate(over="ignore"):
        return np.where(singular, np.inf, 1.0 / eigenvalues[..., 0])


def smallest_eigenvalue(W: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch"]:
    """Return λmin; 0 where singular."""
    eigenvalues, singular = _spectrum(W)
    return np.where(singular, 0.0, eigenvalues[..., 0])


def log_det(W: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch"]:
    """Return log det W; -inf where singular."""
    eigenvalues, singular = _spectrum(W)
    return np.where(singular, -np.inf, np.log(eigenvalues).sum(axis=-1))


def trace_inverse(W: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch"]:
    """Return tr W⁻¹, the sum of error variances when W is an information matrix.

    It is inf where W is singular.
    """
    eigenvalues, singular = _spectrum(W)
    with np.errstate(over="ignore"):
        return np.where(singular, np.inf, (1.0 / eigenvalues).sum(axis=-1))


def blend(
    W: Float[np.ndarray, "*batch n n"], weight: float = BLEND_WEIGHT
) -> Float[np.ndarray, "*batch"]:
    """Return log(condition number) + weight · log(unobservability index); inf where singular.

    Raises ValueError if the weight is negative.
    """
    check_blend_weight(weight)
    eigenvalues, singular = _spectrum(W)
    return np.where(
        singular,
        np.inf,
        np.log(eigenvalues[..., -1]) - (1.0 + weight) * np.log(eigenvalues[..., 0]),
    )


class Metric(NamedTuple):
    """A metric and its sense."""

    function: Callable[..., np.ndarray]
    larger_is_worse: bool


# each metric by its name in files: the function of a Gramian, and whether larger is worse
METRICS = MappingProxyType(
    {
        "condition-number": Metric(condition_number, larger_is_worse=True),
        "unobservability-index": Metric(unobservability_index, larger_is_worse=True),
        "smallest-eigenvalue": Metric(smallest_eigenvalue, larger_is_worse=False),
        "log-det": Metric(log_det, larger_is_worse=False),
        "trace-inverse": Metric(trace_inverse, larger_is_worse=True),
        "blend": Metric(blend, larger_is_worse=True),
    }
)


def score(
    name: str, W: Float[np.ndarray, "*batch n n"], *, blend_weight: float = BLEND_WEIGHT
) -> Float[np.ndarray, "*batch"]:
    """Return the metric called ``name`` for a minimiser.

    Lower is better, and inf where W is singular, whatever the metric.

    Metrics of which more is better (smallest eigenvalue, log det) change sign. Raises ValueError
    for an unknown name.
    """
    check_metric(name)
    if name == "blend":
        return blend(W, blend_weight)
    values = METRICS[name].function(W)
    if METRICS[name].larger_is_worse:
        return values
    return np.where(_spectrum(W)[1], np.inf, -values)


def check_metric(name: str) -> None:
    """Raise ValueError unless ``name`` is a key of METRICS."""
    if name not in METRICS:
        raise ValueError(f"metric {name!r} is not known; choose one of {', '.join(METRICS)}")


def check_blend_weight(weight: float) -> None:
    """Raise ValueError unless the weight is finite and not negative."""
    if not 0.0 <= weight < np.inf:
        raise ValueError(f"blend weight must be finite and at least 0, got {weight}")


def relative_motion_index(
    x: tuple[Any, Any], v: tuple[Any, Any], time_scale: float = 1.0
) -> Expression:
    r"""Return how observable a relative position is at one instant, from 0 to 1, the best.

    .. math:: \frac{\sigma_{\min}(O)}{\sigma_{\max}(O)} = \frac{2 |c|}{a + b +
              \sqrt{(a - b)^2 + 4 g^2}}, \quad O = \begin{bmatrix} x^\top \\ \tau v^\top
              \end{bmatrix}

    with a = ‖x‖², b = τ²‖v‖², c = τ (x1 v2 - x2 v1), g = τ x·v. The rows of O are the gradients of
    half the squared range and of its rate, the velocity being measured. It is 0 where the vehicles
    move along the line between them, and 1 where they move across it and ‖x‖ = τ‖v‖; nan where
    both are 0.

    It is the inverse condition number of the observability matrix, in the plane, after Arrichiello,
    Antonelli, Aguiar and Pascoal, "Observability metric for the relative localization of AUVs based
    on range and depth measurements: theory and experiments" (IROS 2011), by its description in the
    thesis its reference [14]. Their index, too, falls with the range and with the angle between
    relative velocity and position.

    Parameters
    ----------
    x, v
        Relative position [m] and velocity [m/s], two components each: numbers, arrays of one shape,
        or expressions.
    time_scale
        τ [s], in which the velocity counts as a length; the paper has none, which is 1 s.
    """
    (x1, x2), (v1, v2) = x, v
    a = x1 * x1 + x2 * x2
    b = time_scale**2 * (v1 * v1 + v2 * v2)
    across = time_scale * (x1 * v2 - x2 * v1)
    along = time_scale * (x1 * v1 + x2 * v2)
    spread = ((a - b) ** 2 + 4.0 * along**2) ** 0.5
    return 2.0 * abs(across) / (a + b + spread)


def unobservable_direction(W: Float[np.ndarray, "n n"], names: Sequence[str]) -> dict[str, float]:
    """Name the direction that the outputs see least.

    It is the unit eigenvector of λmin as {state name: component}.

    Its largest component is positive. Where λmin is repeated, it is one direction of that
    eigenspace. Raises ValueError if W is not finite, or if there is not exactly one name per state.
    """
    if len(names) != len(W):
        raise ValueError(
            f"give one name per state: W has {len(W)} states, got {len(names)} names {list(names)}"
        )
    if not np.isfinite(W).all():
        raise ValueError(f"W must be finite to name a direction, got {W.tolist()}")
    weakest = np.linalg.eigh(W)[1][:, 0]
    weakest = weakest * np.sign(weakest[np.argmax(np.abs(weakest))])
    return dict(zip(names, weakest.tolist(), strict=True))


def position_schur_complement(
    W: Float[np.ndarray, "*batch n n"], keep: int = 2
) -> Float[np.ndarray, "*batch keep keep"]:
    r"""Return the Gramian of the first ``keep`` states with the others as unknown nuisance.

    .. math:: W = \begin{bmatrix} A & B \\ B^\top & D \end{bmatrix}, \quad S = A - B D^{+} B^\top

    For an information matrix, S⁻¹ is the position block of W⁻¹. D may be singular: B has no part in
    its null space when W is positive semidefinite. D is scaled to unit diagonal first, so that
    units cannot make a weak state look like rounding, and its eigenvalues are raised to n·eps
    rather than dropped. Eigenvalues of S below n·eps·λmax(A) are what cancellation leaves of zero,
    and are set to zero. A matrix that is not finite gives zero: no information. Raises ValueError
    unless 1 ≤ keep ≤ n.
    """
    n = W.shape[-1]
    if not 1 <= keep <= n:
        raise ValueError(f"keep must be between 1 and the {n} states of W, got {keep}")
    W = _finite_or_zero(W)
    A, B, D = W[..., :keep, :keep], W[..., :keep, keep:], W[..., keep:, keep:]
    scale = np.sqrt(np.maximum(np.diagonal(D, axis1=-2, axis2=-1), 0.0))
    inverse_scale = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    scaled_D = D * inverse_scale[..., :, None] * inverse_scale[..., None, :]
    scaled_B = B * inverse_scale[..., None, :]
    eigenvalues, vectors = np.linalg.eigh(scaled_D)
    raised = np.maximum(eigenvalues, n * EPS)
    coupling = scaled_B @ vectors / np.sqrt(raised)[..., None, :]
    kept, axes = np.linalg.eigh(A - coupling @ np.swapaxes(coupling, -1, -2))
    kept = np.where(kept > n * EPS * np.linalg.eigvalsh(A)[..., -1:], kept, 0.0)
    return (axes * kept[..., None, :]) @ np.swapaxes(axes, -1, -2)


def _spectrum(
    W: Float[np.ndarray, "*batch n n"],
) -> tuple[Float[np.ndarray, "*batch n"], Bool[np.ndarray, "*batch"]]:
    """Return the ascending eigenvalues (ones where singular) and where W is singular."""
    eigenvalues = np.linalg.eigvalsh(_finite_or_zero(W))
    regular = eigenvalues[..., 0] > W.shape[-1] * EPS * eigenvalues[..., -1]
    return np.where(regular[..., None], eigenvalues, 1.0), np.asarray(~regular)


def _finite_or_zero(W: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch n n"]:
    """Replace every matrix that holds a nan or an infinity by zero, which is singular."""
    finite = np.isfinite(W).all(axis=(-2, -1), keepdims=True)
    return np.where(finite, W, 0.0)


def score_expression(
    name: str, entries: Entries, *, blend_weight: float = BLEND_WEIGHT
) -> Expression:
    """Return the metric called ``name`` for a minimiser, as ``score`` does.

    Lower is better, and inf where W is singular or not finite.

    The rule for singular is the same. A pivot that is rounding needs no test of its own: λmin is no
    larger. Raises ValueError for an unknown name, or unless there are 3 or 6 entries.
    """
    check_metric(name)
    check_blend_weight(blend_weight)
    if len(entries) not in (3, 6):
        raise ValueError(f"give the 3 or 6 entries of the upper triangle of W, got {len(entries)}")
    entries = tuple(ca.densify(w) for w in entries)
    n = 2 if len(entries) == 3 else 3
    regular, pivots, inverse = _invert2(*entries) if n == 2 else _invert3(*entries)
    largest = _largest_eigenvalue(entries)
    smallest = 1.0 / _largest_eigenvalue(inverse)
    regular = ca.logic_and(regular, smallest > n * EPS * largest)
    match name:
        case "condition-number":
            value = largest / smallest
        case "unobservability-index":
            value = 1.0 / smallest
        case "smallest-eigenvalue":
            value = -smallest
        case "log-det":
            value = -sum(ca.log(pivot) for pivot in pivots)
        case "trace-inverse":
            value = inverse[0] + inverse[-1] + (inverse[3] if n == 3 else 0.0)
        case _:  # blend
            value = ca.log(largest) - (1.0 + blend_weight) * ca.log(smallest)
    return ca.if_else(regular, value, ca.inf)


def position_schur_expression(entries: Entries) -> Entries:
    """Return the Schur complement of the first two of three states by its three entries.

    `position_schur_complement` does the same for arrays.

    What cancellation leaves of zero, at most 3·eps of the entry it came from, is made exactly
    singular.
    """
    w11, w12, w13, w22, w23, w33 = (ca.densify(w) for w in entries)
    seen = w33 > 0
    pivot = ca.if_else(seen, w33, 1.0)  # where the nuisance is not seen at all, w13 = w23 = 0
    s11 = w11 - w13 * w13 / pivot
    s12 = w12 - w13 * w23 / pivot
    s22 = w22 - w23 * w23 / pivot
    first = s11 > 3 * EPS * w11
    s11 = ca.if_else(first, s11, 0.0)
    s12 = ca.if_else(first, s12, 0.0)
    shadow = s12 * s12 / ca.if_else(first, s11, 1.0)
    second = s22 - shadow > 3 * EPS * w22
    return s11, s12, ca.if_else(second, s22, shadow)


def _invert2(w11, w12, w22) -> tuple[Any, Entries, Entries]:
    """Return where every pivot is positive, the pivots, and the entries of W⁻¹.

    A pivot that is not counts as 1.
    """
    regular, d1 = _pivot(w11)
    l21 = w12 / d1
    regular2, d2 = _pivot(w22 - l21 * w12)
    inverse = 1.0 / d1 + l21 * l21 / d2, -l21 / d2, 1.0 / d2
    return ca.logic_and(regular, regular2), (d1, d2), inverse


def _invert3(w11, w12, w13, w22, w23, w33) -> tuple[Any, Entries, Entries]:
    """Return what ``_invert2`` does, for three states; (a, -l32, 1) is the last row of L⁻¹."""
    regular1, d1 = _pivot(w11)
    l21, l31 = w12 / d1, w13 / d1
    regular2, d2 = _pivot(w22 - l21 * w12)
    s23 = w23 - l21 * w13
    l32 = s23 / d2
    regular3, d3 = _pivot(w33 - l31 * w13 - l32 * s23)
    a = l21 * l32 - l31
    v11 = 1.0 / d1 + l21 * l21 / d2 + a * a / d3
    v12 = -l21 / d2 - a * l32 / d3
    v22 = 1.0 / d2 + l32 * l32 / d3
    inverse = v11, v12, a / d3, v22, -l32 / d3, 1.0 / d3
    regular = ca.logic_and(ca.logic_and(regular1, regular2), regular3)
    return regular, (d1, d2, d3), inverse


def _pivot(pivot):
    """Return whether the pivot is positive (not where it is nan), and a pivot safe to divide by."""
    positive = pivot > 0
    return positive, ca.if_else(positive, pivot, 1.0)


def _largest_eigenvalue(entries):
    """Return the largest eigenvalue of a symmetric 2 x 2 or 3 x 3 matrix in closed form."""
    return _largest_of_2(*entries) if len(entries) == 3 else _largest_of_3(*entries)


def _largest_of_2(w11, w12, w22):
    return 0.5 * (w11 + w22) + ca.hypot(0.5 * (w11 - w22), w12)


def _largest_of_3(w11, w12, w13, w22, w23, w33):
    r"""Return the largest eigenvalue as mean + 2 radius cos(θ/3) (Smith 1961, CACM 4(4):168).

    The matrix is mean·I + radius·B with tr B = 0 and tr B² = 6, and cos θ = det B / 2.
    """
    mean = (w11 + w22 + w33) / 3.0
    a, b, c = w11 - mean, w22 - mean, w33 - mean
    diagonal = a * a + b * b + c * c
    off_diagonal = w12 * w12 + w13 * w13 + w23 * w23
    radius = ca.sqrt((diagonal + 2.0 * off_diagonal) / 6.0)
    unit = ca.if_else(radius > 0, radius, 1.0)  # radius 0: a multiple of the identity
    a, b, c = a / unit, b / unit, c / unit
    d, e, f = w12 / unit, w13 / unit, w23 / unit
    det = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    cosine = ca.fmin(ca.fmax(0.5 * det, -1.0), 1.0)
    return mean + 2.0 * radius * ca.cos(ca.acos(cosine) / 3.0)
