"""What a planner is, what else it may offer, and a check that it is one.

Each protocol below `Planner` is a capability: a planner that has the attribute has it.
"""

import difflib
import inspect
from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from obsplan.constraints import Constraints
from obsplan.planning.companion import Companion
from obsplan.planning.expressions import Expression
from obsplan.planning.situation import Situation
from obsplan.types import Belief, Decision, ObsplanError, Pose

ALIKE = 0.85  # of a name to a capability's (difflib's ratio), from which it is taken for misspelt
CALL = "plan(pose, auvs, *, time=0.0)"

Progress = Callable[[int, int], None]  # done, in all


@runtime_checkable
class Planner(Protocol):
    """Anything that turns what is known of the AUVs into the aid vehicle's next manoeuvre."""

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose turn rate and speed from a time [s] of the mission until the next decision."""
        ...


@runtime_checkable
class Situated(Planner, Protocol):
    """Is told of the mission: the scenario gives it a `Situation` when it builds it."""

    @property
    def situation(self) -> Situation:
        """What it was told."""
        ...


@runtime_checkable
class ChoosesStart(Planner, Protocol):
    """Begins elsewhere than where the scenario has the vehicle."""

    def initial_pose(self, pose: Pose) -> Pose:
        """Where it wants to start instead of at a pose."""
        ...


@runtime_checkable
class Draws(Planner, Protocol):
    """Draws random numbers."""

    def for_mission(self, seed: int) -> Planner:
        """The planner of the mission that is flown under a seed."""
        ...


@runtime_checkable
class Prepares(Planner, Protocol):
    """Plans before the mission begins."""

    def prepare(self, pose: Pose, progress: Progress) -> None:
        """Plan from the start on, calling ``progress(done, in all)``."""
        ...


@runtime_checkable
class KeepsLimits(Planner, Protocol):
    """Keeps within limits by itself; the simulator keeps every other planner within them."""

    @property
    def constraints(self) -> Constraints:
        """The limits it keeps within."""
        ...


@runtime_checkable
class Cooperates(Planner, Protocol):
    """Counts on what ranges to other aid vehicles tell, and keeps its distance from them."""

    def plan_among(
        self,
        pose: Pose,
        auvs: Sequence[Belief],
        companions: Sequence[Companion],
        *,
        time: float = 0.0,
    ) -> Decision:
        """As ``plan``, other aid vehicles' plans being known."""
        ...


@runtime_checkable
class PlansTogether(Planner, Protocol):
    """Plans all aid vehicles at once before the mission, where all have planners of its kind."""

    @classmethod
    def together(
        cls, members: Sequence[Any], poses: Sequence[Pose], progress: Progress
    ) -> Sequence[Planner]:
        """The planners that fly the mission, from where the vehicles start."""
        ...


@runtime_checkable
class HasExpression(Planner, Protocol):
    """Decides by one CasADi expression, which the simulator folds into its step.

    Such a planner is hashable. One that has an expression only under some options has None under
    the others, and is then called.
    """

    @property
    def expression(self) -> Expression | None:
        """The decision as a function of symbols."""
        ...


@runtime_checkable
class HasCommands(Planner, Protocol):
    """Has fixed every command beforehand.

    They are flown whatever limits there are, but no faster and in no tighter turn than the vehicle
    can. ``plan`` is not called.
    """

    @property
    def commands(self) -> Float[np.ndarray, "steps 2"]:
        """Turn rate [rad/s] and speed [m/s] over each time step."""
        ...


@runtime_checkable
class NamesCondition(Planner, Protocol):
    """Says what its condition numbers are of."""

    @property
    def condition_label(self) -> str:
        """Such as κ(W); empty where it has none."""
        ...


CAPABILITIES = {
    "situation": Situated,
    "initial_pose": ChoosesStart,
    "for_mission": Draws,
    "prepare": Prepares,
    "constraints": KeepsLimits,
    "plan_among": Cooperates,
    "together": PlansTogether,
    "expression": HasExpression,
    "commands": HasCommands,
    "condition_label": NamesCondition,
}


def expression_of(planner: Planner) -> Expression | None:
    """The decision as one expression; None where ``plan`` has to be called."""
    return planner.expression if isinstance(planner, HasExpression) else None


def check_planner(planner: Any) -> None:
    """Refuse what is no planner, and what was meant as a capability but is misspelt.

    Raises
    ------
    ObsplanError
        A class instead of an object, no ``plan``, one that takes other arguments, or an attribute
        that is nearly, but not quite, a capability's name.
    """
    if isinstance(planner, type):
        raise ObsplanError(
            f"a planner must be an object, and {planner.__name__} is a class: "
            f"give {planner.__name__}(...)"
        )
    name = type(planner).__name__
    plan = getattr(planner, "plan", None)
    if not callable(plan):
        raise ObsplanError(f"a planner must have a method {CALL}, and {name} has none")
    if inspect.iscoroutinefunction(plan):
        raise ObsplanError(
            f"plan of {name} must return a Decision at once: define it without async"
        )
    if not _can_be_called(plan):
        raise ObsplanError(
            f"a planner must have a method {CALL}, and {name} has "
            f"plan{inspect.signature(plan)}: give it these arguments"
        )
    for attribute in dir(planner):
        meant = _capability_meant(attribute)
        if meant is not None and not hasattr(planner, meant):
            raise ObsplanError(f'{name} has "{attribute}": did you mean "{meant}"? Rename it')


def check_condition_label(planner: object) -> None:
    """Refuse a name of condition numbers that is no text.

    Raises
    ------
    ObsplanError
        Naming the planner.
    """
    label = planner.condition_label if isinstance(planner, NamesCondition) else ""
    if not isinstance(label, str):
        raise ObsplanError(
            f"condition_label of {type(planner).__name__} must be text, such as κ(W), "
            f"got {type(label).__name__}"
        )


def checked_start(planner: ChoosesStart, start: Pose) -> Pose:
    """Where a planner wants to start instead of at a pose.

    Raises
    ------
    ObsplanError
        It is no `Pose`, or not all numbers.
    """
    pose = planner.initial_pose(start)
    if (
        not isinstance(pose, Pose)
        or not np.isfinite([pose.x, pose.y, pose.heading, pose.turn_rate]).all()
    ):
        raise ObsplanError(
            f"initial_pose of {type(planner).__name__} must return an obsplan.Pose of finite "
            f"numbers, and returned {pose if isinstance(pose, Pose) else type(pose).__name__}"
        )
    return pose


def checked_commands(planner: HasCommands, steps: int) -> Float[np.ndarray, "steps 2"]:
    """The commands of a planner that has fixed them, one for each of the mission's steps.

    Raises
    ------
    ObsplanError
        They are not steps x 2, or not all numbers.
    """
    commands = np.asarray(planner.commands, dtype=float)
    if commands.shape != (steps, 2) or not np.isfinite(commands).all():
        raise ObsplanError(
            f"commands of {type(planner).__name__} must be finite, a turn rate [rad/s] and a speed "
            f"[m/s] for each of the {steps} time steps, got an array of {commands.shape}"
        )
    return commands


def _can_be_called(plan: Callable[..., Any]) -> bool:
    """Whether ``plan`` can be called as the loop calls it."""
    try:
        signature = inspect.signature(plan)
    except ValueError:  # of a function written in C, nothing is known
        return True
    try:
        signature.bind(None, [], time=0.0)
    except TypeError:
        return False
    return True


def _capability_meant(attribute: str) -> str | None:
    """The capability whose name an attribute nearly has."""
    if attribute.startswith("_") or attribute in CAPABILITIES:
        return None
    close = difflib.get_close_matches(attribute, CAPABILITIES, n=1, cutoff=ALIKE)
    return close[0] if close else None
