"""The metrics of 2 x 2 and 3 x 3 Gramians as CasADi expressions, elementwise over matrices of entries.

A Gramian is given by the entries of its upper triangle row by row, (w11, w12, w22) or (w11, w12, w13, w22, w23, w33). Each entry may be a
scalar or a matrix holding that entry for many Gramians at once: SX, MX or DM.

W is factored as L D Lᵀ. The largest eigenvalues of W and of W⁻¹ = L⁻ᵀ D⁻¹ L⁻¹ come from the trigonometric solution of the characteristic
cubic; λmin is one over the latter, so nothing cancels. Two nearly equal eigenvalues cost that formula half of its digits: the relative
error is 1e-8 plus that of W itself, n·eps·κ.
"""

from typing import Any

import casadi as ca

from .metrics import BLEND_WEIGHT, EPS, check_blend_weight, check_metric

Expression = Any  # SX, MX or DM
Entries = tuple[Any, ...]


def score_expression(
    name: str, entries: Entries, *, blend_weight: float = BLEND_WEIGHT
) -> Expression:
    """Return the metric called ``name`` for a minimiser, as ``metrics.score`` does: lower is better, inf where W is singular or not finite.

    The rule for singular is the same. A pivot that is rounding needs no test of its own: λmin is no larger.
    Raises ValueError for an unknown name, or unless there are 3 or 6 entries.
    """
    check_metric(name)
    check_blend_weight(blend_weight)
    if len(entries) not in (3, 6):
        raise ValueError(f"give the 3 or 6 entries of the upper triangle of W, got {len(entries)}")
    entries = tuple(ca.densify(w) for w in entries)
    n, regular, pivots, inverse = (
        (2, *_invert2(*entries)) if len(entries) == 3 else (3, *_invert3(*entries))
    )
    largest = _largest_eigenvalue(entries)
    smallest = 1.0 / _largest_eigenvalue(inverse)
    regular = ca.logic_and(regular, smallest > n * EPS * largest)
    value = {
        "condition-number": lambda: largest / smallest,
        "unobservability-index": lambda: 1.0 / smallest,
        "smallest-eigenvalue": lambda: -smallest,
        "log-det": lambda: -sum(ca.log(pivot) for pivot in pivots),
        "trace-inverse": lambda: inverse[0] + inverse[-1] + (inverse[3] if n == 3 else 0.0),
        "blend": lambda: ca.log(largest) - (1.0 + blend_weight) * ca.log(smallest),
    }[name]()
    return ca.if_else(regular, value, ca.inf)


def position_schur_expression(entries: Entries) -> Entries:
    """Return the three entries of the Schur complement of the first two of three states, as ``metrics.position_schur_complement`` does.

    What cancellation leaves of zero, at most 3·eps of the entry it came from, is made exactly singular.
    """
    w11, w12, w13, w22, w23, w33 = (ca.densify(w) for w in entries)
    seen = w33 > 0
    pivot = ca.if_else(seen, w33, 1.0)  # where the nuisance is not seen at all, w13 = w23 = 0
    s11, s12, s22 = w11 - w13 * w13 / pivot, w12 - w13 * w23 / pivot, w22 - w23 * w23 / pivot
    first = s11 > 3 * EPS * w11
    s11, s12 = ca.if_else(first, s11, 0.0), ca.if_else(first, s12, 0.0)
    shadow = s12 * s12 / ca.if_else(first, s11, 1.0)
    return s11, s12, ca.if_else(s22 - shadow > 3 * EPS * w22, s22, shadow)


def _invert2(w11, w12, w22) -> tuple[Any, Entries, Entries]:
    """Return where every pivot is positive, the pivots, and the entries of W⁻¹; a pivot that is not counts as 1."""
    regular, d1 = _pivot(w11)
    l21 = w12 / d1
    regular2, d2 = _pivot(w22 - l21 * w12)
    return (
        ca.logic_and(regular, regular2),
        (d1, d2),
        (1.0 / d1 + l21 * l21 / d2, -l21 / d2, 1.0 / d2),
    )


def _invert3(w11, w12, w13, w22, w23, w33) -> tuple[Any, Entries, Entries]:
    """Return what ``_invert2`` does, for three states; (a, -l32, 1) is the last row of L⁻¹."""
    regular1, d1 = _pivot(w11)
    l21, l31 = w12 / d1, w13 / d1
    regular2, d2 = _pivot(w22 - l21 * w12)
    s23 = w23 - l21 * w13
    l32 = s23 / d2
    regular3, d3 = _pivot(w33 - l31 * w13 - l32 * s23)
    a = l21 * l32 - l31
    inverse = (
        1.0 / d1 + l21 * l21 / d2 + a * a / d3,
        -l21 / d2 - a * l32 / d3,
        a / d3,
        1.0 / d2 + l32 * l32 / d3,
        -l32 / d3,
        1.0 / d3,
    )
    return ca.logic_and(ca.logic_and(regular1, regular2), regular3), (d1, d2, d3), inverse


def _pivot(pivot):
    """Return whether the pivot is positive (not where it is nan), and a pivot safe to divide by."""
    positive = pivot > 0
    return positive, ca.if_else(positive, pivot, 1.0)


def _largest_eigenvalue(entries):
    """Return the largest eigenvalue of a symmetric 2 x 2 or 3 x 3 matrix in closed form (Smith 1961, CACM 4(4):168)."""
    if len(entries) == 3:
        w11, w12, w22 = entries
        return 0.5 * (w11 + w22) + ca.hypot(0.5 * (w11 - w22), w12)
    w11, w12, w13, w22, w23, w33 = entries
    mean = (w11 + w22 + w33) / 3.0
    a, b, c = w11 - mean, w22 - mean, w33 - mean
    radius = ca.sqrt((a * a + b * b + c * c + 2.0 * (w12 * w12 + w13 * w13 + w23 * w23)) / 6.0)
    unit = ca.if_else(radius > 0, radius, 1.0)  # radius 0: a multiple of the identity
    a, b, c, d, e, f = a / unit, b / unit, c / unit, w12 / unit, w13 / unit, w23 / unit
    half_det = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    return mean + 2.0 * radius * ca.cos(ca.acos(ca.fmin(ca.fmax(half_det, -1.0), 1.0)) / 3.0)
