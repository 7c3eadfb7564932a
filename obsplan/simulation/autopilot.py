"""A mission as an autopilot sails it: from waypoint to waypoint, at the speeds it was given."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from formulations.model.arcs import one_arc
from formulations.solution import Status
from obsplan.missions import Track
from obsplan.types import Belief, Decision, Pose
from obsplan.vehicles import Unicycle

LOOK_AHEAD = 2.0  # acceptance radii


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedPath:
    """A planner that has fixed all commands beforehand, whatever is measured on the way."""

    commands: Float[np.ndarray, "steps 2"]  # turn rate [rad/s] and speed [m/s] over each time step
    time_step: float  # [s]

    def plan(
        self,
        pose: Pose,  # noqa: ARG002
        auvs: Sequence[Belief],  # noqa: ARG002
        *,
        time: float = 0.0,
    ) -> Decision:
        """Look up the command of a time."""
        step = min(round(time / self.time_step), len(self.commands) - 1)
        turn_rate, speed = self.commands[step].tolist()
        return Decision(turn_rate=turn_rate, speed=speed, status=Status.OPTIMAL)


@dataclass(frozen=True, kw_only=True)
class Autopilot:
    """Steers a vehicle along the lines between waypoints by pure pursuit (Coulter 1992).

    It aims at the point of these lines that is a look-ahead farther than the vehicle, and turns on
    the arc that leads there. A waypoint is reached within the acceptance radius, or when passed.
    """

    cna: Unicycle
    acceptance: float  # [m]

    def commands(
        self,
        track: Track,
        start: Pose,
        *,
        time_step: float,
        steps: int,
        late: float = 0.0,
        stream: Float[np.ndarray, "steps 2"] | None = None,
    ) -> Float[np.ndarray, "steps 2"]:
        """Turn rate [rad/s] and speed [m/s] over each time step; at rest before and after.

        In a stream both are through the water: it crabs to hold its lines and speeds over ground,
        and drifts while it waits.

        Parameters
        ----------
        track
            Waypoints in local metres, with the speed of each leg [m/s] and holds [s].
        late
            Time [s] for which the vehicle waits at the start.
        stream
            Current that carries the vehicle over each time step, east and north [m/s].
        """
        waiting = min(round(late / time_step), steps)
        progress = _Progress(track, start, self, time_step)
        done = np.zeros((steps, 2))
        currents = [(0.0, 0.0)] * steps if stream is None else stream.tolist()
        pose = start
        for k, current in enumerate(currents):
            if k >= waiting:
                done[k] = progress.command(pose, current)
            turn_rate, speed = done[k].tolist()
            pose = carried(moved(pose, turn_rate, speed, time_step), current, time_step)
        return done


class _Progress:
    """How far a vehicle has come on its mission."""

    def __init__(self, track: Track, start: Pose, autopilot: Autopilot, time_step: float) -> None:
        corners = np.vstack([[start.x, start.y], track.points])
        speeds = [autopilot.cna.speed] if track.speed is None else track.speed.tolist()
        self.cna, self.acceptance, self.time_step = autopilot.cna, autopilot.acceptance, time_step
        self.corners: list[list[float]] = corners.tolist()
        self.lengths: list[float] = np.hypot(*np.diff(corners, axis=0).T).tolist()
        self.speeds: list[float] = [speeds[0], *speeds]
        self.holds = [0.0] * len(track.points) if track.hold is None else track.hold.tolist()
        self.leg = 0  # to the first waypoint
        self.waiting = 0.0  # [s]

    @property
    def is_done(self) -> bool:
        """Whether the last waypoint has been reached."""
        return self.leg == len(self.lengths)

    def command(self, pose: Pose, current: Sequence[float]) -> tuple[float, float]:
        """Turn rate [rad/s] and speed [m/s] over the next time step, in a current [m/s]."""
        while self.waiting <= 0 and not self.is_done and self._has_reached(pose):
            self.waiting = self.holds[self.leg]
            self.leg += 1
        if self.waiting > 0 or self.is_done:
            self.waiting -= self.time_step
            return 0.0, 0.0
        speed = self.speeds[self.leg]
        look_ahead = max(LOOK_AHEAD * self.acceptance, 2.0 * speed * self.time_step)
        aim = self._aim(pose, look_ahead)
        if any(current):
            aim, speed = through_water(pose, aim, speed, current)
            speed = min(speed, self.cna.speed)
        return pursue(pose, aim, speed, self.cna), speed

    def _has_reached(self, pose: Pose) -> bool:
        x, y = self.corners[self.leg + 1]
        near = math.hypot(x - pose.x, y - pose.y) <= self.acceptance
        return near or self._along(pose) >= self.lengths[self.leg]

    def _along(self, pose: Pose) -> float:
        """How far along its leg the vehicle is [m]."""
        (x0, y0), (x1, y1) = self.corners[self.leg : self.leg + 2]
        length = self.lengths[self.leg]
        if length == 0:
            return 0.0
        return ((pose.x - x0) * (x1 - x0) + (pose.y - y0) * (y1 - y0)) / length

    def _aim(self, pose: Pose, look_ahead: float) -> tuple[float, float]:
        """The point of the mission's lines that is a distance [m] ahead of the vehicle."""
        leg, left = self.leg, max(self._along(pose), 0.0) + look_ahead
        while left > self.lengths[leg] and leg + 1 < len(self.lengths):
            left -= self.lengths[leg]
            leg += 1
        (x0, y0), (x1, y1) = self.corners[leg : leg + 2]
        share = left / self.lengths[leg] if self.lengths[leg] > 0 else 1.0
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)


def pursue(pose: Pose, aim: tuple[float, float], speed: float, cna: Unicycle) -> float:
    """Turn rate [rad/s] of the arc through a point; the greatest where it lies behind."""
    east, north = aim[0] - pose.x, aim[1] - pose.y
    bearing = math.atan2(north, east) - pose.heading
    limit = speed / cna.min_turn_radius
    if math.cos(bearing) < 0:
        return math.copysign(limit, math.sin(bearing))
    wanted = 2.0 * speed * math.sin(bearing) / max(math.hypot(east, north), 1e-9)
    return max(-limit, min(limit, wanted))


def through_water(
    pose: Pose, aim: tuple[float, float], speed: float, current: Sequence[float]
) -> tuple[tuple[float, float], float]:
    """Where to aim, and how fast [m/s], in water that carries the vehicle, to go so over ground."""
    duration = math.hypot(aim[0] - pose.x, aim[1] - pose.y) / speed
    if not duration:
        return aim, speed
    x, y = aim[0] - current[0] * duration, aim[1] - current[1] * duration
    return (x, y), math.hypot(x - pose.x, y - pose.y) / duration


def carried(pose: Pose, current: Sequence[float], duration: float) -> Pose:
    """Where a current [m/s] takes a vehicle in a time [s]."""
    if not any(current):
        return pose
    return Pose(pose.x + current[0] * duration, pose.y + current[1] * duration, pose.heading)


def moved(pose: Pose, turn_rate: float, speed: float, duration: float) -> Pose:
    """Where a vehicle is after an arc: turn rate [rad/s] and speed [m/s] held for a time [s]."""
    return Pose(*one_arc((pose.x, pose.y, pose.heading), turn_rate, speed, duration))


def in_wider_turns(
    plan: Float[np.ndarray, "samples 2"], start: Pose, cna: Unicycle, time_step: float
) -> Float[np.ndarray, "samples 2"]:
    """Follow a plan with a vehicle that turns wider than the one it was made for.

    At each sample it pursues the place that the plan reaches one turning radius later, at most at
    the speed of ``cna``. So it cuts corners that it cannot turn, and never falls behind for good.

    Parameters
    ----------
    plan
        Places [m] at steps of time [s].
    cna
        The vehicle, with its own least turning radius.
    """
    return pursuit(plan, start, cna, time_step)[0]


def pursuit(
    plan: Float[np.ndarray, "samples 2"], start: Pose, cna: Unicycle, time_step: float
) -> tuple[Float[np.ndarray, "samples 2"], Float[np.ndarray, "steps 2"]]:
    """The places of `in_wider_turns`, and the turn rate and speed [rad/s, m/s] of each step."""
    ahead = max(2, math.ceil(cna.min_turn_radius / (cna.speed * time_step)))
    ahead_time = ahead * time_step
    points: list[list[float]] = plan.tolist()
    pose = start
    done, commands = [[start.x, start.y]], []
    for k in range(len(points) - 1):
        x, y = points[min(k + ahead, len(points) - 1)]
        speed = min(cna.speed, math.hypot(x - pose.x, y - pose.y) / ahead_time)
        turn_rate = pursue(pose, (x, y), speed, cna)
        pose = moved(pose, turn_rate, speed, time_step)
        done.append([pose.x, pose.y])
        commands.append([turn_rate, speed])
    return np.array(done), np.array(commands)
