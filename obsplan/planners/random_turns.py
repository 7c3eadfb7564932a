"""Random turns: what a planner has to beat to be worth anything."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np

from formulations.model.schedule import intervals
from formulations.solution import Status
from obsplan.planning.checks import check_situation
from obsplan.planning.fallback import predict_path, straight_on
from obsplan.planning.situation import Situation
from obsplan.quantities import INTERVAL, SEED
from obsplan.types import Belief, Decision, Pose

PLANNER_STREAM = 2  # of a mission's streams: process, measurement, planner


@dataclass(frozen=True)
class RandomTurns:
    """Hold turn rates drawn evenly between the limits, each equally long, whatever the AUVs do.

    The draws follow from the seed and the time alone: the same time has the same turn, however
    often it is asked for. There is no score. Outside a mission the default seed is 0.
    """

    condition_label = ""

    situation: Situation
    _: KW_ONLY
    seed: Annotated[int | None, "of the turns; default: the mission's", SEED] = None
    hold: Annotated[float, "time a turn is held [s]", INTERVAL] = 5.0

    def __post_init__(self) -> None:
        check_situation(self)

    def for_mission(self, seed: int) -> "RandomTurns":
        """The planner of a mission flown under a seed."""
        return self if self.seed is not None else replace(self, seed=seed)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Draw the turn of this time; the generator's counter is the number of turns before."""
        cna = self.situation.cna
        if not np.isfinite([pose.x, pose.y, pose.heading, pose.turn_rate]).all():
            return straight_on(cna, pose, Status.INVALID_INPUT, len(auvs))
        key = np.random.SeedSequence(self.seed or 0, spawn_key=(PLANNER_STREAM,)).generate_state(
            2, np.uint64
        )
        turn = int(intervals(time, self.hold))
        limit = cna.max_turn_rate
        turn_rate = float(
            np.random.Generator(np.random.Philox(key=key, counter=turn)).uniform(-limit, limit)
        )
        return Decision(
            turn_rate=turn_rate,
            speed=cna.speed,
            predict=partial(predict_path, cna, pose, turn_rate, cna.speed),
            score=0.0,
            condition=np.full(len(auvs), np.nan),
        )
