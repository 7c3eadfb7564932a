"""What is done where there is nothing to plan for, or no decision to be had, and says why.

Where there is nothing to plan for, the aid vehicle goes straight on. Where a planner has failed it
holds its turn, or circles: so it stays near for as long as that lasts.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.arcs import arcs
from formulations.solution import Status
from obsplan.types import Belief, Decision, Pose
from obsplan.vehicles import Unicycle

PATH_POINTS = 21  # poses in a predicted path
WIDEST = 10.0  # smallest radii; a turn that is wider leads away, and is not held


def unusable(cna: Unicycle, pose: Pose, auvs: Sequence[Belief]) -> Decision | None:
    """Go straight on where no AUV has a weight, or a pose or a mean is not finite; else None."""
    if not any(auv.weight > 0 for auv in auvs):
        return straight_on(cna, pose, Status.NO_TARGETS, len(auvs))
    known = [[pose.x, pose.y, pose.heading, pose.turn_rate], *(auv.mean for auv in auvs)]
    if np.isfinite(known).all():
        return None
    return straight_on(cna, pose, Status.INVALID_INPUT, len(auvs))


def straight_on(cna: Unicycle, pose: Pose, status: Status, n_auvs: int) -> Decision:
    """Go straight on at cruising speed, with the status that made it necessary."""
    return Decision(
        turn_rate=0.0,
        speed=cna.speed,
        predict=partial(predict_path, cna, pose, 0.0, cna.speed),
        status=status,
        condition=np.full(n_auvs, np.nan),
    )


def hold_turn(cna: Unicycle, pose: Pose, status: Status, n_auvs: int) -> Decision:
    """Hold the present turn at cruising speed, or circle, with the status that made it necessary.

    See `held_turn_rate`.
    """
    turn_rate = float(held_turn_rate(cna, pose.turn_rate))
    return Decision(
        turn_rate=turn_rate,
        speed=cna.speed,
        predict=partial(predict_path, cna, pose, turn_rate, cna.speed),
        status=status,
        condition=np.full(n_auvs, np.nan),
    )


def held_turn_rate(cna: Unicycle, turn_rate: Any) -> Any:
    """The present turn rate [rad/s] within the vehicle's limit, as an expression.

    It is that of the smallest circle, to the left, where the vehicle goes straight on or on a
    circle of more than `WIDEST` of its smallest radii.
    """
    limit = cna.max_turn_rate
    within = ca.fmin(ca.fmax(turn_rate, -limit), limit)
    return ca.if_else(ca.fabs(turn_rate) * WIDEST >= limit, within, limit)


def predict_path(
    cna: Unicycle, pose: Pose, turn_rate: float, speed: float
) -> Float[np.ndarray, "steps 3"]:
    """Poses on the arc held for two thirds of the smallest circle, the thesis's horizon."""
    times = np.linspace(0.0, two_thirds_turn(cna), PATH_POINTS)
    return arcs(np.array([pose.x, pose.y, pose.heading]), np.array(turn_rate), speed, times)


def two_thirds_turn(cna: Unicycle) -> float:
    """Time [s] the vehicle needs for two thirds of its smallest circle (thesis 4.2)."""
    return 2.0 / 3.0 * 2.0 * np.pi * cna.min_turn_radius / cna.speed
