"""What a planner is, and how one that is an expression is evaluated on its own."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol, runtime_checkable

import casadi as ca
import numpy as np

from formulations.solution import Status
from obsplan.types import Belief, Decision, Pose
from obsplan.vehicles import Unicycle

PATH_POINTS = 21  # poses in a predicted path


@runtime_checkable
class Planner(Protocol):
    """Anything that turns what is known of the AUVs into the aid vehicle's next manoeuvre."""

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose turn rate and speed to hold until the next decision."""
        ...


class Targets(NamedTuple):
    """Beliefs about M AUVs as expressions: means (4 x M: east, north [m], heading [rad], speed [m/s]) and weights (M)."""

    mean: ca.SX
    weight: ca.SX


class Command(NamedTuple):
    """A decision as expressions; ``condition`` has one entry per AUV, nan where the planner has none."""

    turn_rate: ca.SX
    speed: ca.SX
    score: ca.SX
    condition: ca.SX
    status: ca.SX


@runtime_checkable
class ExpressionPlanner(Planner, Protocol):
    """A planner whose decision is one CasADi expression, which the simulator folds into its step; it must be hashable."""

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:
        """The decision at a time [s] and pose (east, north, heading, turn rate)."""
        ...


@runtime_checkable
class SteeringPlanner(ExpressionPlanner, Protocol):
    """An expression planner that keeps its vehicle moving."""

    @property
    def cna(self) -> Unicycle:
        """The vehicle it steers."""
        ...


def guarded_expression(planner: ExpressionPlanner, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:
    """The planner's command; where its turn rate is not a number the vehicle goes straight on and the status says so."""
    command = planner.expression(time, pose, targets)
    usable = command.turn_rate == command.turn_rate
    return command._replace(
        turn_rate=ca.if_else(usable, command.turn_rate, 0.0),
        status=ca.if_else(usable, command.status, float(Status.INVALID_INPUT)),
    )


def decide(planner: SteeringPlanner, pose: Pose, auvs: Sequence[Belief], time: float) -> Decision:
    """Evaluate a planner's expression for AUVs it needs; without a usable one the vehicle goes straight on, and the status says why."""
    if not any(auv.weight > 0 for auv in auvs):
        return straight_on(planner.cna, pose, Status.NO_TARGETS, len(auvs))
    if not all(np.isfinite(auv.mean).all() for auv in auvs):
        return straight_on(planner.cna, pose, Status.INVALID_INPUT, len(auvs))
    return evaluate(planner, pose, auvs, time)


def evaluate(planner: SteeringPlanner, pose: Pose, auvs: Sequence[Belief], time: float) -> Decision:
    """Evaluate a planner's expression at a pose."""
    if not np.isfinite((pose.x, pose.y, pose.heading, pose.turn_rate)).all():
        return straight_on(planner.cna, pose, Status.INVALID_INPUT, len(auvs))
    means = np.array([auv.mean for auv in auvs]).reshape(-1, 4).T
    weights = np.array([auv.weight for auv in auvs])
    state = [pose.x, pose.y, pose.heading, pose.turn_rate]
    values = [v.full().ravel() for v in compiled(planner, len(auvs)).call([ca.DM(time), ca.DM(state), ca.DM(means), ca.DM(weights)])]
    turn_rate, speed, score, condition, status = values
    return Decision(
        turn_rate=float(turn_rate[0]),
        speed=float(speed[0]),
        path=predict_path(planner.cna, pose, float(turn_rate[0]), float(speed[0])),
        score=float(score[0]),
        status=Status(int(status[0])),
        condition=condition,
    )


@lru_cache(maxsize=64)
def compiled(planner: ExpressionPlanner, n_auvs: int) -> ca.Function:
    """The planner's expression for a number of AUVs as a Function, built once."""
    time, pose = ca.SX.sym("time"), ca.SX.sym("pose", 4)  # pyright: ignore[reportArgumentType, reportCallIssue]
    targets = Targets(ca.SX.sym("mean", 4, n_auvs), ca.SX.sym("weight", n_auvs))  # pyright: ignore[reportArgumentType, reportCallIssue]
    return ca.Function("decision", [time, pose, *targets], list(guarded_expression(planner, time, pose, targets)))


def straight_on(cna: Unicycle, pose: Pose, status: Status, n_auvs: int) -> Decision:
    """The substitute manoeuvre: straight on at cruising speed, with the status that made it necessary."""
    path = predict_path(cna, pose, 0.0, cna.speed)
    return Decision(turn_rate=0.0, speed=cna.speed, path=path, score=np.nan, status=status, condition=np.full(n_auvs, np.nan))


def predict_path(cna: Unicycle, pose: Pose, turn_rate: float, speed: float) -> np.ndarray:
    """Poses (steps, 3) on the arc held for two thirds of the smallest circle, the thesis's horizon."""
    t = np.linspace(0.0, two_thirds_turn(cna), PATH_POINTS)
    half = 0.5 * turn_rate * t
    chord = speed * t * np.sinc(half / np.pi)
    return np.stack(
        [pose.x + chord * np.cos(pose.heading + half), pose.y + chord * np.sin(pose.heading + half), pose.heading + 2 * half], -1
    )


def two_thirds_turn(cna: Unicycle) -> float:
    """Time [s] the vehicle needs for two thirds of its smallest circle (thesis 4.2)."""
    return 2.0 / 3.0 * 2.0 * np.pi * cna.min_turn_radius / cna.speed
