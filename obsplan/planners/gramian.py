"""Gramian horizon: hold the turn that makes the AUVs most observable (thesis chapter 4)."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import lru_cache, partial
from typing import Annotated, Literal

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.gramian.empirical_range import empirical_gramian_entries
from formulations.gramian.pings import ping_moments
from formulations.gramian.range import (
    DEGREE,
    DisplacementMoments,
    displacement_moments,
    gramian_entries,
)
from formulations.metrics import BLEND_WEIGHT, position_schur_expression, score_expression
from formulations.model.arcs import arcs
from formulations.model.casadi import Call
from formulations.model.frames import to_body
from formulations.model.ranging import EDGE, arrival, law_of, variance
from formulations.model.ties import TIE
from formulations.solution import Status
from obsplan.constraints import Constraints
from obsplan.planning.candidates import first_of_the_best
from obsplan.planning.checks import check_situation
from obsplan.planning.expressions import (
    Command,
    Symbolic,
    Targets,
    Vectorized,
    decide,
    decision_of,
    fill,
    interpreted,
    packed,
    symbols,
)
from obsplan.planning.fallback import unusable
from obsplan.planning.limits import LimitsAhead
from obsplan.planning.situation import Situation
from obsplan.quantities import CANDIDATES, CIRCLES, INTERVAL, WEIGHT
from obsplan.types import Belief, Decision, Pose

# Rounding of the entries of W, relative to the largest: of sums and products, and of differences.
ROUNDING = {"exact": 2e-15, "thesis": 2e-15, "degrees": 2e-15, "empirical": 1e-11}
LEAST_PINGS = 3  # that tell the three states: east, north, heading
SCALARS = 1  # AUVs up to which scalars are faster than matrices, which hold all candidates
HARDLY = 1e-6  # [s] in place of no time at all, where all pings are silent
HORIZON_POINTS = 16  # at which a candidate's arc is held against the limits

Metric = Literal[
    "condition-number",
    "unobservability-index",
    "smallest-eigenvalue",
    "log-det",
    "trace-inverse",
    "blend",
]
Entries = tuple[Symbolic, ...]


@dataclass(frozen=True)
class GramianHorizon:
    """Hold the candidate turn rate whose Gramian over the horizon scores best (thesis chapter 4).

    Algorithms 1 and 2 of the thesis. Candidates are spread evenly between the turning limits and
    tried from left to right; of equal ones the leftmost is taken, where equal is what the rounding
    of the Gramian cannot tell apart. ``score`` is the aggregated metric, lower is better. Where no
    candidate makes every AUV observable the vehicle goes straight on.

    The defaults are the thesis's: AUVs at rest, ranges all the time, a horizon of two thirds of
    the smallest circle, the unscaled Gramian of the squared range. The options depart from it:

    - ``gramian``: ``exact`` is a closed form. ``empirical`` takes central differences of
      simulations. ``thesis`` is exact but for the range's sensitivity to the heading, which
      (4.6) leaves out. ``degrees`` is exact with headings in degrees, which all but leaves it
      out, too (`obsplan thesis eq4.6`).
    - ``motion``: AUVs keep the velocity reported.
    - ``sampling``: ranges come at the next pings, as many as the horizon holds, to each AUV in its
      slot and not while there is silence. It is lengthened to hold at least three.
    - ``block``: the Schur complement of the position is what is known of it while the heading is
      unknown.
    - ``noise``: information in units of the sensors' variances, one sample of each per ping. A
      range's variance becomes that of a squared range at the candidate's root-mean-square
      distance over the horizon, so that distance alone earns nothing. At that distance variances
      that grow are taken, and the probability that ranges arrive, by which they count.
    - ``weighting``: weights times the trace of the reported position covariance.

    Under limits a candidate is discarded if it breaks one before the next decision or leaves no
    circle free. One that breaks a limit later in the horizon is discarded if others do not. If
    all candidates break limits, the least violating is taken and the status says so.
    """

    condition_label = "κ(W)"

    situation: Situation
    _: KW_ONLY
    gramian: Annotated[
        Literal["exact", "empirical", "thesis", "degrees"], "how the Gramian is computed"
    ] = "exact"
    metric: Annotated[
        Metric, "of each AUV's Gramian over (east, north, heading); units m, rad (or degrees), s"
    ] = "condition-number"
    blend_weight: Annotated[
        float,
        "of log(unobservability index) beside log(condition number), of metric blend",
        WEIGHT,
    ] = BLEND_WEIGHT
    aggregate: Annotated[Literal["mean", "rms", "max"], "over AUVs, by their weights"] = "mean"
    turn_rates: Annotated[int, "number of candidates", CANDIDATES] = 21
    horizon: Annotated[float | None, "look-ahead [s]; default: by circles", INTERVAL] = None
    circles: Annotated[
        float, "look-ahead in smallest circles, where horizon is not given", CIRCLES
    ] = 2.0 / 3.0
    motion: Annotated[Literal["at-rest", "constant-velocity"], "of the AUVs over the horizon"] = (
        "at-rest"
    )
    sampling: Annotated[Literal["continuous", "pings"], "when ranges come"] = "continuous"
    block: Annotated[
        Literal["pose", "position"],
        "of the Gramian: all of it, or the position's, the heading unknown",
    ] = "pose"
    noise: Annotated[
        Literal["unit", "sensor"], "variances that scale the outputs: 1, or the sensors'"
    ] = "unit"
    weighting: Annotated[
        Literal["fixed", "covariance"],
        "weights of the AUVs: as given, or times their position variance",
    ] = "fixed"

    def __post_init__(self) -> None:
        check_situation(self)
        if self.gramian == "empirical" and (self.motion, self.sampling) != (
            "at-rest",
            "continuous",
        ):
            raise ValueError(
                'gramian "empirical" takes AUVs at rest and ranges all the time; '
                'for other motion or sampling choose "exact"'
            )

    @property
    def candidates(self) -> np.ndarray:
        """Turn rates tried [rad/s], from the left limit to the right one."""
        limit = self.situation.cna.max_turn_rate
        return np.linspace(limit, -limit, self.turn_rates)

    @property
    def constraints(self) -> Constraints:
        """The limits it keeps within."""
        return self.situation.constraints

    @property
    def expression(self) -> Vectorized | None:
        """The decision as an expression; None where limits have to be looked at."""
        return None if self.constraints else self.vectorized

    @property
    def vectorized(self) -> Vectorized:
        """The choice among all candidates."""
        return Vectorized(self.choose, scalars=SCALARS)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose the best candidate."""
        if self.expression is not None:
            return decide(self, pose, auvs, time)
        cna = self.situation.cna
        return unusable(cna, pose, auvs) or self._choose_within_limits(pose, auvs, time)

    def choose(
        self,
        time: Symbolic,
        pose: Symbolic,
        targets: Targets,
        allowed: Symbolic | None = None,
        otherwise: Symbolic | None = None,
    ) -> Command:
        """The best of the allowed candidates, all of them scored for every AUV at once.

        Without ``allowed`` all are; ``otherwise`` (straight on) if no candidate is regular.
        """
        scores, condition, doubt = self._scores(time, pose, targets)
        shares = self._shares(targets)
        totals, doubts = (self._aggregated(each, shares) for each in (scores, doubt))
        totals = totals if allowed is None else ca.if_else(allowed, totals, ca.inf)
        choose, auvs = first_of_the_best(self.turn_rates), targets.mean.shape[1]
        straight = 0.0 if otherwise is None else otherwise
        best, turn_rate = choose(totals, self.candidates, straight, doubts)
        totals, doubts = (ca.repmat(each, 1, auvs) for each in (totals, doubts))
        _, chosen = choose.map(auvs)(totals, condition, ca.DM.inf(1, auvs), doubts)
        status = ca.if_else(best < ca.inf, float(Status.OPTIMAL), float(Status.UNOBSERVABLE))
        return Command(turn_rate, ca.DM(self.situation.cna.speed), best, chosen, status)

    @property
    def look_ahead(self) -> float:
        """Horizon [s]; with pings the whole number of intervals that is nearest, at least three."""
        cna, interval = self.situation.cna, self.situation.ping_interval
        horizon = self.horizon
        if horizon is None:
            horizon = self.circles * 2.0 * np.pi * cna.min_turn_radius / cna.speed
        if self.sampling == "continuous":
            return horizon
        return max(LEAST_PINGS, round(horizon / interval)) * interval

    def _scores(
        self, time: Symbolic, pose: Symbolic, targets: Targets
    ) -> tuple[Symbolic, Symbolic, Symbolic]:
        """Metric, condition number and rounding of the metric of each candidate (K x M)."""
        entries = of_pose = self._pose_entries(time, pose, targets)
        lost = 1.0  # by which the block's entries are less than those that they are differences of
        if self.block == "position":
            entries = position_schur_expression(of_pose)
            lost = (of_pose[0] + of_pose[3]) / (entries[0] + entries[2])
        scores = condition = score_expression(self.metric, entries, blend_weight=self.blend_weight)
        if self.metric != "condition-number":
            condition = score_expression("condition-number", entries)
        doubt = ROUNDING[self.gramian] * lost * condition
        if self.metric in ("log-det", "blend"):
            return scores, condition, TIE + doubt * self._gain
        return scores, condition, doubt * ca.fabs(scores)

    @property
    def _gain(self) -> float:
        """Of a logarithmic metric on the relative error of the smallest eigenvalue."""
        return max(1.0, self.blend_weight) if self.metric == "blend" else 1.0

    def _pose_entries(self, time: Symbolic, pose: Symbolic, targets: Targets) -> Entries:
        """Upper triangles of the Gramians of pose in the body frame, each K x M."""
        body = partial(to_body, ca.cos(pose[2]), ca.sin(pose[2]))
        x = body(pose[0] - targets.mean[0, :], pose[1] - targets.mean[1, :])
        v = (
            None
            if self.motion == "at-rest"
            else body(targets.velocity[0, :], targets.velocity[1, :])
        )
        if self.gramian == "empirical":
            entries = empirical_gramian_entries(
                x,
                turn_rates=self.candidates,
                speed=self.situation.cna.speed,
                horizon=self.look_ahead,
            )
        else:
            entries = self._closed_form(time, x, v)
        if self.noise == "sensor":
            height = targets.depth - self.situation.transducer_depth
            entries = self._scaled(entries, height, self._heard(time, targets.mean.shape[1]))
        return entries

    @property
    def _slots(self) -> bool:
        """Whether AUVs have pings of their own."""
        return self.sampling == "pings" and not self.situation.schedule.plain

    def _closed_form(self, time: Symbolic, x: Entries, v: Entries | None) -> Entries:
        """Upper triangles of the Gramians of relative positions and AUVs' velocities."""
        build = partial(gramian_entries, variant=self.gramian)
        if not self._slots:
            return build(self._moments(time, 0), x, v)
        of_each = []
        for auv in range(x[0].shape[1]):
            x_own = x[0][auv], x[1][auv]
            v_own = None if v is None else (v[0][auv], v[1][auv])
            of_each.append(build(self._moments(time, auv), x_own, v_own))
        return tuple(ca.horzcat(*columns) for columns in zip(*of_each, strict=True))

    def _moments(self, time: Symbolic, auv: int) -> DisplacementMoments:
        """Moments of the candidates' arcs, all the time or at an AUV's next pings."""
        speed, interval = self.situation.cna.speed, self.situation.ping_interval
        if self.sampling == "continuous":
            return displacement_moments(speed, self.candidates, self.look_ahead)
        return ping_moments(
            speed,
            self.candidates,
            first=self.situation.schedule.time_to_slot(time, auv),
            interval=interval,
            count=round(self.look_ahead / interval),
            heard=self._heard_pings(time, auv) if self.situation.silent else None,
        )

    def _heard_pings(self, time: Symbolic, auv: int) -> Symbolic:
        """1 for each of an AUV's next pings that is not silent, as a column."""
        schedule, interval = self.situation.schedule, self.situation.ping_interval
        after = ca.DM(interval * np.arange(round(self.look_ahead / interval)))
        return schedule.heard(time + schedule.time_to_slot(time, auv) + after)

    def _heard(self, time: Symbolic, auvs: int) -> Symbolic:
        """For how long [s] of the horizon ranges come, to all AUVs or to each."""
        if not (self._slots and self.situation.silent):
            return self.look_ahead
        counts = [ca.sum1(self._heard_pings(time, auv)) for auv in range(auvs)]
        heard = ca.fmax(self.situation.ping_interval * ca.horzcat(*counts), HARDLY)
        return ca.repmat(heard, self.turn_rates, 1)

    def _scaled(self, entries: Entries, height: Symbolic, heard: Symbolic) -> Entries:
        """Gramian in units of the sensors' variances.

        With variance 1 the heading adds the time T that is heard to W33, and W11 + W22 is 4 T d².
        """
        w11, w12, w13, w22, w23, w33 = entries
        law, interval = law_of(self.situation.ranging), self.situation.ping_interval
        of_squares = w11 + w22  # a squared range's variance is 4 r² σ²
        if law.form.slant:
            up2 = ca.repmat(ca.vec(height).T ** 2, self.turn_rates, 1)
            of_squares += 4 * heard * up2
        r2 = of_squares / (4 * heard)
        if law.form.squared:
            of_squares = heard
        samples = arrival(law, r2, edge=EDGE) * (heard / interval)
        gain = samples / (variance(law, r2) * ca.if_else(of_squares > 0, of_squares, 1.0))
        unit = DEGREE if self.gramian == "degrees" else 1.0
        seen = self.look_ahead / interval / (self.situation.heading_sigma / unit) ** 2
        return (
            w11 * gain,
            w12 * gain,
            w13 * gain,
            w22 * gain,
            w23 * gain,
            (w33 - heard) * gain + seen,
        )

    def _shares(self, targets: Targets) -> Symbolic:
        """What each AUV counts; as given where covariances are to weigh and there are none."""
        fixed = targets.weight / ca.sum1(targets.weight)
        if self.weighting == "fixed":
            return fixed
        uncertain = (
            targets.weight
            * (targets.position_covariance[0, :] + targets.position_covariance[2, :]).T
        )
        total = ca.sum1(uncertain)
        return ca.if_else(total > 0, uncertain / ca.if_else(total > 0, total, 1.0), fixed)

    def _aggregated(self, scores: Symbolic, weight: Symbolic) -> Symbolic:
        """One total per candidate; an AUV of weight 0 has no say."""
        share = ca.repmat(weight.T, scores.shape[0], 1)
        if self.aggregate == "max":
            heard = ca.if_else(share > 0, scores, -ca.inf)
            return ca.vertcat(*(ca.mmax(heard[k, :]) for k in range(scores.shape[0])))
        power = 2 if self.aggregate == "rms" else 1
        return ca.sum2(ca.if_else(share > 0, share * scores**power, 0.0)) ** (1 / power)

    def _choose_within_limits(self, pose: Pose, auvs: Sequence[Belief], time: float) -> Decision:
        """The best of the least violating: before the next decision, then over the horizon."""
        first, later = (np.maximum(broken, 0.0) for broken in self._violations(pose, auvs))
        least = first <= first.min() * (1 + TIE)
        allowed = least & (later <= later[least].min() * (1 + TIE))
        straightest = min(self.candidates[allowed], key=abs)
        call = limited_choice(self, len(auvs))
        fill(call.given, pose, auvs, time)
        call.given[-self.turn_rates - 1 : -1] = allowed
        call.given[-1] = straightest
        decision = decision_of(call(), self.situation.cna, pose)
        return replace(decision, status=Status.VIOLATED) if first.min() > 0 else decision

    def _violations(
        self, pose: Pose, auvs: Sequence[Belief]
    ) -> tuple[Float[np.ndarray, " K"], Float[np.ndarray, " K"]]:
        """How far [m] each candidate breaks a limit: before the next decision, over the horizon.

        The first includes what it cannot avoid after the next decision.
        """
        cna, rates = self.situation.cna, self.candidates
        state = np.array([pose.x, pose.y, pose.heading])
        limits = LimitsAhead(self.situation, auvs)
        times = self.look_ahead * np.arange(1, HORIZON_POINTS + 1) / HORIZON_POINTS
        positions = arcs(state, rates, cna.speed, times)[..., :2]
        first = limits.first_move(state, rates, cna.speed)
        return first, limits.along(positions, times).max(axis=-1)


@lru_cache(maxsize=16)
def limited_choice(planner: GramianHorizon, n_auvs: int) -> Call:
    """The choice among allowed candidates for a number of AUVs, built once.

    Its arguments are the beliefs, the candidates allowed, and the turn rate if none is regular.
    """
    known = symbols(n_auvs, more=planner.turn_rates + 1)
    allowed, otherwise = known.more[:-1], known.more[-1]
    command = planner.choose(known.time, known.pose, known.targets, allowed, otherwise)
    function = ca.Function("choice", [known.given], [packed(command)])
    return Call(interpreted(function, planner.vectorized, n_auvs))
