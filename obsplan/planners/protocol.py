"""What a planner is, and how one that is an expression is evaluated on its own."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.arcs import arcs
from formulations.model.casadi import symbol
from formulations.solution import Status
from obsplan.types import Belief, Decision, Pose
from obsplan.vehicles import Unicycle

PATH_POINTS = 21  # poses in a predicted path


@runtime_checkable
class Planner(Protocol):
    """Anything that turns what is known of the AUVs into the aid vehicle's next manoeuvre.

    It may also have ``initial_pose(pose) -> Pose``, where it wants to start; ``for_mission(seed) -> Planner``, where it draws numbers;
    ``prepare(pose, progress)``, to plan from the start before the mission begins, calling ``progress(done, in all)``;
    ``condition_label``, what its condition numbers are of; ``constraints``, the limits it keeps within by itself;
    ``expression``, see `expression_of`; and ``commands``, where it has fixed the turn rate [rad/s] and the speed [m/s] of
    every time step beforehand: these are flown as they are, whatever limits there are, and ``plan`` is not called.
    """

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose turn rate and speed to hold until the next decision."""
        ...


class Targets(NamedTuple):
    """Beliefs about M AUVs as expressions."""

    mean: ca.SX  # 4 x M: east, north [m], heading [rad], speed through the water [m/s]
    drift: ca.SX  # 2 x M: the current they are carried by [m/s]
    position_covariance: ca.SX  # 3 x M: variance of east, covariance, variance of north [m^2]
    weight: ca.SX  # M

    @property
    def velocity(self) -> ca.SX:
        """Velocity over ground (2 x M) [m/s]."""
        heading, speed = self.mean[2, :], self.mean[3, :]
        return ca.vertcat(speed * ca.cos(heading), speed * ca.sin(heading)) + self.drift


ROWS = {
    "mean": 4,
    "drift": 2,
    "position_covariance": 3,
    "weight": 1,
}  # of each of the targets, where AUVs are columns


class Command(NamedTuple):
    """A decision as expressions; ``condition`` has one entry per AUV, nan where the planner has none."""

    turn_rate: ca.SX
    speed: ca.SX
    score: ca.SX
    condition: ca.SX
    status: ca.SX


Expression = Callable[
    [ca.SX, ca.SX, Targets], Command
]  # of time [s], pose (east, north, heading, turn rate) and targets


def expression_of(planner: Planner) -> Expression | None:
    """The decision as one CasADi expression, which the simulator folds into its step; None where ``plan`` has to be called.

    A planner that has one is hashable, and one that has it only under some options has ``expression`` None under the others.
    """
    return getattr(planner, "expression", None)


@runtime_checkable
class SteeringPlanner(Planner, Protocol):
    """A planner that keeps its vehicle moving."""

    @property
    def cna(self) -> Unicycle:
        """The vehicle it steers."""
        ...


def guarded(expression: Expression, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:
    """A planner's command; `unusable` as an expression: straight on where what it looks at is no number or has no weight, and why."""
    command = expression(time, pose, targets)
    looks = ca.depends_on(command.turn_rate, ca.vec(targets.mean))
    heard = ca.sum1(targets.weight) > 0 if looks else ca.SX(1.0)
    seen = (
        ca.vertcat(pose, ca.vec(targets.mean), command.turn_rate)
        if looks
        else ca.vertcat(pose, command.turn_rate)
    )
    usable = ca.logic_and(
        heard, ca.fabs(ca.sum1(seen)) < ca.inf
    )  # CasADi takes x == x for true, whatever x is
    why = ca.if_else(heard, float(Status.INVALID_INPUT), float(Status.NO_TARGETS))
    return Command(
        turn_rate=ca.if_else(usable, command.turn_rate, 0.0),
        speed=command.speed,
        score=ca.if_else(usable, command.score, np.nan),
        condition=ca.if_else(usable, command.condition, np.nan),
        status=ca.if_else(usable, command.status, why),
    )


def decide(planner: SteeringPlanner, pose: Pose, auvs: Sequence[Belief], time: float) -> Decision:
    """Evaluate a planner's expression for AUVs it needs."""
    return unusable(planner, pose, auvs) or evaluate(planner, pose, auvs, time)


def unusable(planner: SteeringPlanner, pose: Pose, auvs: Sequence[Belief]) -> Decision | None:
    """The substitute where there is no AUV to plan for, or a pose or belief is not finite: straight on, and the status says why."""
    if not any(auv.weight > 0 for auv in auvs):
        return straight_on(planner.cna, pose, Status.NO_TARGETS, len(auvs))
    known = [[pose.x, pose.y, pose.heading, pose.turn_rate], *(auv.mean for auv in auvs)]
    return (
        None
        if np.isfinite(known).all()
        else straight_on(planner.cna, pose, Status.INVALID_INPUT, len(auvs))
    )


def evaluate(planner: SteeringPlanner, pose: Pose, auvs: Sequence[Belief], time: float) -> Decision:
    """Evaluate a planner's expression at a pose."""
    state = [pose.x, pose.y, pose.heading, pose.turn_rate]
    if not np.isfinite(state).all():
        return straight_on(planner.cna, pose, Status.INVALID_INPUT, len(auvs))
    results = compiled(planner, len(auvs)).call([ca.DM(time), ca.DM(state), *columns(auvs)])
    turn_rate, speed, score, condition, status = (result.full().ravel() for result in results)
    return Decision(
        turn_rate=float(turn_rate[0]),
        speed=float(speed[0]),
        path=predict_path(planner.cna, pose, float(turn_rate[0]), float(speed[0])),
        score=float(score[0]),
        status=Status(int(status[0])),
        condition=condition,
    )


def columns(auvs: Sequence[Belief]) -> list[ca.DM]:
    """Beliefs as the targets that `compiled` takes, one column per AUV."""
    mean, drift, weight = (
        [auv.mean for auv in auvs],
        [auv.drift for auv in auvs],
        [auv.weight for auv in auvs],
    )
    covariance = [auv.covariance[[0, 0, 1], [0, 1, 1]] for auv in auvs]
    rows = zip((mean, drift, covariance, weight), ROWS.values(), strict=True)
    return [
        ca.DM(np.reshape(np.array(values, dtype=float), (len(auvs), n)).T) for values, n in rows
    ]


@lru_cache(maxsize=64)
def compiled(planner: Planner, n_auvs: int) -> ca.Function:
    """The planner's expression for a number of AUVs as a Function, built once."""
    expression = expression_of(planner)
    if expression is None:
        raise TypeError(f"{type(planner).__name__} has no expression; call its plan instead")
    inputs, targets = symbols(n_auvs)
    return ca.Function("decision", inputs, list(guarded(expression, inputs[0], inputs[1], targets)))


def symbols(n_auvs: int) -> tuple[list[ca.SX], Targets]:
    """Inputs of a Function of time, pose and beliefs (`columns`), and the targets made of them."""
    time, pose = symbol("time"), symbol("pose", 4)
    known = [symbol(name, rows, n_auvs) for name, rows in ROWS.items()]
    return [time, pose, *known], Targets(*known)._replace(weight=known[-1].T)


def straight_on(cna: Unicycle, pose: Pose, status: Status, n_auvs: int) -> Decision:
    """The substitute manoeuvre: straight on at cruising speed, with the status that made it necessary."""
    path = predict_path(cna, pose, 0.0, cna.speed)
    return Decision(
        turn_rate=0.0,
        speed=cna.speed,
        path=path,
        score=np.nan,
        status=status,
        condition=np.full(n_auvs, np.nan),
    )


def predict_path(
    cna: Unicycle, pose: Pose, turn_rate: float, speed: float
) -> Float[np.ndarray, "steps 3"]:
    """Poses on the arc held for two thirds of the smallest circle, the thesis's horizon."""
    times = np.linspace(0.0, two_thirds_turn(cna), PATH_POINTS)
    return arcs(np.array([pose.x, pose.y, pose.heading]), np.array(turn_rate), speed, times)


def two_thirds_turn(cna: Unicycle) -> float:
    """Time [s] the vehicle needs for two thirds of its smallest circle (thesis 4.2)."""
    return 2.0 / 3.0 * 2.0 * np.pi * cna.min_turn_radius / cna.speed
