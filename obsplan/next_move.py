"""Which turns are safe: the way to the next decision, and circles free to turn on after it."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from formulations.model.arcs import arcs
from obsplan.constraints import Constraints

MOVE_POINTS = 16  # at which the way to the next decision is held against the limits
LOITER_POINTS = 9  # at which a loiter in a current is held against the limits
ESCAPE_POINTS = 16  # at which what may follow the next decision is held against separations


class Stream(NamedTuple):
    """Water that carries the vehicle."""

    current: tuple[float, float] = (0.0, 0.0)  # east, north [m/s]
    turn: float = 0.0  # time [s] in which the vehicle sails its smallest circle

    def __bool__(self) -> bool:
        """Whether it flows."""
        return any(self.current)

    def drift(self, times: Float[np.ndarray, "*t"]) -> Float[np.ndarray, "*t 2"]:
        """How far [m] it has gone after times [s]."""
        return times[..., None] * np.array(self.current)

    def over_ground(
        self, places: Float[np.ndarray, "*batch T n"], times: Float[np.ndarray, " T"]
    ) -> Float[np.ndarray, "*batch T n"]:
        """Where places or poses in this water [m] are over ground at times from now [s]."""
        if not self:
            return places
        moved = places.copy()
        moved[..., :2] += self.drift(times)
        return moved


STILL = Stream()


def first_move_violation(
    constraints: Constraints,
    pose: Float[np.ndarray, "3"],
    turn_rates: Float[np.ndarray, " K"],
    *,
    speed: float,
    radius: float,
    interval: float,
    auvs: Callable[[Float[np.ndarray, " points"]], Float[np.ndarray, "points M 2"]],
    margin: Float[np.ndarray, " M"] | float = 0.0,
    stream: Stream = STILL,
    aids: int = 0,
) -> Float[np.ndarray, " K"]:
    """How far [m] each turn breaks a limit before the next decision, or without fail after it.

    A vehicle that cannot stop is safe for ever as long as one of its two smallest circles, with
    what it encloses, is within the fixed limits: turning on the free one keeps it free. These
    circles are the terminal safe set. So if the limiting turns are among the candidates and one
    circle is free now, some candidate always keeps within the fixed limits. In a current the
    circles are loiters (`loiter_violation`), which take finer steering than a candidate held until
    the next decision: there the last is not promised.

    Distances to vehicles that move are held to less: as they are expected to go on, one of the two
    smallest half circles, or going straight on for as long, must keep the separations after the
    next decision (`Escapes`). Of what comes after that nothing is promised.

    A fixed limit is preferred where no separation can be kept: whatever breaks one counts as worse
    than the worst that does not. Distances change by no more than the vehicles move. Half of that
    between the points looked at is added, so that nothing between them is missed before the next
    decision.

    Parameters
    ----------
    pose, turn_rates, speed, radius, interval
        Pose now (east, north [m], heading [rad]); candidates [rad/s]; speed [m/s]; smallest turning
        radius [m]; time until the next decision [s].
    auvs
        Positions of the AUVs [m] at times from now [s], over ground.
    margin
        By which separations are kept more than the limits say, per AUV [m].
    stream
        What carries the vehicle.
    aids
        How many of the last of ``auvs`` are other aid vehicles.
    """
    times = interval * np.arange(1, MOVE_POINTS + 1) / MOVE_POINTS
    in_water = arcs(pose, turn_rates, speed, times)
    poses = stream.over_ground(in_water, times)
    positions = poses[..., :2]
    half_step = 0.5 * (speed + math.hypot(*stream.current)) * interval / MOVE_POINTS
    centers, reach = _loiters(poses[:, -1], radius, stream)
    places = [positions, centers.reshape(len(centers), -1, 2)]
    away = constraints.fixed_violation(np.concatenate(places, axis=1))
    fixed = away[:, :MOVE_POINTS].max(axis=-1)
    if speed > 0 or stream:  # a vehicle at rest needs no circle
        loiters = away[:, MOVE_POINTS:].reshape(centers.shape[:-1]).max(axis=-1)
        fixed = np.maximum(fixed, (loiters + reach).min(axis=-1))
    known = auvs(np.append(0.0, times))
    strides = 0.5 * np.max(np.linalg.norm(np.diff(known, axis=0), axis=-1), axis=-1, initial=0.0)
    broken = constraints.separation_violation(positions, known[1:], margin, aids=aids)
    apart = np.max(broken + strides, axis=-1)
    if speed > 0 and (aids or constraints.separates):
        ways = Escapes(in_water[:, -1], interval, speed, radius, stream)
        apart = np.maximum(apart, ways.violation(constraints, auvs, margin, aids))
    worst = np.maximum(fixed, apart) + half_step
    return np.where(
        fixed + half_step > 0, worst + max(0.0, float(np.max(apart)) + half_step), worst
    )


class Escapes(NamedTuple):
    """What a vehicle can do after its next decision to stay away from others, or near them."""

    poses: Float[np.ndarray, "K 3"]  # at that decision, in the water [m, rad]
    begin: float  # when that is, from now [s]
    speed: float  # [m/s]
    radius: float  # of the smallest circle [m]
    stream: Stream

    def violation(
        self,
        constraints: Constraints,
        auvs: Callable[[Float[np.ndarray, " points"]], Float[np.ndarray, "points M 2"]],
        margin: Float[np.ndarray, " M"] | float,
        aids: int,
    ) -> Float[np.ndarray, " K"]:
        """How far [m] the best of them breaks a separation.

        They are the half circles to both sides, after which the vehicle is under way back, and
        straight on for as long.
        """
        limit = self.speed / self.radius
        since = np.pi / limit * np.arange(1, ESCAPE_POINTS + 1) / ESCAPE_POINTS
        turns = np.array([limit, 0.0, -limit])
        ways = arcs(self.poses[:, None], turns[None], self.speed, since)
        times = self.begin + since
        positions = self.stream.over_ground(ways, times)[..., :2]
        broken = constraints.separation_violation(positions, auvs(times), margin, aids=aids)
        return broken.max(axis=-1).min(axis=-1)


def loiter_violation(
    constraints: Constraints,
    poses: Float[np.ndarray, "*batch 3"],
    radius: float,
    stream: Stream = STILL,
) -> Float[np.ndarray, "*batch 2"]:
    r"""How far the smallest circles left and right of poses are outside the fixed limits [m].

    A circle counts with what it encloses. In a current c it is carried, and the vehicle stays by
    heading upstream once a turn: it completes its turn until it heads upstream, in a time τ, goes
    straight on until it has made good the way :math:`c T` of a whole turn, which it then begins.
    All the while it is within the radius of the line

    .. math:: \text{centre} + s c, \quad τ - T \le s \le τ,

    which is what counts there.
    """
    centers, reach = _loiters(poses, radius, stream)
    return constraints.fixed_violation(centers).max(axis=-1) + reach


def _loiters(
    poses: Float[np.ndarray, "*batch 3"], radius: float, stream: Stream
) -> tuple[Float[np.ndarray, "*batch 2 points 2"], float]:
    """Points [m] about which the vehicle loiters left and right of poses, and within what."""
    left = radius * np.stack([-np.sin(poses[..., 2]), np.cos(poses[..., 2])], axis=-1)
    centers = poses[..., None, :2] + np.array([[1.0], [-1.0]]) * left[..., None, :]
    if not stream:
        return centers[..., None, :], radius
    current = np.array(stream.current)
    upstream = math.atan2(-current[1], -current[0])
    turns = np.stack([upstream - poses[..., 2], poses[..., 2] - upstream], axis=-1)
    until = np.remainder(turns / (2 * np.pi), 1.0) * stream.turn
    back = stream.turn * np.linspace(0.0, 1.0, LOITER_POINTS)
    since = until[..., None] - back
    between = 0.5 * math.hypot(*current) * stream.turn / (LOITER_POINTS - 1)
    return centers[..., None, :] + since[..., None] * current, radius + between
