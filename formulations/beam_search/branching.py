"""One stage of one sequence of turns, as an expression."""

from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..model.arcs import compose
from ..model.casadi import SX, Cases, matrix, symbol
from ..model.covariance import DEPTH, condition_on_range, informed, pack, predict, unpack
from ..model.ranging import EDGE, Form, Law, law, throughput

CRITERIA = ("trace", "log-det")
TINY = 1e-30  # [m^4]; a position known exactly has no logarithm
# What a branching is told of an AUV at the last ranges and at the next: where it is, how far the
# aid vehicle is above it, how many ranges there are, and the root of what else is known then.
AT_RANGES = ("x", "y", "height", "pings", "root_east", "root_both", "root_north")
# ``per_metre`` is what each metre to the AUV costs that is to come, weighted as the AUV is, and
# beyond ``near`` [m].
AUV = (
    *(f"{name}_before" for name in AT_RANGES),
    *AT_RANGES,
    *("cos", "sin", "speed"),
    *("east_noise", "north_noise", "heading_noise", "speed_noise", "depth_noise"),
    *("doubt", "weight", "per_metre", "near"),
)
LAW = ("sigma", "growth", "loss", "per_half_distance", "per_reach")  # its numbers
# Of the horizon, the share; the numbers of the ranging's law; what lost throughput costs, and its
# own half distance.
STAGE = ("duration", "share", *LAW, "link_weight", "per_link_half_distance")
UNROLLED = 500  # AUVs times turns, up to which the virtual machine runs a branching on scalars


class Kind(NamedTuple):
    """What the machine code of a search depends on."""

    auvs: int
    turns: int
    form: Form
    criterion: str
    states: int = 4  # of an AUV; with a fifth the depth is one
    aided: bool = False  # whether more is known at ranges than they tell
    linked: bool = False  # whether lost throughput costs
    doubted: bool = False  # whether means are believed less than covariances say

    @property
    def half(self) -> int:
        """Entries of a packed covariance."""
        return self.states * (self.states + 1) // 2


@lru_cache(maxsize=16)
def branching(kind: Kind) -> Cases:
    """One stage of one sequence, for many sequences.

    (pose, packed covariances: half x M, cost so far, told)
    -> (costs: K, costs and what is to come: K, poses: 3 x K, packed covariances: half x M)

    ``told`` holds ``AUV`` of each, ``STAGE`` and the moves of the turns, 3 x K, one after the
    other.
    """
    auvs, turns = kind.auvs, kind.turns
    sizes = told_sizes(auvs, turns)
    pose = matrix("pose", 3)
    P = matrix("P", kind.half, auvs)
    cost = matrix("cost")
    told = matrix("told", sum(sizes))
    auv, stage, moves = ca.vertsplit(told, np.cumsum([0, *sizes]).tolist())
    auv = ca.reshape(auv, len(AUV), auvs)
    moves = ca.reshape(moves, 3, turns)
    poses = composed(turns)(pose, moves)
    of_all = of_one(kind).map(auvs)
    repeated = [ca.repmat(part, 1, auvs) for part in (pose, poses, stage)]
    known, to_go, predicted = of_all(P, auv, *repeated)
    share, weight = stage[STAGE.index("share")], auv[AUV.index("weight"), :]
    costs = cost + share * (known @ weight.T)
    ranks = costs + ca.sum2(to_go)
    outputs = [costs, ranks, poses, predicted]
    function = ca.Function("branching", [pose, P, cost, told], outputs)
    return Cases(function, scalars=auvs * turns <= UNROLLED)


def told_sizes(auvs: int, turns: int) -> tuple[int, int, int]:
    """Of the parts of what a branching is told."""
    return len(AUV) * auvs, len(STAGE), 3 * turns


@lru_cache(maxsize=16)
def of_one(kind: Kind) -> ca.Function:
    """A branching of one AUV.

    (covariance, AUV, pose, poses: 3 x K, STAGE)
    -> (criterion after each turn: K, cost to go from there: K, covariance)
    """
    P, auv, stage = symbol("P", kind.half), symbol("auv", len(AUV)), symbol("stage", len(STAGE))
    pose, poses = symbol("pose", 3), symbol("poses", 3, kind.turns)
    duration, _, numbers, link = ca.vertsplit(stage, [0, 1, 2, 2 + len(LAW), len(STAGE)])
    ranging = law(kind.form, numbers)
    at = len(AT_RANGES)
    before, there, motion, noise, own = ca.vertsplit(
        auv, [0, at, 2 * at, 2 * at + 3, AUV.index("doubt"), len(AUV)]
    )
    doubt = own[0] if kind.doubted else 0.0
    begun = _at_ranges(unpack(P, kind.states), pose, before, ranging, doubt, kind)
    predicted = predict(begun, motion, noise[: kind.states], duration)
    place = [0, 1, *range(DEPTH, kind.states)]
    per_metre, near = auv[AUV.index("per_metre")], auv[AUV.index("near")]
    known, to_go = [], []
    for k in range(kind.turns):
        after = _at_ranges(predicted[place, place], poses[:, k], there, ranging, doubt, kind)
        cost = _criterion(after, kind.criterion)
        if kind.linked:
            cost += _lost_throughput(poses[:, k], there, ranging, link)
        known.append(cost)
        distance = _distance(poses[:, k], there, ranging.form)
        to_go.append(per_metre * ca.fmax(distance - near, 0.0))
    outputs = [ca.vertcat(*known), ca.vertcat(*to_go), pack(predicted)]
    return ca.Function("of_one", [P, auv, pose, poses, stage], outputs, {"cse": True})


def _at_ranges(P: SX, pose: SX, there: SX, ranging: Law, doubt: SX | float, kind: Kind) -> SX:
    """What is known once the ranges from a pose have come, and what else is known then."""
    position, height, pings, root = ca.vertsplit(there, [0, 2, 3, 4, len(AT_RANGES)])
    x = pose[:2] - position
    known = condition_on_range(P, x, law=ranging, pings=pings, height=height, doubt=doubt)
    return informed(known, root) if kind.aided else known


def _lost_throughput(pose: SX, there: SX, ranging: Law, link: SX) -> SX:
    """What the share of throughput costs that is lost between a pose and an AUV."""
    weight, per_half_distance = ca.vertsplit(link)
    r2 = _squared_distance(pose, there, ranging.form)
    return weight * (1 - throughput(r2, per_half_distance, ranging.per_reach, edge=EDGE))


def _squared_distance(pose: SX, there: SX, form: Form) -> SX:
    """Of an AUV from a pose [m^2]: the slant one where ranges are slant."""
    r2 = ca.sumsqr(pose[:2] - there[:2])
    return r2 + there[AT_RANGES.index("height")] ** 2 if form.slant else r2


def _distance(pose: SX, there: SX, form: Form) -> SX:
    return ca.sqrt(_squared_distance(pose, there, form))


@lru_cache(maxsize=16)
def composed(turns: int) -> ca.Function:
    """(pose, moves: 3 x K) -> poses after each: 3 x K."""
    pose, moves = symbol("pose", 3), symbol("moves", 3, turns)
    return ca.Function("composed", [pose, moves], [compose(pose, moves)], {"cse": True})


def _criterion(P: SX, name: str) -> SX:
    """Trace or log det of the position covariance, the depth's with it where that is a state."""
    if P.shape[0] > 2:
        return ca.trace(P) if name == "trace" else ca.log(ca.fmax(ca.det(P), TINY))
    if name == "trace":
        return P[0, 0] + P[1, 1]
    return ca.log(ca.fmax(P[0, 0] * P[1, 1] - P[0, 1] ** 2, TINY))
