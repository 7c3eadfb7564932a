"""One stage of one sequence of turns, as an expression."""

from functools import lru_cache

import casadi as ca
import numpy as np

from ..model.arcs import compose
from ..model.casadi import SX, Cases, matrix, symbol
from ..model.covariance import condition_on_range, pack, predict, unpack

CRITERIA = ("trace", "log-det")
TINY = 1e-30  # [m^4]; a position known exactly has no logarithm
HALF = 10  # entries of a packed covariance
# What a branching is told of an AUV: where it is at the last ranges and the next, and how it moves.
AUV = (
    *("x_before", "y_before", "x", "y", "cos", "sin", "speed"),
    *("east_noise", "north_noise", "heading_noise", "speed_noise", "weight"),
)
STAGE = ("duration", "share", "pings_before", "pings", "sigma")  # share: of the horizon
UNROLLED = 500  # AUVs times turns, up to which the virtual machine runs a branching on scalars


@lru_cache(maxsize=16)
def branching(auvs: int, turns: int, squared: bool, criterion: str) -> Cases:
    """One stage of one sequence, for many sequences.

    (pose, packed covariances: HALF x M, cost so far, told)
    -> (costs: K, poses: 3 x K, packed covariances: HALF x M)

    ``told`` holds ``AUV`` of each, ``STAGE`` and the moves of the turns, 3 x K, one after the
    other.
    """
    sizes = told_sizes(auvs, turns)
    pose = matrix("pose", 3)
    P = matrix("P", HALF, auvs)
    cost = matrix("cost")
    told = matrix("told", sum(sizes))
    auv, stage, moves = ca.vertsplit(told, np.cumsum([0, *sizes]).tolist())
    auv = ca.reshape(auv, len(AUV), auvs)
    moves = ca.reshape(moves, 3, turns)
    poses = composed(turns)(pose, moves)
    of_all = of_one(turns, squared, criterion).map(auvs)
    repeated = [ca.repmat(part, 1, auvs) for part in (pose, poses, stage)]
    known, predicted = of_all(P, auv, *repeated)
    share, weight = stage[STAGE.index("share")], auv[AUV.index("weight"), :]
    costs = cost + share * (known @ weight.T)
    function = ca.Function("branching", [pose, P, cost, told], [costs, poses, predicted])
    return Cases(function, scalars=auvs * turns <= UNROLLED)


def told_sizes(auvs: int, turns: int) -> tuple[int, int, int]:
    """Of the parts of what a branching is told."""
    return len(AUV) * auvs, len(STAGE), 3 * turns


@lru_cache(maxsize=16)
def of_one(turns: int, squared: bool, criterion: str) -> ca.Function:
    """A branching of one AUV.

    (covariance, AUV, pose, poses: 3 x K, STAGE) -> (criterion after each turn: K, covariance)
    """
    P, auv, stage = symbol("P", HALF), symbol("auv", len(AUV)), symbol("stage", len(STAGE))
    pose, poses = symbol("pose", 3), symbol("poses", 3, turns)
    duration, _, last_pings, pings, sigma = ca.vertsplit(stage)
    before, there, motion, noise, _ = ca.vertsplit(auv, [0, 2, 4, 7, 11, 12])
    last = pose[:2] - before
    begun = condition_on_range(unpack(P), last, sigma=sigma, pings=last_pings, squared=squared)
    predicted = predict(begun, motion, noise, duration)
    known = []
    for k in range(turns):
        x = poses[:2, k] - there
        after = condition_on_range(predicted[:2, :2], x, sigma=sigma, pings=pings, squared=squared)
        known.append(_criterion(after, criterion))
    outputs = [ca.vertcat(*known), pack(predicted)]
    return ca.Function("of_one", [P, auv, pose, poses, stage], outputs, {"cse": True})


@lru_cache(maxsize=16)
def composed(turns: int) -> ca.Function:
    """(pose, moves: 3 x K) -> poses after each: 3 x K."""
    pose, moves = symbol("pose", 3), symbol("moves", 3, turns)
    return ca.Function("composed", [pose, moves], [compose(pose, moves)], {"cse": True})


def _criterion(P: SX, name: str) -> SX:
    """Trace or log det of the position covariance."""
    if name == "trace":
        return P[0, 0] + P[1, 1]
    return ca.log(ca.fmax(P[0, 0] * P[1, 1] - P[0, 1] ** 2, TINY))
