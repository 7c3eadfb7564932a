"""Path inertia: circle so that the path looks equally long from all sides (thesis chapter 3)."""

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import lru_cache, partial
from typing import Annotated, Literal

import casadi as ca
import numpy as np

from formulations.path_inertia import (
    PathInertiaProblem,
    curvature_condition_number,
    lateral_offset,
    path_inertia_curvature,
    path_inertia_radius,
)
from formulations.solution import Status
from obsplan.planning.checks import check_situation
from obsplan.planning.expressions import Command, Symbolic, Targets, Vectorized, decide
from obsplan.planning.fallback import predict_path, unusable
from obsplan.planning.situation import Situation
from obsplan.quantities import CHANGE_WEIGHT, LENGTH, WEIGHT
from obsplan.types import Belief, Decision, Pose


@dataclass(frozen=True)
class PathInertia:
    """Turn on the circle that makes the principal moments of inertia most alike (thesis 3.26).

    The moments are those of the path about the AUVs, taken to be at rest. ``difference``, the
    thesis's rule, minimises the weighted mean difference of the eigenvalues plus
    γ (squared centre distance + |radius|). ``condition-number`` minimises the weighted mean
    condition number over the curvature, straight ahead included, and has no γ. ``score`` is the
    weighted mean of κ(J) [-] either way. The moments are of geometry alone: how ranges err, which
    of them come and when has no say.

    Without further limits the decision is a closed form, and part of the simulator's step. The
    limits and the penalty on change make it a convex program, solved at each decision by the
    solver named. All find the same turn; a solver that fails, or whose answer its residuals
    refute, is replaced by the closed form, and the status says so. Where no turn satisfies the
    limits, the turn without them is taken and the status says so. Straight ahead of the AUVs
    or away from them both sides are equally good: it turns left.
    """

    condition_label = "κ(J)"

    situation: Situation
    _: KW_ONLY
    gamma: Annotated[
        float,
        "weight of separation against conditioning [-], at least 0; of the objective difference",
        WEIGHT,
    ] = 1.0
    objective: Annotated[Literal["difference", "condition-number"], "what is minimised"] = (
        "difference"
    )
    solver: Annotated[
        Literal["closed-form", "osqp", "clarabel", "cvxpy-osqp", "cvxpy-clarabel"],
        "what solves the convex program; cvxpy takes it as printed, others reduced to one number",
    ] = "closed-form"
    change_weight: Annotated[
        float,
        "penalty on the squared change of radius [-], or of curvature [m^2]; at least 0",
        CHANGE_WEIGHT,
    ] = 0.0
    max_radius: Annotated[float | None, "largest turning radius [m]; default: none", LENGTH] = None
    max_center_distance: Annotated[
        float | None,
        "largest distance of the circle's centre from each AUV [m]; default: none",
        LENGTH,
    ] = None

    def __post_init__(self) -> None:
        check_situation(self)
        _ = problem(self)  # its limits are checked there

    @property
    def expression(self) -> Vectorized | None:
        """The decision as an expression; None where a program has to be solved."""
        limited = (
            self.change_weight
            or self.max_radius is not None
            or self.max_center_distance is not None
        )
        if limited or self.solver != "closed-form":
            return None
        return Vectorized(self.closed_form)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose the circle to turn on."""
        if self.expression is not None:
            return decide(self, pose, auvs, time)
        return unusable(self.situation.cna, pose, auvs) or self._solve(pose, auvs)

    def closed_form(
        self,
        time: Symbolic,  # noqa: ARG002
        pose: Symbolic,
        targets: Targets,
    ) -> Command:
        """The turn rate without limits beyond the vehicle's own."""
        cna = self.situation.cna
        x1, x2 = pose[0] - targets.mean[0, :], pose[1] - targets.mean[1, :]
        weight = targets.weight / ca.sum1(targets.weight)
        offset, square_distance = lateral_offset(x1, x2, pose[2]), x1**2 + x2**2
        mean_offset, r_min = offset @ weight, cna.min_turn_radius
        if self.objective == "difference":
            distance = ca.sqrt(square_distance @ weight)
            radius, clipped = path_inertia_radius(mean_offset, self.gamma, r_min, distance)
            curvature = 1 / radius
        else:
            curvature, clipped = path_inertia_curvature(
                mean_offset, square_distance @ weight, r_min
            )
        condition = curvature_condition_number(curvature, offset, square_distance)
        status = ca.if_else(clipped, float(Status.CLIPPED), float(Status.OPTIMAL))
        return Command(
            cna.speed * curvature, ca.DM(cna.speed), condition @ weight, condition, status
        )

    def _solve(self, pose: Pose, auvs: Sequence[Belief]) -> Decision:
        """Solve the program with its limits; if they leave no turn, without them."""
        cna = self.situation.cna
        x = np.array([[pose.x, pose.y] - auv.mean[:2] for auv in auvs])
        weights = np.array([auv.weight for auv in auvs], dtype=float)
        last = cna.speed / pose.turn_rate if pose.turn_rate else math.inf
        solution = problem(self).solve(x, pose.heading, weights, last_radius=last)
        status = solution.status
        if not np.isfinite(solution.x[0]):
            solution = problem(
                PathInertia(self.situation, gamma=self.gamma, objective=self.objective)
            ).solve(x, pose.heading, weights)
        curvature = (
            float(solution.x[0])
            if self.objective == "condition-number"
            else 1 / float(solution.x[0])
        )
        condition = curvature_condition_number(
            curvature, lateral_offset(x[:, 0], x[:, 1], pose.heading), np.sum(x**2, axis=1)
        )
        turn_rate = cna.speed * curvature
        return Decision(
            turn_rate=turn_rate,
            speed=cna.speed,
            predict=partial(predict_path, cna, pose, turn_rate, cna.speed),
            score=float(condition @ weights / weights.sum()),
            status=status,
            condition=condition,
        )


@lru_cache(maxsize=16)
def problem(planner: PathInertia) -> PathInertiaProblem:
    """The planner's convex program, set up once.

    Raises
    ------
    ValueError
        A weight or a limit out of its range.
    """
    return PathInertiaProblem(
        min_radius=planner.situation.cna.min_turn_radius,
        gamma=planner.gamma,
        change_weight=planner.change_weight,
        max_radius=math.inf if planner.max_radius is None else planner.max_radius,
        max_center_distance=math.inf
        if planner.max_center_distance is None
        else planner.max_center_distance,
        objective=planner.objective,
        solver=planner.solver,
    )
