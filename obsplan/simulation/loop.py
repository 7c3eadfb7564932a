"""Fly missions: one compiled step, folded over time, the planner inside or called between steps."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter

import casadi as ca
import numpy as np

from formulations.model.casadi import machine_code
from formulations.model.covariance import unpack_array
from formulations.solution import Status
from obsplan.planning.expressions import interpreted
from obsplan.planning.interface import (
    ChoosesStart,
    Draws,
    HasCommands,
    KeepsLimits,
    Planner,
    Prepares,
    Progress,
    check_decision,
    check_planner,
    checked_commands,
)
from obsplan.planning.limits import within_limits
from obsplan.run import Run, Timing, record
from obsplan.scenario import Scenario, load
from obsplan.scenario.states import BASIC
from obsplan.simulation.advance import Advance
from obsplan.simulation.inputs import mission_inputs
from obsplan.simulation.step import Carry, Inputs, Log, StepBuilder, folded, shape_of
from obsplan.surveys import Reference
from obsplan.types import Belief, Decision, Pose
from obsplan.vehicles import Unicycle

ROUNDING = 1e-9  # relative, by which a turn may exceed the limit
# AUVs up to which machine code is made of scalars: a quarter faster, but compiled for each AUV
UNROLLED = 1
CHUNK = 256  # steps between two looks at the clock and the keyboard


def simulate(
    scenario: Scenario | str,
    *,
    planner: Planner | str | None = None,
    seed: int | None = None,
    progress: Progress | None = None,
) -> Run:
    """Fly one mission: move the truth, measure, filter, plan.

    Parameters
    ----------
    scenario
        A scenario, or the name or path of one.
    planner
        A planner by name, or any object that has ``plan``; default: the scenario's.
    seed
        Of all random numbers; default: the scenario's. The same seed gives the same noise to every
        planner.
    progress
        Called with (done, in all) every few hundred steps. A planner that plans before the mission
        reports that as the first half.

    Raises
    ------
    ObsplanError
        The scenario or the planner's name is wrong.
    """
    scenario = load(scenario) if isinstance(scenario, str) else scenario
    scenario = scenario.replace(planner=planner) if isinstance(planner, str) else scenario
    planner = scenario.planner() if planner is None or isinstance(planner, str) else planner
    return ClosedLoop(scenario=scenario, planner=planner).fly(
        scenario.table.seed if seed is None else seed, progress=progress
    )


@dataclass(frozen=True, kw_only=True)
class ClosedLoop:
    """One scenario under one planner, compiled once and flown any number of times.

    ``compiled``: run the step as machine code made by the C compiler, where there is one. The
    second that this takes pays from some thirty missions on. The results are the same to the last
    bit.
    """

    scenario: Scenario
    planner: Planner
    compiled: bool = False

    def __post_init__(self) -> None:
        check_planner(self.planner)

    @cached_property
    def step(self) -> ca.Function:
        """The Function (Carry, Inputs) -> (Carry, Log) of one time step."""
        step = StepBuilder(scenario=self.scenario, planner=self.planner).build()
        auvs = len(self.scenario.table.auv)
        if self.compiled:
            return machine_code(step.expand() if auvs <= UNROLLED else step)
        return interpreted(step, folded(self.scenario, self.planner), auvs)

    @property
    def start(self) -> Pose:
        """Where the aid vehicle starts: the scenario's start, or where the planner begins."""
        start, planner = self.scenario.start, self.planner
        return planner.initial_pose(start) if isinstance(planner, ChoosesStart) else start

    def fly(self, seed: int, *, start: Pose | None = None, progress: Progress | None = None) -> Run:
        """Fly the mission under the noise of a seed, from another ``start`` if one is given."""
        began, progress = perf_counter(), progress or (lambda _done, _steps: None)
        start = start or self.start
        first, inputs = mission_inputs(self.scenario, start, seed)
        steps = len(inputs.time)
        planner = self.planner
        if isinstance(planner, Prepares):
            progress = prepared(planner, start, progress)
        carry = Carry(*(np.concatenate([a[None], np.empty((steps, *a.shape))]) for a in first))
        log = Log(*(np.empty((steps, *shape_of(name, self.scenario))) for name in Log._fields))
        decisions: list[float] = []
        if isinstance(planner, HasCommands):
            inputs.given[:, 0] = checked_commands(planner, steps)
            self._fold(carry, inputs, log, progress)
        elif folded(self.scenario, planner) is not None:
            self._fold(carry, inputs, log, progress)
        else:
            planner = planner.for_mission(seed) if isinstance(planner, Draws) else planner
            decisions = self._walk(planner, carry, inputs, log, progress)
        timing = Timing(seconds=perf_counter() - began, decision_seconds=decisions)
        # a long mission's are large, and not recorded
        carry = carry._replace(reported=None, reported_covariance=None)
        del inputs
        return record(self.scenario, self.planner, seed, carry, log, timing)

    def _fold(self, carry: Carry, inputs: Inputs, log: Log, progress: Progress) -> None:
        """Advance by whole chunks of steps; the planner is part of the step."""
        steps = len(inputs.time)
        for k in range(0, steps, CHUNK):
            n = min(CHUNK, steps - k)
            self._advance(carry, inputs, log, k, n)
            progress(k + n, steps)

    def _advance(self, carry: Carry, inputs: Inputs, log: Log, k: int, n: int) -> None:
        """Take n steps from step k on."""
        if n not in self._advances:
            self._advances[n] = Advance(self.step, n)
        self._advances[n](carry, inputs, log, k)

    @cached_property
    def _advances(self) -> dict[int, Advance]:
        """By the number of steps."""
        return {}

    def _walk(
        self, planner: Planner, carry: Carry, inputs: Inputs, log: Log, progress: Progress
    ) -> list[float]:
        """Advance from decision to decision, calling the planner; returns the time of each [s]."""
        steps, every = len(inputs.time), self.scenario.decide_every
        seconds = []
        for k in range(0, steps, every):
            n = min(every, steps - k)
            began = perf_counter()
            auvs = self._beliefs(carry, inputs, k)
            decision = self._decision(planner, pose_of(carry, k), auvs, float(inputs.time[k, 0, 0]))
            seconds.append(perf_counter() - began)
            inputs.given[k : k + n, 0] = decision.turn_rate, decision.speed
            self._advance(carry, inputs, log, k, n)
            log.score[k], log.status[k] = decision.score, decision.status
            log.condition[k, :, 0] = decision.condition if decision.condition.size else np.nan
            if k // CHUNK != (k + n) // CHUNK or k + n == steps:
                progress(k + n, steps)
        return seconds

    def _decision(self, planner: Planner, pose: Pose, auvs: list[Belief], time: float) -> Decision:
        """What the vehicle makes of a manoeuvre, kept within limits the planner does not know."""
        scenario, limits = self.scenario, self.scenario.constraints
        decision = check_decision(planner.plan(pose, auvs, time=time), planner)
        decision = flyable(decision, scenario.cna)
        if not limits or (isinstance(planner, KeepsLimits) and planner.constraints == limits):
            return decision
        return within_limits(decision, pose, auvs, scenario.situation)

    def _beliefs(self, carry: Carry, inputs: Inputs, k: int) -> list[Belief]:
        """What the planner is told of each AUV."""
        scenario, now = self.scenario, float(inputs.time[k].item())
        knowledge = scenario.table.planner.knowledge
        told = {"survey": inputs.survey, "truth": carry.truth}.get(knowledge, carry.reported)
        means = told[k, :, :BASIC]
        covariances = unpack_array(carry.reported_covariance[k])[:, :BASIC, :BASIC]
        routes = [
            None if knowledge == "estimate" else route(*known, now)
            for known in zip(scenario.references, means, strict=True)
        ]
        return [
            Belief(
                mean=mean,
                covariance=covariance,
                process_noise=noise,
                weight=auv.weight,
                current=scenario.table.environment.current,
                route=along,
                checked=False,
            )
            for mean, covariance, noise, auv, along in zip(
                means, covariances, self._noises, scenario.table.auv, routes, strict=True
            )
        ]

    @cached_property
    def _noises(self) -> list[tuple[float, float, float]]:
        """Of position, heading and speed, as the filter of each AUV assumes them."""
        noises = self.scenario.process_noise(assumed=True).tolist()
        return [(position, heading, speed) for position, _, heading, speed in noises]


def prepared(planner: Prepares, start: Pose, progress: Progress) -> Progress:
    """Let a planner plan before the mission, and report that as the first half.

    Returns what reports the mission as the second half, or as a whole if the planner reported
    nothing.
    """
    told = []

    def half(done: int, total: int) -> None:
        told.append(done)
        progress(done, 2 * total)

    planner.prepare(start, half)
    if not told:
        return progress
    return lambda done, steps: progress(steps + done, 2 * steps)


def route(reference: Reference, mean: np.ndarray, now: float) -> Callable[[np.ndarray], np.ndarray]:
    """Positions ahead of where an AUV is known to be, the rest of its survey still before it."""
    off = mean[:2] - reference.position(now)
    return lambda ahead: reference.position(now + ahead) + off


def flyable(decision: Decision, cna: Unicycle) -> Decision:
    """What the vehicle makes of a decision; the status says so.

    It turns within its limit, and goes straight on where a command is not finite or its
    speed negative.
    """
    if not (np.isfinite([decision.turn_rate, decision.speed]).all() and decision.speed >= 0):
        return replace(decision, turn_rate=0.0, speed=cna.speed, status=Status.INVALID_INPUT)
    limit = decision.speed / cna.min_turn_radius
    if abs(decision.turn_rate) > limit * (1 + ROUNDING):
        return replace(
            decision, turn_rate=math.copysign(limit, decision.turn_rate), status=Status.CLIPPED
        )
    return decision


def pose_of(carry: Carry, k: int) -> Pose:
    """Pose of the aid vehicle at a step's beginning, with the turn rate it is still at."""
    return Pose(*(float(v) for v in (*carry.cna[k, 0], carry.command[k, 0, 0])))
