"""Planners that are one CasADi expression, and how one is evaluated on its own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import Call, matrix, symbol
from formulations.solution import Status
from obsplan.planning.fallback import held_turn_rate, predict_path, straight_on
from obsplan.types import Belief, Decision, Pose

ROUNDING = 1e-9  # relative, by which a command may exceed what the vehicle can do
OWN = 5  # numbers of a call that are no AUV's: time, and the pose's four
ROWS = {  # of each of the targets, where AUVs are columns
    "mean": 4,
    "current": 2,
    "position_covariance": 3,
    "weight": 1,
    "depth": 1,
    "doubt": 1,
}
EACH = sum(ROWS.values())  # numbers of a call for each AUV
CONDITION = 4  # entries of a result before the condition numbers
SCALARS = 64  # AUVs up to which the virtual machine runs scalars faster than matrices

Symbolic = Any  # CasADi's SX, MX where an expression is `Vectorized`, or numbers as DM


class Targets(NamedTuple):
    """Beliefs about M AUVs as expressions."""

    mean: Symbolic  # 4 x M: east, north [m], heading [rad], speed through the water [m/s]
    current: Symbolic  # 2 x M: the current they are carried by [m/s]
    position_covariance: Symbolic  # 3 x M: variance of east, covariance, variance of north [m^2]
    weight: Symbolic  # M
    depth: Symbolic = 0.0  # 1 x M: of their transducers [m]
    doubt: Symbolic = 0.0  # 1 x M: see `Belief` [m]

    @property
    def velocity(self) -> Symbolic:
        """Velocity over ground (2 x M) [m/s]."""
        heading, speed = self.mean[2, :], self.mean[3, :]
        return ca.vertcat(speed * ca.cos(heading), speed * ca.sin(heading)) + self.current


class Command(NamedTuple):
    """A decision as expressions; ``condition`` has one entry per AUV, nan if it is unknown."""

    turn_rate: Symbolic
    speed: Symbolic
    score: Symbolic
    condition: Symbolic
    status: Symbolic


# of time [s], pose (east, north, heading, turn rate) and targets
Expression = Callable[[Symbolic, Symbolic, Targets], Command]


@dataclass(frozen=True)
class Vectorized:
    """An expression that takes CasADi's MX as well as SX.

    Its operations run over all AUVs at once: it is no larger for many of them than for one.
    ``scalars`` says up to how many AUVs the virtual machine is faster on scalars all the same.
    """

    expression: Expression
    scalars: int = SCALARS

    def __call__(self, time: Symbolic, pose: Symbolic, targets: Targets) -> Command:
        """The same."""
        return self.expression(time, pose, targets)


def guarded(
    expression: Expression, time: Symbolic, pose: Symbolic, targets: Targets, cna: Any
) -> Command:
    """A planner's command within what the vehicle can do; `unusable` as an expression.

    It is straight on where what the planner looks at is no number or has no weight, and says why.
    Where the command alone is no number, the present turn is held.

    Raises
    ------
    ValueError
        A part of the command has not as many entries as it must have.
    """
    command = expression(time, pose, targets)
    check_sizes(command, targets.mean.shape[1])
    looks = ca.depends_on(command.turn_rate, targets.mean)
    heard = ca.sum1(targets.weight) > 0 if looks else ca.DM(1.0)
    seen = [pose, ca.vec(targets.mean)] if looks else [pose]
    valid = ca.logic_and(is_finite(command.speed), command.speed >= 0.0)
    usable = ca.logic_and(heard, is_finite(*seen, command.turn_rate))
    usable = ca.logic_and(usable, valid)
    told = is_finite(time, pose, *(ca.vec(part) for part in targets))
    fault = ca.if_else(told, float(Status.INVALID_DECISION), float(Status.INVALID_INPUT))
    why = ca.if_else(heard, fault, float(Status.NO_TARGETS))
    turn = ca.if_else(why == float(Status.INVALID_DECISION), held_turn_rate(cna, pose[3]), 0.0)
    fit = fitted(command, cna)
    return Command(
        turn_rate=ca.if_else(usable, fit.turn_rate, turn),
        speed=ca.if_else(valid, fit.speed, cna.speed),
        score=ca.if_else(usable, fit.score, np.nan),
        condition=ca.if_else(usable, fit.condition, np.nan),
        status=ca.if_else(usable, fit.status, why),
    )


def check_sizes(command: Command, n_auvs: int) -> None:
    """Refuse a command that is not one number each, with one condition number per AUV.

    Raises
    ------
    ValueError
        Naming the part.
    """
    for name, part in command._asdict().items():
        entries = n_auvs if name == "condition" else 1
        given = ca.vec(part).numel()
        if given != entries:
            raise ValueError(f"{name} of a Command must have {entries} entries, got {given}")


def is_finite(*parts: Symbolic) -> Symbolic:
    """Whether all entries of columns are finite; CasADi takes x == x for true, whatever x is."""
    return ca.fabs(ca.sum1(ca.vertcat(*parts))) < ca.inf


def fitted(command: Command, cna: Any) -> Command:
    """A command within the vehicle's greatest speed and turn, with the status that says so."""
    too_fast = command.speed > cna.speed * (1 + ROUNDING)
    speed = ca.if_else(too_fast, cna.speed, command.speed)
    limit = speed / cna.min_turn_radius
    clipped = ca.fabs(command.turn_rate) > limit * (1 + ROUNDING)
    turn_rate = ca.if_else(clipped, ca.sign(command.turn_rate) * limit, command.turn_rate)
    # nothing that the planner itself says of its decision is hidden
    optimal = command.status == float(Status.OPTIMAL)
    status = ca.if_else(ca.logic_and(clipped, optimal), float(Status.CLIPPED), command.status)
    status = ca.if_else(too_fast, float(Status.TOO_FAST), status)
    known = ca.logic_and(command.status >= 0, command.status <= float(max(Status)))
    known = ca.logic_and(known, ca.floor(command.status) == command.status)
    status = ca.if_else(known, status, float(Status.INVALID_DECISION))
    return command._replace(turn_rate=turn_rate, speed=speed, status=status)


def decide(planner: Any, pose: Pose, auvs: Sequence[Belief], time: float) -> Decision:
    """Evaluate the expression of a planner that has a `Situation`."""
    cna = planner.situation.cna
    if not auvs:
        return straight_on(cna, pose, Status.NO_TARGETS, 0)
    return evaluate(planner, pose, auvs, time)


def evaluate(planner: Any, pose: Pose, auvs: Sequence[Belief], time: float) -> Decision:
    """Evaluate a planner's expression, also for no AUVs."""
    call = compiled(planner, len(auvs))
    fill(call.given, pose, auvs, time)
    return decision_of(call(), planner.situation.cna, pose)


def fill(given: np.ndarray, pose: Pose, auvs: Sequence[Belief], time: float) -> None:
    """Write time, pose and beliefs where a Function made of `symbols` reads them."""
    given[:OWN] = time, pose.x, pose.y, pose.heading, pose.turn_rate
    at = OWN
    for auv in auvs:
        (var_east, covariance), (_, var_north) = auv.covariance[:2, :2].tolist()
        given[at : at + 4] = auv.mean
        position = var_east, covariance, var_north
        given[at + 4 : at + EACH] = *auv.current, *position, auv.weight, auv.depth, auv.doubt
        at += EACH


class Symbols(NamedTuple):
    """What a Function reads where `fill` writes: all of it, and its parts."""

    given: Symbolic
    time: Symbolic
    pose: Symbolic  # east, north, heading, turn rate
    targets: Targets
    more: Symbolic  # what the caller writes itself, at the end


def symbols(n_auvs: int, *, more: int = 0) -> Symbols:
    """Symbols (MX) for a number of AUVs and, if wished, some more numbers."""
    known = OWN + EACH * n_auvs
    given = matrix("given", known + more)
    columns = ca.reshape(given[OWN:known], EACH, n_auvs)
    ends = np.cumsum([0, *ROWS.values()]).tolist()
    mean, current, covariance, weight, depth, doubt = ca.vertsplit(columns, ends)
    targets = Targets(mean, current, covariance, weight.T, depth, doubt)
    return Symbols(given, given[0], given[1:OWN], targets, given[known:])


def packed(command: Command) -> Symbolic:
    """A command as one column, as `decision_of` reads it."""
    *own, condition, status = command
    return ca.densify(ca.vertcat(*own, status, ca.vec(condition)))


def decision_of(result: np.ndarray, cna: Any, pose: Pose) -> Decision:
    """The decision that a packed command stands for."""
    turn_rate, speed, score, status = result[:CONDITION].tolist()
    return Decision(
        turn_rate=turn_rate,
        speed=speed,
        predict=partial(predict_path, cna, pose, turn_rate, speed),
        score=score,
        status=Status(int(status)),
        condition=result[CONDITION:].copy(),
    )


def decision_function(expression: Expression, n_auvs: int, cna: Any) -> ca.Function:
    """An expression, guarded: time, pose and each of `Targets` -> each of `Command`."""
    of = matrix if isinstance(expression, Vectorized) else symbol
    time, pose, weight = of("time"), of("pose", 4), of("weight", n_auvs)
    rows = {name: of(name, count, n_auvs) for name, count in ROWS.items() if name != "weight"}
    targets = Targets(weight=weight, **rows)
    command = guarded(expression, time, pose, targets, cna)
    results = [ca.densify(result) for result in command]
    return ca.Function("decision", [time, pose, *targets], results)


@lru_cache(maxsize=64)
def compiled(planner: Any, n_auvs: int) -> Call:
    """The planner's expression for a number of AUVs, built once."""
    expression, known = planner.expression, symbols(n_auvs)
    decision = decision_function(expression, n_auvs, planner.situation.cna)
    command = Command(*decision(known.time, known.pose, *known.targets))
    function = ca.Function("decision", [known.given], [packed(command)])
    return Call(interpreted(function, expression, n_auvs))


def interpreted(function: ca.Function, expression: Expression | None, n_auvs: int) -> ca.Function:
    """A Function that holds an expression, as the virtual machine runs it faster."""
    most = expression.scalars if isinstance(expression, Vectorized) else SCALARS
    return function.expand() if n_auvs <= most else function
