"""The closed loop: truth, noise, estimate, plan. The only place where they meet."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from obsplan.estimators import Ekf
from obsplan.planners.protocol import ExpressionPlanner, Planner, Targets, guarded_expression
from obsplan.run import Run, Timing, record
from obsplan.scenario import Scenario, load, replanned
from obsplan.types import Belief, Pose

N = 4  # states of an AUV: east, north [m], heading [rad], speed through the water [m/s]
HALF = N * (N + 1) // 2  # entries of a covariance's lower triangle
CHUNK = 256  # steps between two looks at the clock and the keyboard


class Carry(NamedTuple):
    """What one step hands to the next; matrices have one column per AUV, covariances their lower triangle by columns."""

    cna: Any  # 3: east, north, heading
    command: Any  # 2: turn rate, speed
    truth: Any  # N x M
    mean: Any  # N x M
    covariance: Any  # HALF x M
    reported: Any  # N x M, the mean as last reported at a ping and dead-reckoned since
    reported_covariance: Any  # HALF x M


class Inputs(NamedTuple):
    """What a step is given from outside, one column (or M columns) a step."""

    time: Any  # 1, at the step's beginning [s]
    decide: Any  # 1, whether a decision is due
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


def simulate(
    scenario: Scenario | str,
    *,
    planner: Planner | str | None = None,
    seed: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """Fly one mission: move the truth, measure, filter, plan.

    Parameters
    ----------
    scenario
        A scenario, or the name or path of one.
    planner
        A planner by name, or any object that has ``plan``; default: the scenario's.
    seed
        Of all random numbers; default: the scenario's. The same seed gives the same noise to every planner.
    progress
        Called with (steps done, steps in all) every few hundred steps.

    Raises
    ------
    ObsplanError
        The scenario or the planner's name is wrong.
    """
    scenario = load(scenario) if isinstance(scenario, str) else scenario
    scenario = replanned(scenario, planner) if isinstance(planner, str) else scenario
    planner = scenario.planner() if planner is None or isinstance(planner, str) else planner
    seed = scenario.table.seed if seed is None else seed
    loop = ClosedLoop(scenario=scenario, planner=planner)
    began = perf_counter()
    carries, logs, decision_times = loop.fly(seed, progress or (lambda _done, _steps: None))
    timing = Timing(seconds=perf_counter() - began, decision_seconds=decision_times)
    return record(scenario, planner, seed, carries._asdict(), logs._asdict(), timing)


@dataclass(frozen=True, kw_only=True)
class ClosedLoop:
    """One scenario under one planner, as one compiled step."""

    scenario: Scenario
    planner: Planner

    @property
    def folded(self) -> bool:
        """Whether the planner's decision is part of the step; else it is called between steps."""
        return isinstance(self.planner, ExpressionPlanner)

    @cached_property
    def step(self) -> ca.Function:
        """The Function (Carry, Inputs) -> (Carry, Log) of one time step."""
        m = len(self.scenario.table.auv)
        widths = {"cna": (3, 1), "command": (2, 1), "covariance": (HALF, m), "reported_covariance": (HALF, m)}
        carry = Carry(*(ca.SX.sym(name, *widths.get(name, (N, m))) for name in Carry._fields))  # pyright: ignore[reportArgumentType]
        widths = {"survey": (N, m), "steer": (2, m), "disturbance": (N, m), "heading_error": (1, m), "range_error": (1, m)}
        inputs = Inputs(*(ca.SX.sym(name, *widths.get(name, (1, 1))) for name in Inputs._fields))  # pyright: ignore[reportArgumentType]
        names = [*Carry._fields, *Inputs._fields], [*(f"next_{name}" for name in Carry._fields), *Log._fields]
        after, log = self._step(carry, inputs)
        return ca.Function("step", [*carry, *inputs], [*after, *log], *names)

    def _step(self, carry: Carry, inputs: Inputs) -> tuple[Carry, Log]:
        scenario, dt = self.scenario, self.scenario.table.time_step
        command, score, condition, status = self._decide(carry, inputs)
        cna = scenario.cna.step(carry.cna, command, dt)
        moved = [self._auv_step(i, cna, carry, inputs) for i in range(carry.truth.shape[1])]
        *columns, ranges = (ca.horzcat(*column) for column in zip(*moved, strict=True))
        return Carry(cna, command, *columns), Log(ranges, score, condition, status)

    def _decide(self, carry: Carry, inputs: Inputs) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Command, score, condition numbers and status; a planner that is no expression has put its command into the carry."""
        if not isinstance(self.planner, ExpressionPlanner):
            return carry.command, ca.SX.nan(1), ca.SX.nan(1, carry.truth.shape[1]), ca.SX.nan(1)
        known = {"estimate": carry.reported, "survey": inputs.survey, "truth": carry.truth}[self.scenario.table.planner.knowledge]
        weight = ca.SX(ca.DM([auv.weight for auv in self.scenario.table.auv]))
        pose = ca.vertcat(carry.cna, carry.command[0])
        new = guarded_expression(self.planner, inputs.time, pose, Targets(known, weight))
        due = lambda value, otherwise: ca.if_else(inputs.decide, value, otherwise)  # noqa: E731
        command = due(ca.vertcat(new.turn_rate, new.speed), carry.command)
        return command, due(new.score, np.nan), due(new.condition, np.nan), due(new.status, np.nan)

    def _auv_step(self, i: int, cna: ca.SX, carry: Carry, inputs: Inputs) -> tuple[ca.SX, ...]:
        """Truth, mean, covariance, report and range of one AUV at the step's end."""
        scenario, ekf = self.scenario, self._filter(i)
        u = inputs.steer[:, i] - carry.truth[2:, i]  # the autopilot brings heading and speed back to the survey's, and measures what it did
        truth = ekf.f(carry.truth[:, i], u) + inputs.disturbance[:, i]
        x, P = ekf.predict(carry.mean[:, i], full(carry.covariance[:, i]), u)
        compass, ranging = scenario.heading_sensor, scenario.range_sensor
        x, P = ekf.update(x, P, compass.measure(truth, cna) + inputs.heading_error[i], compass, cna)
        z = ranging.measure(truth, cna) + inputs.range_error[i]
        x_ranged, P_ranged = ekf.update(x, P, z, ranging, cna)
        pinged = lambda value, otherwise: ca.if_else(inputs.ping, value, otherwise)  # noqa: E731
        x, P = pinged(x_ranged, x), pinged(half(P_ranged), half(P))
        reckoned, reckoned_P = ekf.predict(carry.reported[:, i], full(carry.reported_covariance[:, i]), ca.SX.zeros(2))
        return truth, x, P, pinged(x, reckoned), pinged(P, half(reckoned_P)), pinged(z, np.nan)

    def _filter(self, i: int) -> Ekf:
        dt = self.scenario.table.time_step
        Q = np.diag(self.scenario.process_noise(assumed=True)[i] ** 2 * dt)
        return Ekf(f=lambda x, u: self.scenario.auv_model.step(x, u, dt), Q=ca.DM(Q))

    def fly(self, seed: int, progress: Callable[[int, int], None]) -> tuple[Carry, Log, list[float]]:
        """Fly the mission; every carry from time 0 on, the log of every step, and the time each unfolded decision took [s]."""
        carry, inputs = self.start(seed), self.inputs(seed)
        carries, logs, decisions = [carry], [], []
        march = self._fold if self.folded else self._walk
        for after, log in march(carry, inputs, decisions, progress):
            carries.append(after)
            logs.append(log)
        join = lambda parts: np.concatenate(parts, axis=-1)  # noqa: E731
        return Carry(*map(join, zip(*carries, strict=True))), Log(*map(join, zip(*logs, strict=True))), decisions

    def _fold(self, carry: Carry, inputs: Inputs, _: list[float], progress: Callable[[int, int], None]) -> Iterator[tuple[Carry, Log]]:
        """Advance by whole chunks of steps at a time."""
        steps = inputs.time.shape[-1]
        sizes = [min(CHUNK, steps - k) for k in range(0, steps, CHUNK)]
        chunks = {n: self.step.mapaccum("chunk", n, len(Carry._fields)) for n in set(sizes)}
        for k, n in zip(range(0, steps, CHUNK), sizes, strict=True):
            arrays = [r.full() for r in chunks[n](*carry, *(columns(a, k, n, steps) for a in inputs))]
            after, log = Carry(*arrays[: len(carry)]), Log(*arrays[len(carry) :])
            carry = Carry(*(columns(a, n - 1, 1, n) for a in after))
            yield after, log
            progress(k + n, steps)

    def _walk(
        self, carry: Carry, inputs: Inputs, decisions: list[float], progress: Callable[[int, int], None]
    ) -> Iterator[tuple[Carry, Log]]:
        """Advance step by step, calling the planner between them."""
        steps = inputs.time.shape[-1]
        for k in range(steps):
            now = Inputs(*(columns(a, k, 1, steps) for a in inputs))
            log = None
            if now.decide:
                carry, log, seconds = self._planned(carry, float(now.time[0, 0]))
                decisions.append(seconds)
            arrays = [r.full() for r in self.step(*carry, *now)]
            carry, said = Carry(*arrays[: len(carry)]), Log(*arrays[len(carry) :])
            yield carry, said if log is None else log._replace(range=said.range)
            if (k + 1) % CHUNK == 0 or k + 1 == steps:
                progress(k + 1, steps)

    def _planned(self, carry: Carry, time: float) -> tuple[Carry, Log, float]:
        """The carry with the planner's command in it, what is logged of the decision, and how long it took [s]."""
        pose = Pose(*(float(v) for v in (*carry.cna[:, 0], carry.command[0, 0])))
        beliefs = self._beliefs(carry, time)
        began = perf_counter()
        decision = self.planner.plan(pose, beliefs, time=time)
        seconds = perf_counter() - began
        condition = decision.condition if decision.condition.size == len(beliefs) else np.full(len(beliefs), np.nan)
        command = np.array([[decision.turn_rate], [decision.speed]])
        log = Log(None, np.array([[decision.score]]), condition[None, :], np.array([[float(decision.status)]]))
        return carry._replace(command=command), log, seconds

    def _beliefs(self, carry: Carry, time: float) -> list[Belief]:
        """What the planner is told of each AUV."""
        knowledge, scenario = self.scenario.table.planner.knowledge, self.scenario
        noise = scenario.process_noise(assumed=True)
        beliefs = []
        for i, (auv, reference, motion) in enumerate(zip(scenario.table.auv, scenario.references, scenario.motions, strict=True)):
            k = round(time / scenario.table.time_step)
            surveyed = np.array([*motion.position[k], motion.heading[k], motion.speed[k]])
            mean = {"estimate": carry.reported[:, i], "survey": surveyed, "truth": carry.truth[:, i]}[knowledge]
            covariance = full_array(carry.reported_covariance[:, i]) if knowledge == "estimate" else np.zeros((N, N))
            course = None if knowledge == "estimate" else lambda ahead, reference=reference: reference.position(time + ahead)
            beliefs.append(
                Belief(
                    mean=mean,
                    covariance=covariance,
                    process_noise=(noise[i, 0], noise[i, 2], noise[i, 3]),
                    weight=auv.weight,
                    drift=scenario.table.environment.current,
                    course=course,
                )
            )
        return beliefs

    def start(self, seed: int) -> Carry:
        """Truth, first estimates and the aid vehicle's pose at time 0."""
        scenario = self.scenario
        pose = scenario.start
        if hasattr(self.planner, "initial_pose"):
            pose = self.planner.initial_pose(pose)  # pyright: ignore[reportAttributeAccessIssue]
        truth = np.array([[*m.position[0], m.heading[0], m.speed[0]] for m in scenario.motions]).T
        error = _streams(seed)[1].standard_normal(truth.shape)
        mean, covariance = scenario.first_estimates(truth, error)
        lower = np.array([half_array(P) for P in covariance]).T
        command = np.array([[0.0], [scenario.cna.speed]])
        return Carry(np.array([[pose.x], [pose.y], [pose.heading]]), command, truth, mean, lower, mean, lower)

    def inputs(self, seed: int) -> Inputs:
        """Schedules, survey and noise of every step; matrices of consecutive steps side by side."""
        scenario = self.scenario
        time, dt, auvs = scenario.time, scenario.table.time_step, len(scenario.table.auv)
        steps = time.size - 1
        survey = np.stack([np.column_stack([m.position, m.heading, m.speed]) for m in scenario.motions], axis=1)  # steps + 1, M, N
        process, measurement, _ = _streams(seed)
        measurement.standard_normal((N, auvs))  # the first estimate's
        disturbance = process.standard_normal((steps, auvs, N)) * scenario.process_noise() * np.sqrt(dt)
        errors = measurement.standard_normal((2, steps, auvs))
        index = np.arange(steps)
        side_by_side = lambda a: a.reshape(-1, a.shape[-1]).T  # noqa: E731
        return Inputs(
            time=time[None, :-1],
            decide=(index % scenario.decide_every == 0)[None, :].astype(float),
            ping=((index + 1) % scenario.ping_every == 0)[None, :].astype(float),
            survey=side_by_side(survey[:-1]),
            steer=side_by_side(survey[1:, :, 2:]),
            disturbance=side_by_side(disturbance),
            heading_error=errors[0].reshape(1, -1) * scenario.heading_sensor.sigma,
            range_error=errors[1].reshape(1, -1) * scenario.range_sensor.sigma,
        )


def _streams(seed: int) -> list[np.random.Generator]:
    """Process, measurement and planner: streams of their own, so that planners are compared under the same noise (thesis 5.3)."""
    return [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]


def columns(a: np.ndarray, k: int, n: int, steps: int) -> np.ndarray:
    """Columns of n steps from step k on."""
    width = a.shape[-1] // steps
    return a[:, k * width : (k + n) * width]


LOWER = ca.Sparsity.lower(N)
ROWS, COLUMNS = (np.array(v) for v in LOWER.get_triplet())


def full(lower: ca.SX) -> ca.SX:
    """Symmetric matrix from its lower triangle by columns."""
    return ca.tril2symm(ca.SX(LOWER, lower))


def half(P: ca.SX) -> ca.SX:
    """Lower triangle by columns."""
    return ca.vec(P)[(ROWS + N * COLUMNS).tolist()]


def full_array(lower: np.ndarray) -> np.ndarray:
    """`full` of numbers; further axes of ``lower`` come first in the result."""
    P = np.empty((*lower.shape[1:], N, N))
    P[..., ROWS, COLUMNS] = P[..., COLUMNS, ROWS] = np.moveaxis(lower, 0, -1)
    return P


def half_array(P: np.ndarray) -> np.ndarray:
    """`half` of numbers."""
    return P[ROWS, COLUMNS]
