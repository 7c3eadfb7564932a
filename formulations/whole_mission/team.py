"""Several aid vehicles: each planned in turn given the others' plans, and then all at once."""

import numpy as np
from jaxtyping import Float

from ..solution import Solution, Status
from .aided import alone, beacon_of
from .path import Turns
from .problem import Beacon, Problem
from .search import (
    ITERATIONS,
    Candidate,
    Objective,
    Progress,
    assess,
    better,
    descend,
    multi_start,
    rank,
    untold,
)

ROUNDS = 20  # at most, in which each vehicle is planned again given the others


def optimise(
    problem: Problem,
    *,
    hold: int,
    count: int,
    random: np.random.Generator,
    progress: Progress = untold,
) -> Solution:
    """Find the turns of all aid vehicles for the least mean predicted position variance.

    One vehicle's are found by a multi-start (`multi_start`, which says what is given and found).
    Several are first planned in turn (`in_turn`); a multi-start over the turns of all at once then
    begins there as well as at its own starts, so that it ends no worse.
    """
    vehicles = len(problem.vehicles)
    if vehicles == 1:
        return multi_start(problem, hold=hold, count=count, random=random, progress=progress)
    parts = vehicles + 1
    one_by_one = in_turn(problem, hold=hold, count=count, random=random, progress=progress)
    told = _part(progress, vehicles, parts)
    return multi_start(
        problem, hold=hold, count=count, random=random, progress=told, also=[one_by_one.w]
    )


def in_turn(
    problem: Problem,
    *,
    hold: int,
    count: int,
    random: np.random.Generator,
    progress: Progress = untold,
) -> Candidate:
    """Turns of several vehicles, each planned given the others' until none changes.

    Each is first planned by a multi-start, given where those before it go; then it descends from
    its turns, given all others', until a round is no `better`.
    """
    objective = Objective(Turns(problem, hold))
    turns, before = [], []
    for k, vehicle in enumerate(problem.vehicles):
        own = alone(problem, vehicle, before)
        told = _part(progress, k, len(problem.vehicles) + 1)
        found = multi_start(own, hold=hold, count=count, random=random, progress=told)
        turns.append(found.x[0] / vehicle.max_turn_rate)
        path = Turns(own, hold).poses(turns[-1])[0, :, :2]
        before.append(beacon_of(vehicle, path))
    best = assess(objective, np.concatenate(turns), Status.BEST_MANOEUVRE)
    for _ in range(ROUNDS):
        improved = once_around(objective, best)
        if not better(objective, improved, best):
            break
        best = improved
    return best


def once_around(objective: Objective, best: Candidate) -> Candidate:
    """The turns after each vehicle has descended once, given the others'."""
    problem, hold = objective.turns.problem, objective.turns.hold
    for k, vehicle in enumerate(problem.vehicles):
        own = Objective(Turns(alone(problem, vehicle, others(objective.turns, best.w, k)), hold))
        found = descend(own, objective.turns.of_each(best.w)[k], ITERATIONS)
        turns = objective.turns.of_each(best.w).copy()
        turns[k] = found.w
        best = min(best, assess(objective, turns.ravel(), found.status), key=rank)
    return best


def others(turns: Turns, w: Float[np.ndarray, " n"], k: int) -> list[Beacon]:
    """All vehicles but one, as it is known where they go."""
    paths = turns.poses(w)[..., :2]
    vehicles = turns.problem.vehicles
    return [beacon_of(vehicles[i], paths[i]) for i in range(len(vehicles)) if i != k]


def _part(progress: Progress, done: int, parts: int) -> Progress:
    """Progress of one of several parts that take about as long."""

    def told(steps: int, allowed: int) -> None:
        progress(done * allowed + steps, parts * allowed)

    return told
