"""Information horizon: take the turns after which the AUVs will know most."""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float

from formulations.beam_search import (
    Link,
    cost_to_go,
    search_manoeuvres,
    turn_candidates,
)
from formulations.model.covariance import DEPTH, Tracks
from formulations.model.schedule import Stages
from formulations.solution import Solution, Status
from obsplan.constraints import Constraints
from obsplan.planning.checks import check_situation
from obsplan.planning.companion import Companion, Turns, told
from obsplan.planning.fallback import straight_on, unusable
from obsplan.planning.limits import LimitsAhead, positions_ahead
from obsplan.planning.situation import Situation
from obsplan.planning.steering import greatest_doubt
from obsplan.quantities import BEAM_WIDTH, BRANCHES, INTERVAL, LINK_WEIGHT, STAGES
from obsplan.types import Belief, Decision, Pose

STILL = 1e-9  # [m/s]; slower is at rest but for rounding, which has no direction
KNOWN_DEPTH = 1e-6  # [m]; beside an AUV that estimates its depth, another's has a log-determinant


@dataclass(frozen=True)
class InformationHorizon:
    """Search a tree of constant turns for the least predicted position covariance of the AUVs.

    Each AUV's own covariance is predicted along its route, with its process noise. Ranges come at
    the pings, and their second-order error is counted (`formulations.model.covariance`). Where a
    belief's covariance has a depth, that is part of the position. The tree has ``stages`` levels of
    ``turn_rates`` branches; a beam of ``beam_width`` is kept. Where pings are rare, a stage lasts
    from ping to ping and the horizon is that much longer.

    Where pings are frequent, a stage should not leave time for a whole circle: a plan that begins
    with one goes nowhere for as long as decisions come more often than stages end.

    Where a position is doubted (`Belief.doubt`), the second-order error is that of where the AUV
    may be, so that the vehicle keeps a distance from which its ranges still tell.

    What ranges to moored beacons and other aid vehicles are expected to tell is counted as well
    (`obsplan.planning.companion.told`).

    Sequences are ranked at each level by the criterion so far and by what their distance from the
    AUVs will cost beyond the horizon (`formulations.beam_search.to_go`), so that a vehicle that is
    far away comes back.

    A turn that breaks a limit, or leaves no circle free to turn on, is discarded. If all do, the
    least violating is taken and the status says so. ``score`` is the mean of the criterion over
    the horizon, [m^2] or [-], without what comes later.

    With a ``communication_weight`` the share of throughput that is lost by distance, times that
    weight, is added to each AUV's criterion, and so to the score.
    """

    condition_label = ""

    situation: Situation
    _: KW_ONLY
    criterion: Annotated[
        Literal["trace", "log-det"], "of the position covariance, averaged over the horizon"
    ] = "trace"
    horizon: Annotated[float, "least look-ahead [s]", INTERVAL] = 20.0
    stages: Annotated[int, "levels of the tree", STAGES] = 6
    turn_rates: Annotated[int, "branches at each level, odd", BRANCHES] = 7
    beam_width: Annotated[int, "sequences kept at each level", BEAM_WIDTH] = 128
    communication_weight: Annotated[
        float,
        "of the share of throughput that is lost, added to the criterion, in its unit [m^2 or -]",
        LINK_WEIGHT,
    ] = 0.0

    def __post_init__(self) -> None:
        check_situation(self)
        if self.turn_rates < 3 or self.turn_rates % 2 == 0:
            raise ValueError(
                "turn_rates must be odd and at least 3, straight on and pairs, "
                f"got {self.turn_rates}: add one"
            )
        told = self.situation
        if self.communication_weight and not told.throughput_half_distance < np.inf:
            raise ValueError(
                f"communication_weight = {self.communication_weight:g} weighs a throughput that "
                "falls with distance, and it does not: give communication.throughput_half_distance"
            )

    @property
    def constraints(self) -> Constraints:
        """The limits it keeps within."""
        return self.situation.constraints

    @cached_property
    def _candidates(self) -> Float[np.ndarray, " K"]:
        """Turn rates to try at each stage [rad/s]."""
        return turn_candidates(self.situation.cna.max_turn_rate, self.turn_rates)

    def prepare(self, pose: Pose, progress: Callable[[int, int], None]) -> None:  # noqa: ARG002
        """Compile the search before the mission, so that no decision waits for that."""
        filed = self.situation.filed
        if filed is not None:
            self.build(pose, filed.beliefs_at(0))

    def build(self, pose: Pose, auvs: Sequence[Belief]) -> None:
        """Compile the search for as many AUVs, and decide once.

        It takes a second or two, once for each number of AUVs on a machine, and nothing without a
        compiler. Where it was not called the first decision takes that long.
        """
        self.plan(pose, auvs)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose the first turn of the best sequence found."""
        return self.plan_among(pose, auvs, (), time=time)

    def plan_among(
        self,
        pose: Pose,
        auvs: Sequence[Belief],
        companions: Sequence[Companion],
        *,
        time: float = 0.0,
    ) -> Decision:
        """The same, other aid vehicles' plans being known."""
        known = (*self.situation.companions, *companions)
        return unusable(self.situation.cna, pose, auvs) or self._search(pose, auvs, known, time)

    def _search(
        self, pose: Pose, auvs: Sequence[Belief], companions: Sequence[Companion], time: float
    ) -> Decision:
        cna = self.situation.cna
        schedule = self.situation.schedule
        stages = schedule.stages(time, self.horizon, self.stages, len(auvs))
        best = self._best(pose, auvs, companions, time, stages)
        if best is None or not np.isfinite(best.objective):  # what is told is no number
            return straight_on(cna, pose, Status.INVALID_INPUT, len(auvs))
        turns, lasting = tuple(best.x.tolist()), tuple(stages.duration.tolist())
        return Decision(
            turn_rate=turns[0],
            speed=cna.speed,
            predict=lambda: best.poses,
            score=best.objective,
            status=best.status,
            condition=np.full(len(auvs), np.nan),
            lasting=stages.duration,
            route=Turns(pose, turns, cna.speed, lasting, self.situation.current),
        )

    def _best(
        self,
        pose: Pose,
        auvs: Sequence[Belief],
        companions: Sequence[Companion],
        time: float,
        stages: Stages,
    ) -> Solution | None:
        """The best sequence found; None where a covariance is no number."""
        cna = self.situation.cna
        covariance, process_noise = believed(auvs)
        if not np.isfinite(covariance).all():
            return None
        state, turn_rates = np.array([pose.x, pose.y, pose.heading]), self._candidates
        doubts = np.minimum([auv.doubt for auv in auvs], greatest_doubt(self.situation))
        to_go = cost_to_go(
            covariance,
            ranging=self.situation.ranging,
            speed=cna.speed,
            horizon=float(stages.duration.sum()),
            criterion=self.criterion,
        )
        limits = LimitsAhead(self.situation, auvs, companions) if self.constraints else None
        return search_manoeuvres(
            state,
            covariance,
            tracks=predicted_tracks(auvs, stages, self.situation.transducer_depth),
            process_noise=process_noise,
            weights=np.array([auv.weight for auv in auvs], dtype=float),
            stages=stages,
            turn_rates=turn_rates,
            speed=cna.speed,
            ranging=self.situation.ranging,
            criterion=self.criterion,
            beam_width=self.beam_width,
            link=Link(self.communication_weight, self.situation.throughput_half_distance),
            violation=None if limits is None else limits.along,
            limits=None if limits is None else limits.numbers(),
            first_violation=None
            if limits is None
            else limits.first_move(state, turn_rates, cna.speed),
            to_go=to_go,
            doubts=doubts,
            known=told(companions, auvs, time, stages, self.situation.current),
        )


def believed(
    auvs: Sequence[Belief],
) -> tuple[Float[np.ndarray, "M n n"], Float[np.ndarray, "M n"]]:
    """Covariances and process noises of the AUVs, with a depth where it is a state of any."""
    noises = np.array([auv.process_noise for auv in auvs])[:, [0, 0, 1, 2]]
    deep = [len(auv.covariance) > DEPTH for auv in auvs]
    if not any(deep):
        return np.array([auv.covariance for auv in auvs]), noises
    P = np.zeros((len(auvs), DEPTH + 1, DEPTH + 1))
    P[:, DEPTH, DEPTH] = KNOWN_DEPTH**2
    for i, auv in enumerate(auvs):
        n = len(auv.covariance)
        P[i, :n, :n] = auv.covariance
    depth_noise = np.array([auv.depth_noise for auv in auvs]) * deep
    return P, np.column_stack([noises, depth_noise])


def predicted_tracks(
    auvs: Sequence[Belief], stages: Stages, transducer_depth: float = 0.0
) -> Tracks:
    """Where the AUVs are expected at the end of each stage, and how they move during it.

    The motion is their mean velocity through the water; one at rest heads as it is believed to.
    """
    ends = np.zeros(stages.duration.size + 1)
    stages.duration.cumsum(out=ends[1:])
    position = positions_ahead(auvs, ends)
    moved = position[1:] - position[:-1]
    water = moved / stages.duration[:, None, None] - np.array([auv.current for auv in auvs])
    speed = np.hypot(water[..., 0], water[..., 1])
    way = np.arctan2(water[..., 1], water[..., 0])
    heading = np.where(speed <= STILL, [auv.mean[2] for auv in auvs], way)
    heights = [auv.depth - transducer_depth for auv in auvs]
    return Tracks(position[1:], heading, speed, np.array([heights] * len(moved)))
