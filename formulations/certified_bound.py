"""The certified information bound: what no path of the beacon can beat.

Time runs over samples as in `cramer_rao`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float, Int

from .cramer_rao import positive, posterior_cramer_rao
from .model.casadi import of_each, symbol
from .model.covariance import propagate
from .model.recursion import Recursion

RELATIVE_GAP = 0.005  # of the mean square: the bound's RMS is within 0.25 % of the best
MAX_ITERATIONS = 300
FINEST = 4096  # steps, up to which a search begins from nothing
CURVATURE_DECREASE = 0.9  # of the backtracking, as in Pedregosa et al. (2020)
CURVATURE_INCREASE = 2.0
ROUNDING = 1e-12  # of a value, relative: decreases below it cannot be told


Progress = Callable[[float], None]  # of the share done


@dataclass(frozen=True, slots=True, kw_only=True)
class InformationBound:
    """What no path of the beacon can beat, with its certificate.

    It is a bound and no `Solution`: its minimiser is an allocation that no path need reach, and
    what counts is the value less the gap. Mean squares [m²] are of the position error, over time.

    ``value`` is reached by the fractional directions ``allocation`` (one 2 x 2 matrix of trace one
    per ping); ``gap`` is its duality gap: the least mean square of any path lies above ``bound`` =
    value − gap. ``weights`` are those of the samples, with sum one.
    """

    value: float
    gap: float
    iterations: int
    allocation: Float[np.ndarray, "pings 2 2"]
    weights: Float[np.ndarray, " samples"]

    @property
    def bound(self) -> float:
        """Certified lower bound on the mean square position error [m²]."""
        return self.value - self.gap

    @property
    def bound_rms_m(self) -> float:
        """Certified lower bound on the root mean square position error [m]."""
        return float(np.sqrt(self.bound))

    def efficiency(self, P: Float[np.ndarray, "samples n n"]) -> float:
        """Return the bound over the RMS of a path's posterior Cramér-Rao covariances.

        It is in (0, 1], and 1 where no error is left.
        """
        achieved = float(np.sqrt(_mean_square(P, self.weights)))
        return self.bound_rms_m / achieved if achieved > 0 else 1.0


def information_bound(
    P0: Float[np.ndarray, "n n"],
    F: Float[np.ndarray, "steps n n"],
    Q: Float[np.ndarray, "*steps_or_none n n"],
    J_other: Float[np.ndarray, "steps n n"],
    *,
    pings: Int[np.ndarray, " pings"],
    sigma: float | Float[np.ndarray, " pings"],
    weights: Float[np.ndarray, " samples"] | None = None,
    relative_gap: float = RELATIVE_GAP,
    max_iterations: int = MAX_ITERATIONS,
    progress: Progress = lambda _share: None,
) -> InformationBound:
    r"""Bound one AUV's mean square position error from below, over every path of the beacon.

    The error is that of the posterior Cramér-Rao bound.

    .. math:: \min_{M} \sum_k w_k \operatorname{tr} [P_k]_{xy} \quad \text{over} \quad
              M_j \succeq 0, \; \operatorname{tr} M_j = 1, \\
              P = \text{posterior Cramér-Rao with }
              J_k = J^\mathrm{other}_k + M_j / \sigma_j^2 \text{ at ping } j

    A range gives u uᵀ/σ² with u a unit vector: one such M. Several at one step, from as many aid
    vehicles, together give one of their precisions' sum, and no other set of matrices:

    .. math:: \Bigl\{ \sum_i p_i M_i \Bigr\} = \Bigl\{ \sum_i p_i \; M \Bigr\},

    as a mean of such M weighted by p is one, and every one is the mean of itself. The information
    of the whole trajectory is linear in M, so the sum is convex, and value less duality gap bounds
    every path, whatever prior, dynamics and process noise: with f the sum, for any allocation M and
    every other one M',

    .. math:: f(M') \ge f(M) + \langle \nabla f(M), M' - M \rangle \ge f(M) - g(M), \quad
              g(M) = \max_{M''} \langle \nabla f(M), M - M'' \rangle .

    Solved by Frank-Wolfe (Jaggi 2013) with backtracking (Pedregosa et al. 2020); gradients by one
    adjoint sweep. Stopped at ``max_iterations`` the bound is looser, and as certain.

    The certificate asks nothing of where M comes from. So a long mission is first solved with two
    steps taken as one, that with four, and so on down to `FINEST` steps, and each time the coarser
    allocation is where the finer search begins: from there it takes an iteration or two in place
    of some fifty. Value and gap are of all steps and pings, whatever the start; from no coarser
    one it is M = I/2.

    Parameters
    ----------
    P0, F, Q
        As for ``posterior_cramer_rao``, states one and two being east and north [m]. F must not
        depend on the beacon's path: take Jacobians along the AUV's true trajectory.
    J_other
        Information of everything but ranges to the vehicles whose paths are open, per step: of a
        compass, of ranges to fixed beacons.
    pings
        Steps at whose end a range comes: ``J[pings]`` holds it. Several ranges repeat their step.
        Those that were lost are left out; the bound is then over the paths on which the same ones
        come.
    sigma
        Smallest standard deviation of a range that any path could reach [m], one or per ping:
        `formulations.model.worth.least_sigma`, whatever the law of the ranging. For squared ranges
        of standard deviation s [m²], worth more the farther, that is s / (2 d) at the largest
        distance d ever allowed.
    weights
        Of the samples in the mean over time; equal unless given. A mean square compared with the
        bound must be over the same samples.
    relative_gap
        Of the value, at which to stop.
    progress
        Called with the share done, from 0 to 1, at each iteration.

    Raises
    ------
    ValueError
        If pings lie outside the steps, sigma is not positive, weights are negative or all
        zero, or the model is not finite.
    """
    weights = _normalized(np.ones(len(F) + 1) if weights is None else weights, len(F) + 1)
    _check_pings(pings, len(F))
    if not (relative_gap > 0 and max_iterations >= 1):
        raise ValueError(
            "relative_gap must be positive and max_iterations at least 1, "
            f"got {relative_gap} and {max_iterations}"
        )
    precision = np.broadcast_to(1.0 / positive(sigma) ** 2, pings.shape)
    steps, of_step = np.unique(pings, return_inverse=True)
    together = np.bincount(of_step, precision, len(steps))
    problem = _Allocation(
        P0=P0, F=F, Q=Q, J_other=J_other, pings=steps, precision=together, weights=weights
    )
    found = _coarse_to_fine(problem, relative_gap, max_iterations, progress)
    return replace(found, allocation=found.allocation[of_step])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Allocation:
    """Mean square position error, a function of how each ping informs different directions."""

    P0: np.ndarray
    F: np.ndarray
    Q: np.ndarray
    J_other: np.ndarray
    pings: np.ndarray
    precision: np.ndarray  # 1 / σ² per ping
    weights: np.ndarray

    def evaluate(self, M: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Mean square of the allocation M, and the information and covariances behind it."""
        J = self.J_other.copy()
        J[self.pings, :2, :2] += self.precision[:, None, None] * M
        P = posterior_cramer_rao(self.P0, self.F, self.Q, J)
        return _mean_square(P, self.weights), J, P

    def gradient(self, J: np.ndarray, P: np.ndarray) -> np.ndarray:
        r"""Derivative with respect to M, by the adjoint sweep.

        .. math:: \Lambda_k = w_k E + A_k^\top \Lambda_{k+1} A_k, \quad
                  A_k = (I - P_{k+1} J_k) F_k, \quad
                  \partial / \partial J_k = -P_{k+1} \Lambda_{k+1} P_{k+1}

        E selects the position.
        """
        n = len(self.P0)
        backwards = np.empty_like(P)
        backwards[0] = self.weights[-1] * np.diag(np.arange(n) < 2)
        _adjoint_sweep(n)(backwards, P[:0:-1], J[::-1], self.F[::-1], self.weights[-2::-1])
        adjoint = backwards[::-1][self.pings + 1]
        return of_each(_by_information(n), P[self.pings + 1], adjoint, self.precision)[0]

    def halved(self) -> tuple["_Allocation", np.ndarray]:
        """Take two steps as one, and say which of its pings each ping becomes part of.

        What is measured at the first step counts as measured at the second, so this is about the
        same problem and no bound of it: a cheap place to look for a good allocation.
        """
        nothing = np.zeros_like(self.P0)
        F, F_second = _in_twos(self.F, np.eye(len(self.P0)))
        Q, Q_second = _in_twos(np.broadcast_to(self.Q, self.F.shape), nothing)
        J, J_second = _in_twos(self.J_other, nothing)
        weights, weights_second = _in_twos(self.weights[1:], np.zeros(()))
        both, part = np.unique(self.pings // 2, return_inverse=True)
        coarse = _Allocation(
            P0=self.P0,
            F=_product(F_second, F),
            Q=_product(_product(F_second, Q), F_second.swapaxes(1, 2)) + Q_second,
            J_other=J + J_second,
            pings=both,
            precision=np.bincount(part, self.precision, len(both)),
            weights=np.append(self.weights[0], weights + weights_second),
        )
        return coarse, part


def _in_twos(a: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first and the second of each two steps; ``last`` is the second of one without."""
    second = a[1::2]
    return a[::2], np.concatenate([second, last[None]]) if len(a) % 2 else second


def _coarse_to_fine(
    problem: _Allocation, relative_gap: float, max_iterations: int, progress: Progress
) -> InformationBound:
    """Solve a long problem from the allocation that suits it at half as many steps."""
    M = np.broadcast_to(np.eye(2) / 2, (len(problem.pings), 2, 2))
    if len(problem.F) <= FINEST:
        return _frank_wolfe(problem, M, relative_gap, max_iterations, progress)
    coarse, part = problem.halved()
    rough = _coarse_to_fine(coarse, relative_gap, max_iterations, lambda share: progress(share / 2))
    M = rough.allocation[part]
    del coarse  # what is not needed makes room: of a long mission it is large
    return _frank_wolfe(
        problem, M, relative_gap, max_iterations, lambda share: progress((1 + share) / 2)
    )


def _frank_wolfe(
    problem: _Allocation,
    M: np.ndarray,
    relative_gap: float,
    max_iterations: int,
    progress: Progress,
) -> InformationBound:
    """Minimise over allocations from M; the best lower bound of all iterations is kept."""
    value, J, P = problem.evaluate(M)
    if not np.isfinite(value):
        raise ValueError(
            "P0, F, Q, J_other and weights must be finite and not overflow, "
            f"got a mean square of {value}"
        )
    bound, curvature, iterations = 0.0, 0.0, 0  # a mean square is at least zero
    while True:
        iterations += 1
        gradient = problem.gradient(J, P)
        step = _steepest_vertex(gradient) - M
        descent = -float(np.sum(gradient * step))
        bound = max(bound, value - descent)
        gap = value - bound
        progress(min(1.0, relative_gap * value / gap) if gap > 0 else 1.0)  # the gap goes as 1/k
        if gap <= relative_gap * value or iterations >= max_iterations:
            return InformationBound(
                value=value,
                gap=gap,
                iterations=iterations,
                allocation=np.array(M),
                weights=problem.weights,
            )
        curvature = max(CURVATURE_DECREASE * curvature, descent)
        del J, P  # to make room for the next
        while True:
            length = min(1.0, descent / curvature)
            trial, J, P = problem.evaluate(M + length * step)
            model = value - length * descent + length**2 * curvature / 2
            if trial <= model + ROUNDING * value:
                break
            curvature *= CURVATURE_INCREASE
        M, value = M + length * step, trial


def _product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Products of matrices, summed in the same order on every processor, as BLAS's are not."""
    return np.einsum("kij,kjl->kil", A, B)


def _steepest_vertex(gradient: np.ndarray) -> np.ndarray:
    """Minimise the linear model: u uᵀ per ping.

    u is the eigenvector of the gradient's least eigenvalue; without one all do equally, and I/2
    stands for them.
    """
    half = (gradient[:, 0, 0] - gradient[:, 1, 1]) / 2
    across = (gradient[:, 0, 1] + gradient[:, 1, 0]) / 2
    size = np.hypot(half, across)
    split = np.where(size > 0, size, 1.0)
    cos, sin = half / split, across / split  # of twice the angle of the other eigenvector
    return np.stack([1 - cos, -sin, -sin, 1 + cos], axis=-1).reshape(-1, 2, 2) / 2


def _mean_square(P: np.ndarray, weights: np.ndarray) -> float:
    # not by a scalar product: BLAS sums differently on each processor
    return float(np.sum(weights * (P[:, 0, 0] + P[:, 1, 1])))


def _normalized(weights: np.ndarray, samples: int) -> np.ndarray:
    """Return weights of sum one, once they are known to be weights."""
    if len(weights) != samples:
        raise ValueError(
            f"give one weight per sample: {samples} samples, got {len(weights)} weights"
        )
    if not (np.all(weights >= 0) and 0 < np.sum(weights) < np.inf):
        raise ValueError(
            "weights must be at least 0 and not all 0, "
            f"got a least of {np.min(weights)} and a sum of {np.sum(weights)}"
        )
    return weights / np.sum(weights)


def _check_pings(pings: np.ndarray, steps: int) -> None:
    if len(pings) and (pings.min() < 0 or pings.max() >= steps):
        raise ValueError(
            f"pings must be steps 0 to {steps - 1}, got {pings.min()} to {pings.max()}"
        )


@cache
def _adjoint_sweep(n: int) -> Recursion:
    """Make (Λ, P and J after the step, F, w before it) -> Λ of the sample before."""
    L, P, J, Ft = (symbol(name, n, n) for name in ("L", "P", "J", "Ft"))
    w = symbol("w")
    At = Ft @ (ca.SX.eye(n) - J @ P)
    before = propagate(L, At, w * _position(n))
    return Recursion(ca.Function("adjoint", [L, P, J, Ft, w], [before]))


@cache
def _by_information(n: int) -> ca.Function:
    """Make (P, Λ, 1/σ²) -> derivative with respect to the direction of a ping."""
    P, L, precision = symbol("P", n, n), symbol("L", n, n), symbol("r")
    slope = -precision * (P[:2, :] @ L @ P[:, :2])
    return ca.Function("by_information", [P, L, precision], [slope])


def _position(n: int) -> ca.DM:
    """What selects the position, states one and two."""
    return ca.diag(ca.DM([1.0, 1.0, *[0.0] * (n - 2)]))
