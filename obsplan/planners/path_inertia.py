"""Path inertia: circle so that the path looks equally long from every side of the AUVs (thesis chapter 3)."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Literal

import casadi as ca

from formulations.path_inertia import (
    curvature_condition_number,
    lateral_offset,
    path_inertia_curvature,
    path_inertia_radius,
)
from formulations.solution import Status
from obsplan.planners.protocol import Command, Targets, decide
from obsplan.types import Belief, Decision, Pose
from obsplan.vehicles import Unicycle


@dataclass(frozen=True)
class PathInertia:
    """Turn on the circle that makes the principal moments of inertia about the AUVs most alike, were they at rest (thesis 3.26).

    ``difference`` minimises the weighted mean difference of the eigenvalues plus γ (squared centre distance + |radius|), the thesis's
    rule; ``condition-number`` minimises the weighted mean condition number itself over the curvature, straight ahead included, and has
    no γ. ``score`` is the weighted mean of κ(J) [-] either way.
    """

    condition_label = "κ(J)"

    cna: Unicycle
    _: KW_ONLY
    gamma: Annotated[float, "weight of separation against conditioning [-], at least 0; of the objective difference"] = 1.0
    objective: Annotated[Literal["difference", "condition-number"], "what is minimised"] = "difference"

    def __post_init__(self) -> None:
        if not 0 <= self.gamma < float("inf"):
            raise ValueError(f"gamma must be at least 0 and finite, got {self.gamma}")
        if self.objective not in ("difference", "condition-number"):
            raise ValueError(f'objective must be "difference" or "condition-number", got "{self.objective}"')

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose the circle to turn on."""
        return decide(self, pose, auvs, time)

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002 - the protocol's signature
        """The turn rate in closed form."""
        x1, x2 = pose[0] - targets.mean[0, :], pose[1] - targets.mean[1, :]
        weight = targets.weight / ca.sum1(targets.weight)
        offset, square_distance = lateral_offset(x1, x2, pose[2]), x1**2 + x2**2
        mean_offset, r_min = offset @ weight, self.cna.min_turn_radius
        if self.objective == "difference":
            radius, clipped = path_inertia_radius(mean_offset, self.gamma, r_min)
            curvature = 1 / radius
        else:
            curvature, clipped = path_inertia_curvature(mean_offset, square_distance @ weight, r_min)
        condition = curvature_condition_number(curvature, offset, square_distance)
        status = ca.if_else(clipped, float(Status.CLIPPED), float(Status.OPTIMAL))
        return Command(self.cna.speed * curvature, ca.SX(self.cna.speed), condition @ weight, condition, status)
