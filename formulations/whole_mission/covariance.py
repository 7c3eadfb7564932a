"""The AUVs' mean predicted position variance, a function of where the aid vehicle is at ranges."""

from functools import lru_cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..model.casadi import SX, matrix, symbol
from ..model.covariance import condition_on_range, pack, pack_array, propagate, symmetric, unpack
from .problem import HEADING, Maps, Problem

PACKED = 10  # entries of a packed covariance
FREE = ((0, 2), (1, 2), (2, 2), (3, 2), (0, 3), (1, 3), (2, 3))  # of a transition: not 0 or 1


class PredictedVariance:
    """Weighted position variance over the mission's time [m^2], and its gradient by positions [m].

    The variances of a stage's beginning, middle and end count as `MissionStages.share` says.
    """

    def __init__(self, problem: Problem) -> None:
        stages = problem.stages
        S, M = len(stages.end), len(problem.weights)
        first, second = stages.halves
        of_stages = [
            problem.position[stages.end],
            *columns(first),
            *columns(second),
            stages.pings,
            stages.share,
            np.tile(problem.weights, (S, 1)),
            np.full(S, problem.ranging.sigma),
        ]
        start = pack_array(problem.covariance)
        by_stage = [part.reshape(S, -1).T for part in of_stages]
        self._parameters = [ca.DM(start.T), *(ca.DM(part) for part in by_stage)]
        self._function = variance_function(S, M, problem.ranging.squared)

    def __call__(self, x: Float[np.ndarray, "S 2"]) -> tuple[float, Float[np.ndarray, "S 2"]]:
        """The mean variance with the aid vehicle at x at the stages' ends, and its gradient."""
        value, gradient = self._function(x.T, *self._parameters)
        return float(value), gradient.full().T


def columns(maps: Maps) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Maps as CasADi stores matrices, by columns; the noise is symmetric."""
    return maps.transition.swapaxes(-1, -2), maps.noise, maps.heading


@lru_cache(maxsize=16)
def variance_function(S: int, M: int, squared: bool) -> ca.Function:
    """(positions 2 x S, first covariances, parameters of the stages) -> mean variance, gradient."""
    stage = stage_function(M, squared)
    first, x = matrix("P", PACKED, M), matrix("x", 2, S)
    parameters = []
    for i in range(3, stage.n_in()):  # after covariances, sum and position
        rows, each = stage.size_in(i)
        parameters.append(matrix(f"p{i}", rows, each * S))
    _, sums = stage.mapaccum("stages", S, 2)(first, 0, x, *parameters)
    total = sums[-1]
    return ca.Function("variance", [x, first, *parameters], [total, ca.gradient(total, x)])


@lru_cache(maxsize=16)
def stage_function(M: int, squared: bool) -> ca.Function:
    """One stage: (covariances, sum so far, position, parameters) -> (covariances, sum).

    Parameters: positions of the AUVs, the maps of both halves, number of ranges, share of the
    mission's time, weights, standard deviation of a range.
    """
    P, total, x = symbol("P", PACKED, M), symbol("total"), symbol("x", 2)
    positions = symbol("auvs", 2, M)
    first_half, second_half = half_symbols(M), half_symbols(M)
    pings, share = symbol("pings"), symbol("share", 3)
    weights, sigma = symbol("weights", M), symbol("sigma")
    after, mean = [], total
    for i in range(M):
        begin = unpack(P[:, i])
        middle = advanced(begin, [part[:, i] for part in first_half])
        end = advanced(middle, [part[:, i] for part in second_half])
        variances = [covariance[0, 0] + covariance[1, 1] for covariance in (begin, middle, end)]
        mean += weights[i] * ca.dot(share, ca.vertcat(*variances))
        apart = x - positions[:, i]
        ranged = condition_on_range(end, apart, sigma=sigma, pings=pings, squared=squared)
        after.append(pack(ranged))
    maps = [ca.vec(part) for part in (positions, *first_half, *second_half)]
    inputs = [P, total, x, *maps, pings, share, weights, sigma]
    return ca.Function("stage", inputs, [ca.horzcat(*after), mean])


def half_symbols(M: int) -> tuple[SX, SX, SX]:
    """Symbols of one interval's maps: a column for each AUV."""
    return symbol("T", 16, M), symbol("Q", 16, M), symbol("h", 1, M)


def advanced(P: SX, maps: list[SX]) -> SX:
    """`problem.advance` of one AUV as an expression; of the transition only `FREE` is read."""
    T, Q, h = maps
    F = ca.SX.eye(4)
    for row, column in FREE:
        F[row, column] = T[row + 4 * column]
    heading = P[:, HEADING]
    known = P - h / (1 + h * heading[HEADING]) * heading @ heading.T
    return propagate(symmetric(known), F, ca.reshape(Q, 4, 4))
