"""One time step of the closed loop as one CasADi Function.

It moves the aid vehicle, and each AUV's truth, filter and last report.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import symbol
from formulations.model.covariance import pack, unpack
from obsplan.estimators import Process
from obsplan.planning.expressions import Expression, Targets, guarded
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
        """The Function (Carry, Inputs) -> (Carry, Log)."""
        auvs = len(self.scenario.table.auv)
        carry = Carry(*map(self._symbol, Carry._fields))
        inputs = Inputs(*map(self._symbol, Inputs._fields))
        command, score, condition, status = self._decide(carry, inputs)
        cna = self.scenario.cna.step(carry.cna, command, self.scenario.table.time_step)
        moved = [self._auv(i, cna, carry, inputs) for i in range(auvs)]
        *columns, ranges = (ca.horzcat(*column) for column in zip(*moved, strict=True))
        after = Carry(cna, command, *columns)
        log = Log(ranges, score, condition, status)
        outputs = [ca.densify(expression) for expression in (*after, *log)]
        given = [*Carry._fields, *Inputs._fields]
        made = [*(f"next_{name}" for name in Carry._fields), *Log._fields]
        return ca.Function("step", [*carry, *inputs], outputs, given, made)

    def _symbol(self, name: str) -> ca.SX:
        """The symbol of an input, with one column per AUV."""
        return symbol(name, *reversed(shape_of(name, self.scenario)))

    def _decide(self, carry: Carry, inputs: Inputs) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Command, score, condition numbers and status.

        A planner without an expression gives its command between steps, and the others are nan.
        """
        expression = folded(self.scenario, self.planner)
        if expression is None:
            return inputs.given, ca.SX.nan(1), ca.SX.nan(1, carry.truth.shape[1]), ca.SX.nan(1)
        means = {"survey": inputs.survey, "truth": carry.truth}
        known = means.get(self.scenario.table.planner.knowledge, carry.reported)
        pose = ca.vertcat(carry.cna, carry.command[0])
        targets = self._targets(known[:BASIC, :], carry)
        new = guarded(expression, inputs.time, pose, targets)
        command = ca.if_else(inputs.decide, ca.vertcat(new.turn_rate, new.speed), carry.command)
        score = ca.if_else(inputs.decide, new.score, np.nan)
        condition = ca.if_else(inputs.decide, new.condition, np.nan)
        status = ca.if_else(inputs.decide, new.status, np.nan)
        return command, score, condition, status

    def _targets(self, known: ca.SX, carry: Carry) -> Targets:
        """What the planner is told: means by the scenario's knowledge, uncertainty as reported.

        The report is the last one of the AUVs' filters.
        """
        auvs = self.scenario.table.auv
        current = ca.repmat(ca.SX(ca.DM(self.scenario.table.environment.current)), 1, len(auvs))
        weight = ca.SX(ca.DM([auv.weight for auv in auvs]))
        second = len(self.scenario.filter_states)  # where the second column of the triangle begins
        position = carry.reported_covariance[[0, 1, second], :]
        return Targets(known, current, position, weight)

    def _auv(self, i: int, cna: ca.SX, carry: Carry, inputs: Inputs) -> tuple[ca.SX, ...]:
        """Truth, mean, covariance, report and range of one AUV at the step's end."""
        scenario = self.scenario
        vehicle, filtering, process = scenario.vehicles[i], scenario.estimator, self._process(i)
        compass, ranging = scenario.heading_sensor, scenario.range_sensor
        m = len(scenario.filter_states)
        # the autopilot brings heading and speed back to the survey's, and measures what it did
        u = inputs.steer[:, i] - carry.truth[2:BASIC, i]
        moved = vehicle.step(carry.truth[:, i], u, scenario.table.time_step)
        truth = moved + inputs.disturbance[:, i]
        x, P = filtering.predict(carry.mean[:, i], unpack(carry.covariance[:, i], m), u, process)
        heading = compass.measure(truth, cna) + inputs.heading_error[i]
        x, P = filtering.update(x, P, heading, compass, cna)
        error = ranging.deviation(truth, cna) * inputs.range_error[i]
        z = ranging.measure(truth, cna) + error
        x_ranged, P_ranged = filtering.update(x, P, z, ranging, cna)
        x = ca.if_else(inputs.ping, x_ranged, x)
        P = ca.if_else(inputs.ping, pack(P_ranged), pack(P))
        along = scenario.table.planner.knowledge == "estimate-and-survey"
        turns = inputs.steer[:, i] - carry.reported[2:BASIC, i] if along else ca.SX.zeros(2)
        reckoned, reckoned_P = filtering.predict(
            carry.reported[:, i], unpack(carry.reported_covariance[:, i], m), turns, process
        )
        reported = ca.if_else(inputs.ping, x, reckoned)
        reported_P = ca.if_else(inputs.ping, P, pack(reckoned_P))
        measured = ca.if_else(inputs.ping, z, np.nan)
        return truth, x, P, reported, reported_P, measured

    def _process(self, i: int) -> Process:
        """What the filter of an AUV assumes."""
        scenario = self.scenario
        assumed = noise(scenario, scenario.filter_states, assumed=True)[i]
        return Process(
            model=scenario.vehicles[i], noise=tuple(assumed), dt=scenario.table.time_step
        )
