"""Fly missions: one compiled step, folded over time, the planner inside or called between steps."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from time import perf_counter

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.casadi import machine_code
from obsplan.planned import AS_FLOWN, Planned
from obsplan.planning.answers import BLAMES, Answer, ask, blamed, fitted_commands
from obsplan.planning.companion import Companion
from obsplan.planning.expressions import decision_function, interpreted
from obsplan.planning.interface import (
    ChoosesStart,
    Cooperates,
    Draws,
    HasCommands,
    KeepsLimits,
    Planner,
    Progress,
    check_condition_label,
    check_planner,
    checked_commands,
    checked_start,
)
from obsplan.planning.limits import within_limits
from obsplan.planning.team import Team, later, members_of, team_of
from obsplan.planning.water import in_the_water
from obsplan.run import Run, Timing
from obsplan.scenario import Scenario, load
from obsplan.signals import hear_stops
from obsplan.simulation.advance import Advance, Memory, recorded_covariance
from obsplan.simulation.ahead import Ahead, keep_all, planned_of
from obsplan.simulation.bank import Bank
from obsplan.simulation.beliefs import beliefs, poses_of
from obsplan.simulation.inputs import mission_inputs
from obsplan.simulation.recorded import record
from obsplan.simulation.step import StepBuilder, folded
from obsplan.types import Belief, ObsplanError, Pose

LOG = logging.getLogger(__name__)
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

    A planner that raises, or returns what the vehicle cannot fly, does not end the mission: each
    such decision is replaced (`obsplan.planning.answers`), its status blames the planner, and what
    was wrong first is logged as a warning and kept in `Run.faults`. A planner that does not return
    holds the mission up.

    Parameters
    ----------
    scenario
        A scenario, or the name or path of one.
    planner
        A planner by name, or any object that has ``plan``; default: the scenario's. Of several aid
        vehicles each has one: a `Team`, or the object as it would be in each one's situation, or,
        where it has none, the same object for all.
    seed
        Of all random numbers; default: the scenario's. The same seed gives the same noise to every
        planner.
    progress
        Called with (done, in all) every few hundred steps. A planner that plans before the mission
        reports that as the first half.

    Raises
    ------
    ObsplanError
        The scenario or the planner's name is wrong, or the planner fails before the mission.
    """
    scenario = load(scenario) if isinstance(scenario, str) else scenario
    scenario = scenario.replace(planner=planner) if isinstance(planner, str) else scenario
    named = planner is None or isinstance(planner, str)
    asked = scenario.team() if named else planner
    team = team_of(asked, scenario.situations, joint=scenario.joint)
    run = ClosedLoop(scenario=scenario, planner=team).fly(
        scenario.table.seed if seed is None else seed, progress=progress, paths=True
    )
    for status, fault in run.faults.items():
        LOG.warning("%s: %s, %s", run.planner, status, fault)
    return run


@dataclass(frozen=True, kw_only=True)
class Walk:
    """What is known of a planner after it was called through a mission."""

    seconds: list[float] = field(default_factory=list)  # that each decision took [s]
    faults: dict[str, str] = field(default_factory=dict)  # by status: when first, and what
    planned: tuple[Planned | None, ...] = ()  # the paths that planners had in mind


@dataclass(frozen=True, kw_only=True)
class ClosedLoop:
    """One scenario under one planner, compiled once and flown any number of times.

    ``compiled``: run the step as machine code made by the C compiler, where there is one. The
    second that this takes pays from some thirty missions on. The results are the same to the last
    bit.
    """

    scenario: Scenario
    planner: Planner | Team
    compiled: bool = False

    def __post_init__(self) -> None:
        aids = len(self.scenario.aids)
        if len(self.planners) != aids:
            raise ObsplanError(
                f"{self.scenario.source}: there are {aids} aid vehicles and {len(self.planners)} "
                "planners: give a Team with one for each, in the order of [[cna]]"
            )
        for planner in self.planners:
            with blamed(planner, "say what it offers"):
                check_planner(planner)
                check_condition_label(planner)

    @property
    def planners(self) -> tuple[Planner, ...]:
        """Of each aid vehicle."""
        return members_of(self.planner)

    @property
    def joint(self) -> bool:
        """Whether they decide given each other's plans."""
        return isinstance(self.planner, Team) and self.planner.joint

    @property
    def step(self) -> ca.Function:
        """The Function (Carry, Inputs) -> (Carry, Log) of one time step at first."""
        return self._step(self.scenario.hypotheses)

    def _step(self, hypotheses: int) -> ca.Function:
        """The same with room for some hypotheses."""
        if hypotheses not in self._steps:
            self._steps[hypotheses] = self._built(hypotheses)
        return self._steps[hypotheses]

    @cached_property
    def _steps(self) -> dict[int, ca.Function]:
        """By the number of hypotheses."""
        return {}

    def along(self, planner: "Planner | Team") -> "ClosedLoop":
        """The same scenario under a planner whose commands are fixed beforehand, as this one's are.

        The step does not depend on such commands, so it is not built again.
        """
        other = replace(self, planner=planner)
        vars(other).update(_steps=self._steps, _advances=self._advances)  # those kept below
        return other

    def _built(self, hypotheses: int) -> ca.Function:
        auvs = len(self.scenario.table.auv)
        expressions = []
        for planner in self.planners:
            with blamed(planner, "build its expression"):
                expressions.append(folded(self.scenario, planner))
        try:
            builder = StepBuilder(
                scenario=self.scenario, planners=self.planners, hypotheses=hypotheses
            )
            step = builder.build()
        except Exception:  # of an expression itself, or of a vehicle, a sensor or a filter
            parts = zip(self.planners, expressions, self.scenario.aids, strict=True)
            for planner, expression, aid in parts:
                if expression is not None:
                    with blamed(planner, "build its expression"):
                        decision_function(expression, auvs, aid)
            raise
        if self.compiled:
            return machine_code(step.expand() if auvs <= UNROLLED else step)
        return interpreted(step, expressions[0], auvs)

    @property
    def start(self) -> Pose:
        """Where the (first) aid vehicle starts: as the scenario says, or the planner begins."""
        return self.starts[0]

    @property
    def starts(self) -> tuple[Pose, ...]:
        """Where the aid vehicles start."""
        found = []
        for start, planner in zip(self.scenario.starts, self.planners, strict=True):
            with blamed(planner, "choose its start"):
                chosen = isinstance(planner, ChoosesStart)
                found.append(checked_start(planner, start) if chosen else start)
        return tuple(found)

    def fly(
        self,
        seed: int,
        *,
        start: Pose | Sequence[Pose] | None = None,
        progress: Progress | None = None,
        covariances: bool = True,
        paths: bool = False,
    ) -> Run:
        """Fly the mission under the noise of a seed, from other places if given.

        A ``start`` is the first aid vehicle's; several are those of all.

        Without ``covariances`` those of the run, more than half of what it holds, are nan. With
        ``paths`` those that planners had in mind are kept.
        """
        hear_stops()
        began, progress = perf_counter(), progress or (lambda _done, _steps: None)
        given = (start,) if isinstance(start, Pose) else tuple(start or ())
        starts = (*given, *self.starts[len(given) :])
        first, inputs = mission_inputs(self.scenario, starts, seed)
        steps = len(inputs.time)
        team, progress = prepared(Team(self.planners, self.joint), starts, progress)
        memory = Memory(self.scenario, first, inputs, covariances=covariances)
        del inputs
        walk, bank = Walk(), Bank(scenario=self.scenario)
        offered = [self._commands(planner, steps) for planner in self.planners]
        fixed = [commands for commands in offered if commands is not None]
        if len(fixed) == len(offered):
            codes = []
            for c, (commands, aid) in enumerate(zip(fixed, self.scenario.aids, strict=True)):
                memory.inputs.given[:, c], code = fitted_commands(commands, aid)
                codes.append(code)
            self._fold(memory, bank, progress)
            memory.log.status[:, :, 0] = np.stack(codes, axis=-1)
            walk = Walk(planned=(AS_FLOWN,) * len(fixed))
        elif all(folded(self.scenario, planner) is not None for planner in self.planners):
            self._fold(memory, bank, progress)
        else:
            walk = self._walk(self._of_mission(team, seed), memory, bank, progress, paths=paths)
        timing = Timing(seconds=perf_counter() - began, decision_seconds=walk.seconds)
        # what a run does not hold makes room: of a long mission it is large
        carry, log = memory.carry, memory.log
        del memory
        carry = carry._replace(covariance=recorded_covariance(carry))
        run = record(self.scenario, self.planners, seed, carry, log, timing, walk.faults)
        planned = walk.planned or (None,) * len(starts)
        return replace(run, hypotheses=bank.fitting, planned=planned if paths else ())

    def _commands(self, planner: Planner, steps: int) -> Float[np.ndarray, "steps 2"] | None:
        """What a planner has fixed beforehand, if it has."""
        with blamed(planner, "give its commands"):
            return checked_commands(planner, steps) if isinstance(planner, HasCommands) else None

    def _of_mission(self, team: Team, seed: int) -> Team:
        """The planners that are asked in the mission under a seed."""
        found = []
        for planner in team.members:
            with blamed(planner, "draw its numbers"):
                if isinstance(planner, Draws):
                    planner = planner.for_mission(seed)
                    check_planner(planner)
                found.append(planner)
        return replace(team, members=tuple(found))

    def _fold(self, memory: Memory, bank: Bank, progress: Progress) -> None:
        """Advance by whole chunks of steps; the planner is part of the step."""
        steps = len(memory.given)
        for k in range(0, steps, CHUNK):
            n = min(CHUNK, steps - k)
            self._advance(memory, bank, k, n)
            progress(k + n, steps)

    def _advance(self, memory: Memory, bank: Bank, k: int, n: int) -> None:
        """Take n steps from step k on."""
        end = k + n
        while k < end:
            some = bank.until(memory.inputs, k, end - k)
            key = bank.room, some, memory.held
            if key not in self._advances:
                self._advances[key] = Advance(self._step(bank.room), some, memory.held)
            self._advances[key](memory, k)
            k += some
            bank.tidy(memory.carry, memory.log, k)

    @cached_property
    def _advances(self) -> dict[tuple[int, int, tuple[str, ...]], Advance]:
        """By room for hypotheses, number of steps, and what is held."""
        return {}

    def _walk(
        self, team: Team, memory: Memory, bank: Bank, progress: Progress, *, paths: bool
    ) -> Walk:
        """Advance from decision to decision, calling the planners."""
        carry, inputs, log = memory.carry, memory.inputs, memory.log
        steps, every = len(inputs.time), self.scenario.decide_every
        free = [self._is_free(planner) for planner in team.members]
        situations, before = self.scenario.situations, []
        walk, ahead = Walk(), [Ahead(-(-steps // every)) for _ in situations if paths]
        for k in range(0, steps, every):
            n = min(every, steps - k)
            began = perf_counter()
            auvs = beliefs(self.scenario, carry, inputs, k, bank.reported(carry, log, k))
            time = float(inputs.time[k, 0, 0])
            poses = poses_of(carry, k)
            ask = partial(self._ask, poses=poses, auvs=auvs, team=team, time=time, free=free)
            speeds = carry.command[k, :, 1].tolist()
            answers = team.decide(poses, speeds, situations, ask, before)
            before = later(answers, poses, situations, n * self.scenario.table.time_step)
            walk.seconds.append(perf_counter() - began)
            for c, (decision, fault) in enumerate(answers):
                if fault:
                    said = f"first after {time:g} s: {fault}"
                    walk.faults.setdefault(decision.status.label, said)
                inputs.given[k : k + n, c] = decision.turn_rate, decision.speed
            keep_all(ahead, time, answers, walk.faults)
            self._advance(memory, bank, k, n)
            for c, (decision, _) in enumerate(answers):
                log.score[k, c], log.status[k, c] = decision.score, decision.status
            condition = answers[0].decision.condition
            log.condition[k, :, 0] = condition if condition.size else np.nan
            if k // CHUNK != (k + n) // CHUNK or k + n == steps:
                progress(k + n, steps)
        return replace(walk, planned=planned_of(ahead, [told.current for told in situations]))

    def _ask(
        self,
        aid: int,
        companions: Sequence[Companion],
        *,
        poses: list[Pose],
        auvs: list[Belief],
        team: Team,
        time: float,
        free: list[bool],
    ) -> Answer:
        """What an aid vehicle makes of its planner's answer, kept within limits if it is not free.

        What is flown in place of the planner's decision is always kept within them.
        """
        planner, situation, pose = team.members[aid], self.scenario.situations[aid], poses[aid]
        auvs = in_the_water(auvs, situation.current)
        decision, fault = ask(
            planner, pose, auvs, time=time, cna=situation.cna, companions=companions
        )
        if not self.scenario.constraints or (free[aid] and not fault):
            return Answer(decision, fault)
        kept = within_limits(decision, pose, auvs, situation, companions)
        if decision.status in BLAMES:
            kept = replace(kept, status=decision.status)
        return Answer(kept, fault)

    def _is_free(self, planner: Planner) -> bool:
        """Whether a planner's decisions are flown as they are: it keeps the limits, if any."""
        limits = self.scenario.constraints
        if not limits:
            return True
        if limits.min_separation_cna and not isinstance(planner, Cooperates):
            return False
        with blamed(planner, "say which limits it keeps"):
            return isinstance(planner, KeepsLimits) and bool(planner.constraints == limits)


def prepared(team: Team, starts: Sequence[Pose], progress: Progress) -> tuple[Team, Progress]:
    """Let a team plan before the mission, and report that as the first half.

    Returns what reports the mission as the second half, or as a whole if nothing was reported.
    """
    told = []

    def half(done: int, total: int) -> None:
        told.append(done)
        progress(done, 2 * total)

    team = team.prepared(starts, half)
    if not told:
        return team, progress
    return team, lambda done, steps: progress(steps + done, 2 * steps)
