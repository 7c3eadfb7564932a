"""The search: what is told of each stage, and the sequence it ends with."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.arcs import arcs
from ..model.covariance import Tracks, motions, pack_array
from ..model.ranging import Ranging
from ..model.schedule import Stages
from ..solution import Solution, Status
from .branching import AT_RANGES, AUV, CRITERIA, LAW, Kind, branching, told_sizes
from .compiled import Compiled, machine_code
from .interpreted import Interpreted
from .limits import Limits
from .selection import Feasibility, Violation
from .to_go import NOTHING, ToGo


class Link(NamedTuple):
    """What it costs that throughput falls with distance; see `formulations.model.ranging`."""

    weight: float = 0.0  # of the share that is lost, in the criterion's unit
    half_distance: float = np.inf  # at which half is left [m]


FREE = Link()


def turn_candidates(max_turn_rate: float, count: int) -> Float[np.ndarray, " K"]:
    """Turn rates to try at each stage [rad/s], from left to right.

    Straight on, and pairs that fall off threefold from the limit.
    """
    side = max_turn_rate / 3.0 ** np.arange(count // 2)
    return np.concatenate([side, [0.0], -side[::-1]])


def search_manoeuvres(
    pose: Float[np.ndarray, "3"],
    covariance: Float[np.ndarray, "M n n"],
    *,
    tracks: Tracks,
    process_noise: Float[np.ndarray, "M n"],
    weights: Float[np.ndarray, " M"],
    stages: Stages,
    turn_rates: Float[np.ndarray, " K"],
    speed: float,
    ranging: Ranging,
    criterion: str = "trace",
    beam_width: int = 32,
    violation: Violation | None = None,
    first_violation: Float[np.ndarray, " K"] | None = None,
    limits: Limits | None = None,
    known: Float[np.ndarray, "S M 2 2"] | None = None,
    link: Link = FREE,
    doubts: Float[np.ndarray, " M"] | None = None,
    to_go: ToGo = NOTHING,
) -> Solution:
    """Find the turns, one a stage, after which the AUVs' position covariances are smallest.

    Parameters
    ----------
    pose
        Of the aid vehicle: east, north [m], heading [rad].
    covariance, process_noise
        Of each AUV's state now; standard deviations of its random walk per square root of a second.
        A fifth state is the depth [m], and then part of the position.
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
        that break them least later, of these the cheapest by what they cost and what is to come.
    violation
        How far [m] positions (..., T, 2) at times from now [s] are on the wrong side of a limit, at
        most 0 where they are right.
    first_violation
        How far [m] each turn breaks a limit as the first one.
    limits
        What ``violation`` says as numbers, where there are any: asked instead of it where there is
        a compiler.
    known
        Information [1/m^2] on each AUV's position at the end of each stage that does not come from
        this vehicle: ranges to others.
    link
        What throughput costs that is lost by distance, at the end of each stage, to be added to the
        criterion of each AUV. Nothing is left beyond the ranging's reach.
    doubts
        Standard deviations [m] of each coordinate by which AUVs may be elsewhere, besides what
        their covariances say: the second order of ranges counts them, so the vehicle keeps a
        distance. Default: 0.
    to_go
        What the distance from the AUVs will cost beyond the horizon (`cost_to_go`): added at each
        stage, for the distance there alone, to what sequences are ranked by. Distances are slant
        where ranges are. Default: nothing.

    Returns
    -------
    The best sequence of the last beam; of equals the one that comes first, turning left. ``x``:
    turn rates [rad/s]. ``poses``: at the beginning and the ends of the stages. ``objective``: the
    criterion, and what lost throughput costs, without what is to come. Primal residual: how far it
    breaks a limit at the points looked at [m]. The status is the first turn's, which is the one
    that is taken: ``VIOLATED`` where each breaks a limit, and ``INVALID_INPUT`` where the criterion
    is no number.

    Raises
    ------
    ValueError
        A criterion that is not known; numbers of AUVs or stages that are not the same everywhere.
    """
    S, M, K = len(stages.duration), len(weights), len(turn_rates)
    _check_shapes(covariance, process_noise, tracks, M, S)
    width = min(beam_width, K**S)
    doubts = np.zeros(M) if doubts is None else doubts
    kind = Kind(
        M,
        K,
        ranging.form,
        criterion,
        covariance.shape[-1],
        aided=known is not None,
        linked=link.weight > 0,
        doubted=bool(doubts.any()),
    )
    sequences = beam_of(kind, S, width)
    told = _told(
        tracks,
        process_noise,
        weights,
        stages,
        turn_rates,
        speed,
        ranging,
        known=known,
        link=link,
        doubts=doubts,
        to_go=to_go,
    )
    sequences.begin(pose, pack_array(covariance))
    if violation is None and first_violation is None:
        sequences.search(told)
        return _solution(sequences, told, turn_rates, 0.0, 0.0)
    feasible = Feasibility(
        violation,
        np.zeros(K) if first_violation is None else first_violation,
        turn_rates=turn_rates,
        speed=speed,
        durations=stages.duration,
        limits=limits,
    )
    broken = _within_limits(sequences, feasible, told, width)
    return _solution(sequences, told, turn_rates, *broken)


def _solution(
    sequences: Compiled | Interpreted,
    told: Float[np.ndarray, "S told"],
    turn_rates: Float[np.ndarray, " K"],
    first: float,
    worst: float,
) -> Solution:
    """The first sequence of the last beam, of which two violations [m] are known."""
    cost, turns, poses = sequences.first(told)
    return Solution(
        x=turn_rates[turns],
        objective=cost,
        status=_status(cost, first),
        primal_residual=max(first, worst),
        poses=poses,
    )


def _check_shapes(
    covariance: np.ndarray, process_noise: np.ndarray, tracks: Tracks, M: int, S: int
) -> None:
    """Refuse arrays that machine code would read beyond the end of."""
    n = covariance.shape[-1]
    wrong = n not in (4, 5) or process_noise.shape != (M, n)
    if wrong or covariance.shape != (M, n, n) or tracks.position.shape != (S, M, 2):
        raise ValueError(
            f"give covariances and tracks of {M} AUVs, as there are weights, over {S} stages, "
            f"got {covariance.shape} and {tracks.position.shape}"
        )


def _within_limits(
    sequences: Compiled | Interpreted,
    feasible: Feasibility,
    told: Float[np.ndarray, "S told"],
    width: int,
) -> tuple[float, float]:
    """Go through all stages; how far [m] the best's first turn, and all of it, break a limit."""
    for of_stage in told:
        cost = sequences.branch(of_stage)
        sequences.follow(feasible.best(sequences.pose, cost, width))
    return float(feasible.first[0]), float(feasible.worst[0])


def _status(cost: float, first_violation: float) -> Status:
    if not np.isfinite(cost):
        return Status.INVALID_INPUT
    return Status.VIOLATED if first_violation > 0 else Status.OPTIMAL


@lru_cache(maxsize=16)
def beam_of(kind: Kind, stages: int, width: int) -> Compiled | Interpreted:
    """What a search works with, as machine code where there is a compiler.

    Raises ValueError for a criterion that is not known.
    """
    if kind.criterion not in CRITERIA:
        raise ValueError(f'criterion must be one of {", ".join(CRITERIA)}, got "{kind.criterion}"')
    library = machine_code(kind)
    if library is None:
        return Interpreted(branching(kind), kind.turns, width)
    return Compiled(library, kind, stages, width)


def _told(
    tracks: Tracks,
    process_noise: Float[np.ndarray, "M n"],
    weights: Float[np.ndarray, " M"],
    stages: Stages,
    turn_rates: Float[np.ndarray, " K"],
    speed: float,
    ranging: Ranging,
    known: Float[np.ndarray, "S M 2 2"] | None = None,
    link: Link = FREE,
    doubts: Float[np.ndarray, " M"] | float = 0.0,
    to_go: ToGo = NOTHING,
) -> Float[np.ndarray, "S told"]:
    """What a branching is told at each stage; see `branching`."""
    S, M = tracks.heading.shape
    of_auvs, of_stage, of_moves = told_sizes(M, len(turn_rates))
    told = np.zeros((S, of_auvs + of_stage + of_moves))
    auv = told[:, :of_auvs].reshape(S, M, len(AUV))
    stage = told[:, of_auvs : of_auvs + of_stage]
    moves = told[:, of_auvs + of_stage :]
    at = len(AT_RANGES)
    there = auv[..., at : 2 * at]
    there[..., :2] = tracks.position
    there[..., 2] = tracks.height
    there[..., 3] = stages.pings if stages.pings.ndim > 1 else stages.pings[:, None]
    if known is not None:
        there[..., 4:] = roots(known)
    auv[1:, :, :at] = there[:-1]  # no ranges before the first stage
    auv[..., 2 * at : 2 * at + 3] = motions(tracks.heading, tracks.speed)
    auv[..., 2 * at + 3 : 2 * at + 3 + process_noise.shape[1]] = process_noise
    auv[..., AUV.index("doubt")] = doubts
    weight = weights / weights.sum()
    auv[..., AUV.index("weight")] = weight
    auv[..., AUV.index("per_metre")] = weight * to_go.per_metre
    auv[..., AUV.index("near")] = to_go.near
    stage[:, 0] = stages.duration
    stage[:, 1] = stages.duration / stages.duration.sum()
    stage[:, 2 : 2 + len(LAW)] = ranging.numbers
    stage[:, 2 + len(LAW) :] = link.weight, 1 / link.half_distance
    rates = tuple(turn_rates.tolist())
    for s, duration in enumerate(stages.duration.tolist()):
        moves[s] = _moves_of(rates, duration, speed)
    return told


def roots(information: Float[np.ndarray, "*batch 2 2"]) -> Float[np.ndarray, "*batch 3"]:
    """Lower triangular roots by columns of information matrices [1/m^2], which may be singular."""
    east, both, north = information[..., 0, 0], information[..., 0, 1], information[..., 1, 1]
    first = np.sqrt(east)
    below = np.divide(both, first, out=np.zeros_like(both), where=first > 0)
    last = np.sqrt(np.maximum(north - below**2, 0.0))
    return np.stack([first, below, last], axis=-1)


@lru_cache(maxsize=256)
def _moves_of(turn_rates: tuple[float, ...], duration: float, speed: float) -> np.ndarray:
    """Arcs from the origin, one after the other."""
    ends = arcs(np.zeros(3), np.array(turn_rates), speed, np.array([duration]))
    return ends.ravel()
