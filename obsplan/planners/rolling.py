"""Rolling: the whole mission's plan, made anew on the way from what is believed."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from formulations.model.schedule import ROUNDING
from formulations.solution import Status
from formulations.whole_mission import Turns, again
from obsplan.constraints import Constraints
from obsplan.planners.whole_mission import WholeMission
from obsplan.planning.checks import check_situation
from obsplan.planning.fallback import straight_on, unusable
from obsplan.planning.interface import Progress
from obsplan.planning.open_loop import OpenLoopPlan
from obsplan.planning.rest import Known, frame_at, problem_of, sample_at, vehicle_of
from obsplan.planning.situation import Situation
from obsplan.quantities import INTERVAL, ITERATIONS, SEED, STARTS
from obsplan.types import Belief, Decision, ObsplanError, Pose


@dataclass(frozen=True)
class Rolling:
    """Follow a plan of the whole mission, and improve the rest of it after each range.

    The plan is made before the mission as `obsplan.planners.whole_mission.WholeMission` makes it.
    At the first decision after a range was due, and not more often than turns change, a descent
    begins at the rest of the plan and ends after ``iterations`` at most: a number and no clock, so
    that results repeat. AUVs are expected to go on along their filed surveys, from where they are
    believed to be and known as well as they are now. A plan that is as good as it can be made, to a
    ten thousandth, stays as it is (`formulations.whole_mission.again`). Decisions follow the plan.
    One that improves it takes one processor 15 ms for two AUVs and 55 ms for four.

    So ranges that did not come, or told less than was expected, change the rest of the path, as do
    AUVs that are not where they filed to be. Where all goes as filed it is level with
    ``whole-mission`` (geometric mean of the errors' ratios over ten seeds: 1.00 in four of the
    suite's scenarios with one or two AUVs; 0.97 in ``four-formation``, three seeds). Of two AUVs
    that strayed from their filed lines, in the end by 17 m (one standard deviation), the error was
    0.89 of that under ``whole-mission`` (p = 0.02, ten seeds), and 0.97 of that under
    ``information`` (p = 0.3).

    What is counted, and how limits are kept, is the same. Of a doubted position, of several
    hypotheses, and of a depth that is estimated nothing is counted.

    A vehicle that is not where the plan has it has its plan made anew from where it is, from the
    same turns. That happens after going straight on for a pose or a belief that was not finite.
    Beliefs of another number of AUVs than have filed change no plan. ``score`` is the plan's mean
    weighted position variance from when it was made on [m^2].

    It plans for one aid vehicle, or for each as if it were the only one
    (``planner.team = "alone"``).
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
    starts: Annotated[int, "descents before the mission", STARTS] = 24
    search_seed: Annotated[int, "of these descents' random turns", SEED] = 1
    iterations: Annotated[int, "of the descent after a range, at most", ITERATIONS] = 40

    def __post_init__(self) -> None:
        check_situation(self)
        _ = self.beforehand  # which refuses what it cannot plan for

    @cached_property
    def beforehand(self) -> WholeMission:
        """What plans before the mission."""
        return WholeMission(
            self.situation,
            segment=self.segment,
            starts=self.starts,
            search_seed=self.search_seed,
        )

    @property
    def constraints(self) -> Constraints:
        """The limits it keeps within."""
        return self.situation.constraints

    @cached_property
    def _memory(self) -> "dict[str, _Asked]":
        """The last question; no field, since planners with the same options are equal."""
        return {}

    def prepare(self, pose: Pose, progress: Progress) -> None:
        """Plan the mission from its start and report the progress (done, in all)."""
        self.beforehand.prepare(pose, progress)

    @classmethod
    def together(
        cls,
        members: Sequence["Rolling"],
        poses: Sequence[Pose],  # noqa: ARG003 - all are refused
        progress: Progress,  # noqa: ARG003
    ) -> "list[Rolling]":
        """Refuse several aid vehicles that are to be planned at once.

        Raises
        ------
        ObsplanError
            Naming what plans them.
        """
        raise ObsplanError(
            f"planner rolling plans one aid vehicle, and there are {len(members)}: take "
            'whole-mission or information, or set planner.team = "alone"'
        )

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Look up the turn of this time in the plan, which is improved first where that is due.

        The plan is remembered as long as time goes on. Asked about an earlier time, or otherwise
        about the same one, it starts afresh from the plan made beforehand.
        """
        fallback = unusable(self.situation.cna, pose, auvs)
        if fallback is not None:
            return fallback
        told = np.concatenate([np.append(auv.mean, auv.covariance) for auv in auvs])
        if not np.isfinite(told).all():
            return straight_on(self.situation.cna, pose, Status.INVALID_INPUT, len(auvs))
        last = self._memory.get("last")
        if last is None or not last.is_asked(pose, told, time):
            looked, plan = self._present(last, pose, time)
            if self._due(looked, plan, pose, len(auvs), time):
                looked, plan = time, self._improved(plan, pose, auvs, time)
            last = self._memory["last"] = _Asked(time, pose, told, looked, plan)
        return last.plan.decision(pose, time, len(auvs))

    def _present(
        self, last: "_Asked | None", pose: Pose, time: float
    ) -> tuple[float, OpenLoopPlan]:
        """The plan that is followed, and when it was last looked at [s]."""
        if last is not None and last.time < time:
            return last.looked, last.plan
        return time, self.beforehand.open_loop(pose, time=time)

    def _due(self, looked: float, plan: OpenLoopPlan, pose: Pose, auvs: int, time: float) -> bool:
        """Whether the plan is to be improved: it is left, or a range was due since."""
        filed = self.beforehand.filed
        if auvs != filed.weights.size or time > filed.time[-1] - filed.time_step:
            return False
        if not plan.passes(pose, time):
            return True
        if time - looked < self.beforehand.turn_duration * (1 - ROUNDING):
            return False
        schedule = self.situation.schedule
        return any(schedule.times(auv, looked, time).size for auv in range(auvs))

    def _improved(
        self, plan: OpenLoopPlan, pose: Pose, auvs: Sequence[Belief], time: float
    ) -> OpenLoopPlan:
        """The plan for the rest of the mission after a descent from what is believed."""
        filed, situation = self.beforehand.filed, self.situation
        known = Known.as_believed(filed, sample_at(filed, time), auvs)
        frame = frame_at(pose, filed)
        vehicle = vehicle_of(situation, known, frame, pose)
        problem = problem_of(situation, known, frame, (vehicle,))
        hold = round(plan.duration / filed.time_step)
        over, begun = divmod(round((time - plan.begin + plan.elapsed) / filed.time_step), hold)
        present = frame.mirror * plan.turn_rates[None, over:]
        found = again(Turns(problem, hold, begun), present, iterations=self.iterations)
        if found is None and plan.passes(pose, time):
            return plan
        rates = present if found is None else found.x
        return replace(
            plan,
            start=pose,
            begin=time,
            turn_rates=frame.mirror * rates[0],
            plan=plan.plan if found is None else found,
            elapsed=begun * filed.time_step,
        )


class _Asked(NamedTuple):
    """A question and the plan that answered it."""

    time: float  # [s]
    pose: Pose
    told: np.ndarray  # of the AUVs: means and covariances, one number after the other
    looked: float  # when the plan was last looked at [s]
    plan: OpenLoopPlan

    def is_asked(self, pose: Pose, told: np.ndarray, time: float) -> bool:
        """Whether this is the same question."""
        return time == self.time and pose == self.pose and np.array_equal(told, self.told)
