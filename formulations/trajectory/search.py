"""From the best manoeuvre to the optimum; what is taken is at least as good as what it replaces.

A solver's answer counts only if it says it succeeded, the limits hold along the path followed anew
(to ``TOLERANCE``), and its score, computed anew, is no worse than the best manoeuvre's, the
program's margins counted for both. Otherwise the next attempt, each the fallback of those before:
fatrop from the last trajectory, fatrop from the best manoeuvre, IPOPT from there, the best
manoeuvre itself. The second is a multi-start, from the best of each kind of manoeuvre, since
programs like these have several optima: the cheapest first, and no more once there is an answer
and `ENOUGH` iterations were taken, which is less than IPOPT takes from one start. Where the best
manoeuvre already breaks a limit, whatever breaks limits less is better than it.
"""

from collections.abc import Callable
from itertools import islice
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..beam_search import Violation
from ..model.ties import rounded
from ..solution import Solution, Status
from .manoeuvres import manoeuvres
from .parameters import Setting, chosen, setting
from .program import Controls, Program, program
from .rollout import Path, condition_numbers, gramians, ramped, rollout, scores
from .task import Task, frame_of, in_body_frame

TOLERANCE = 1e-5  # by which a limit may be broken [m]
WORSE = 1e-6  # by which a score may be worse, of its unit or of itself: solvers leave that much
# Iterations of fatrop in a multi-start, after which no further start is begun. Of 260 random tasks
# 6 in 100 have a better optimum, by up to a tenth, from a start that is then left out.
ENOUGH = 25
MANY_STATES = 20  # above which an iteration counts more: fatrop's take the longer beside IPOPT's
CHECKS = 8  # points of each stage at which the limits are checked in the end

REMEDIES = {
    Status.SECOND_SOLVER: (
        "solved as stated, but fatrop failed and IPOPT, which is slower, found it; "
        "fewer stages may help if it happens often"
    ),
    Status.BEST_MANOEUVRE: (
        "no solver improved on the best manoeuvre tried, which is taken; "
        "fewer stages, more iterations or a longer deadline may help"
    ),
}


class PathLimits(NamedTuple):
    """The true limits, in metres and world axes: how far something breaks them, at most 0 if not.

    ``along``: positions at times from now. ``terminal``: the terminal safe sets of poses, which are
    the smallest circles to the left and to the right.
    """

    along: Callable[[Float[np.ndarray, "K T 2"], Float[np.ndarray, " T"]], Float[np.ndarray, "K T"]]
    terminal: Callable[[Float[np.ndarray, "K 3"]], Float[np.ndarray, "K 2"]]


def freer_side(terminal: Float[np.ndarray, "K 2"]) -> Float[np.ndarray, " K"]:
    """Side of the terminal safe set that breaks the limits less: 1 left, -1 right."""
    return np.where(terminal[:, 0] <= terminal[:, 1], 1.0, -1.0)


class Candidates(NamedTuple):
    """Sequences, in units of the task, and what they are worth."""

    turn_rates: Float[np.ndarray, "K N"]
    speeds: Float[np.ndarray, "K N"]
    score: Float[np.ndarray, " K"]
    violation: Float[np.ndarray, " K"]  # the worst [m]
    excess: Float[np.ndarray, " K"]  # the mean over time [m]
    side: Float[np.ndarray, " K"]  # of the freer terminal safe set: 1 left, -1 right

    def one(self, k: int) -> Controls:
        """One of them."""
        return Controls(self.turn_rates[k], self.speeds[k])


class Search(NamedTuple):
    """What is looked for: a task, seen from the vehicle, of all AUVs and of those with a weight."""

    world: Task
    body: Task
    heard: Task
    objective: str
    limits: PathLimits | None


class Attempt(NamedTuple):
    """Candidates to start from, the solver, and the status of its answer."""

    starts: list[int]
    solver: str
    status: Status


def optimise(
    task: Task,
    objective: str,
    *,
    limits: PathLimits | None = None,
    last: Controls | None = None,
    max_iterations: int = 100,
    seconds_left: Callable[[], float] = lambda: np.inf,
) -> Solution:
    """Find the best trajectory of a task that has an AUV of positive weight.

    Parameters
    ----------
    task, objective
        See `Task` and ``OBJECTIVES``.
    limits
        The true limits behind the task's areas and separations.
    last
        The rest of the last trajectory on the stages of this one [rad/s, m/s].
    max_iterations
        Of each solver.
    seconds_left
        Says how much time is left; asked before each start of a solver, which then ends after
        as many iterations as that is enough for, if they take as long as those before.

    Returns
    -------
    ``x``: turn rate [rad/s] and speed [m/s] of each stage, as rows. ``poses``: now and at the ends
    of the stages. ``condition``: of each AUV's Gramian over the horizon; nan where it has none.
    Primal residual: the worst violation of the true limits [m], at most `TOLERANCE` unless the
    status says so.
    """
    search = _search(task, objective, limits)
    known = _in_units(task, last)
    tried = _judged(search, *manoeuvres(search.heard, objective, known, _along(search)))
    k, best = _best(search, tried)
    for attempt in _attempts(tried, k, best, warm=last is not None):
        found = _improved(search, attempt, tried, best, max_iterations, seconds_left)
        if found is not None:
            feasible = found.violation[0] <= TOLERANCE
            return _solution(search, found, attempt.status if feasible else Status.SOFTENED)
    feasible = best.violation[0] <= TOLERANCE
    return _solution(search, best, Status.BEST_MANOEUVRE if feasible else Status.VIOLATED)


def build(
    task: Task,
    objective: str,
    *,
    limits: PathLimits | None = None,
    max_iterations: int = 100,
    timed: bool = False,
) -> None:
    """Compile what `optimise` may need for a task; ``timed``: also where time is short."""
    search = _search(task, objective, limits)
    stages = len(task.durations)
    straight = Controls(np.zeros(stages), np.full(stages, search.body.speed[1]))
    fed = setting(search.body, search.heard, straight, objective, 1.0)
    program(fed.shape, max_iterations).build(timed=timed)


def _search(task: Task, objective: str, limits: PathLimits | None) -> Search:
    """What is looked for."""
    body = in_body_frame(task)
    heard = chosen(body, np.flatnonzero(task.weights > 0))
    return Search(task, body, heard, objective, limits)


def _in_units(task: Task, controls: Controls | None) -> Controls | None:
    """Controls in units of the task."""
    if controls is None:
        return None
    return Controls(controls.turn_rates * task.time, controls.speeds / task.speed[1])


def _attempts(tried: Candidates, k: int, best: Candidates, *, warm: bool) -> list[Attempt]:
    """What is attempted, in order; the last trajectory, where there is one, is the first tried."""
    starts = [k]
    if best.violation[0] <= TOLERANCE:
        starts += _of_each_kind(tried, k)
    cold = Attempt(starts, "fatrop", Status.RESTARTED if warm else Status.OPTIMAL)
    last = Attempt([k], "ipopt", Status.SECOND_SOLVER)
    if warm:
        return [Attempt([0], "fatrop", Status.OPTIMAL), cold, last]
    return [cold, last]


def _of_each_kind(tried: Candidates, best: int) -> list[int]:
    """The cheapest feasible candidate of each other kind than the best's, the cheapest first.

    A kind turns to the left first, or to the right, and then to either; straight on is of no kind.
    """
    half = tried.turn_rates.shape[1] // 2
    scores = rounded(tried.score)
    first = tried.turn_rates[:, :half].mean(axis=1)
    second = tried.turn_rates[:, half:].mean(axis=1)
    turns = 2 * (first > 0) + (second > 0)
    kind = np.where(first * second == 0, -1, turns)
    feasible = tried.violation <= TOLERANCE
    found = []
    for each in range(4):
        score = np.where(feasible & (kind == each), scores, np.inf)
        if each != kind[best] and np.isfinite(score.min()):
            found.append(int(score.argmin()))
    return sorted(found, key=lambda k: float(scores[k]))


def _improved(
    search: Search,
    attempt: Attempt,
    tried: Candidates,
    best: Candidates,
    max_iterations: int,
    seconds_left: Callable[[], float],
) -> Candidates | None:
    """The best of an attempt's answers; None where none counts."""
    answers = []
    taken = 0.0
    for k in attempt.starts:
        seconds = seconds_left()
        if seconds <= 0 or (answers and taken >= ENOUGH):
            break
        start, side = tried.one(k), float(tried.side[k])
        fed = setting(search.body, search.heard, start, search.objective, side)
        compiled = program(fed.shape, max_iterations)
        bounds = _bounds(search.body)
        answer = compiled.solve(attempt.solver, start, fed.parameters, bounds, seconds=seconds)
        taken += answer.iterations * max(1.0, compiled.nx / MANY_STATES)
        if answer.controls is None:
            continue
        found = _accepted(search, compiled, fed, answer.controls, best)
        if found is not None:
            answers.append(found)
    if not answers:
        return None
    best = min(answers, key=lambda one: (max(one.excess[0], TOLERANCE), one.score[0]))
    return next(one for one in answers if _as_good(one, best))


def _as_good(one: Candidates, best: Candidates) -> bool:
    """Whether an answer is the best but for what solvers leave, as its mirror image may be."""
    breaks, least = (max(each.excess[0], TOLERANCE) for each in (one, best))
    score, bar = one.score[0], best.score[0]
    return bool(breaks <= least * (1 + WORSE) and score <= bar + WORSE * abs(bar))


def _bounds(body: Task) -> Float[np.ndarray, "2 2"]:
    """Least and greatest turn rate and speed, as rows."""
    slow, fast = body.speed
    limit = fast / body.min_turn_radius
    return np.array([[-limit, slow], [limit, fast]])


def _accepted(
    search: Search, compiled: Program, fed: Setting, answer: Controls, best: Candidates
) -> Candidates | None:
    """A solver's answer, followed anew; None if it is worse than the best."""
    speeds = answer.speeds[None]
    found = _judged(search, ramped(search.body, answer.turn_rates[None], speeds), speeds, CHECKS)
    feasible = found.violation[0] <= TOLERANCE
    if best.violation[0] > TOLERANCE:
        return found if feasible or found.excess[0] <= best.excess[0] else None
    merit, bar = (
        one.score[0] + fed.unit * compiled.penalty(one.one(0), fed.parameters)
        for one in (found, best)
    )
    as_good = merit <= bar + WORSE * max(fed.unit, abs(bar))
    return found if feasible and as_good else None


def _best(search: Search, tried: Candidates) -> tuple[int, Candidates]:
    """The best candidate whose path bears a closer look, and that look.

    It breaks the limits least; of those that do not break them it is the cheapest.
    """
    broken = np.where(tried.violation <= TOLERANCE, 0.0, tried.excess)
    order = np.lexsort((rounded(tried.score), rounded(broken))).tolist()
    for k in islice(order, int(np.sum(broken == 0))):
        looked = _look(search, tried, k)
        if looked.violation[0] <= TOLERANCE:
            return k, looked
    return order[0], _look(search, tried, order[0])


def _look(search: Search, tried: Candidates, k: int) -> Candidates:
    """One candidate judged at the points of the last check."""
    return _judged(search, tried.turn_rates[[k]], tried.speeds[[k]], CHECKS)


def _judged(
    search: Search,
    turn_rates: Float[np.ndarray, "K N"],
    speeds: Float[np.ndarray, "K N"],
    points: int = 2,
) -> Candidates:
    """Sequences followed, scored, and held against the limits.

    ``points``: of each stage, an even number.
    """
    path = rollout(search.body, turn_rates, speeds, points)
    each = points // 2
    halves = Path(path.poses[:, ::each], path.times[::each])
    score = scores(search.heard, halves, search.objective) @ search.heard.weights
    nothing = np.zeros(len(score))
    if search.limits is None:
        return Candidates(turn_rates, speeds, score, nothing, nothing, nothing + 1.0)
    world = _world(search.world, path)
    along = search.limits.along(world.poses[:, 1:, :2], world.times[1:])
    terminal = search.limits.terminal(world.poses[:, -1])
    broken = np.concatenate([along, terminal.min(axis=1)[:, None]], axis=1)
    return Candidates(
        turn_rates,
        speeds,
        score,
        violation=broken.max(axis=1),
        excess=np.maximum(broken, 0.0).mean(axis=1),
        side=freer_side(terminal),
    )


def _world(task: Task, path: Path) -> Path:
    """A path in SI units and world axes."""
    xy = frame_of(task).world(path.poses[..., :2])
    heading = path.poses[..., 2:] + task.pose[2]
    return Path(np.concatenate([xy, heading], axis=-1), path.times * task.time)


def _along(search: Search) -> Violation | None:
    """The true limits as the beam search asks for them, in units of the task."""
    if search.limits is None:
        return None
    task, along = search.world, search.limits.along
    frame = frame_of(task)

    def violation(positions: np.ndarray, times: np.ndarray) -> np.ndarray:
        flat = frame.world(positions.reshape(-1, len(times), 2))
        return along(flat, times * task.time).reshape(positions.shape[:-1]) / task.length

    return violation


def _solution(search: Search, found: Candidates, status: Status) -> Solution:
    """What was found, in SI units and world axes."""
    task = search.world
    path = rollout(search.body, found.turn_rates, found.speeds)
    condition = np.full(len(task.weights), np.nan)
    if search.objective != "covariance":
        condition[task.weights > 0] = condition_numbers(gramians(search.heard, path))[0]
    controls = [found.turn_rates[0] / task.time, found.speeds[0] * task.speed[1]]
    return Solution(
        x=np.stack(controls, axis=-1),
        objective=_in_si(task, float(found.score[0]), search.objective),
        status=status,
        primal_residual=max(0.0, float(found.violation[0])),
        poses=_world(task, path).poses[0, ::2],
        condition=condition,
        remedies=REMEDIES,
    )


def _in_si(task: Task, score: float, objective: str) -> float:
    """A score in SI units."""
    if objective == "covariance":
        return score * task.length**2
    unit = np.log(4 * task.length**2 * task.time)  # of a Gramian
    shift = {"log-det": 2 * unit, "smallest-eigenvalue": unit, "condition-number": 0.0}
    return score - shift[objective]
