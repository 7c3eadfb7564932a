"""Steering laws that planners share, as expressions."""

import casadi as ca

from obsplan.vehicles import Unicycle


def look_ahead(cna: Unicycle) -> float:
    """Distance [m] over which errors of course and place are corrected: the turning diameter."""
    return 2.0 * cna.min_turn_radius


def turn_toward(
    cna: Unicycle,
    heading: ca.SX,
    course: ca.SX,
    *,
    turning: ca.SX | float = 0.0,
    speed: ca.SX | None = None,
) -> ca.SX:
    """Turn rate [rad/s] onto a course that itself turns at a rate.

    It keeps within the limit at the speed [m/s], by default the cruising speed.
    """
    error = course - heading
    correction = cna.speed / look_ahead(cna) * ca.atan2(ca.sin(error), ca.cos(error))
    limit = (cna.speed if speed is None else speed) / cna.min_turn_radius
    return ca.fmax(-limit, ca.fmin(limit, turning + correction))
