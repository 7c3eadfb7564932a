r"""What AUVs know of themselves: covariances predicted between ranges, and conditioned on ranges.

State of an AUV: (east, north [m], heading [rad], speed through the water [m/s]). Over a stage of h
seconds at heading ψ and speed V

.. math:: P \leftarrow F P F^\top + Q h + (A Q + Q A^\top) \tfrac{h^2}{2}
          + A Q A^\top \tfrac{h^3}{3}, \quad F = I + A h,

A having the columns (-V sin ψ, V cos ψ) and (cos ψ, sin ψ) of the heading and the speed; A² = 0
makes it exact. The heading's own variance stays as it is: the compass makes up for its random walk.
At the stage's end n ranges of variance σ² bring, along the line of sight u with v normal to it and
d the distance,

.. math:: P \leftarrow (P^{-1} + u u^\top / R)^{-1}, \quad
          R = \sigma^2 / n + \tfrac{3}{4} (v^\top P v / d)^2.

The second term is the mean square of the range's second-order error, which the filter neglects and
which repeated ranges share; it keeps the aid vehicle away from an AUV that is closer than it is
sure of. (Jazwinski 1970, section 9.3: second-order filters.) A squared range's is
:math:`(\operatorname{tr} P)^2 + 2 \operatorname{tr} P^2`, that of the squared length of a Gaussian
vector. σ may grow with distance, ranges may be lost (`formulations.model.ranging`).

A slant range over a height h, r² = d² + h², tells of the position along ρ/r, ρ = (x, -h) with the
depth's place among the states where it is one, and x/r where the depth is known. With the Hessian
:math:`B = (1 - \rho \rho^\top / r^2) / r` the second term is
:math:`\tfrac{1}{4} ((\operatorname{tr} BP)^2 + 2 \operatorname{tr} (BP)^2)`.
"""

import math
from functools import cache, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float, Int

from .casadi import SX, of_each, symbol
from .ranging import NUMBERS, Form, Law, Ranging, expected_ranges, law, variance

# Unit of length; nearer ranges count as from there: from on top of an AUV they tell nothing.
NEAREST = 1e-6


DEPTH = 4  # index in the state, where the depth is one


class Tracks(NamedTuple):
    """Where M AUVs are expected at the end of each stage, and how they move during it."""

    position: Float[np.ndarray, "S M 2"]  # [m]
    heading: Float[np.ndarray, "S M"]  # [rad]
    speed: Float[np.ndarray, "S M"]  # through the water [m/s]
    # from each AUV's transducer up to the aid vehicle's [m]; counts where ranges are slant
    height: Float[np.ndarray, "S M"] | float = 0.0


def symmetric(P: SX) -> SX:
    """P with its upper triangle copied from the lower.

    Rounding cannot make it lopsided, and half the work is saved.
    """
    return ca.tril2symm(ca.tril(ca.densify(P)))


@lru_cache(maxsize=8)
def triangle(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the lower triangle by columns, which is how covariances are packed."""
    columns, rows = np.triu_indices(n)  # the upper triangle by rows
    return rows, columns


def pack(P: SX) -> SX:
    """Lower triangle by columns."""
    rows, columns = triangle(P.shape[0])
    return ca.vec(P)[(rows + P.shape[0] * columns).tolist()]


def unpack(packed: SX, n: int = 4) -> SX:
    """Symmetric matrix of its lower triangle by columns."""
    return ca.tril2symm(ca.SX(ca.Sparsity.lower(n), packed))


def pack_array(P: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch half"]:
    """Lower triangles by columns."""
    n = P.shape[-1]
    return P.reshape(*P.shape[:-2], n * n).take(_lower(n), axis=-1)


def unpack_array(packed: Float[np.ndarray, "*batch half"]) -> Float[np.ndarray, "*batch n n"]:
    """Symmetric matrices of their lower triangles by columns."""
    return packed.take(_whole(packed.shape[-1]), axis=-1)


@lru_cache(maxsize=8)
def _lower(n: int) -> Int[np.ndarray, " half"]:
    """Where in a matrix, row by row, its packed entries are."""
    rows, columns = triangle(n)
    return n * rows + columns


@lru_cache(maxsize=8)
def _whole(half: int) -> Int[np.ndarray, "n n"]:
    """Where among packed entries each of a symmetric matrix's is."""
    n = (math.isqrt(8 * half + 1) - 1) // 2
    rows, columns = triangle(n)
    place = np.empty((n, n), dtype=int)
    place[rows, columns] = place[columns, rows] = np.arange(half)
    return place


def propagate(P: SX, F: SX, Q: SX) -> SX:
    """Covariance of F x + w, w of covariance Q."""
    return symmetric(F @ P @ F.T + Q)


def predict(P: SX, motion: SX, noise: SX, duration: SX) -> SX:
    """Covariance after a stage without ranges.

    ``motion``: cosine and sine of the heading, speed; ``noise``: standard deviations per square
    root of a second, the heading's without effect. A fifth state is the depth.
    """
    cos, sin, speed = ca.vertsplit(motion)
    n = P.shape[0]
    A = ca.SX(n, n)
    A[0, 2] = -speed * sin
    A[1, 2] = speed * cos
    A[0, 3] = cos
    A[1, 3] = sin
    walks = noise**2
    walks[2] = 0
    Q = ca.diag(walks)
    h = duration
    first_order = A @ Q + Q @ A.T
    second_order = A @ Q @ A.T
    grown = Q * h + first_order * (h**2 / 2) + second_order * (h**3 / 3)
    return propagate(P, ca.SX.eye(n) + A * h, grown)


def condition_on_range(
    P: SX, x: SX, *, law: Law, pings: SX, height: SX | float = 0.0, doubt: SX | float = 0.0
) -> SX:
    """Covariance after a number of ranges, or none, from the relative position x; see the module.

    P may hold the whole state or, for what becomes of the position alone, its first two components.
    ``height`` is that of the other vehicle's transducer above the AUV's; P with a depth is 5 x 5,
    or 3 x 3 (east, north, depth). ``doubt`` is a standard deviation [m] of each coordinate by which
    the AUV may be elsewhere besides: the second order counts it, though no range will lessen it.
    """
    if law.form.slant:
        return _condition_on_slant_range(P, x, law, pings, height, doubt)
    d2 = ca.fmax(ca.sumsqr(x), NEAREST**2)
    over = 1 / d2
    Px = P[:, :2] @ x
    along = ca.dot(x, Px[:2]) * over
    trace = P[0, 0] + P[1, 1]
    unknown = doubt**2
    error = variance(law, d2)
    if law.form.squared:
        spread = P[:2, :2] + unknown * ca.SX.eye(2)
        second = 0.25 * over * ((trace + 2 * unknown) ** 2 + 2 * ca.sumsqr(spread))
        error *= 0.25 * over
    else:
        across = trace - along + unknown
        second = 0.75 * over * across**2
    some, count = expected_ranges(law, d2, pings)
    gain = count / ((error + count * (second + along)) * d2)
    gain = some * gain if law.form.lossy else gain
    return P - gain * Px @ Px.T


def _condition_on_slant_range(
    P: SX, x: SX, law: Law, pings: SX, height: SX | float, doubt: SX | float
) -> SX:
    """The same over a height.

    Raises
    ------
    ValueError
        Of squared ranges, which are horizontal.
    """
    if law.form.squared:
        raise ValueError("squared ranges are horizontal: leave slant False, or give ranges")
    places = [0, 1]
    rho = x
    if P.shape[0] in (3, DEPTH + 1):
        places = [0, 1, P.shape[0] - 1]
        rho = ca.vertcat(x, -height)  # depths count downwards
    r2 = ca.fmax(ca.sumsqr(x) + height**2, NEAREST**2)
    Prho = P[:, places] @ rho
    along = ca.dot(rho, Prho[places]) / r2
    spread = P[places, places]
    spread[:2, :2] += doubt**2 * ca.SX.eye(2)
    bent = (ca.SX.eye(len(places)) - rho @ rho.T / r2) @ spread
    second = 0.25 * (ca.trace(bent) ** 2 + 2 * ca.trace(bent @ bent)) / r2
    some, count = expected_ranges(law, r2, pings)
    gain = count / ((variance(law, r2) + count * (second + along)) * r2)
    return P - some * gain * Prho @ Prho.T


def informed(P: SX, root: SX) -> SX:
    """Covariance once more is known of the position: the information L Lᵀ [1/m^2].

    ``root`` holds L's lower triangle by columns.
    """
    for column in (ca.vertcat(root[0], root[1]), ca.vertcat(0, root[2])):
        Pc = P[:, :2] @ column
        P = P - Pc @ Pc.T / (1 + ca.dot(column, Pc[:2]))
    return P


def predicted(
    P: Float[np.ndarray, "*#batch n n"],
    motion: Float[np.ndarray, "*#batch 3"],
    noise: Float[np.ndarray, "*#batch n"],
    duration: float,
) -> Float[np.ndarray, "*batch n n"]:
    """`predict` of arrays."""
    return of_each(_predict(P.shape[-1]), P, motion, noise, np.asarray(duration))[0]


def conditioned(
    P: Float[np.ndarray, "*#batch n n"],
    x: Float[np.ndarray, "*#batch 2"],
    ranging: Ranging,
    pings: float | Float[np.ndarray, "*#batch"],
    height: float | Float[np.ndarray, "*#batch"] = 0.0,
    doubt: float | Float[np.ndarray, "*#batch"] = 0.0,
) -> Float[np.ndarray, "*batch n n"]:
    """`condition_on_range` of arrays."""
    function = _condition_on_range(ranging.form, P.shape[-1])
    numbers, given = np.array(ranging.numbers), (pings, height, doubt)
    return of_each(function, P, x, numbers, *(np.asarray(a) for a in given))[0]


def motions(
    heading: Float[np.ndarray, "*batch"], speed: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 3"]:
    """Headings [rad] and speeds as `predict` takes them."""
    motion = np.empty((*heading.shape, 3))
    np.cos(heading, out=motion[..., 0])
    np.sin(heading, out=motion[..., 1])
    motion[..., 2] = speed
    return motion


@cache
def _predict(n: int) -> ca.Function:
    P, motion = symbol("P", n, n), symbol("c", 3)
    noise, duration = symbol("q", n), symbol("h")
    after = predict(P, motion, noise, duration)
    return ca.Function("predict", [P, motion, noise, duration], [after])


@cache
def _condition_on_range(form: Form, n: int) -> ca.Function:
    P, x, numbers = symbol("P", n, n), symbol("x", 2), symbol("law", NUMBERS)
    pings, height, doubt = symbol("pings"), symbol("height"), symbol("doubt")
    after = condition_on_range(
        P, x, law=law(form, numbers), pings=pings, height=height, doubt=doubt
    )
    return ca.Function("condition", [P, x, numbers, pings, height, doubt], [after])
