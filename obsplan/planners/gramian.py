"""Gramian horizon: try turn rates over a short horizon and take the one that makes the AUVs most observable (thesis chapter 4)."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Literal, get_args

import casadi as ca
import numpy as np

from formulations.empirical_range_gramian import empirical_gramian_entries
from formulations.metric_expressions import score_expression
from formulations.range_gramian import displacement_moments, gramian_entries
from formulations.solution import Status
from obsplan.planners.protocol import Command, Targets, decide, two_thirds_turn
from obsplan.types import Belief, Decision, Pose
from obsplan.vehicles import Unicycle

TIE = 1e-9  # scores this close, relative, are equal: a mirror-symmetric choice is made by the order of candidates, not by rounding

Gramian = Literal["exact", "empirical", "thesis"]
Metric = Literal["condition-number", "unobservability-index", "smallest-eigenvalue", "log-det", "trace-inverse", "blend"]
Aggregate = Literal["mean", "rms", "max"]


@dataclass(frozen=True)
class GramianHorizon:
    """Hold the candidate turn rate whose Gramian over the horizon scores best, the AUVs taken to be at rest (thesis Algorithms 1 and 2).

    Candidates are spread evenly between the turning limits, and tried from left to right: of equals the leftmost is taken. ``gramian``:
    ``exact`` is closed form; ``empirical`` central differences by simulation; ``thesis`` exact but for the range's sensitivity to the
    heading, which (4.6) leaves out. ``score`` is the aggregated metric, lower is better. Where no candidate makes every AUV observable
    the vehicle goes straight on.
    """

    condition_label = "κ(W)"

    cna: Unicycle
    _: KW_ONLY
    gramian: Annotated[Gramian, "how the Gramian is computed"] = "exact"
    metric: Annotated[Metric, "of each AUV's Gramian over (east, north, heading); units m, rad, s"] = "condition-number"
    aggregate: Annotated[Aggregate, "over AUVs, by their weights"] = "mean"
    turn_rates: Annotated[int, "number of candidates, at least 2"] = 21
    horizon: Annotated[float | None, "look-ahead [s]; default: two thirds of the smallest circle"] = None

    def __post_init__(self) -> None:
        for name, known in (("gramian", Gramian), ("metric", Metric), ("aggregate", Aggregate)):
            if getattr(self, name) not in get_args(known):
                raise ValueError(f'{name} must be one of {", ".join(get_args(known))}, got "{getattr(self, name)}"')
        if self.turn_rates < 2:
            raise ValueError(f"turn_rates must be at least 2 candidates, got {self.turn_rates}")
        if self.horizon is not None and not 0 < self.horizon < np.inf:
            raise ValueError(f"horizon must be positive and finite [s], got {self.horizon}")

    @property
    def candidates(self) -> np.ndarray:
        """Turn rates tried [rad/s], from the left limit to the right one."""
        return np.linspace(self.cna.max_turn_rate, -self.cna.max_turn_rate, self.turn_rates)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose the best candidate."""
        return decide(self, pose, auvs, time)

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002 - the protocol's signature
        """The best candidate, scores of all being one expression."""
        entries = self._entries(pose, targets)
        scores = score_expression(self.metric, entries)
        condition = scores if self.metric == "condition-number" else score_expression("condition-number", entries)
        totals = self._aggregated(scores, targets.weight / ca.sum1(targets.weight))
        turn_rate, best, chosen = ca.SX(0.0), ca.SX(ca.inf), ca.SX.inf(1, scores.shape[1])
        for k, candidate in enumerate(self.candidates):
            better = totals[k] + TIE * ca.fabs(totals[k]) < best
            turn_rate, best = ca.if_else(better, candidate, turn_rate), ca.if_else(better, totals[k], best)
            chosen = ca.if_else(better, condition[k, :], chosen)
        status = ca.if_else(best < ca.inf, float(Status.OPTIMAL), float(Status.UNOBSERVABLE))
        return Command(turn_rate, ca.SX(self.cna.speed), best, chosen, status)

    def _entries(self, pose: ca.SX, targets: Targets) -> tuple[ca.SX, ...]:
        """Upper triangles of the Gramians in the body frame, each K x M."""
        east, north = pose[0] - targets.mean[0, :], pose[1] - targets.mean[1, :]
        c, s = ca.cos(pose[2]), ca.sin(pose[2])
        x = c * east + s * north, c * north - s * east
        horizon = two_thirds_turn(self.cna) if self.horizon is None else self.horizon
        if self.gramian == "empirical":
            return empirical_gramian_entries(x, turn_rates=self.candidates, speed=self.cna.speed, horizon=horizon)
        moments = displacement_moments(self.cna.speed, self.candidates, horizon)
        return gramian_entries(moments, x, variant=self.gramian)

    def _aggregated(self, scores: ca.SX, weight: ca.SX) -> ca.SX:
        """One total per candidate; an AUV of weight 0 has no say."""
        share = ca.repmat(weight.T, scores.shape[0], 1)
        if self.aggregate == "max":
            heard = ca.if_else(share > 0, scores, -ca.inf)
            return ca.vertcat(*(ca.mmax(heard[k, :]) for k in range(scores.shape[0])))
        power = 2 if self.aggregate == "rms" else 1
        return ca.sum2(ca.if_else(share > 0, share * scores**power, 0.0)) ** (1 / power)
