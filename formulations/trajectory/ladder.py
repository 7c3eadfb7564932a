"""From the best manoeuvre to the optimum, one rung after the other; what is taken is at least as good as what it replaces.

A solver's answer counts only if it says it succeeded, the limits hold along the path followed anew (to ``TOLERANCE``), and its score,
computed anew, is no worse than the best manoeuvre's, the program's margins counted for both. Otherwise the next rung: fatrop from the last
trajectory, fatrop from the best manoeuvre, IPOPT from there, the best manoeuvre itself. The second rung starts from the best of each kind
of manoeuvre, since programs like these have several optima. Where the best manoeuvre already breaks a limit, whatever breaks limits less is
better than it.
"""

from collections.abc import Callable
from itertools import islice
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..beam_search import Violation
from ..solution import Status
from .manoeuvres import manoeuvres
from .parameters import chosen, setting
from .program import Controls, program
from .rollout import Path, condition_numbers, follow, gramians, ramped, scores
from .task import Task, frame_of, in_body_frame

TOLERANCE = 1e-5  # by which a limit may be broken [m]
WORSE = 1e-6  # by which a score may be worse, of its unit or of itself: what solvers leave of an optimum they were given
CHECKS = 8  # points of each stage at which the limits are checked in the end


class Limits(NamedTuple):
    """The true limits, in metres and world axes: how far something breaks them, at most 0 if it does not."""

    along: Callable[
        [Float[np.ndarray, "K T 2"], Float[np.ndarray, " T"]], Float[np.ndarray, "K T"]
    ]  # positions at times from now
    after: Callable[
        [Float[np.ndarray, "K 3"]], Float[np.ndarray, "K 2"]
    ]  # the smallest circles to the left and the right of poses


class Candidates(NamedTuple):
    """Sequences, in units of the task, and what they are worth."""

    turn_rates: Float[np.ndarray, "K N"]
    speeds: Float[np.ndarray, "K N"]
    score: Float[np.ndarray, " K"]
    violation: Float[np.ndarray, " K"]  # the worst [m]
    excess: Float[np.ndarray, " K"]  # the mean over time [m]
    side: Float[np.ndarray, " K"]  # the freer circle at the end: 1 left, -1 right

    def one(self, k: int) -> Controls:
        """One of them."""
        return Controls(self.turn_rates[k], self.speeds[k])


class Outcome(NamedTuple):
    """The trajectory taken, in SI units and world axes."""

    turn_rates: Float[np.ndarray, " N"]
    speeds: Float[np.ndarray, " N"]
    poses: Float[np.ndarray, "nodes 3"]  # at the ends of the stages, the first now
    score: float
    condition: Float[np.ndarray, " M"]  # κ of each AUV's Gramian; nan where there is none
    violation: float  # the worst [m]; at most TOLERANCE unless the status says so
    side: float  # of the circle it can end in
    status: Status


class Search(NamedTuple):
    """What is looked for: a task, seen from the vehicle, of all AUVs and of those that have a weight."""

    world: Task
    body: Task
    heard: Task
    objective: str
    limits: Limits | None


def optimise(
    task: Task,
    objective: str,
    *,
    limits: Limits | None = None,
    last: Controls | None = None,
    max_iterations: int = 100,
    hurry: Callable[[], bool] = lambda: False,
) -> Outcome:
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
    hurry
        Says whether time is up; asked before each rung.
    """
    body = in_body_frame(task)
    search = Search(task, body, chosen(body, np.flatnonzero(task.weights > 0)), objective, limits)
    shifted = (
        None if last is None else Controls(last.turn_rates * task.time, last.speeds / task.speed[1])
    )
    tried = _judged(search, *manoeuvres(search.heard, objective, shifted, _positions(search)))
    k, best = _best(search, tried)
    for starts, solver, status in _rungs(tried, k, best, warm=last is not None):
        if hurry():
            break
        found = [
            _solved(search, solver, tried.one(i), float(tried.side[i]), best, max_iterations)
            for i in starts
        ]
        better = [one for one in found if one is not None]
        if better:
            taken = min(better, key=lambda one: (max(one.excess[0], TOLERANCE), one.score[0]))
            return _outcome(
                search, taken, status if taken.violation[0] <= TOLERANCE else Status.SOFTENED
            )
    return _outcome(
        search, best, Status.BEST_MANOEUVRE if best.violation[0] <= TOLERANCE else Status.VIOLATED
    )


def _rungs(
    tried: Candidates, k: int, best: Candidates, *, warm: bool
) -> list[tuple[list[int], str, Status]]:
    """Manoeuvres to start from, the last trajectory being the first of those tried; solver; what it is called."""
    others = _of_each_kind(tried, k) if best.violation[0] <= TOLERANCE else []
    again = Status.RESTARTED if warm else Status.OPTIMAL
    first = [([0], "fatrop", Status.OPTIMAL)] if warm else []
    return [*first, ([k, *others], "fatrop", again), ([k], "ipopt", Status.SECOND_SOLVER)]


def _of_each_kind(tried: Candidates, best: int) -> list[int]:
    """The cheapest that breaks no limit of those that turn to the left first, or to the right, and then to either; not the best itself."""
    half = tried.turn_rates.shape[1] // 2
    first, second = tried.turn_rates[:, :half].mean(axis=1), tried.turn_rates[:, half:].mean(axis=1)
    kind = np.where(
        first * second == 0, -1, np.where(first > 0, 2, 0) + np.where(second > 0, 1, 0)
    )  # straight on is of no kind
    free = tried.violation <= TOLERANCE
    found = [
        np.where(free & (kind == each), tried.score, np.inf)
        for each in range(4)
        if each != kind[best]
    ]
    return [int(score.argmin()) for score in found if np.isfinite(score.min())]


def _solved(
    search: Search, solver: str, start: Controls, side: float, best: Candidates, max_iterations: int
) -> Candidates | None:
    """The answer of a solver, followed anew; None if it failed, or is worse than the best manoeuvre."""
    fed = setting(search.body, search.heard, start, search.objective, side)
    compiled = program(fed.shape, max_iterations)
    slow, fast = search.body.speed
    limit = fast / search.body.min_turn_radius
    answer = compiled.solve(
        solver, start, fed.parameters, np.array([[-limit, slow], [limit, fast]])
    )
    if answer is None:
        return None
    found = _judged(
        search,
        ramped(search.body, answer.turn_rates[None], answer.speeds[None]),
        answer.speeds[None],
        CHECKS,
    )
    if best.violation[0] > TOLERANCE:
        return (
            found if found.violation[0] <= TOLERANCE or found.excess[0] <= best.excess[0] else None
        )
    merit, bar = (
        one.score[0] + fed.unit * compiled.penalty(one.one(0), fed.parameters)
        for one in (found, best)
    )
    return (
        found
        if found.violation[0] <= TOLERANCE and merit <= bar + WORSE * max(fed.unit, abs(bar))
        else None
    )


def _best(search: Search, tried: Candidates) -> tuple[int, Candidates]:
    """The manoeuvre that breaks the limits least, of those that do not the cheapest, whose path bears a closer look; and that look."""
    broken = np.where(tried.violation <= TOLERANCE, 0.0, tried.excess)
    order = np.lexsort((tried.score, broken))
    looked = (
        (int(k), _judged(search, tried.turn_rates[[k]], tried.speeds[[k]], CHECKS)) for k in order
    )
    for found in islice(looked, int(np.sum(broken == 0))):
        if found[1].violation[0] <= TOLERANCE:
            return found
    k = order[0]
    return int(k), _judged(search, tried.turn_rates[[k]], tried.speeds[[k]], CHECKS)


def _judged(
    search: Search,
    turn_rates: Float[np.ndarray, "K N"],
    speeds: Float[np.ndarray, "K N"],
    points: int = 2,
) -> Candidates:
    """Sequences followed, scored, and held against the limits at so many points of each stage, an even number."""
    path = follow(search.body, turn_rates, speeds, points)
    each = points // 2
    score = (
        scores(search.heard, Path(path.poses[:, ::each], path.times[::each]), search.objective)
        @ search.heard.weights
    )
    nothing = np.zeros(len(score))
    if search.limits is None:
        return Candidates(turn_rates, speeds, score, nothing, nothing, nothing + 1.0)
    world = _world(search.world, path)
    along = search.limits.along(world.poses[:, 1:, :2], world.times[1:])
    after = search.limits.after(world.poses[:, -1])
    broken = np.concatenate([along, after.min(axis=1)[:, None]], axis=1)
    side = np.where(after[:, 0] <= after[:, 1], 1.0, -1.0)
    return Candidates(
        turn_rates, speeds, score, broken.max(axis=1), np.maximum(broken, 0.0).mean(axis=1), side
    )


def _world(task: Task, path: Path) -> Path:
    """A path in SI units and world axes."""
    xy = frame_of(task).world(path.poses[..., :2])
    return Path(
        np.concatenate([xy, path.poses[..., 2:] + task.pose[2]], axis=-1), path.times * task.time
    )


def _positions(search: Search) -> Violation | None:
    """The true limits as the manoeuvre search asks for them: of positions (..., T, 2) at times, in units of the task."""
    if search.limits is None:
        return None
    task, along = search.world, search.limits.along
    frame = frame_of(task)

    def violation(positions: np.ndarray, times: np.ndarray) -> np.ndarray:
        flat = frame.world(positions.reshape(-1, len(times), 2))
        return along(flat, times * task.time).reshape(positions.shape[:-1]) / task.length

    return violation


def _outcome(search: Search, found: Candidates, status: Status) -> Outcome:
    task, objective = search.world, search.objective
    path = follow(search.body, found.turn_rates, found.speeds)
    condition = np.full(len(task.weights), np.nan)
    score = float(found.score[0])
    if objective == "covariance":
        score *= task.length**2
    else:
        condition[task.weights > 0] = condition_numbers(gramians(search.heard, path))[0]
        unit = np.log(4 * task.length**2 * task.time)
        score -= {"log-det": 2 * unit, "smallest-eigenvalue": unit, "condition-number": 0.0}[
            objective
        ]
    return Outcome(
        turn_rates=found.turn_rates[0] / task.time,
        speeds=found.speeds[0] * task.speed[1],
        poses=_world(task, path).poses[0, ::2],
        score=score,
        condition=condition,
        violation=float(found.violation[0]),
        side=float(found.side[0]),
        status=status,
    )
