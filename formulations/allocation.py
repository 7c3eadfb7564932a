"""Mean square position error along a mission, by how each range informs different directions.

It is convex in the information of the ranges; what it costs and gains to change that is found by
one sweep forward and one back. Time runs over samples as in `cramer_rao`.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from .cramer_rao import posterior_cramer_rao
from .model.casadi import of_each, symbol
from .model.covariance import propagate
from .model.recursion import Recursion


@dataclass(frozen=True, slots=True, kw_only=True)
class Allocation:
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
        return mean_square(P, self.weights), J, P

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

    def halved(self) -> tuple["Allocation", np.ndarray]:
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
        coarse = Allocation(
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


def _product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Products of matrices, summed in the same order on every processor, as BLAS's are not."""
    return np.einsum("kij,kjl->kil", A, B)


def mean_square(P: np.ndarray, weights: np.ndarray) -> float:
    """Mean over time of the position's variance, with weights of sum one."""
    # not by a scalar product: BLAS sums differently on each processor
    return float(np.sum(weights * (P[:, 0, 0] + P[:, 1, 1])))


def normalized(weights: np.ndarray, samples: int) -> np.ndarray:
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


def check_pings(pings: np.ndarray, steps: int) -> None:
    """Raise ValueError unless pings are steps."""
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
