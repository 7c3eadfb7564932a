"""The run that the loop's arrays are a record of."""

from collections.abc import Mapping

import numpy as np

from obsplan.planners import name_of
from obsplan.planning.interface import NamesCondition
from obsplan.run import Run, Timing
from obsplan.scenario import Scenario
from obsplan.simulation.step import Carry, Log


def record(
    scenario: Scenario,
    planner: object,
    seed: int,
    carry: Carry,
    log: Log,
    timing: Timing,
    faults: Mapping[str, str],
) -> Run:
    """Make a run of the loop's carries and logs.

    Carries have the axes (samples, AUVs, rows), but covariances those of a run; logs (steps, AUVs,
    rows).
    """
    missing = np.full((len(scenario.table.auv), 1), np.nan)
    # a carry's command is that of the step before
    command = np.concatenate([carry.command[1:, 0], carry.command[-1:, 0]])
    turn_rate, speed = command.T
    label = planner.condition_label if isinstance(planner, NamesCondition) else ""
    return Run(
        scenario=scenario,
        planner=name_of(planner),
        condition_label=label,
        seed=seed,
        time=scenario.time,
        cna=carry.cna[:, 0],
        turn_rate=turn_rate,
        speed=speed,
        truth=by_auv(carry.truth),
        mean=by_auv(carry.mean),
        covariance=carry.covariance,
        # measured at the step's end
        range=np.concatenate([missing, by_auv(log.range)[..., 0]], axis=1),
        # decided at its beginning
        condition=np.concatenate([by_auv(log.condition)[..., 0], missing], axis=1),
        score=np.append(log.score[:, 0, 0], np.nan),
        status=np.append(log.status[:, 0, 0], np.nan),
        timing=timing,
        faults=faults,
    )


def by_auv(a: np.ndarray) -> np.ndarray:
    """Swap the axes of samples and AUVs."""
    return np.ascontiguousarray(a.swapaxes(0, 1))
