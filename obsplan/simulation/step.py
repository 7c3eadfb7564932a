"""One time step of the closed loop as one CasADi Function.

It moves the aid vehicles, and each AUV's truth, filter and last report.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import matrix, symbol
from obsplan.planning.expressions import Command, Expression, Targets, decision_function
from obsplan.planning.interface import Planner, expression_of
from obsplan.scenario import Scenario
from obsplan.scenario.states import BASIC
from obsplan.simulation.features import Features
from obsplan.simulation.own import Kind, Own
from obsplan.simulation.surveyor import Fleet, Surveyor


class Carry(NamedTuple):
    """What one step hands to the next: expressions, or arrays with axes (..., AUV, row).

    Expressions have one column per AUV, or aid vehicle. Truths have the n states of the vehicles,
    estimates the m of the filter. Covariances are their lower triangles by columns.
    """

    cna: Any  # 3 x C: east, north, heading of each aid vehicle
    command: Any  # 2 x C: turn rate, speed
    truth: Any  # n x M
    mean: Any  # m x M
    covariance: Any  # m (m + 1) / 2 x M
    reported: Any  # m x M, the mean as last reported at a ping and dead-reckoned since
    reported_covariance: Any  # as covariance
    in_flight: Any  # reports on their way, each: mean, covariance, steps until it arrives
    excess: Any  # 1 x M, of squared innovations over what filters expect, a running mean [m^2]
    reported_excess: Any  # as last reported; both are none where nothing is doubted
    # several hypotheses, where there are: mean and covariance are those of all together
    bank: Any
    misses: Any  # B x M, ranges rejected in a row; none without a gate


# of Carry, what no run records: arrays have the present sample only
HELD = (
    *("reported", "reported_covariance", "in_flight", "excess", "reported_excess"),
    *("bank", "misses"),
)


class Inputs(NamedTuple):
    """What a step is given from outside; as arrays, with the step as first axis.

    From ``chance`` on there are none where the scenario has no use for them (`Features`).
    """

    time: Any  # 1, at the step's beginning [s]
    decide: Any  # 1, whether a decision is due
    given: Any  # 2 x C: turn rate, speed, of planners that are no expression
    ping: Any  # B x M, whether an AUV ranges to a beacon at the step's end
    survey: Any  # 4 x M, the reference at the step's beginning; and the depth where that counts
    steer: Any  # 2 x M, heading and speed of the reference at the step's end
    disturbance: Any  # n x M, process noise over the step
    heading_error: Any  # 1 x M, of the measurement at the step's end [rad]
    range_error: Any  # B x M, in standard deviations
    chance: Any  # B x M, from 0 to 1: a range comes whose probability is greater
    false: Any  # 2 B x M: how much longer ranges are whatever the distance [m]; relative errors
    repeated: Any  # B x M, whether a range is delivered twice
    depth: Any  # 1 x M, true depth at the step's end [m]
    depth_error: Any  # 1 x M, of its measurement [m]
    bearing_error: Any  # B x M, in standard deviations
    log: Any  # 1 x M, whether the speed is measured at the step's end
    log_error: Any  # some x M, in standard deviations
    water: Any  # 2 x M, true current at the step's end [m/s]
    stream: Any  # 2 x C, current that carries the aid vehicles over the step [m/s]
    report_chance: Any  # B x M, from 0 to 1: a report comes whose probability is greater


class Log(NamedTuple):
    """What a step says besides; ``range`` is nan where none came, the others without a decision."""

    range: Any  # B x M
    score: Any  # 1 x C
    condition: Any  # 1 x M, of the first aid vehicle's decision
    status: Any  # 1 x C
    bearing: Any  # B x M, or none
    report: Any  # 1 x M, whether a report was made that is heard, be it later
    fate: Any  # B x M, code of what became of a range (`Fate`)
    innovation: Any  # B x M, of the range
    innovation_variance: Any  # B x M


OF_ALL = ("time", "decide")  # one column
# a column for each aid vehicle
OF_AID = ("cna", "command", "given", "score", "status", "stream")

# of each AUV, what its part of the step is told of Carry and Inputs
OF_AUV = (
    *("truth", "mean", "covariance", "reported", "reported_covariance"),
    *("in_flight", "excess", "reported_excess", "bank", "misses"),
)
GIVEN_AUV = (
    *("survey", "steer", "disturbance", "ping", "heading_error", "range_error"),
    *("chance", "false", "repeated", "depth", "depth_error", "bearing_error"),
    *("log", "log_error", "water", "report_chance"),
)
LOGGED_AUV = ("range", "bearing", "report", "fate", "innovation", "innovation_variance")
FOUND = (*OF_AUV, *LOGGED_AUV)


def shape_of(name: str, scenario: Scenario, hypotheses: int = 1) -> tuple[int, int]:
    """Axes (column, row) of a field, as arrays have them, with room for some hypotheses."""
    n, m = len(scenario.truth_states), len(scenario.filter_states)
    half, beacons = m * (m + 1) // 2, len(scenario.beacons)
    has = Features.of(scenario)
    rows = {"cna": 3, "command": 2, "given": 2, "survey": BASIC + has.deep, "steer": 2}
    rows |= {"truth": n, "disturbance": n, "mean": m, "reported": m}
    rows |= {"covariance": half, "reported_covariance": half}
    rows |= {"ping": beacons, "range_error": beacons, "range": beacons}
    rows |= {"chance": beacons * has.lossy, "repeated": beacons * has.repeated}
    rows |= {"false": 2 * beacons * has.false, "depth": has.deep, "depth_error": has.deep}
    rows |= {"log": has.logged > 0, "log_error": has.logged}
    rows |= {"water": 2 * has.varying, "stream": 2 * has.carried}
    rows |= {"in_flight": scenario.in_flight * (m + half + has.doubted + 1)}
    rows |= {"report_chance": beacons * has.unheard, "excess": has.doubted}
    rows |= {"reported_excess": has.doubted}
    filtering = scenario.filtering(hypotheses)
    rows |= {"bank": filtering.rows, "misses": filtering.counted}
    rows |= dict.fromkeys(("fate", "innovation", "innovation_variance"), beacons)
    rows |= {"bearing_error": beacons * has.bearing, "bearing": beacons * has.bearing}
    columns = len(scenario.table.auv)
    if name in OF_ALL or name in OF_AID:
        columns = 1 if name in OF_ALL else len(scenario.aids)
    return columns, int(rows.get(name, 1))


def folded(scenario: Scenario, planner: Planner) -> Expression | None:
    """The planner's expression, or None where it has to be called between steps.

    Under limits it is always None.
    """
    return None if scenario.constraints else expression_of(planner)


@dataclass(frozen=True, kw_only=True)
class StepBuilder:
    """Composes a scenario's vehicles, sensors and filter into one step.

    Planners that are expressions are part of it.
    """

    scenario: Scenario
    planners: tuple[Planner, ...]  # of the aid vehicles
    hypotheses: int = 1  # that there is room for

    def build(self) -> ca.Function:
        """The Function (Carry, Inputs) -> (Carry, Log), of the fields that have any row.

        The others would take a tenth of its time, empty as they are.
        What concerns one AUV is one Function, mapped over those of a kind: the step is about as
        large for many AUVs as for one.
        """
        carry, inputs = Carry(*self._matrices(Carry)), Inputs(*self._matrices(Inputs))
        command, score, condition, status = self._decide(carry, inputs)
        moved = self._moved()
        aids = range(len(self.planners))
        stream = inputs.stream
        cna = ca.horzcat(*(moved(carry.cna[:, c], command[:, c], stream[:, c]) for c in aids))
        found = dict(zip(FOUND, self._fleet(cna, command, carry, inputs), strict=True))
        after = Carry(cna, command, *(found[name] for name in OF_AUV))
        decided = {"score": score, "condition": condition, "status": status}
        log = Log(**decided, **{name: found[name] for name in LOGGED_AUV})
        given = _filled({**carry._asdict(), **inputs._asdict()})
        moved_on = {f"next_{name}": value for name, value in after._asdict().items()}
        found = _filled({**moved_on, **log._asdict()})
        outputs = [ca.densify(expression) for expression in found.values()]
        return ca.Function("step", [*given.values()], outputs, [*given], [*found])

    def _matrices(self, of: type[Carry | Inputs]) -> list[ca.MX]:
        """A symbol for each field."""
        return [matrix(name, *self._shape(name)[::-1]) for name in of._fields]

    def _shape(self, name: str) -> tuple[int, int]:
        """Axes (column, row) of a field."""
        return shape_of(name, self.scenario, self.hypotheses)

    def _moved(self) -> ca.Function:
        """(pose, command, current that carries it) -> pose of an aid vehicle."""
        pose, command = symbol("pose", 3), symbol("command", 2)
        stream = symbol("stream", shape_of("stream", self.scenario)[1])
        dt = self.scenario.table.time_step
        after = self.scenario.cna.step(pose, command, dt)
        if stream.numel():
            after = ca.vertcat(after[:2] + stream * dt, after[2])
        return ca.Function("moved", [pose, command, stream], [after])

    def _decide(self, carry: Carry, inputs: Inputs) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Commands, scores and statuses of the aid vehicles, condition numbers of the first's.

        The commands of planners that are no expressions are given.
        """
        offered = [folded(self.scenario, planner) for planner in self.planners]
        expressions = [expression for expression in offered if expression is not None]
        auvs, aids = carry.truth.shape[1], len(offered)
        if len(expressions) < aids:
            return inputs.given, ca.MX.nan(1, aids), ca.MX.nan(1, auvs), ca.MX.nan(1, aids)
        known = {"survey": inputs.survey, "truth": carry.truth}.get(
            self.scenario.table.planner.knowledge, carry.reported
        )[:BASIC, :]
        due = partial(ca.if_else, inputs.decide)
        commands, scores, statuses, conditions = [], [], [], []
        for c, expression in enumerate(expressions):
            pose = ca.vertcat(carry.cna[:, c], carry.command[0, c])
            decision = decision_function(expression, auvs, self.scenario.aids[c])
            new = Command(*decision(inputs.time, pose, *self._targets(known, carry, inputs, c)))
            command = due(ca.vertcat(new.turn_rate, new.speed), carry.command[:, c])
            commands.append(command)
            scores.append(due(new.score, np.nan))
            statuses.append(due(new.status, np.nan))
            conditions.append(due(ca.reshape(new.condition, 1, auvs), np.nan))
        return ca.horzcat(*commands), ca.horzcat(*scores), conditions[0], ca.horzcat(*statuses)

    def _targets(self, known: ca.MX, carry: Carry, inputs: Inputs, aid: int) -> Targets:
        """What the planner of an aid vehicle is told.

        Means are by the scenario's knowledge, uncertainty always as the AUVs' filters last
        reported it. Currents are relative to what carries the aid vehicle.
        """
        auvs = self.scenario.table.auv
        carrying = np.array(self.scenario.carrying[aid])
        current = ca.DM((np.array(self.scenario.assumed_currents) - carrying).T)
        weight = ca.DM([auv.weight for auv in auvs])
        second = len(self.scenario.filter_states)  # where the second column of the triangle begins
        position = carry.reported_covariance[[0, 1, second], :]
        deep = Features.of(self.scenario).deep
        depth = inputs.survey[BASIC:, :] if deep else ca.DM.zeros(1, len(auvs))
        doubt = carry.reported_excess
        doubt = ca.sqrt(ca.fmax(doubt, 0.0)) if doubt.numel() else ca.DM.zeros(1, len(auvs))
        return Targets(known, current, position, weight, depth, doubt)

    def _fleet(self, cna: ca.MX, command: ca.MX, carry: Carry, inputs: Inputs) -> list[ca.MX]:
        """Each of `FOUND` of all AUVs at the step's end."""
        kinds: dict[Kind, list[int]] = {}
        for i in range(len(self.scenario.table.auv)):
            kinds.setdefault(self._kind(i), []).append(i)
        known = [getattr(carry, name) for name in OF_AUV] + [getattr(inputs, n) for n in GIVEN_AUV]
        found = []
        of_all = (cna, command, inputs.stream)
        for kind, these in kinds.items():
            own = [field[:, these] for field in known]
            shared = [ca.repmat(ca.vec(field), 1, len(these)) for field in of_all]
            found.append(self._of_one(kind).map(len(these))(*own, *shared))
        order = np.argsort(np.concatenate([*kinds.values()])).tolist()
        return [ca.horzcat(*columns)[:, order] for columns in zip(*found, strict=True)]

    def _of_one(self, kind: Kind) -> ca.Function:
        """Each of `FOUND` of one AUV of a kind at the step's end."""
        names = (*OF_AUV, *GIVEN_AUV)
        own = {name: symbol(name, self._shape(name)[1]) for name in names}
        aids = len(self.planners)
        of_aid = {name: shape_of(name, self.scenario)[1] for name in ("cna", "command", "stream")}
        shared = [symbol(name, rows * aids) for name, rows in of_aid.items()]
        by_aid = [ca.reshape(column, -1, aids) for column in shared]
        fleet = Fleet.of(self.scenario, *by_aid)
        surveyor = Surveyor(self.scenario, kind, fleet, self.scenario.filtering(self.hypotheses))
        results = surveyor.step(Own(**own))
        found = [ca.densify(results[name]) for name in FOUND]
        # what truth, filter and its second update of a range have in common is computed once
        return ca.Function("of_one", [*own.values(), *shared], found, {"cse": True})

    def _kind(self, i: int) -> Kind:
        """What the filter of an AUV assumes, and what measures its speed."""
        scenario = self.scenario
        process = scenario.filter_process(i, scenario.table.time_step)
        logs = zip(scenario.true_logs[i], scenario.filter_logs[i], strict=True)
        return Kind(scenario.vehicles[i], process, scenario.assumed_currents[i], tuple(logs))


def _filled(fields: dict[str, ca.MX]) -> dict[str, ca.MX]:
    """Those that have any row."""
    return {name: value for name, value in fields.items() if value.numel()}
