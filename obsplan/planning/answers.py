"""A planner at arm's length: what it answers, held against what the vehicle can do.

Whatever a planner raises or returns becomes a decision that the vehicle can fly, with a status that
says who is to blame. A planner that never returns cannot be stopped: it runs in this process.
"""

import math
import reprlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from formulations.solution import Status
from obsplan.planning.companion import Companion
from obsplan.planning.expressions import ROUNDING
from obsplan.planning.fallback import hold_turn, straight_on
from obsplan.planning.interface import Cooperates, Planner
from obsplan.plugins import in_words
from obsplan.types import Belief, Decision, ObsplanError, Pose
from obsplan.vehicles import Unicycle

FAULTS = (Exception, SystemExit)  # of a planner; an interruption by the user is none
NUMBERS = "fiu"  # kinds of arrays that are numbers
# Statuses that nothing may hide which comes later, such as a limit of the mission.
BLAMES = frozenset({Status.PLANNER_FAILED, Status.INVALID_DECISION, Status.TOO_FAST})


class Answer(NamedTuple):
    """A decision as the vehicle flies it, and in words what was wrong with the planner's."""

    decision: Decision
    fault: str = ""


@contextmanager
def blamed(planner: object, doing: str) -> Iterator[None]:
    """Turn whatever a planner raises before the mission into a sentence that names it.

    Raises
    ------
    ObsplanError
        The planner's own, or one that says what it raised and what it was doing.
    """
    try:
        yield
    except ObsplanError:
        raise
    except FAULTS as error:
        name, said = type(planner).__name__, in_words(error) + place(error, planner)
        raise ObsplanError(f"planner {name} failed to {doing}: {said}; correct it") from error


def ask(
    planner: Planner,
    pose: Pose,
    auvs: Sequence[Belief],
    *,
    time: float,
    cna: Unicycle,
    companions: Sequence[Companion] = (),
) -> Answer:
    """Call a planner, and make of its answer or failure what the vehicle flies.

    One that cooperates is told of companions, if there are any.

    A failure over a pose or a belief that is not finite is not the planner's: the status then
    blames the input, and the vehicle goes straight on.
    """
    n_auvs = len(auvs)
    try:
        with np.errstate():  # which a planner may change for itself
            if companions and isinstance(planner, Cooperates):
                given = planner.plan_among(pose, [*auvs], companions, time=time)
            else:
                given = planner.plan(pose, [*auvs], time=time)
    except FAULTS as error:
        fault = in_words(error) + place(error, planner)
        return _substitute(Status.PLANNER_FAILED, fault, pose, auvs, cna)
    try:
        answer = fitted(given, cna, n_auvs)
    except FAULTS as error:  # of numbers and arrays of its own kind
        return _substitute(Status.INVALID_DECISION, in_words(error), pose, auvs, cna)
    if isinstance(answer, str):
        return _substitute(Status.INVALID_DECISION, answer, pose, auvs, cna)
    return answer


def fitted(given: Any, cna: Unicycle, n_auvs: int) -> Answer | str:
    """A planner's decision within what the vehicle can do; in words what is wrong if it is none.

    Its speed is at most the vehicle's, its turn at most that of the smallest circle. Figures that
    are none (score, status, condition numbers) are left out.
    """
    if not isinstance(given, Decision):
        return f"plan must return an obsplan.Decision, and returned {type(given).__name__}"
    turn_rate, speed = _number(given.turn_rate), _number(given.speed)
    if turn_rate is None or not math.isfinite(turn_rate):
        return f"turn_rate must be a finite number [rad/s], got {_short(given.turn_rate)}"
    if speed is None or not 0.0 <= speed < math.inf:
        return f"speed must be finite and at least 0 [m/s], got {_short(given.speed)}"
    wrong = _wrong_figure(given, n_auvs)
    decision = _without_figures(turn_rate, speed, n_auvs) if wrong else _plain(given)
    top = cna.speed
    if speed > top * (1 + ROUNDING):
        wrong = wrong or f"speed is {speed:g} m/s, and the vehicle does {top:g} m/s"
        blame = decision.status if decision.status in BLAMES else Status.TOO_FAST
        decision = replace(decision, speed=top, status=blame, route=None)
    limit = decision.speed / cna.min_turn_radius
    if abs(turn_rate) > limit * (1 + ROUNDING):
        turn = math.copysign(limit, turn_rate)
        # nothing that the planner itself says of its decision is hidden
        status = Status.CLIPPED if decision.status == Status.OPTIMAL else decision.status
        decision = replace(decision, turn_rate=turn, status=status, route=None)
    return Answer(decision, wrong)


def _plain(given: Decision) -> Decision:
    """A decision that is made of plain numbers, whatever class it and its numbers are of."""
    numbers = given.turn_rate, given.speed, given.score
    if type(given) is Decision and all(type(number) is float for number in numbers):
        return given
    turn_rate, speed, score = map(float, numbers)
    return Decision(
        turn_rate=turn_rate,
        speed=speed,
        predict=given.predict,
        score=score,
        status=given.status,
        condition=given.condition,
        lasting=given.lasting,
        route=given.route,
    )


def fitted_commands(commands: np.ndarray, cna: Unicycle) -> tuple[np.ndarray, np.ndarray]:
    """Commands (steps x 2) within what the vehicle can do, and statuses, nan where they were."""
    turn_rate, speed = commands.T
    too_fast = speed > cna.speed * (1 + ROUNDING)
    flown = np.where(too_fast, cna.speed, speed)
    limit = flown / cna.min_turn_radius
    clipped = np.abs(turn_rate) > limit * (1 + ROUNDING)
    turn = np.where(clipped, np.copysign(limit, turn_rate), turn_rate)
    status = np.select([too_fast, clipped], [Status.TOO_FAST, Status.CLIPPED], np.nan)
    return np.column_stack([turn, flown]), status


def place(error: BaseException, planner: object) -> str:
    """Where it was raised in the planner's own file; empty if that cannot be told."""
    plan = getattr(type(planner), "plan", None)
    code = getattr(plan, "__code__", None)
    if code is None:
        return ""
    frame, line = error.__traceback__, None
    while frame is not None:
        if frame.tb_frame.f_code.co_filename == code.co_filename:
            line = frame.tb_lineno
        frame = frame.tb_next
    if line is None:
        return ""
    file = code.co_filename.replace("\\", "/").rpartition("/")[2]
    return f" ({file}, line {line})"


def _substitute(
    status: Status, fault: str, pose: Pose, auvs: Sequence[Belief], cna: Unicycle
) -> Answer:
    """What is flown in place of a decision that cannot be had."""
    if _is_finite(pose, auvs):
        return Answer(hold_turn(cna, pose, status, len(auvs)), fault)
    return Answer(straight_on(cna, pose, Status.INVALID_INPUT, len(auvs)), fault)


def _is_finite(pose: Pose, auvs: Sequence[Belief]) -> bool:
    """Whether all that a planner was told is numbers."""
    own = [pose.x, pose.y, pose.heading, pose.turn_rate]
    told = [np.isfinite(auv.mean).all() and np.isfinite(auv.covariance).all() for auv in auvs]
    return bool(np.isfinite(own).all()) and all(told)


def _number(value: Any) -> float | None:
    """A number, whatever class it is of; None where it is none."""
    if type(value) is float:
        return value
    if isinstance(value, str | bytes | bool):
        return None
    try:
        return None if np.ndim(value) else float(value)
    except Exception:  # of a class of the planner's own, which may do anything
        return None


def _short(value: Any) -> str:
    """A value on one line, or else its class."""
    if isinstance(value, int | float | complex | str | np.generic):
        return reprlib.repr(value)
    return type(value).__name__


def _wrong_figure(given: Decision, n_auvs: int) -> str:
    """In words what is wrong with what a decision says beside its command; empty if nothing is."""
    condition = given.condition
    if type(given.status) is not Status:
        return f"status must be an obsplan.Status, got {_short(given.status)}"
    if _number(given.score) is None:
        return f"score must be a number, got {_short(given.score)}"
    if not isinstance(condition, np.ndarray) or condition.dtype.kind not in NUMBERS:
        return f"condition must be an array of numbers, got {_short(condition)}"
    if condition.shape not in ((n_auvs,), (0,)):
        return f"condition must have a number for each of {n_auvs} AUVs, got {condition.shape}"
    return "" if callable(given.predict) else "predict must be a function without arguments"


def _without_figures(turn_rate: float, speed: float, n_auvs: int) -> Decision:
    """Only the command of a decision."""
    return Decision(
        turn_rate=turn_rate,
        speed=speed,
        status=Status.INVALID_DECISION,
        condition=np.full(n_auvs, np.nan),
    )
