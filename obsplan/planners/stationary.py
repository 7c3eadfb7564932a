"""Stay where you are: the baseline of an anchored beacon (thesis 5.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from formulations.solution import Status
from obsplan.planning.expressions import Command, Targets
from obsplan.types import Belief, Decision, Pose


@dataclass(frozen=True)
class Stationary:
    """Hold position."""

    condition_label = ""

    def plan(
        self,
        pose: Pose,
        auvs: Sequence[Belief],
        *,
        time: float = 0.0,  # noqa: ARG002
    ) -> Decision:
        """Stop, whatever the AUVs do."""
        here = np.array([[pose.x, pose.y, pose.heading]], dtype=float)
        status = Status.OPTIMAL if np.isfinite(here).all() else Status.INVALID_INPUT
        return Decision(
            turn_rate=0.0,
            speed=0.0,
            predict=lambda: here,
            score=0.0,
            status=status,
            condition=np.full(len(auvs), np.nan),
        )

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002
        """Speed and turn rate zero."""
        return Command(
            ca.SX(0.0),
            ca.SX(0.0),
            ca.SX(0.0),
            ca.SX.nan(1, targets.mean.shape[1]),
            ca.SX(float(Status.OPTIMAL)),
        )
