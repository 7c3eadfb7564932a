"""What planners are told at a decision: of the AUVs, and of the aid vehicles' own poses."""

from collections.abc import Callable, Sequence

import numpy as np

from formulations.model.covariance import unpack_array
from obsplan.scenario import Scenario
from obsplan.scenario.states import BASIC
from obsplan.simulation.doubt import doubts
from obsplan.simulation.step import Carry, Inputs
from obsplan.surveys import Reference
from obsplan.types import Belief, Hypothesis, Pose


def beliefs(
    scenario: Scenario,
    carry: Carry,
    inputs: Inputs,
    k: int,
    reported: Sequence[tuple[Hypothesis, ...]],
) -> list[Belief]:
    """What the planner is told of each AUV at step k; ``reported`` are hypotheses of each."""
    knowledge, now = scenario.table.planner.knowledge, float(inputs.time[k].item())
    known = {"survey": inputs.survey[k], "truth": carry.truth[k]}.get(knowledge)
    means = carry.reported[0] if known is None else known
    means = means[:, :BASIC].copy()  # of the truth, say, which no planner moves
    covariances = unpack_array(carry.reported_covariance[0])[:, :BASIC, :BASIC]
    for told_to_planner in (means, covariances):
        told_to_planner.setflags(write=False)
    depths, doubted = scenario.depths[k].tolist(), doubts(carry.reported_excess[0]).tolist()
    found = []
    for i, auv in enumerate(scenario.table.auv):
        along = None
        if knowledge != "estimate":
            along = route(scenario.references[i], means[i], now)
        belief = Belief(
            mean=means[i],
            covariance=covariances[i],
            process_noise=scenario.assumed_noises[i],
            weight=auv.weight,
            current=scenario.assumed_currents[i],
            depth=depths[i],
            doubt=doubted[i],
            route=along,
            hypotheses=reported[i] if known is None else (),
            checked=False,
        )
        found.append(belief)
    return found


def route(reference: Reference, mean: np.ndarray, now: float) -> Callable[[np.ndarray], np.ndarray]:
    """Positions ahead of where an AUV is known to be, the rest of its survey still before it."""
    off = mean[:2] - reference.position(now)
    return lambda ahead: reference.position(now + ahead) + off


def poses_of(carry: Carry, k: int) -> list[Pose]:
    """Poses of the aid vehicles at a step's beginning, with the turn rates they are still at."""
    known = zip(carry.cna[k].tolist(), carry.command[k, :, 0].tolist(), strict=True)
    return [Pose(x, y, heading, turn_rate) for (x, y, heading), turn_rate in known]
