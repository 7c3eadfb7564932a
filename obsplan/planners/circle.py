"""A circle about the survey: the baseline a survey engineer would choose by hand (thesis 5.3)."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Annotated

import casadi as ca
import numpy as np

from formulations.model.ties import TIE
from formulations.model.worth import best_distance
from formulations.solution import Status
from obsplan.constraints import Disc
from obsplan.planning.checks import check_situation
from obsplan.planning.expressions import Command, Targets, evaluate
from obsplan.planning.situation import Situation
from obsplan.planning.steering import bearing, look_ahead, turn_along
from obsplan.quantities import LENGTH
from obsplan.types import Belief, Decision, Point, Pose, as_point


@dataclass(frozen=True)
class Circle:
    """Follow a circle counter-clockwise.

    Away from the circle the vehicle steers to its tangent, with a look-ahead of the smallest
    turning diameter. Where slant ranges to AUVs at depth tell most from farther than the circle
    about the survey, it is as wide as that, unless its radius is given. In a current that carries
    it, it crabs to stay on it.
    """

    condition_label = ""

    situation: Situation
    _: KW_ONLY
    center: Annotated[
        Point | None, "centre, east and north [m]; default: of the circle just enclosing the survey"
    ] = None
    radius: Annotated[
        float | None, "radius [m]; default: of the circle just enclosing the survey", LENGTH
    ] = None
    start_on_circle: Annotated[
        bool, "start at the nearest point of the circle, on its tangent, instead of at cna.start"
    ] = True

    def __post_init__(self) -> None:
        check_situation(self)
        if self.center is not None:
            object.__setattr__(self, "center", as_point(self.center))
            if not np.isfinite(self.center).all():
                raise ValueError(
                    f"center of the circle must be finite [m], got {self.center}: correct it"
                )
        least = self.situation.cna.min_turn_radius
        if self.radius is not None and not least <= self.radius < np.inf:
            raise ValueError(
                f"radius of the circle must be at least the turning radius {least} m, "
                f"got {self.radius}: make it larger"
            )
        _ = self.circle

    @cached_property
    def circle(self) -> Disc:
        """The circle in use.

        Raises
        ------
        ValueError
            A centre or a radius that neither the options nor the situation has.
        """
        survey, center, radius = self.situation.survey_circle, self.center, self.radius
        if survey is not None:
            center = (survey.x, survey.y) if center is None else center
            radius = self._wide(survey.radius) if radius is None else radius
        if center is None or radius is None:
            raise ValueError("give center and radius of the circle: no survey is known")
        return Disc(x=center[0], y=center[1], radius=radius)

    def _wide(self, least: float) -> float:
        """Radius [m] from which ranges over the AUVs' depth, as filed at first, tell most."""
        situation = self.situation
        if situation.filed is None or not situation.ranging.slant:
            return least
        height = np.average(situation.filed.depth[0], weights=situation.filed.weights)
        best = float(best_distance(situation.ranging, height - situation.transducer_depth))
        return max(least, best) if best < np.inf else least

    def initial_pose(self, pose: Pose) -> Pose:
        """Where the vehicle starts: on the circle nearest to the pose, unless told otherwise."""
        if not self.start_on_circle:
            return pose
        circle = self.circle
        east, north = pose.x - circle.x, pose.y - circle.y
        outward = np.arctan2(north, east)
        if np.hypot(east, north) <= TIE * circle.radius:  # from the centre: straight ahead
            outward = pose.heading
        x = circle.x + circle.radius * np.cos(outward)
        y = circle.y + circle.radius * np.sin(outward)
        return Pose(float(x), float(y), float(outward + np.pi / 2))

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Steer along the circle, whatever the AUVs do."""
        return evaluate(self, pose, auvs, time)

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002
        """The turn rate of the circle plus a correction toward the tangent at the look-ahead."""
        cna, circle = self.situation.cna, self.circle
        east, north = pose[0] - circle.x, pose[1] - circle.y
        outside = ca.sqrt(east**2 + north**2) - circle.radius
        outward = bearing(east, north, least=circle.radius, otherwise=pose[2])
        course = outward + np.pi / 2 + ca.atan(outside / look_ahead(cna))
        velocity = -ca.DM(self.situation.current)  # of a place over ground, in the water
        turn_rate = turn_along(cna, pose[2], course, velocity=velocity, radius=circle.radius)
        none = ca.SX.nan(1, targets.mean.shape[1])
        return Command(turn_rate, ca.SX(cna.speed), outside**2, none, ca.SX(float(Status.OPTIMAL)))
