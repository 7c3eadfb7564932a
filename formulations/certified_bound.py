"""The certified information bound: what no path of the beacon can beat.

Time runs over samples as in `cramer_rao`.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from .allocation import Allocation, check_pings, mean_square, normalized
from .cramer_rao import positive
from .frank_wolfe import CertifiedBound, Progress, frank_wolfe

RELATIVE_GAP = 0.005  # of the mean square: the bound's RMS is within 0.25 % of the best
MAX_ITERATIONS = 300
FINEST = 4096  # steps, up to which a search begins from nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class InformationBound(CertifiedBound):
    """What no path of the beacon can beat, with its certificate.

    It is a bound and no `Solution`: its minimiser is an allocation that no path need reach, and
    what counts is the value less the gap. Mean squares [m²] are of the position error, over time.

    ``value`` is reached by the fractional directions ``allocation`` (one 2 x 2 matrix of trace one
    per ping); ``gap`` is its duality gap: the least mean square of any path lies above ``bound`` =
    value − gap. ``weights`` are those of the samples, with sum one.
    """

    allocation: Float[np.ndarray, "pings 2 2"]
    weights: Float[np.ndarray, " samples"]

    def efficiency(self, P: Float[np.ndarray, "samples n n"]) -> float:
        """Return the bound over the RMS of a path's posterior Cramér-Rao covariances.

        It is in (0, 1], and 1 where no error is left.
        """
        achieved = float(np.sqrt(mean_square(P, self.weights)))
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
    every path, whatever prior, dynamics and process noise.

    Solved by `frank_wolfe`; gradients by one adjoint sweep. Stopped at ``max_iterations`` the bound
    is looser, and as certain.

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
    weights = normalized(np.ones(len(F) + 1) if weights is None else weights, len(F) + 1)
    check_pings(pings, len(F))
    if not (relative_gap > 0 and max_iterations >= 1):
        raise ValueError(
            "relative_gap must be positive and max_iterations at least 1, "
            f"got {relative_gap} and {max_iterations}"
        )
    precision = np.broadcast_to(1.0 / positive(sigma) ** 2, pings.shape)
    steps, of_step = np.unique(pings, return_inverse=True)
    together = np.bincount(of_step, precision, len(steps))
    problem = Allocation(
        P0=P0, F=F, Q=Q, J_other=J_other, pings=steps, precision=together, weights=weights
    )
    found = _coarse_to_fine(problem, relative_gap, max_iterations, progress)
    return replace(found, allocation=found.allocation[of_step])


def _coarse_to_fine(
    problem: Allocation, relative_gap: float, max_iterations: int, progress: Progress
) -> InformationBound:
    """Solve a long problem from the allocation that suits it at half as many steps."""
    M = np.broadcast_to(np.eye(2) / 2, (len(problem.pings), 2, 2))
    if len(problem.F) <= FINEST:
        return _searched(problem, M, relative_gap, max_iterations, progress)
    coarse, part = problem.halved()
    rough = _coarse_to_fine(coarse, relative_gap, max_iterations, lambda share: progress(share / 2))
    M = rough.allocation[part]
    del coarse  # what is not needed makes room: of a long mission it is large
    return _searched(
        problem, M, relative_gap, max_iterations, lambda share: progress((1 + share) / 2)
    )


def _searched(
    problem: Allocation,
    M: np.ndarray,
    relative_gap: float,
    max_iterations: int,
    progress: Progress,
) -> InformationBound:
    """Minimise over allocations from M."""
    found = frank_wolfe(
        problem,
        M,
        _steepest_vertex,
        relative_gap=relative_gap,
        max_iterations=max_iterations,
        progress=progress,
    )
    return InformationBound(
        value=found.value,
        gap=found.gap,
        iterations=found.iterations,
        allocation=found.point,
        weights=problem.weights,
    )


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
