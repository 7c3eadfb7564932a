"""The run that the loop's arrays are a record of."""

from collections.abc import Mapping, Sequence

import numpy as np

from obsplan.planners import name_of
from obsplan.planning.interface import NamesCondition
from obsplan.run import AidTrack, Run, Timing
from obsplan.scenario import Scenario
from obsplan.simulation.step import Carry, Log


def record(
    scenario: Scenario,
    planners: Sequence[object],
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
    command = np.concatenate([carry.command[1:], carry.command[-1:]])
    aids = []
    for c in range(len(planners)):
        score, status = held(log, c)
        turn_rate, speed = command[:, c].T
        # copied: a view would keep all of the flight's memory
        aids.append(AidTrack(carry.cna[:, c].copy(), turn_rate, speed, score, status))
    first, planner = aids[0], planners[0]
    label = planner.condition_label if isinstance(planner, NamesCondition) else ""
    # decided at a step's beginning
    condition = np.concatenate([by_auv(log.condition)[..., 0], missing], axis=1)
    reports = np.concatenate([missing > 0, by_auv(log.report)[..., 0] > 0], axis=1)
    return Run(
        scenario=scenario,
        planner=name_of(planner),
        condition_label=label,
        seed=seed,
        time=scenario.time,
        cna=first.pose,
        turn_rate=first.turn_rate,
        speed=first.speed,
        others=tuple(aids[1:]),
        truth=by_auv(carry.truth),
        mean=by_auv(carry.mean),
        covariance=carry.covariance,
        # measured at the step's end
        ranges=measured(log.range),
        bearings=measured(log.bearing),
        fates=measured(log.fate),
        innovations=measured(log.innovation),
        innovation_variances=measured(log.innovation_variance),
        reports=reports,
        condition=condition,
        score=first.score,
        status=first.status,
        timing=timing,
        faults=faults,
    )


def held(log: Log, aid: int) -> tuple[np.ndarray, np.ndarray]:
    """Scores and statuses of an aid vehicle's decisions, each from the step's beginning on."""
    return np.append(log.score[:, aid, 0], np.nan), np.append(log.status[:, aid, 0], np.nan)


def measured(logged: np.ndarray) -> np.ndarray:
    """What was measured at the ends of steps (steps x AUVs x beacons), by beacon and AUV."""
    _, auvs, beacons = logged.shape
    none = np.full((beacons, auvs, 1), np.nan)
    return np.concatenate([none, np.moveaxis(logged, 0, -1).swapaxes(0, 1)], axis=-1)


def by_auv(a: np.ndarray) -> np.ndarray:
    """Swap the axes of samples and AUVs."""
    return np.ascontiguousarray(a.swapaxes(0, 1))
