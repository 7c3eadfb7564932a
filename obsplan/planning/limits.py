"""Keep planners that know no limits within the scenario's, and say where AUVs are expected."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from formulations.solution import Status
from obsplan.constraints import first_move_violation
from obsplan.planning.fallback import predict_path
from obsplan.planning.situation import Situation
from obsplan.types import Belief, Decision, Pose

SURE = 3.0  # standard deviations of an AUV's position, added to separations
CANDIDATES = 21  # turns tried in place of one that breaks a limit

Expected = Callable[[Float[np.ndarray, " T"]], Float[np.ndarray, "T M 2"]]


def expected(auvs: Sequence[Belief]) -> tuple[Expected, Float[np.ndarray, " M"]]:
    """Where AUVs are expected [m] at times from now [s], and the margin [m] to keep from each.

    The margin is for not knowing where it is; none where that is unknown, too.
    """
    var_east, covariance, var_north = (
        np.array([auv.covariance[[0, 0, 1], [0, 1, 1]] for auv in auvs]).reshape(-1, 3).T
    )
    largest = (var_east + var_north) / 2 + np.hypot((var_east - var_north) / 2, covariance)

    def ahead(times):
        return (
            np.array([auv.ahead(times) for auv in auvs])
            .reshape(len(auvs), len(times), 2)
            .swapaxes(0, 1)
        )

    return ahead, SURE * np.sqrt(np.where(np.isfinite(largest), np.maximum(largest, 0.0), 0.0))


def within_limits(
    wanted: Decision,
    pose: Pose,
    auvs: Sequence[Belief],
    situation: Situation,
) -> Decision:
    """Replace a manoeuvre that breaks a limit by the nearest turn that breaks none.

    A manoeuvre breaks one before the next decision, or by leaving no circle to turn on. If every
    turn does, the least violating one is taken. The status says which. Beliefs that are not
    finite count for nothing.
    """
    state = np.array([pose.x, pose.y, pose.heading])
    if not np.isfinite(state).all():
        return wanted
    cna = situation.cna
    limit = wanted.speed / cna.min_turn_radius
    turn_rates = np.concatenate([[wanted.turn_rate], np.linspace(limit, -limit, CANDIDATES)])
    ahead, margin = expected([auv for auv in auvs if np.isfinite(auv.mean).all()])
    violation = first_move_violation(
        situation.constraints,
        state,
        turn_rates,
        speed=wanted.speed,
        radius=cna.min_turn_radius,
        interval=situation.decision_interval,
        auvs=ahead,
        margin=margin,
    )
    broken = np.maximum(violation, 0.0)
    if broken[0] == 0:
        return wanted
    k = np.lexsort((abs(turn_rates - wanted.turn_rate), broken))[0]
    turn_rate, status = float(turn_rates[k]), Status.VIOLATED if broken[k] > 0 else Status.LIMITED
    return replace(
        wanted,
        turn_rate=turn_rate,
        predict=partial(predict_path, cna, pose, turn_rate, wanted.speed),
        status=status,
    )
