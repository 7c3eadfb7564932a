"""Trail the AUVs: the escort that keeps its place in their formation."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import casadi as ca

from formulations.solution import Status
from obsplan.planning.checks import check_situation
from obsplan.planning.expressions import Command, Targets, decide
from obsplan.planning.situation import Situation
from obsplan.planning.steering import bearing, look_ahead, telling_distance, turn_toward
from obsplan.quantities import POSITION
from obsplan.types import Belief, Decision, Pose


@dataclass(frozen=True)
class Trail:
    """Keep a place behind, or left of, the AUVs' weighted centroid, as slowly as that takes.

    Behind and left refer to their mean heading, or, where headings cancel, to the bearing of their
    centroid. The velocity wanted is the centroid's plus the
    way to the place, divided by the time the vehicle needs for a look-ahead. ``score`` is the
    squared distance from the place [m^2]. Where slant ranges to AUVs at depth tell most from
    farther than a turning diameter, it is that far behind, unless the distance is given.
    """

    condition_label = ""

    situation: Situation
    _: KW_ONLY
    behind: Annotated[
        float | None, "distance behind [m]; default: the smallest turning diameter", POSITION
    ] = None
    left: Annotated[float, "distance to the left [m]; negative: to the right", POSITION] = 0.0

    def __post_init__(self) -> None:
        check_situation(self)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Steer to the place."""
        return decide(self, pose, auvs, time)

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002
        """Turn rate and speed of a pursuit of the place."""
        cna = self.situation.cna
        share = targets.weight / ca.sum1(targets.weight)
        way = targets.mean[:2, :] @ share - pose[:2]
        toward = bearing(way[0], way[1], least=cna.min_turn_radius, otherwise=pose[2])
        course = (wave(targets.mean[2, :]) @ share for wave in (ca.cos, ca.sin))
        heading = bearing(*course, least=1.0, otherwise=toward)
        ahead = ca.vertcat(ca.cos(heading), ca.sin(heading))
        abeam = ca.vertcat(-ca.sin(heading), ca.cos(heading))
        behind = self.behind
        if behind is None:
            behind = telling_distance(self.situation, targets, look_ahead(cna))
        gap = way - behind * ahead + self.left * abeam
        wanted = targets.velocity @ share + gap * (cna.speed / look_ahead(cna))
        # cruising speed also where it is no number
        speed = ca.fmin(cna.speed, ca.hypot(wanted[0], wanted[1]))
        turn_rate = turn_toward(cna, pose[2], ca.atan2(wanted[1], wanted[0]), speed=speed)
        none = ca.SX.nan(1, targets.mean.shape[1])
        return Command(turn_rate, speed, ca.sumsqr(gap), none, ca.SX(float(Status.OPTIMAL)))
