"""Error ellipse: the greedy rule of single-beacon planning."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import casadi as ca
import numpy as np

from formulations.model.arcs import arc
from formulations.model.schedule import time_to_next
from formulations.solution import Status
from obsplan.planning.candidates import first_of_the_best
from obsplan.planning.checks import check_situation
from obsplan.planning.expressions import Command, Symbolic, Targets, Vectorized, decide
from obsplan.planning.situation import Situation
from obsplan.quantities import CANDIDATES
from obsplan.types import Belief, Decision, Pose

SCALARS = 8  # AUVs up to which scalars are no slower than matrices, which hold all candidates


@dataclass(frozen=True)
class ErrorEllipse:
    r"""Turn so that the next range is measured along the largest axis of the error ellipses.

    Each candidate turn rate is held until the next ping. The best one leaves the least variance
    across the lines of sight,

    .. math:: \sum_i w_i (\operatorname{tr} P_i - u_i^\top P_i u_i),

    which is ``score`` [m^2]. P is the reported position covariance and u the line of sight to the
    AUV, which moves on at its velocity. The planner looks no further than one range and keeps no
    distance. Errors along the range are taken to vanish. (Chitre, "Path planning for cooperative
    underwater range-only navigation using a single beacon", 2010, whose beacon minimises the
    error after the next range.)
    """

    condition_label = ""

    situation: Situation
    _: KW_ONLY
    turn_rates: Annotated[int, "number of candidates", CANDIDATES] = 21

    def __post_init__(self) -> None:
        check_situation(self)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose the best turn."""
        return decide(self, pose, auvs, time)

    @property
    def expression(self) -> Vectorized:
        """The decision as an expression."""
        return Vectorized(self.choose, scalars=SCALARS)

    def choose(self, time: Symbolic, pose: Symbolic, targets: Targets) -> Command:
        """The best candidate, all of them scored for every AUV at once."""
        cna = self.situation.cna
        limit = cna.max_turn_rate
        rates = np.linspace(limit, -limit, self.turn_rates)
        wait = time_to_next(time, self.situation.ping_interval)
        places = arc(pose, ca.DM(rates).T, cna.speed, wait)
        auvs = targets.mean[:2, :] + targets.velocity * wait
        count = targets.mean.shape[1]
        x = ca.repmat(places[0, :].T, 1, count) - ca.repmat(auvs[0, :], self.turn_rates, 1)
        y = ca.repmat(places[1, :].T, 1, count) - ca.repmat(auvs[1, :], self.turn_rates, 1)
        p11, p12, p22 = (
            ca.repmat(targets.position_covariance[i, :], self.turn_rates, 1) for i in range(3)
        )
        square = x**2 + y**2
        variance = p11 * y**2 - 2 * p12 * x * y + p22 * x**2
        across = variance / ca.if_else(square > 0, square, 1.0)
        totals = across @ (targets.weight / ca.sum1(targets.weight))
        best, turn_rate = first_of_the_best(self.turn_rates)(totals, rates, 0.0)
        unknown = ca.DM.nan(1, count)
        return Command(turn_rate, ca.DM(cna.speed), best, unknown, ca.DM(float(Status.OPTIMAL)))
