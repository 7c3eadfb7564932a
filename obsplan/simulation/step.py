"""One time step of the closed loop as one CasADi Function.

It moves the aid vehicle, and each AUV's truth, filter and last report.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import matrix, symbol
from formulations.model.covariance import pack, unpack
from obsplan.estimators import Process
from obsplan.planning.expressions import Command, Expression, Targets, decision_function
from obsplan.planning.interface import Planner, expression_of
from obsplan.scenario import Scenario
from obsplan.scenario.states import BASIC, noise


class Carry(NamedTuple):
    """What one step hands to the next: expressions, or arrays with axes (..., AUV, row).

    Expressions have one column per AUV. Truths have the n states of the vehicles, estimates the m
    of the filter. Covariances are their lower triangles by columns.
    """

    cna: Any  # 3: east, north, heading
    command: Any  # 2: turn rate, speed
    truth: Any  # n x M
    mean: Any  # m x M
    covariance: Any  # m (m + 1) / 2 x M
    reported: Any  # m x M, the mean as last reported at a ping and dead-reckoned since
    reported_covariance: Any  # as covariance


# of Carry, what no run records: arrays have the present sample only
HELD = ("reported", "reported_covariance")


class Inputs(NamedTuple):
    """What a step is given from outside; as arrays, with the step as first axis."""

    time: Any  # 1, at the step's beginning [s]
    decide: Any  # 1, whether a decision is due
    given: Any  # 2: turn rate, speed, of a planner that is no expression
    ping: Any  # 1, whether ranges are measured at the step's end
    survey: Any  # 4 x M, the reference at the step's beginning
    steer: Any  # 2 x M, heading and speed of the reference at the step's end
    disturbance: Any  # n x M, process noise over the step
    heading_error: Any  # 1 x M, of the measurement at the step's end [rad]
    range_error: Any  # 1 x M, in standard deviations


class Log(NamedTuple):
    """What a step says besides; ``range`` is nan without a ping, the others without a decision."""

    range: Any  # 1 x M
    score: Any  # 1
    condition: Any  # 1 x M
    status: Any  # 1


# one column, however many AUVs
OF_ALL = (
    "cna",
    "command",
    "time",
    "decide",
    "given",
    "ping",
    "score",
    "status",
)


# of each AUV, what its part of the step is told of Carry and Inputs
OF_AUV = ("truth", "mean", "covariance", "reported", "reported_covariance")
GIVEN_AUV = ("steer", "disturbance", "heading_error", "range_error")


def shape_of(name: str, scenario: Scenario) -> tuple[int, int]:
    """Axes (column, row) of a field, as arrays have them."""
    n, m = len(scenario.truth_states), len(scenario.filter_states)
    half = m * (m + 1) // 2
    rows = {"cna": 3, "command": 2, "given": 2, "survey": BASIC, "steer": 2}
    rows |= {"truth": n, "disturbance": n, "mean": m, "reported": m}
    rows |= {"covariance": half, "reported_covariance": half}
    return 1 if name in OF_ALL else len(scenario.table.auv), rows.get(name, 1)


def folded(scenario: Scenario, planner: Planner) -> Expression | None:
    """The planner's expression, or None where it has to be called between steps.

    Under limits it is always None.
    """
    return None if scenario.constraints else expression_of(planner)


@dataclass(frozen=True, kw_only=True)
class StepBuilder:
    """Composes a scenario's vehicle, sensors and filter into one step.

    A planner that is an expression is part of it.
    """

    scenario: Scenario
    planner: Planner

    def build(self) -> ca.Function:
        """The Function (Carry, Inputs) -> (Carry, Log).

        What concerns one AUV is one Function, mapped over those of a kind: the step is about as
        large for many AUVs as for one.
        """
        carry, inputs = Carry(*self._matrices(Carry)), Inputs(*self._matrices(Inputs))
        command, score, condition, status = self._decide(carry, inputs)
        cna = self._moved()(carry.cna, command)
        *columns, ranges = self._fleet(cna, carry, inputs)
        after, log = Carry(cna, command, *columns), Log(ranges, score, condition, status)
        outputs = [ca.densify(expression) for expression in (*after, *log)]
        names = (
            [*Carry._fields, *Inputs._fields],
            [*(f"next_{name}" for name in Carry._fields), *Log._fields],
        )
        return ca.Function("step", [*carry, *inputs], outputs, *names)

    def _matrices(self, of: type[Carry | Inputs]) -> list[ca.MX]:
        """A symbol for each field."""
        return [matrix(name, *shape_of(name, self.scenario)[::-1]) for name in of._fields]

    def _moved(self) -> ca.Function:
        """(pose, command) -> pose of the aid vehicle."""
        pose, command = symbol("pose", 3), symbol("command", 2)
        after = self.scenario.cna.step(pose, command, self.scenario.table.time_step)
        return ca.Function("moved", [pose, command], [after])

    def _decide(self, carry: Carry, inputs: Inputs) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Command, score, condition numbers and status.

        The command of a planner that is no expression is given.
        """
        expression, auvs = folded(self.scenario, self.planner), carry.truth.shape[1]
        if expression is None:
            return inputs.given, ca.MX.nan(1), ca.MX.nan(1, auvs), ca.MX.nan(1)
        known = {"survey": inputs.survey, "truth": carry.truth}.get(
            self.scenario.table.planner.knowledge, carry.reported
        )[:BASIC, :]
        pose = ca.vertcat(carry.cna, carry.command[0])
        decision = decision_function(expression, auvs, self.scenario.cna)
        new = Command(*decision(inputs.time, pose, *self._targets(known, carry)))
        due = partial(ca.if_else, inputs.decide)
        command = due(ca.vertcat(new.turn_rate, new.speed), carry.command)
        condition = ca.reshape(new.condition, 1, auvs)
        return command, due(new.score, np.nan), due(condition, np.nan), due(new.status, np.nan)

    def _targets(self, known: ca.MX, carry: Carry) -> Targets:
        """What the planner is told.

        Means are by the scenario's knowledge, uncertainty always as the AUVs' filters last
        reported it.
        """
        auvs = self.scenario.table.auv
        current = ca.repmat(ca.DM(self.scenario.table.environment.current), 1, len(auvs))
        weight = ca.DM([auv.weight for auv in auvs])
        second = len(self.scenario.filter_states)  # where the second column of the triangle begins
        position = carry.reported_covariance[[0, 1, second], :]
        return Targets(known, current, position, weight)

    def _fleet(self, cna: ca.MX, carry: Carry, inputs: Inputs) -> list[ca.MX]:
        """Truth, mean, covariance, report and range of all AUVs at the step's end."""
        kinds: dict[Process, list[int]] = {}
        for i in range(len(self.scenario.table.auv)):
            kinds.setdefault(self._process(i), []).append(i)
        known = [getattr(carry, name) for name in OF_AUV] + [getattr(inputs, n) for n in GIVEN_AUV]
        found = []
        for process, these in kinds.items():
            own = [field[:, these] for field in known]
            shared = [ca.repmat(field, 1, len(these)) for field in (cna, inputs.ping)]
            found.append(self._of_one(process).map(len(these))(*own, *shared))
        order = np.argsort(np.concatenate([*kinds.values()])).tolist()
        return [ca.horzcat(*columns)[:, order] for columns in zip(*found, strict=True)]

    def _of_one(self, process: Process) -> ca.Function:
        """Truth, mean, covariance, report and range of one AUV of a kind at the step's end."""
        rows = [shape_of(name, self.scenario)[1] for name in (*OF_AUV, *GIVEN_AUV)]
        own = [symbol(*of) for of in zip((*OF_AUV, *GIVEN_AUV), rows, strict=True)]
        cna, ping = symbol("cna", 3), symbol("ping")
        results = [ca.densify(result) for result in self._auv(process, cna, ping, *own)]
        return ca.Function("of_one", [*own, cna, ping], results)

    def _auv(
        self,
        process: Process,
        cna: ca.SX,
        ping: ca.SX,
        truth: ca.SX,
        mean: ca.SX,
        covariance: ca.SX,
        reported: ca.SX,
        reported_covariance: ca.SX,
        steer: ca.SX,
        disturbance: ca.SX,
        heading_error: ca.SX,
        range_error: ca.SX,
    ) -> tuple[ca.SX, ...]:
        """The same as expressions."""
        scenario, filtering = self.scenario, self.scenario.estimator
        compass, ranging = scenario.heading_sensor, scenario.range_sensor
        m = len(scenario.filter_states)
        # the autopilot brings heading and speed back to the survey's, and measures what it did
        u = steer - truth[2:BASIC]
        moved = process.model.step(truth, u, scenario.table.time_step)
        after = moved + disturbance
        x, P = filtering.predict(mean, unpack(covariance, m), u, process)
        heading = compass.measure(after, cna) + heading_error
        x, P = filtering.update(x, P, heading, compass, cna)
        error = ranging.deviation(after, cna) * range_error
        z = ranging.measure(after, cna) + error
        x_ranged, P_ranged = filtering.update(x, P, z, ranging, cna)
        pinged = partial(ca.if_else, ping)
        x, P = pinged(x_ranged, x), pinged(pack(P_ranged), pack(P))
        along = scenario.table.planner.knowledge == "estimate-and-survey"
        turns = steer - reported[2:BASIC] if along else ca.SX.zeros(2)
        reckoned, reckoned_P = filtering.predict(
            reported, unpack(reported_covariance, m), turns, process
        )
        return after, x, P, pinged(x, reckoned), pinged(P, pack(reckoned_P)), pinged(z, np.nan)

    def _process(self, i: int) -> Process:
        """What the filter of an AUV assumes."""
        scenario = self.scenario
        assumed = noise(scenario, scenario.filter_states, assumed=True)[i]
        return Process(
            model=scenario.vehicles[i], noise=tuple(assumed), dt=scenario.table.time_step
        )
