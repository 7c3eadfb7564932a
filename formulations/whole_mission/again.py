"""A plan descended from again, from what is known now: a warm start, and few iterations."""

import numpy as np
from jaxtyping import Float

from ..solution import Solution, Status
from .path import Turns
from .search import Objective, assess, better, descend, solution_of

Plan = Float[np.ndarray, "vehicles count"]


def again(turns: Turns, turn_rates: Plan, *, iterations: int) -> Solution | None:
    """Improve a plan's turns; None where they are as good as they need be.

    A descent (`formulations.whole_mission.search.descend`) begins at the plan's turns and ends
    after a number of iterations at most. What it finds is taken if it breaks limits less, or as
    little and for a mean variance that is less by
    `formulations.whole_mission.search.SETTLED` of that of going straight on. So a plan
    stays as it is while all goes as it expected. Limits are a penalty of the last weight alone: a
    lighter one would lead the plan out of them first.

    Parameters
    ----------
    turns
        The rest of the mission, and how it is divided into turns.
    turn_rates
        The plan's turns [rad/s] of each vehicle, the first being the one that goes on.
    iterations
        Of the descent, at most.

    Returns
    -------
    As of `formulations.whole_mission.optimise`. The status is `Status.INACCURATE` where the
    iterations ended before the descent did.
    """
    limits = np.array([[vehicle.max_turn_rate] for vehicle in turns.problem.vehicles])
    objective = Objective(turns)
    present = np.clip(turn_rates / limits, -1.0, 1.0).ravel()
    known = assess(objective, present, Status.BEST_MANOEUVRE)
    found = descend(objective, present, iterations, objective.penalties[-1:])
    if not better(objective, found, known):
        return None
    return solution_of(objective, found)
