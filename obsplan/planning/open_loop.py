"""A plan that was made beforehand, flown without looking at what is measured."""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from formulations.model.arcs import path
from formulations.model.schedule import ROUNDING, intervals
from formulations.solution import Solution
from obsplan.next_move import STILL, Stream
from obsplan.types import Decision, Pose
from obsplan.vehicles import Unicycle

ON_PLAN = 1e-3  # [m], [rad]; a vehicle nearer than that to where its plan has it follows it


@dataclass(frozen=True, eq=False)
class OpenLoopPlan:
    """A plan in the water, which may flow, from where and when it begins."""

    cna: Unicycle
    start: Pose
    begin: float  # [s]
    turn_rates: Float[np.ndarray, " n"]  # [rad/s]
    duration: float  # of each turn [s]
    plan: Solution
    stream: Stream = STILL
    elapsed: float = 0.0  # of the first turn, before the plan begins [s]

    def passes(self, pose: Pose, time: float) -> bool:
        """Whether the plan has the vehicle at a pose at a time.

        Water that flows may take it elsewhere than was known before: there its heading alone tells.
        """
        if time < self.begin:
            return False
        x, y, heading = self.poses(self.start, self.begin, time)[-1]
        turned = np.remainder(heading - pose.heading + np.pi, 2 * np.pi) - np.pi
        away = math.hypot(x - pose.x, y - pose.y)
        carried = bool(self.stream) and time > self.begin
        return bool(abs(turned) < ON_PLAN and (carried or away < ON_PLAN))

    def poses(self, pose: Pose, begin: float, end: float) -> Float[np.ndarray, "some 3"]:
        """Poses (east, north, heading) at the ends of the turns between two times, from a pose."""
        times = self.edges(begin, end)
        turns = np.array([self.turn_rate(float(time)) for time in times[:-1]])
        start = np.array([pose.x, pose.y, pose.heading])
        return path(start, turns, self.cna.speed, np.diff(times))

    def edges(self, begin: float, end: float) -> Float[np.ndarray, " some"]:
        """When turns end [s] between two times, and these."""
        ends = np.arange(1, self.turn_rates.size) * self.duration
        edges = self.begin - self.elapsed + ends
        within = edges[(edges > begin + ROUNDING) & (edges < end - ROUNDING)]
        return np.concatenate([[begin], within, [max(begin, end)]])

    def turn_rate(self, time: float) -> float:
        """Turn rate [rad/s] from a time on; after the mission the last one."""
        turn = int(intervals(time - self.begin + self.elapsed, self.duration))
        return float(self.turn_rates[min(max(turn, 0), self.turn_rates.size - 1)])

    def decision(self, pose: Pose, time: float, n_auvs: int) -> Decision:
        """The turn of this time, and the path from here to the mission's end."""
        last = self.begin - self.elapsed + self.turn_rates.size * self.duration
        end = max(last, time + self.duration)
        return Decision(
            turn_rate=self.turn_rate(time),
            speed=self.cna.speed,
            predict=partial(self.poses, pose, time, end),
            score=self.plan.objective,
            status=self.plan.status,
            condition=np.full(n_auvs, np.nan),
            lasting=np.diff(self.edges(time, end)),
        )
