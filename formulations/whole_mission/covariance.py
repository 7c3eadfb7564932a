"""The time mean of the AUVs' predicted position variance as a function of where the aid vehicle is at the ranges, with its gradient."""

from functools import lru_cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..model.casadi import symbol
from ..model.covariance import condition_on_range, pack, pack_array, propagate, symmetric, unpack
from .mission import HEADING, Mission


class PredictedVariance:
    """Weighted position variance of a mission, averaged over its time [m^2], and its gradient by the positions [m]."""

    def __init__(self, mission: Mission) -> None:
        stages, M = mission.stages, len(mission.weights)
        S = len(stages.end)
        by_stage = [
            part
            for half in stages.halves
            for part in (half.transition.swapaxes(-1, -2), half.noise, half.heading)
        ]
        repeated = [np.tile(a, (S, 1)) for a in (mission.weights, [mission.ranging.sigma])]
        first = pack_array(mission.covariance)
        rows = [mission.position[stages.end], *by_stage]
        rows += [stages.pings, stages.share, *repeated]
        self._parameters = [ca.DM(first.T), *(ca.DM(a.reshape(S, -1).T) for a in rows)]
        self._function = variance_function(S, M, mission.ranging.squared)

    def __call__(self, x: Float[np.ndarray, "S 2"]) -> tuple[float, Float[np.ndarray, "S 2"]]:
        """The mean variance with the aid vehicle at x at the stages' ends, and its gradient."""
        value, gradient = self._function(x.T, *self._parameters)
        return float(value), gradient.full().T


@lru_cache(maxsize=16)
def variance_function(S: int, M: int, squared: bool) -> ca.Function:
    """(positions 2 x S, first covariances, parameters of the stages) -> mean variance, gradient."""
    step = stage_function(M, squared)
    sizes = [step.size_in(i) for i in range(step.n_in())]
    first, x = ca.MX.sym("P", 10, M), ca.MX.sym("x", 2, S)  # pyright: ignore[reportArgumentType, reportCallIssue]
    parameters = [
        ca.MX.sym(f"p{i}", rows, columns * S) for i, (rows, columns) in enumerate(sizes[3:])
    ]  # pyright: ignore[reportArgumentType, reportCallIssue]
    _, sums = step.mapaccum("stages", S, 2)(first, 0, x, *parameters)
    total = sums[-1]
    return ca.Function("variance", [x, first, *parameters], [total, ca.gradient(total, x)])


@lru_cache(maxsize=16)
def stage_function(M: int, squared: bool) -> ca.Function:
    """One stage: (covariances, sum so far, position, parameters) -> (covariances, sum)."""
    P, total, x, auvs = symbol("P", 10, M), symbol("total"), symbol("x", 2), symbol("auvs", 2 * M)
    maps = [
        symbol(name, rows * M) for _ in range(2) for name, rows in (("T", 16), ("Q", 16), ("h", 1))
    ]
    pings, share, weights, sigma = (
        symbol("pings"),
        symbol("share", 3),
        symbol("weights", M),
        symbol("sigma"),
    )
    after, known = [], total
    for i in range(M):
        begin = unpack(P[:, i])
        one = [
            part[i * size : (i + 1) * size]
            for part, size in zip(maps, (16, 16, 1) * 2, strict=True)
        ]
        middle = advanced(begin, *one[:3])
        end = advanced(middle, *one[3:])
        variance = ca.vertcat(
            *(covariance[0, 0] + covariance[1, 1] for covariance in (begin, middle, end))
        )
        known += weights[i] * ca.dot(share, variance)
        apart = x - auvs[2 * i : 2 * i + 2]
        ranged = condition_on_range(end, apart, sigma=sigma, pings=pings, squared=squared)
        after.append(pack(ranged))
    return ca.Function(
        "stage",
        [P, total, x, auvs, *maps, pings, share, weights, sigma],
        [ca.horzcat(*after), known],
    )


def advanced(P: ca.SX, T: ca.SX, Q: ca.SX, h: ca.SX) -> ca.SX:
    """`mission.advance` as an expression; only entries that are not 0 or 1 of the transition are read."""
    F = ca.SX.eye(4)
    for row, column in ((0, 2), (1, 2), (2, 2), (3, 2), (0, 3), (1, 3), (2, 3)):
        F[row, column] = T[row + 4 * column]
    column = P[:, HEADING]
    known = P - h / (1 + h * column[HEADING]) * column @ column.T
    return propagate(symmetric(known), F, ca.reshape(Q, 4, 4))
