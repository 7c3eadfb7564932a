"""Several aid vehicles: a planner for each, and their decisions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.planning.answers import Answer, blamed
from obsplan.planning.companion import Companion, Route, Turns
from obsplan.planning.interface import Cooperates, PlansTogether, Prepares, Progress
from obsplan.planning.situation import Situation
from obsplan.types import Decision, Pose

ROUNDS = 4  # at most, in which each member decides given the others

Ask = Callable[[int, Sequence[Companion]], Answer]


@dataclass(frozen=True)
class Team:
    """The planners of several aid vehicles, in the scenario's order.

    Where they are ``joint``, each decides in turn given the others' present plans, until none
    changes or after `ROUNDS`. Those that have not decided yet are expected to go on as they decided
    before, or to hold their turn.
    Planners that do not cooperate (`obsplan.planning.interface.Cooperates`) decide once, alone.
    Where it is not joint all decide at the same time, each as if there were no other; the distance
    to the others is kept, as they are expected to hold their turns.
    """

    members: tuple[Any, ...]
    joint: bool = True

    def prepared(self, poses: Sequence[Pose], progress: Progress) -> "Team":
        """The team that flies a mission that begins at poses, once it has planned before it.

        Planners of one kind that plan together do; the others each by themselves.
        """
        kinds, first = {type(member) for member in self.members}, self.members[0]
        several = len(self.members) > 1 and self.joint and len(kinds) == 1
        if several and isinstance(first, PlansTogether):
            with blamed(first, "plan before the mission"):
                return replace(self, members=tuple(first.together(self.members, poses, progress)))
        for member, pose in zip(self.members, poses, strict=True):
            if isinstance(member, Prepares):
                with blamed(member, "plan before the mission"):
                    member.prepare(pose, progress)
        return self

    def decide(
        self,
        poses: Sequence[Pose],
        speeds: Sequence[float],
        situations: Sequence[Situation],
        ask: Ask,
        before: Sequence[Route] = (),
    ) -> list[Answer]:
        """What ``ask(member, companions)`` makes of each member's answer.

        Poses have the turn rates, and speeds [m/s] are those, that are still held; ``before`` has
        the routes of the decisions before, from now on.
        """
        held: list[Route] = [
            Turns(pose, (pose.turn_rate,), speed, current=situation.current)
            for pose, speed, situation in zip(poses, speeds, situations, strict=True)
        ]
        if not self.joint:
            return [ask(k, others(situations, held, k, told=False)) for k in range(len(poses))]
        held = [*before] or held
        answers: list[Answer] = []
        for k, pose in enumerate(poses):
            answers.append(ask(k, others(situations, held, k)))
            held[k] = route_of(answers[k].decision, pose, situations[k])
        cooperating = [k for k, one in enumerate(self.members) if isinstance(one, Cooperates)]
        for _ in range(ROUNDS - 1 if len(poses) > 1 else 0):
            changed = False
            for k in cooperating:
                answer = ask(k, others(situations, held, k))
                changed |= not same(answer.decision, answers[k].decision)
                held[k] = route_of(answer.decision, poses[k], situations[k])
                answers[k] = answer
            if not changed:
                break
        return answers


def others(
    situations: Sequence[Situation], routes: Sequence[Route], own: int, *, told: bool = True
) -> tuple[Companion, ...]:
    """All aid vehicles but one, as companions; unless it is told, AUVs range to none of them."""
    return tuple(
        Companion(
            route=route,
            ranging=situation.ranging if told and situation.ranged else None,
            schedule=situation.schedule,
            depth=situation.transducer_depth,
            steered=True,
        )
        for k, (situation, route) in enumerate(zip(situations, routes, strict=True))
        if k != own
    )


def route_of(decision: Decision, pose: Pose, situation: Situation) -> Route:
    """Where a decision takes the vehicle: the planner's route, or the turn held on."""
    turn, current = (decision.turn_rate,), situation.current
    return decision.route or Turns(pose, turn, decision.speed, current=current)


def later(
    answers: Sequence[Answer],
    poses: Sequence[Pose],
    situations: Sequence[Situation],
    after: float,
) -> list[Route]:
    """The routes that decisions at poses plan, some time [s] after them."""
    known = zip(answers, poses, situations, strict=True)
    return [
        Later(route_of(answer.decision, pose, situation), after)
        for answer, pose, situation in known
    ]


@dataclass(frozen=True)
class Later:
    """A route as it is some time later."""

    route: Route
    after: float  # [s]

    def __call__(self, times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 2"]:
        """Positions over ground [m] at times from then [s]."""
        return self.route(times + self.after)


def same(one: Decision, other: Decision) -> bool:
    """Whether two decisions plan the same."""
    return (one.turn_rate, one.speed) == (other.turn_rate, other.speed) and np.array_equal(
        one.path, other.path, equal_nan=True
    )


def members_of(planner: Any) -> tuple[Any, ...]:
    """The planners of a team, or the one."""
    return planner.members if isinstance(planner, Team) else (planner,)


def team_of(planner: Any, situations: Sequence[Situation], *, joint: bool = True) -> Any:
    """A planner for each of several aid vehicles: one of its kind, told of the vehicle's situation.

    An object without a situation of its own steers all of them. A single vehicle's, or a team,
    stays as it is.
    """
    if len(situations) == 1 or isinstance(planner, Team):
        return planner
    if not is_dataclass(planner) or isinstance(planner, type):
        return Team((planner,) * len(situations), joint)
    if "situation" not in {field.name for field in fields(planner)}:
        return Team((planner,) * len(situations), joint)
    return Team(tuple(replace(planner, situation=one) for one in situations), joint)
