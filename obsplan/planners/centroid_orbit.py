"""Orbit the AUVs' centroid: the circle a survey engineer would choose, moving with the AUVs."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import casadi as ca
import numpy as np

from formulations.path_inertia.closed_form import lateral_offset, leftward
from formulations.solution import Status
from obsplan.planning.checks import check_situation
from obsplan.planning.expressions import Command, Targets, decide
from obsplan.planning.situation import Situation
from obsplan.planning.steering import bearing, look_ahead, telling_distance, turn_along
from obsplan.quantities import LENGTH
from obsplan.types import Belief, Decision, Pose


@dataclass(frozen=True)
class CentroidOrbit:
    """Circle the AUVs' weighted centroid, the shorter way round, and crab to move with it.

    Where both ways are as short it keeps the centroid to its left.

    The course relative to the centroid is the orbit's tangent, turned toward the orbit by
    atan(distance from it / look-ahead). ``score`` is the squared distance from the orbit [m^2].
    Where slant ranges to AUVs at depth tell most from farther than the orbit would be, it is as
    wide as that, unless its radius is given. (Standoff tracking by a vector field: Frew, Lawrence
    and Morris 2008.)
    """

    condition_label = ""

    situation: Situation
    _: KW_ONLY
    orbit_radius: Annotated[
        float | None,
        "radius [m]; default: the farthest AUV's distance plus the smallest turning diameter",
        LENGTH,
    ] = None

    def __post_init__(self) -> None:
        check_situation(self)
        least = self.situation.cna.min_turn_radius
        if self.orbit_radius is not None and not least <= self.orbit_radius < np.inf:
            raise ValueError(
                f"orbit_radius must be at least the turning radius {least} m, "
                f"got {self.orbit_radius}: make it larger"
            )

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Steer along the orbit as it is now."""
        return decide(self, pose, auvs, time)

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002
        """The turn rate of the orbit plus a correction onto its course."""
        cna = self.situation.cna
        share = targets.weight / ca.sum1(targets.weight)
        center, velocity = targets.mean[:2, :] @ share, targets.velocity @ share
        away = pose[:2] - center
        radius = self._radius(center, targets)
        distance = ca.hypot(away[0], away[1])
        outside = distance - radius
        sense = leftward(lateral_offset(away[0], away[1], pose[2]), distance + cna.min_turn_radius)
        outward = bearing(away[0], away[1], least=cna.min_turn_radius, otherwise=pose[2])
        tangent = outward + sense * (np.pi / 2 + ca.atan(outside / look_ahead(cna)))
        turn_rate = turn_along(cna, pose[2], tangent, velocity=velocity, radius=radius, sense=sense)
        none = ca.SX.nan(1, targets.mean.shape[1])
        return Command(turn_rate, ca.SX(cna.speed), outside**2, none, ca.SX(float(Status.OPTIMAL)))

    def _radius(self, center: ca.SX, targets: Targets) -> ca.SX:
        """Radius [m] in use; an AUV of weight 0 has no say."""
        if self.orbit_radius is not None:
            return ca.SX(self.orbit_radius)
        distance = ca.hypot(targets.mean[0, :] - center[0], targets.mean[1, :] - center[1])
        enclosing = (
            ca.mmax(ca.if_else(targets.weight.T > 0, distance, 0.0))
            + 2.0 * self.situation.cna.min_turn_radius
        )
        return telling_distance(self.situation, targets, enclosing)
