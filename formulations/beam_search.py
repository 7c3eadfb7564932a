"""Search for the turns after which AUVs know best where they are: beam search over constant turns.

Each stage of each sequence is a branching: what the last stage's ranges tell, the prediction, and
what ranges at the end of each turn would tell (`formulations.model.covariance`). It is one
Function, run as machine code where there is a compiler.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float, Int

from .model.arcs import arc, arcs, compose
from .model.casadi import SX, Cases, matrix, symbol
from .model.covariance import (
    Ranging,
    Tracks,
    condition_on_range,
    motions,
    pack,
    pack_array,
    predict,
    unpack,
)
from .model.schedule import Stages
from .solution import Solution, Status

CRITERIA = ("trace", "log-det")
LOOKS = np.arange(1, 9) / 8  # parts of a stage after which it is held against the constraints
TINY = 1e-30  # [m^4]; a position known exactly has no logarithm
HALF = 10  # entries of a packed covariance
# What a branching is told of an AUV: where it is at the last ranges and the next, and how it moves.
AUV = (
    *("x_before", "y_before", "x", "y", "cos", "sin", "speed"),
    *("east_noise", "north_noise", "heading_noise", "speed_noise", "weight"),
)
STAGE = ("duration", "share", "pings_before", "pings", "sigma")  # share: of the horizon
UNROLLED = 500  # AUVs times turns, up to which the virtual machine runs a branching on scalars

Look = Callable[[Int[np.ndarray, " n"]], Float[np.ndarray, " n"]]
Violation = Callable[
    [Float[np.ndarray, "*batch T 2"], Float[np.ndarray, " T"]], Float[np.ndarray, "*batch T"]
]


def turn_candidates(max_turn_rate: float, count: int) -> Float[np.ndarray, " K"]:
    """Turn rates to try at each stage [rad/s], from left to right.

    Straight on, and pairs that fall off threefold from the limit.
    """
    side = max_turn_rate / 3.0 ** np.arange(count // 2)
    return np.concatenate([side, [0.0], -side[::-1]])


class _Beam(NamedTuple):
    """Sequences of turns under consideration."""

    pose: np.ndarray  # B x 3
    covariance: np.ndarray  # B x M x HALF, before the last stage's ranges
    cost: np.ndarray  # B
    first: np.ndarray  # B, how far the first turn itself breaks a limit [m]
    violation: np.ndarray  # B, how far the sequence does [m]


@dataclass(frozen=True, kw_only=True)
class _Feasibility:
    """What sequences are held against."""

    violation: Violation | None
    first_violation: np.ndarray  # K
    turn_rates: np.ndarray  # K
    speed: float

    def best(
        self, beam: _Beam, cost: np.ndarray, width: int, *, elapsed: float, duration: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The best of all sequences of the next stage.

        With them, how far their first turns break a limit, and how far the sequences do.
        """
        each = len(self.turn_rates)
        first = np.repeat(beam.first, each)
        worst = np.repeat(beam.violation, each)
        if elapsed == 0.0:
            first = np.maximum(self.first_violation, 0.0)
        keep, worst = _best(first, worst, cost, width, self._look(beam, elapsed, duration))
        return keep, first[keep], worst[keep]

    def _look(self, beam: _Beam, elapsed: float, duration: float) -> Look | None:
        """How far the stage of some sequences breaks a limit, at the points looked at."""
        violation = self.violation
        if violation is None:
            return None
        times = duration * LOOKS
        ways = arcs(np.zeros(3), self.turn_rates, self.speed, times)  # the same from every pose
        ahead, aside = ways[..., 0], ways[..., 1]
        x, y, heading = beam.pose[..., None].swapaxes(0, 1)
        cos, sin = np.cos(heading), np.sin(heading)

        def look(these):
            parent, turn = np.divmod(these, len(self.turn_rates))
            c, s = cos[parent], sin[parent]
            forward, left = ahead[turn], aside[turn]
            along = np.empty((these.size, times.size, 2))
            along[..., 0] = x[parent] + c * forward - s * left
            along[..., 1] = y[parent] + s * forward + c * left
            broken = violation(along, elapsed + times)
            return broken.max(axis=-1)

        return look


def search_manoeuvres(
    pose: Float[np.ndarray, "3"],
    covariance: Float[np.ndarray, "M 4 4"],
    *,
    tracks: Tracks,
    process_noise: Float[np.ndarray, "M 4"],
    weights: Float[np.ndarray, " M"],
    stages: Stages,
    turn_rates: Float[np.ndarray, " K"],
    speed: float,
    ranging: Ranging,
    criterion: str = "trace",
    beam_width: int = 32,
    violation: Violation | None = None,
    first_violation: Float[np.ndarray, " K"] | None = None,
) -> Solution:
    """Find the turns, one a stage, after which the AUVs' position covariances are smallest.

    Parameters
    ----------
    pose
        Of the aid vehicle: east, north [m], heading [rad].
    covariance, process_noise
        Of each AUV's state now; standard deviations of its random walk per square root of a second.
    tracks, weights
        Where the AUVs are expected, and what each counts.
    stages, turn_rates, speed, ranging
        Of the aid vehicle's horizon, its candidates at each stage [rad/s], its speed [m/s]; how
        ranges err.
    criterion
        ``trace`` [m²] or ``log-det`` [-] of the position covariance after each stage, weighted by
        the AUVs and averaged over time.
    beam_width
        Sequences kept after each stage: those whose first turn breaks limits least, of these those
        that break them least later, of these the cheapest.
    violation
        How far [m] positions (..., T, 2) at times from now [s] are on the wrong side of a limit, at
        most 0 where they are right.
    first_violation
        How far [m] each turn breaks a limit as the first one.

    Returns
    -------
    The best sequence of the last beam; of equals the one that comes first, turning left. ``x``:
    turn rates [rad/s]. ``poses``: at the beginning and the ends of the stages. ``objective``: the
    criterion. Primal residual: how far it breaks a limit at the points looked at [m]. The status is
    the first turn's, which is the one that is taken: ``VIOLATED`` where each breaks a limit, and
    ``INVALID_INPUT`` where the criterion is no number.
    """
    turns = len(turn_rates)
    branch = branching(len(weights), turns, ranging.squared, criterion)
    told = _told(tracks, process_noise, weights, stages, turn_rates, speed, ranging)
    feasibility = None
    if violation is not None or first_violation is not None:
        first = np.zeros(turns) if first_violation is None else first_violation
        feasibility = _Feasibility(
            violation=violation, first_violation=first, turn_rates=turn_rates, speed=speed
        )
    none = np.zeros(1)
    beam = _Beam(pose[None], pack_array(covariance)[None], none, none, none)
    taken, elapsed = [], 0.0
    for s, duration in enumerate(stages.duration.tolist()):
        costs, poses, predicted = branch(beam.pose, beam.covariance, beam.cost, told[s])
        cost = costs.ravel()
        if feasibility is None:
            keep = _cheapest(cost, beam_width if s < len(told) - 1 else 1)
            broken = worst = none
        else:
            keep, broken, worst = feasibility.best(
                beam, cost, beam_width, elapsed=elapsed, duration=duration
            )
        taken.append((keep, beam.pose))
        beam = _Beam(
            pose=poses.reshape(-1, 3).take(keep, axis=0),
            covariance=predicted.take(keep // turns, axis=0),
            cost=cost.take(keep),
            first=broken,
            violation=worst,
        )
        elapsed += duration
    best, poses = _followed_back(taken, turns)
    cost, first, worst = float(beam.cost[0]), float(beam.first[0]), float(beam.violation[0])
    return Solution(
        x=turn_rates[best],
        objective=cost,
        status=_status(cost, first),
        primal_residual=max(first, worst),
        poses=np.array([*poses, beam.pose[0]]),
    )


def _status(cost: float, first_violation: float) -> Status:
    if not np.isfinite(cost):
        return Status.INVALID_INPUT
    return Status.VIOLATED if first_violation > 0 else Status.OPTIMAL


@lru_cache(maxsize=16)
def branching(auvs: int, turns: int, squared: bool, criterion: str) -> Cases:
    """One stage of one sequence, for many sequences.

    (pose, packed covariances: HALF x M, cost so far, told)
    -> (costs: K, poses: 3 x K, packed covariances: HALF x M)

    Raises ValueError for a criterion that is not known.

    ``told`` holds ``AUV`` of each, ``STAGE`` and the moves of the turns, 3 x K, one after the
    other.
    """
    if criterion not in CRITERIA:
        raise ValueError(f'criterion must be one of {", ".join(CRITERIA)}, got "{criterion}"')
    sizes = _sizes(auvs, turns)
    pose = matrix("pose", 3)
    P = matrix("P", HALF, auvs)
    cost = matrix("cost")
    told = matrix("told", sum(sizes))
    auv, stage, moves = ca.vertsplit(told, np.cumsum([0, *sizes]).tolist())
    auv = ca.reshape(auv, len(AUV), auvs)
    moves = ca.reshape(moves, 3, turns)
    poses = _composed(turns)(pose, moves)
    of_all = _branching_of_one(turns, squared, criterion).map(auvs)
    repeated = [ca.repmat(part, 1, auvs) for part in (pose, poses, stage)]
    known, predicted = of_all(P, auv, *repeated)
    share, weight = stage[STAGE.index("share")], auv[AUV.index("weight"), :]
    costs = cost + share * (known @ weight.T)
    function = ca.Function("branching", [pose, P, cost, told], [costs, poses, predicted])
    return Cases(function, scalars=auvs * turns <= UNROLLED)


def _sizes(auvs: int, turns: int) -> tuple[int, int, int]:
    """Of the parts of what a branching is told."""
    return len(AUV) * auvs, len(STAGE), 3 * turns


def _branching_of_one(turns: int, squared: bool, criterion: str) -> ca.Function:
    """The same of one AUV.

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
    return ca.Function("of_one", [P, auv, pose, poses, stage], outputs)


@cache
def _moves() -> Cases:
    """(turn rate, duration, speed) -> the arc from the origin."""
    turn_rate, duration, speed = symbol("turn_rate"), symbol("duration"), symbol("speed")
    move = arc(ca.SX.zeros(3), turn_rate, speed, duration)
    function = ca.Function("moves", [turn_rate, duration, speed], [move])
    return Cases(function, scalars=True)


@lru_cache(maxsize=16)
def _composed(turns: int) -> ca.Function:
    pose, moves = symbol("pose", 3), symbol("moves", 3, turns)
    return ca.Function("composed", [pose, moves], [compose(pose, moves)])


def _criterion(P: SX, name: str) -> SX:
    """Trace or log det of the position covariance."""
    if name == "trace":
        return P[0, 0] + P[1, 1]
    return ca.log(ca.fmax(P[0, 0] * P[1, 1] - P[0, 1] ** 2, TINY))


def _told(
    tracks: Tracks,
    process_noise: Float[np.ndarray, "M 4"],
    weights: Float[np.ndarray, " M"],
    stages: Stages,
    turn_rates: Float[np.ndarray, " K"],
    speed: float,
    ranging: Ranging,
) -> Float[np.ndarray, "S n"]:
    """What a branching is told at each stage; see `branching`."""
    S, M = tracks.heading.shape
    of_auvs, of_stage, of_moves = _sizes(M, len(turn_rates))
    told = np.empty((S, of_auvs + of_stage + of_moves))
    auv = told[:, :of_auvs].reshape(S, M, len(AUV))
    stage = told[:, of_auvs : of_auvs + of_stage]
    moves = told[:, of_auvs + of_stage :]
    auv[0, :, :2] = 0.0  # no ranges before the first stage
    auv[1:, :, :2] = tracks.position[:-1]
    auv[..., 2:4] = tracks.position
    auv[..., 4:7] = motions(tracks.heading, tracks.speed)
    auv[..., 7:11] = process_noise
    auv[..., 11] = weights / weights.sum()
    stage[:, 0] = stages.duration
    stage[:, 1] = stages.duration / stages.duration.sum()
    stage[0, 2] = 0.0
    stage[1:, 2] = stages.pings[:-1]
    stage[:, 3] = stages.pings
    stage[:, 4] = ranging.sigma
    every_rate = np.tile(turn_rates, S)
    every_duration = np.repeat(stages.duration, len(turn_rates))
    (arcs_of_turns,) = _moves()(every_rate, every_duration, np.array([speed]))
    moves[...] = arcs_of_turns.reshape(S, -1)
    return told


def _cheapest(cost: Float[np.ndarray, " n"], count: int) -> Int[np.ndarray, " some"]:
    """The cheapest sequences, in their own order; of equals those that come first."""
    if cost.size <= count:
        return np.arange(cost.size)
    ordered = cost.copy()
    ordered.partition(count - 1)
    dearer = cost > ordered[count - 1]  # what is no number counts as dearest, and is not dearer
    (among,) = (~dearer).nonzero()
    if among.size > count:
        among = np.sort(among[cost[among].argsort(kind="stable")[:count]])
    return among


def _followed_back(
    taken: list[tuple[np.ndarray, np.ndarray]], count: int
) -> tuple[list[int], list[np.ndarray]]:
    """Turns of the first sequence of the last beam, and the poses they began at.

    Of each stage: which branches were kept, ``count`` coming from each sequence, and where the
    sequences were.
    """
    turns, poses, k = [], [], 0
    for keep, pose in reversed(taken):
        k, turn = divmod(int(keep[k]), count)
        turns.append(turn)
        poses.append(pose[k])
    return turns[::-1], poses[::-1]


def _best(
    first: Float[np.ndarray, " n"],
    worst: Float[np.ndarray, " n"],
    cost: Float[np.ndarray, " n"],
    count: int,
    look: Look | None,
) -> tuple[Int[np.ndarray, " count"], Float[np.ndarray, " n"]]:
    """The best sequences, and how far each breaks a limit.

    No more are looked at than it takes to know the best.
    """
    order = np.lexsort((cost, worst, first))
    if look is None:
        return order[:count], worst
    worst, seen = worst.copy(), order[:0]
    least = first[order[0]]
    for begin in range(0, len(order), count):
        these = order[begin : begin + count]
        seen = order[: begin + count]
        worst[these] = np.maximum(worst[these], look(these))
        feasible = (first[seen] == least) & (worst[seen] == 0)
        if np.sum(feasible) >= count:
            break  # whatever comes later costs more, or breaks more
    best = np.lexsort((cost[seen], worst[seen], first[seen]))
    return seen[best[:count]], worst
