"""Where the search for a mission's turns begins: many starts, of four kinds.

The receding horizon's way, orbits of the AUVs, constant turns, and turns at random.
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from .. import beam_search
from ..beam_search import search_manoeuvres, turn_candidates
from ..model.arcs import arcs
from ..model.covariance import Tracks, conditioned
from ..model.schedule import ROUNDING, Stages, ping_stages
from .path import Turns
from .problem import Problem, advance

HORIZON = 20.0  # least look-ahead of the receding horizon [s]
TREES = ((6, 7, 32), (10, 7, 256), (16, 7, 128))  # its levels, branches and beam
ORBITS = (1.0, 2.0, 4.0, 8.0)  # radii, in smallest turning radii beyond the farthest AUV
STRAIGHTER = (1.0, 1.0 / 3.0)  # constant turns, in units of the limit
RANDOM = ((1, 1.0), (2, 1.0), (4, 0.3), (8, 0.3))  # turns that random ones last, and their largest
WINDOWS = (4, 8, 16, 32)  # turns of the best that are perturbed
PERTURBATION = 0.4  # their standard deviation, in units of the limit
SIDES = (1.0, -1.0)  # left, right

Violation = Callable[
    [Float[np.ndarray, "*batch 2"], Float[np.ndarray, " *samples"]], Float[np.ndarray, "*batch"]
]


def starts(
    turns: Turns, random: np.random.Generator, violation: Violation | None
) -> Iterator[Float[np.ndarray, " n"]]:
    """Turns to begin with, one after the other as they are asked for."""
    for levels, branches, beam in TREES:
        yield receding_horizon(turns, levels, branches, beam, violation)
    for radius in ORBITS:
        for left in SIDES:
            yield orbit(turns, radius, left)
    for scale in STRAIGHTER:
        for left in SIDES:
            yield np.full(turns.count, scale * left)
    for longer, scale in RANDOM:
        drawn = random.uniform(-scale, scale, -(-turns.count // longer))
        yield np.repeat(drawn, longer)[: turns.count]


def perturbed(w: Float[np.ndarray, " n"], random: np.random.Generator) -> Float[np.ndarray, " n"]:
    """Turns of which some in a row are other than they were."""
    first, changed = random.integers(w.size), w.copy()
    window = changed[first : first + random.choice(WINDOWS)]
    window += random.normal(0.0, PERTURBATION, window.size)
    return np.clip(changed, -1.0, 1.0)


def receding_horizon(
    turns: Turns, levels: int, branches: int, beam: int, violation: Violation | None
) -> Float[np.ndarray, " n"]:
    """Turns of a beam search repeated at every stage, covariances predicted along the surveys."""
    problem, stages = turns.problem, turns.problem.stages
    dt = problem.time_step
    every = problem.ping_every * dt
    P, pose = problem.covariance, problem.start
    rates = np.empty(problem.steps)
    begin = 0
    for k, end in enumerate(stages.end.tolist()):
        since = (begin - problem.first_ping) % problem.ping_every * dt
        ahead = within(ping_stages(since, every, HORIZON, levels), (problem.steps - begin) * dt)
        found = search_manoeuvres(
            pose,
            P,
            tracks=tracks(problem, begin, ahead.duration),
            process_noise=problem.process_noise,
            weights=problem.weights,
            stages=ahead,
            turn_rates=turn_candidates(problem.max_turn_rate, branches),
            speed=problem.cna_speed,
            ranging=problem.ranging,
            beam_width=beam,
            violation=None if violation is None else _after(violation, begin * dt),
        )
        rates[begin:end] = found.x[0]
        lasts = np.array([(end - begin) * dt])
        pose = arcs(pose, found.x[:1].reshape(()), problem.cna_speed, lasts)[0]
        for half in stages.halves:
            P = advance(P, half, k)
        if stages.pings[k]:
            x = pose[:2] - problem.position[end]
            P = conditioned(P, x, problem.ranging, float(stages.pings[k]))
        begin = end
    return turns.of(rates)


def _after(violation: Violation, begin: float) -> beam_search.Violation:
    return lambda positions, time: violation(positions, np.array(begin + time))


def within(ahead: Stages, left: float) -> Stages:
    """The stages that begin before a time [s], at least the first."""
    ended = int(np.searchsorted(np.cumsum(ahead.duration), left - ROUNDING))
    count = max(1, ended + 1)
    return Stages(ahead.duration[:count], ahead.pings[:count])


def tracks(problem: Problem, sample: int, durations: Float[np.ndarray, " S"]) -> Tracks:
    """Where the AUVs are at the ends of stages from a sample on, and how they move meanwhile."""
    samples = np.arange(problem.steps + 1)
    nodes = sample + np.concatenate([[0.0], np.cumsum(durations)]) / problem.time_step
    ends = nodes[1:]
    auvs = problem.weights.size
    position = np.empty((ends.size, auvs, 2))
    for auv in range(auvs):
        for axis in range(2):
            position[:, auv, axis] = np.interp(ends, samples, problem.position[:, auv, axis])
    middles = 0.5 * (ends + nodes[:-1])
    during = np.minimum(middles.astype(int), problem.steps - 1)
    east, north = np.moveaxis(problem.heading[during], -1, 0)
    return Tracks(position, np.arctan2(north, east), problem.speed[during])


def orbit(turns: Turns, radius: float, left: float) -> Float[np.ndarray, " n"]:
    """Turns about the AUVs' moving centroid.

    ``radius`` counts smallest turning radii beyond the farthest AUV; ``left`` is 1, or -1 for turns
    to the right.
    """
    problem = turns.problem
    speed, limit = problem.cna_speed, problem.max_turn_rate
    smallest = speed / limit
    center = np.einsum("kmi,m->ki", problem.position, problem.weights)
    distance = np.hypot(*np.moveaxis(problem.position - center[:, None], -1, 0))
    far = distance.max(axis=-1) + radius * smallest
    velocity = np.diff(center, axis=0) / problem.time_step
    pose, rates, dt = problem.start, np.empty(problem.steps), turns.hold * problem.time_step
    for k in range(0, problem.steps, turns.hold):
        away = pose[:2] - center[k]
        outside = np.hypot(*away) - far[k]
        inwards = np.arctan(outside / (2 * smallest))
        tangent = np.arctan2(away[1], away[0]) + left * (0.5 * np.pi + inwards)
        # the orbit moves with the AUVs
        water = speed * np.array([np.cos(tangent), np.sin(tangent)]) + velocity[k]
        ahead = left * 0.5 * speed / far[k] * dt
        error = np.arctan2(water[1], water[0]) + ahead - pose[2]
        wrapped = np.arctan2(np.sin(error), np.cos(error))
        rate = np.clip(wrapped / dt, -limit, limit)
        rates[k : k + turns.hold] = rate
        pose = arcs(pose, np.asarray(rate), speed, np.array([dt]))[0]
    return turns.of(rates)
