"""A circle about the survey: the baseline a survey engineer would choose by hand (thesis 5.3)."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import casadi as ca
import numpy as np

from formulations.solution import Status
from obsplan.planners.protocol import Command, Targets, evaluate
from obsplan.types import Belief, Decision, Point, Pose, as_point
from obsplan.vehicles import Unicycle


@dataclass(frozen=True)
class Circle:
    """Follow a circle counter-clockwise; away from it, steer to its tangent with a look-ahead of the smallest turning diameter."""

    condition_label = ""

    cna: Unicycle
    _: KW_ONLY
    center: Annotated[
        Point,
        "centre, east and north [m]; default: of the circle just enclosing the survey",
    ]
    radius: Annotated[float, "radius [m]; default: of the circle just enclosing the survey"]
    start_on_circle: Annotated[
        bool, "start at the nearest point of the circle, on its tangent, instead of at cna.start"
    ] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", as_point(self.center))
        if not np.isfinite(self.center).all():
            raise ValueError(f"center of the circle must be finite [m], got {self.center}")
        if not self.cna.min_turn_radius <= self.radius < np.inf:
            raise ValueError(
                f"radius of the circle must be at least the turning radius {self.cna.min_turn_radius} m, got {self.radius}"
            )

    def initial_pose(self, pose: Pose) -> Pose:
        """Where the vehicle starts: on the circle nearest to the pose, unless told otherwise."""
        if not self.start_on_circle:
            return pose
        bearing = np.arctan2(pose.y - self.center[1], pose.x - self.center[0])
        x, y = (
            self.center[0] + self.radius * np.cos(bearing),
            self.center[1] + self.radius * np.sin(bearing),
        )
        return Pose(float(x), float(y), float(bearing + np.pi / 2))

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Steer along the circle, whatever the AUVs do."""
        return evaluate(self, pose, auvs, time)

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002 - the protocol's signature
        """The turn rate of the circle plus a correction toward the tangent at the look-ahead."""
        east, north = pose[0] - self.center[0], pose[1] - self.center[1]
        look_ahead = 2.0 * self.cna.min_turn_radius
        outside = ca.sqrt(east**2 + north**2) - self.radius
        course = ca.atan2(north, east) + np.pi / 2 + ca.atan(outside / look_ahead)
        error = course - pose[2]
        correction = self.cna.speed / look_ahead * ca.atan2(ca.sin(error), ca.cos(error))
        limit = self.cna.max_turn_rate
        turn_rate = ca.fmax(-limit, ca.fmin(limit, self.cna.speed / self.radius + correction))
        no_condition = ca.SX.nan(1, targets.mean.shape[1])
        return Command(
            turn_rate, ca.SX(self.cna.speed), outside**2, no_condition, ca.SX(float(Status.OPTIMAL))
        )
