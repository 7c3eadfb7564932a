"""Steering laws that planners share, as expressions."""

import math

import casadi as ca

from formulations.model.ties import TIE
from formulations.model.worth import best_distance
from obsplan.planning.expressions import Symbolic, Targets
from obsplan.planning.situation import Situation
from obsplan.vehicles import Unicycle

BENT = math.sqrt(0.75)  # root mean square second order of a range, over variance and distance
STEEPEST = 0.99  # sine of the largest crab angle: beyond it the vehicle cannot keep up anyway


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

    It keeps within the limit at the speed [m/s], by default the cruising speed. Onto the reverse
    course it turns left.
    """
    error = course - heading
    correction = cna.speed / look_ahead(cna) * _shorter_way(ca.atan2(ca.sin(error), ca.cos(error)))
    limit = (cna.speed if speed is None else speed) / cna.min_turn_radius
    return ca.fmax(-limit, ca.fmin(limit, turning + correction))


def _shorter_way(error: ca.SX) -> ca.SX:
    """The same error of course [rad]; half a turn is one to the left, whatever rounding says."""
    return ca.if_else(error < TIE - math.pi, error + 2 * math.pi, error)


def bearing(east: ca.SX, north: ca.SX, *, least: float, otherwise: ca.SX) -> ca.SX:
    """Bearing [rad] of a way [m]; otherwise another, where the way is no longer than rounding.

    That is relative to the least length [m] that counts elsewhere.
    """
    there = ca.hypot(east, north) > TIE * least
    return ca.if_else(there, ca.atan2(north, east), otherwise)


def telling_distance(situation: Situation, targets: Targets, least: Symbolic) -> Symbolic:
    """Distance [m] to keep: that at which ranges tell most over the AUVs' depth, at least another.

    The least where there is no such distance (`formulations.model.worth.best_distance`), as there
    is none where ranges are horizontal.
    """
    share = targets.weight / ca.sum1(targets.weight)
    least = ca.fmax(least, _doubted(situation, ca.vec(targets.doubt).T @ share))
    if not situation.ranging.slant:
        return least
    height = ca.vec(targets.depth - situation.transducer_depth).T @ share
    best = best_distance(situation.ranging, height)
    return ca.if_else(best < ca.inf, ca.fmax(least, best), least)


def greatest_doubt(situation: Situation) -> float:
    """Doubt [m] that keeps the vehicle at the radius of the surveys; a greater one counts as that.

    From farther nothing tells more. There is none without surveys, or where ranges are squared.
    """
    ranging, circle = situation.ranging, situation.survey_circle
    if circle is None or ranging.squared:
        return math.inf
    return math.sqrt(circle.radius * ranging.sigma / BENT)


def _doubted(situation: Situation, doubt: Symbolic) -> Symbolic:
    """Distance [m] from which the second order of a doubted position's range is its error at most.

    Squared ranges have as much of it at any distance.
    """
    ranging = situation.ranging
    if ranging.squared:
        return 0.0 * doubt
    return BENT * ca.fmin(doubt, greatest_doubt(situation)) ** 2 / ranging.sigma


def turn_along(
    cna: Unicycle,
    heading: ca.SX,
    tangent: ca.SX,
    *,
    velocity: ca.SX | ca.DM,
    radius: ca.SX | float,
    sense: ca.SX | float = 1.0,
) -> ca.SX:
    """Turn rate [rad/s] along a circle whose centre moves at a velocity [m/s].

    ``tangent`` is the course relative to the centre, ``sense`` 1 counter-clockwise, -1 clockwise.
    (Standoff tracking by a vector field: Frew, Lawrence and Morris 2008.)
    """
    # the centre's velocity along the tangent and to its left
    along, abeam = rotated(-tangent, velocity)
    crab = ca.asin(ca.fmax(-STEEPEST, ca.fmin(STEEPEST, abeam / cna.speed)))
    ahead = cna.speed * ca.cos(crab)
    turning = sense * (ahead - along) / radius  # of the tangent
    # the crab turns back by as much
    course, rate = tangent + crab, turning * (1 - along / ahead)
    return turn_toward(cna, heading, course, turning=rate)


def rotated(angle: ca.SX, vector: ca.SX | ca.DM) -> tuple[ca.SX, ca.SX]:
    """Components of a vector turned counter-clockwise."""
    c, s = ca.cos(angle), ca.sin(angle)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]
