"""One time step of the closed loop as one CasADi Function: the aid vehicle, and each AUV's truth, filter and last report."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import symbol
from formulations.model.covariance import pack, unpack
from obsplan.estimators import Ekf
from obsplan.planning.expressions import Expression, Targets, guarded
from obsplan.planning.interface import Planner, expression_of
from obsplan.scenario import Scenario

N = 4  # states of an AUV: east, north [m], heading [rad], speed through the water [m/s]
HALF = N * (N + 1) // 2  # entries of a covariance's lower triangle


class Carry(NamedTuple):
    """What one step hands to the next: expressions with one column per AUV, or arrays with axes (..., AUV, row).

    Covariances are their lower triangles by columns.
    """

    cna: Any  # 3: east, north, heading
    command: Any  # 2: turn rate, speed
    truth: Any  # N x M
    mean: Any  # N x M
    covariance: Any  # HALF x M
    reported: Any  # N x M, the mean as last reported at a ping and dead-reckoned since
    reported_covariance: Any  # HALF x M


class Inputs(NamedTuple):
    """What a step is given from outside; as arrays, with the step as first axis."""

    time: Any  # 1, at the step's beginning [s]
    decide: Any  # 1, whether a decision is due
    given: Any  # 2: turn rate, speed, of a planner that is no expression
    ping: Any  # 1, whether ranges are measured at the step's end
    survey: Any  # N x M, the reference at the step's beginning
    steer: Any  # 2 x M, heading and speed of the reference at the step's end
    disturbance: Any  # N x M, process noise over the step
    heading_error: Any  # 1 x M, of the measurement at the step's end
    range_error: Any  # 1 x M


class Log(NamedTuple):
    """What a step says besides; ``range`` is nan without a ping, the others without a decision."""

    range: Any  # 1 x M
    score: Any  # 1
    condition: Any  # 1 x M
    status: Any  # 1


ROWS = {
    "cna": 3,
    "command": 2,
    "given": 2,
    "covariance": HALF,
    "reported_covariance": HALF,
    "truth": N,
    "mean": N,
    "reported": N,
}
ROWS |= {"survey": N, "steer": 2, "disturbance": N}
OF_ALL = (
    "cna",
    "command",
    "time",
    "decide",
    "given",
    "ping",
    "score",
    "status",
)  # one column, however many AUVs


def shape_of(name: str, auvs: int) -> tuple[int, int]:
    """Axes (column, row) of a field, as arrays have them."""
    return 1 if name in OF_ALL else auvs, ROWS.get(name, 1)


def folded(scenario: Scenario, planner: Planner) -> Expression | None:
    """The planner's expression, where the step can hold it; None where it has to be called between steps, as always under limits."""
    return None if scenario.constraints else expression_of(planner)


@dataclass(frozen=True, kw_only=True)
class StepBuilder:
    """Composes vehicle, sensors, filter and, where it is an expression, the planner of a scenario into one step."""

    scenario: Scenario
    planner: Planner

    def build(self) -> ca.Function:
        """The Function (Carry, Inputs) -> (Carry, Log)."""
        auvs = len(self.scenario.table.auv)
        of = lambda name: symbol(name, *shape_of(name, auvs)[::-1])  # noqa: E731
        carry, inputs = Carry(*map(of, Carry._fields)), Inputs(*map(of, Inputs._fields))
        command, score, condition, status = self._decide(carry, inputs)
        cna = self.scenario.cna.step(carry.cna, command, self.scenario.table.time_step)
        moved = [self._auv(i, cna, carry, inputs) for i in range(auvs)]
        *columns, ranges = (ca.horzcat(*column) for column in zip(*moved, strict=True))
        after, log = Carry(cna, command, *columns), Log(ranges, score, condition, status)
        outputs = [ca.densify(expression) for expression in (*after, *log)]
        names = (
            [*Carry._fields, *Inputs._fields],
            [*(f"next_{name}" for name in Carry._fields), *Log._fields],
        )
        return ca.Function("step", [*carry, *inputs], outputs, *names)

    def _decide(self, carry: Carry, inputs: Inputs) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Command, score, condition numbers and status; the command of a planner that is no expression is given."""
        expression = folded(self.scenario, self.planner)
        if expression is None:
            return inputs.given, ca.SX.nan(1), ca.SX.nan(1, carry.truth.shape[1]), ca.SX.nan(1)
        known = {"survey": inputs.survey, "truth": carry.truth}.get(
            self.scenario.table.planner.knowledge, carry.reported
        )
        new = guarded(
            expression,
            inputs.time,
            ca.vertcat(carry.cna, carry.command[0]),
            self._targets(known, carry),
        )
        due = lambda value, otherwise: ca.if_else(inputs.decide, value, otherwise)  # noqa: E731
        command = due(ca.vertcat(new.turn_rate, new.speed), carry.command)
        return command, due(new.score, np.nan), due(new.condition, np.nan), due(new.status, np.nan)

    def _targets(self, known: ca.SX, carry: Carry) -> Targets:
        """What the planner is told: means by the scenario's knowledge, uncertainty always as the AUVs' filters last reported it."""
        auvs = self.scenario.table.auv
        current = ca.repmat(ca.SX(ca.DM(self.scenario.table.environment.current)), 1, len(auvs))
        weight = ca.SX(ca.DM([auv.weight for auv in auvs]))
        return Targets(
            known, current, carry.reported_covariance[[0, 1, N], :], weight
        )  # P11, P21, P22 of a lower triangle by columns

    def _auv(self, i: int, cna: ca.SX, carry: Carry, inputs: Inputs) -> tuple[ca.SX, ...]:
        """Truth, mean, covariance, report and range of one AUV at the step's end."""
        ekf, compass, ranging = (
            self._filter(i),
            self.scenario.heading_sensor,
            self.scenario.range_sensor,
        )
        u = (
            inputs.steer[:, i] - carry.truth[2:, i]
        )  # the autopilot brings heading and speed back to the survey's, and measures what it did
        truth = ekf.f(carry.truth[:, i], u) + inputs.disturbance[:, i]
        x, P = ekf.predict(carry.mean[:, i], unpack(carry.covariance[:, i]), u)
        x, P = ekf.update(x, P, compass.measure(truth, cna) + inputs.heading_error[i], compass, cna)
        z = ranging.measure(truth, cna) + inputs.range_error[i]
        x_ranged, P_ranged = ekf.update(x, P, z, ranging, cna)
        pinged = lambda value, otherwise: ca.if_else(inputs.ping, value, otherwise)  # noqa: E731
        x, P = pinged(x_ranged, x), pinged(pack(P_ranged), pack(P))
        along = self.scenario.table.planner.knowledge == "estimate-and-survey"
        turns = inputs.steer[:, i] - carry.reported[2:, i] if along else ca.SX.zeros(2)
        reckoned, reckoned_P = ekf.predict(
            carry.reported[:, i], unpack(carry.reported_covariance[:, i]), turns
        )
        return truth, x, P, pinged(x, reckoned), pinged(P, pack(reckoned_P)), pinged(z, np.nan)

    def _filter(self, i: int) -> Ekf:
        dt = self.scenario.table.time_step
        Q = np.diag(self.scenario.process_noise(assumed=True)[i] ** 2 * dt)
        return Ekf(f=lambda x, u: self.scenario.auv_model.step(x, u, dt), Q=ca.DM(Q))
