"""Whole mission: plan all turns before it begins, by a multi-start, and follow them."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np

from formulations.model.schedule import ROUNDING, intervals, is_multiple
from formulations.whole_mission import optimise
from obsplan.constraints import Constraints
from obsplan.planning.checks import check_situation
from obsplan.planning.fallback import unusable
from obsplan.planning.filed import Filed
from obsplan.planning.open_loop import OpenLoopPlan
from obsplan.planning.rest import Known, frame_at, problem_of, sample_at, vehicle_of
from obsplan.planning.situation import Situation
from obsplan.quantities import INTERVAL, SEED, STARTS
from obsplan.types import Belief, Decision, ObsplanError, Pose

MOST_TURNS = 400  # of a mission
KEPT = 64  # plans of one planner
Progress = Callable[[int, int], None]


def untold(_done: int, _all: int) -> None:
    """Tell nobody how far the planning is."""


@dataclass(frozen=True)
class WholeMission:
    """Choose all turns of the mission at once for the least mean predicted position variance.

    The mean is over time. The plan is made once, from the surveys as filed, before the mission
    begins. It is followed open loop: neither an estimate nor a mission's noise changes it. Each
    turn is held for ``segment``.

    A multi-start of ``starts`` descents along exact gradients finds it
    (`formulations.whole_mission`). They start from the receding horizon's route, from orbits,
    from constant and random turns, and from perturbations of the best plan. The best local optimum
    is taken. How ranges err with distance and height, whether they arrive, slots and silences are
    counted.

    Limits hold for the surveys as filed, separations with a margin for AUVs that stray from them
    (`Limits`). If no descent keeps them, the least violating is taken and the status says so.

    A vehicle that is not where the plan has it gets a plan of its own for the rest of the
    mission, as if it began there. That happens after going straight on for a pose or a belief
    that was not finite. ``score`` is the mean weighted position variance [m^2].

    All is planned at the first decision, or when the mission is prepared (`prepare`). Measured, one
    processor takes 1.5 s per thousand time steps of the mission for one or two AUVs, 3 to 4.5 s
    for four, and ten times that under limits, which are looked at at every step. A gradient takes
    time in proportion to ranges and AUVs, and the number of gradients is bounded.
    """

    condition_label = ""

    situation: Situation
    _: KW_ONLY
    segment: Annotated[
        float | None,
        "time a turn is held [s]; default: up to half the time between ranges, "
        "longer in long missions",
        INTERVAL,
    ] = None
    starts: Annotated[int, "descents", STARTS] = 24
    search_seed: Annotated[int, "of the descents' random turns", SEED] = 1

    def __post_init__(self) -> None:
        check_situation(self)
        interval, step = self.situation.ping_interval, self.filed.time_step
        if not is_multiple(interval, step):
            raise ValueError(
                "ping_interval must be a whole multiple of the time step, "
                f"{step:.6g} s, got {interval} s: change one of them"
            )
        if self.segment is not None:
            self._check_segment(self.segment)

    def _check_segment(self, segment: float) -> None:
        interval = self.situation.decision_interval
        if not is_multiple(segment, interval):
            raise ValueError(
                "segment must be a whole multiple of the time between decisions, "
                f"{interval} s, got {segment} s: change one of them"
            )
        if segment < self._least_segment * (1 - ROUNDING):
            raise ValueError(
                f"segment must be at least {self._least_segment:.6g} s "
                "in a mission of this length, "
                f"got {segment} s: make it longer"
            )

    @property
    def filed(self) -> Filed:
        """The surveys as filed.

        Raises
        ------
        ValueError
            The situation has none.
        """
        if self.situation.filed is None:
            raise ValueError("a whole mission is planned from filed surveys: give them, as a Filed")
        return self.situation.filed

    @property
    def constraints(self) -> Constraints:
        """The limits it keeps within."""
        return self.situation.constraints

    @property
    def _least_segment(self) -> float:
        """Shortest turn [s] of which no more than `MOST_TURNS` make the mission."""
        interval = self.situation.decision_interval
        decisions = np.ceil(self.filed.time[-1] / MOST_TURNS / interval - ROUNDING)
        return max(1, int(decisions)) * interval

    @property
    def turn_duration(self) -> float:
        """Time [s] each turn is held; two between ranges reach any place that can be reached."""
        if self.segment is not None:
            return self.segment
        interval = self.situation.decision_interval
        half_way = intervals(0.5 * self.situation.ping_interval, interval) * interval
        return max(self._least_segment, half_way)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Look up the turn of this time in the plan that the pose is on."""
        fallback = unusable(self.situation.cna, pose, auvs)
        if fallback is not None:
            return fallback
        return self.open_loop(pose, time=time).decision(pose, time, len(auvs))

    def prepare(self, pose: Pose, progress: Progress) -> None:
        """Plan the mission from its start and report the progress (done, in all)."""
        self.open_loop(pose, progress=progress)

    def open_loop(
        self, pose: Pose, *, time: float = 0.0, progress: Progress = untold
    ) -> "OpenLoopPlan":
        """The plan that a pose at a time is on; it is made where there is none."""
        plans = plans_of(self)
        known = plans.of(pose, time)
        if known is None:
            (known,) = self.made([self], [pose], time, progress)
            plans.keep(known)
        return known

    @classmethod
    def together(
        cls, members: Sequence["WholeMission"], poses: Sequence[Pose], progress: Progress
    ) -> list["Part"]:
        """Planners that follow one plan, made for all aid vehicles at once before the mission.

        Raises
        ------
        ObsplanError
            The vehicles are in different currents.
        """
        if len({member.situation.current for member in members}) > 1:
            raise ObsplanError(
                "whole-mission plans several aid vehicles in the same water: let the current carry "
                'all of them or none (carried), or set planner.team = "alone"'
            )
        key = (tuple(members), tuple(poses))
        if key not in TOGETHER:
            if len(TOGETHER) >= KEPT:
                TOGETHER.pop(next(iter(TOGETHER)))
            TOGETHER[key] = cls.made(members, poses, 0.0, progress)
        return [Part(member, plan) for member, plan in zip(members, TOGETHER[key], strict=True)]

    @staticmethod
    def made(
        members: Sequence["WholeMission"], poses: Sequence[Pose], time: float, progress: Progress
    ) -> "list[OpenLoopPlan]":
        """Plans of vehicles that are at poses at a time, the first one's options being taken."""
        leader = members[0]
        filed, frame = leader.filed, frame_at(poses[0], leader.filed)
        known = Known.as_filed(filed, sample_at(filed, time))
        hold = round(leader.turn_duration / filed.time_step)
        vehicles = [
            vehicle_of(member.situation, known, frame, pose)
            for member, pose in zip(members, poses, strict=True)
        ]
        plan = optimise(
            problem_of(leader.situation, known, frame, tuple(vehicles)),
            hold=hold,
            count=leader.starts,
            random=np.random.default_rng(leader.search_seed),
            progress=progress,
        )
        found = []
        for member, pose, turns in zip(members, poses, plan.x, strict=True):
            cna, rates, stream = member.situation.cna, frame.mirror * turns, member.situation.stream
            duration = hold * filed.time_step
            found.append(OpenLoopPlan(cna, pose, time, rates, duration, plan, stream))
        return found


@dataclass(frozen=True)
class Part:
    """Follow a vehicle's part of a plan made for several; off it, plan the rest for it alone."""

    condition_label = ""

    planner: WholeMission
    own: "OpenLoopPlan"

    @property
    def constraints(self) -> Constraints:
        """The limits it keeps within."""
        return self.planner.constraints

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Look up the turn of this time."""
        if not self.own.passes(pose, time):
            return self.planner.plan(pose, auvs, time=time)
        fallback = unusable(self.planner.situation.cna, pose, auvs)
        return fallback or self.own.decision(pose, time, len(auvs))


# Plans made for several vehicles, by their planners and starts, the newest `KEPT` of them.
TOGETHER: dict[tuple[tuple[WholeMission, ...], tuple[Pose, ...]], "list[OpenLoopPlan]"] = {}


class Plans:
    """Plans made for a planner, the newest `KEPT` of them."""

    def __init__(self) -> None:
        self._plans: deque[OpenLoopPlan] = deque(maxlen=KEPT)

    def of(self, pose: Pose, time: float) -> "OpenLoopPlan | None":
        """The newest plan that a pose at a time is on."""
        return next((known for known in self._plans if known.passes(pose, time)), None)

    def keep(self, known: "OpenLoopPlan") -> None:
        """Remember a plan."""
        self._plans.appendleft(known)


@lru_cache(maxsize=8)
def plans_of(planner: WholeMission) -> Plans:  # noqa: ARG001 - the key
    """What equal planners of this process remember.

    Missions that differ in noise fly the same plan.
    """
    return Plans()
