"""Several aid vehicles: a planner for each, and their decisions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from obsplan.types import Belief, Pose


@dataclass(frozen=True)
class Team:
    """The planners of several aid vehicles, in the scenario's order."""

    members: tuple[Any, ...]

    def decide(
        self,
        poses: Sequence[Pose],
        auvs: Sequence[Belief],
        ask: Callable[[int, Pose, Sequence[Belief]], Any],
    ) -> list[Any]:
        """What ``ask`` makes of each member's answer."""
        return [ask(k, pose, auvs) for k, pose in enumerate(poses)]


def members_of(planner: Any) -> tuple[Any, ...]:
    """The planners of a team, or the one."""
    return planner.members if isinstance(planner, Team) else (planner,)
