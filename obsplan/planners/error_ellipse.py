"""Error ellipse: the greedy rule of single-beacon planning."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import casadi as ca
import numpy as np

from formulations.model.arcs import arc
from formulations.model.ranging import EDGE, Form, arrival, law_of
from formulations.model.ties import TIE
from formulations.model.worth import per_square
from formulations.solution import Status
from obsplan.planning.candidates import first_of_the_best
from obsplan.planning.checks import check_situation
from obsplan.planning.expressions import Command, Symbolic, Targets, Vectorized, decide
from obsplan.planning.situation import Situation
from obsplan.quantities import CANDIDATES
from obsplan.types import Belief, Decision, Pose

ROUNDING = 1e-14  # of variances, relative to the largest
SCALARS = 8  # AUVs up to which scalars are no slower than matrices, which hold all candidates


@dataclass(frozen=True)
class ErrorEllipse:
    r"""Turn so that the next range is measured along the largest axis of the error ellipses.

    Each candidate turn rate is held until each AUV's next range. The best one leaves the least
    variance across the lines of sight,

    .. math:: \sum_i w_i (\operatorname{tr} P_i - u_i^\top P_i u_i),

    which is ``score`` [m^2]. P is the reported position covariance and u the line of sight to the
    AUV, which moves on at its velocity. The planner looks no further than one range and keeps no
    distance. Errors along the range are taken to vanish. (Chitre, "Path planning for cooperative
    underwater range-only navigation using a single beacon", 2010, whose beacon minimises the
    error after the next range.)

    Where distance counts, as ranges are slant, may be lost or err the more the farther, what is
    left along the line of sight is counted too. With p the probability that the range arrives, J
    what it tells along the line of sight and s the variance :math:`u^\top P u`, that is

    .. math:: s \Bigl(1 - p \frac{J s}{1 + J s}\Bigr).
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
        x, y = self._sight(time, pose, targets, rates)
        p11, p12, p22 = (
            ca.repmat(targets.position_covariance[i, :], self.turn_rates, 1) for i in range(3)
        )
        square = x**2 + y**2
        variance = p11 * y**2 - 2 * p12 * x * y + p22 * x**2
        square = ca.if_else(square > (TIE * cna.min_turn_radius) ** 2, square, 0.0)
        left = ca.if_else(square > 0, variance / square, 0.0)  # on top there is no line of sight
        ranging = self.situation.ranging
        if ranging.form != Form(squared=ranging.squared):
            height = ca.vec(targets.depth - self.situation.transducer_depth).T
            left += self._left_along(p11 + p22 - left, square, height)
        share = targets.weight / ca.sum1(targets.weight)
        totals = left @ share
        doubt = ROUNDING * ((p11 + p22) @ share)  # small variances are differences of large ones
        best, turn_rate = first_of_the_best(self.turn_rates)(totals, rates, 0.0, doubt)
        unknown = ca.DM.nan(1, targets.mean.shape[1])
        return Command(turn_rate, ca.DM(cna.speed), best, unknown, ca.DM(float(Status.OPTIMAL)))

    def _sight(
        self, time: Symbolic, pose: Symbolic, targets: Targets, rates: np.ndarray
    ) -> tuple[Symbolic, Symbolic]:
        """Position relative to each AUV as its next range comes, K x M each."""
        schedule, count = self.situation.schedule, targets.mean.shape[1]
        # AUVs of one wait: all of them, or each
        together = [list(range(count))] if schedule.plain else [[auv] for auv in range(count)]
        east, north = [], []
        for these in together:
            wait = schedule.time_to_range(time, these[0])
            places = arc(pose, ca.DM(rates).T, self.situation.cna.speed, wait)
            auvs = targets.mean[:2, these] + targets.velocity[:, these] * wait
            for axis, columns in enumerate((east, north)):
                own = ca.repmat(places[axis, :].T, 1, len(these))
                columns.append(own - ca.repmat(auvs[axis, :], self.turn_rates, 1))
        return ca.horzcat(*east), ca.horzcat(*north)

    def _left_along(self, along: Symbolic, square: Symbolic, height: Symbolic) -> Symbolic:
        """Variance left along the lines of sight, K x M, of what there is before the range."""
        law = law_of(self.situation.ranging)
        r2 = square + ca.repmat(height**2, self.turn_rates, 1) if law.form.slant else square
        gained = square * per_square(law, r2) * along
        return along * (1 - arrival(law, r2, edge=EDGE) * gained / (1 + gained))
