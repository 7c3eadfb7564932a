"""Where the search for a mission's turns begins: many starts, of four kinds.

The receding horizon's way, orbits of the AUVs, constant turns, and turns at random.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from .. import beam_search
from ..beam_search import search_manoeuvres, turn_candidates
from ..model.arcs import arcs
from ..model.covariance import Tracks, conditioned
from ..model.schedule import ROUNDING, Stages
from .aided import alone, beacon_of, information
from .path import Turns
from .problem import Problem, Violation, advance

HORIZON = 20.0  # least look-ahead of the receding horizon [s]
TREES = ((6, 7, 32), (10, 7, 256), (16, 7, 128))  # its levels, branches and beam
ORBITS = (1.0, 2.0, 4.0, 8.0)  # radii, in smallest turning radii beyond the farthest AUV
STRAIGHTER = (1.0, 1.0 / 3.0)  # constant turns, in units of the limit
RANDOM = ((1, 1.0), (2, 1.0), (4, 0.3), (8, 0.3))  # turns that random ones last, and their largest
WINDOWS = (4, 8, 16, 32)  # turns of the best that are perturbed
PERTURBATION = 0.4  # their standard deviation, in units of the limit
SIDES = (1.0, -1.0)  # left, right

Start = Callable[[Turns], Float[np.ndarray, " n"]]  # of one vehicle


def starts(turns: Turns, random: np.random.Generator) -> Iterator[Float[np.ndarray, " n"]]:
    """Turns to begin with, one after the other as they are asked for.

    Of several vehicles each begins in the same way, given where those before it go.
    """
    for start in kinds(random):
        yield start(turns) if len(turns.problem.vehicles) == 1 else of_all(turns, start)


def of_all(turns: Turns, start: Start) -> Float[np.ndarray, " n"]:
    """Turns of several vehicles, each given where those before it go."""
    problem, found, before = turns.problem, [], []
    for vehicle in problem.vehicles:
        own = Turns(alone(problem, vehicle, before), turns.hold)
        found.append(start(own))
        before.append(beacon_of(vehicle, own.poses(found[-1])[0, :, :2]))
    return np.concatenate(found)


def kinds(random: np.random.Generator) -> Iterator[Start]:
    """How one vehicle begins."""
    for levels, branches, beam in TREES:
        yield partial(receding_horizon, levels=levels, branches=branches, beam=beam)
    for radius in ORBITS:
        for left in SIDES:
            yield partial(orbit, radius=radius, left=left)
    for scale in STRAIGHTER:
        for left in SIDES:
            yield partial(constant, turn=scale * left)
    for longer, scale in RANDOM:
        yield partial(at_random, random=random, longer=longer, scale=scale)


def constant(turns: Turns, turn: float) -> Float[np.ndarray, " n"]:
    """One turn all the time, in units of the limit."""
    return np.full(turns.count, turn)


def at_random(
    turns: Turns, random: np.random.Generator, longer: int, scale: float
) -> Float[np.ndarray, " n"]:
    """Turns drawn from -scale to scale, some in a row alike."""
    drawn = random.uniform(-scale, scale, -(-turns.count // longer))
    return np.repeat(drawn, longer)[: turns.count]


def perturbed(w: Float[np.ndarray, " n"], random: np.random.Generator) -> Float[np.ndarray, " n"]:
    """Turns of which some in a row are other than they were."""
    first, changed = random.integers(w.size), w.copy()
    window = changed[first : first + random.choice(WINDOWS)]
    window += random.normal(0.0, PERTURBATION, window.size)
    return np.clip(changed, -1.0, 1.0)


def receding_horizon(
    turns: Turns, levels: int, branches: int, beam: int
) -> Float[np.ndarray, " n"]:
    """Turns of a beam search repeated at every stage, covariances predicted along the surveys.

    Of beacons it counts what their ranges tell, but for their second-order error.
    """
    problem, stages = turns.problem, turns.problem.stages
    (vehicle,) = problem.vehicles
    dt = problem.time_step
    told = information(problem) if problem.beacons else None
    P, pose = problem.covariance, vehicle.start
    rates = np.empty(problem.steps)
    begin = 0
    for k, end in enumerate(stages.end.tolist()):
        ahead = stages_ahead(problem, begin, levels)
        ends = begin + np.cumsum(ahead.duration) / dt
        found = search_manoeuvres(
            pose,
            P,
            tracks=tracks(problem, begin, ahead.duration),
            process_noise=problem.process_noise,
            weights=problem.weights,
            stages=ahead,
            turn_rates=turn_candidates(vehicle.max_turn_rate, branches),
            speed=vehicle.speed,
            ranging=vehicle.ranging,
            beam_width=beam,
            violation=None if vehicle.violation is None else _after(vehicle.violation, begin * dt),
            known=None if told is None else gathered(told, begin, ends),
        )
        rates[begin:end] = found.x[0]
        lasts = np.array([(end - begin) * dt])
        pose = arcs(pose, found.x[:1].reshape(()), vehicle.speed, lasts)[0]
        for half in stages.halves:
            P = advance(P, half, k)
        P = after_ranges(P, problem, k, pose[:2])
        begin = end
    return turns.of(rates, vehicle)


def after_ranges(
    P: Float[np.ndarray, "M 4 4"], problem: Problem, stage: int, place: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "M 4 4"]:
    """Covariances after the ranges of a stage to the one vehicle, at a place, and to beacons."""
    end = problem.stages.end[stage]
    places = [place, *(beacon.position[end] for beacon in problem.beacons)]
    for there, other, pings in zip(
        places, problem.ranged, problem.stages.pings[stage], strict=True
    ):
        if pings.any():
            x, height = there - problem.position[end], problem.height(other)[end]
            P = conditioned(P, x, other.ranging, pings, height)
    return P


def _after(violation: Violation, begin: float) -> beam_search.Violation:
    return lambda positions, time: violation(positions, np.array(begin + time))


def stages_ahead(problem: Problem, sample: int, levels: int) -> Stages:
    """The one vehicle's horizon from a sample on, cut at its ranges and at the mission's end."""
    dt = problem.time_step
    (vehicle,) = problem.vehicles
    schedule = vehicle.schedule
    time = problem.begin + sample * dt
    if schedule.plain:  # counted from a range, so that rounding is the same all the time
        pings = problem.pings[0][0]
        first = int(pings[0]) if pings.size else problem.steps
        time = (sample - first) % round(schedule.interval / dt) * dt
    ahead = schedule.stages(time, HORIZON, levels, len(problem.weights))
    return within(ahead, (problem.steps - sample) * dt)


def gathered(
    told: Float[np.ndarray, "samples M 2 2"], begin: int, ends: Float[np.ndarray, " S"]
) -> Float[np.ndarray, "S M 2 2"]:
    """What is told after a sample, up to the end of each stage."""
    edges = np.minimum(np.round([begin, *ends]).astype(int), len(told) - 1) + 1
    return np.stack([told[a:b].sum(axis=0) for a, b in pairwise(edges)])


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
    (vehicle,) = problem.vehicles
    nearest = np.minimum(np.round(ends).astype(int), problem.steps)
    height = problem.height(vehicle)[nearest]
    return Tracks(position, np.arctan2(north, east), problem.speed[during], height)


def orbit(turns: Turns, radius: float, left: float) -> Float[np.ndarray, " n"]:
    """Turns about the AUVs' moving centroid.

    ``radius`` counts smallest turning radii beyond the farthest AUV; ``left`` is 1, or -1 for turns
    to the right.
    """
    problem = turns.problem
    (vehicle,) = problem.vehicles
    speed, limit = vehicle.speed, vehicle.max_turn_rate
    smallest = speed / limit
    center = np.einsum("kmi,m->ki", problem.position, problem.weights)
    distance = np.hypot(*np.moveaxis(problem.position - center[:, None], -1, 0))
    far = distance.max(axis=-1) + radius * smallest
    velocity = np.diff(center, axis=0) / problem.time_step
    pose, rates, dt = vehicle.start, np.empty(problem.steps), turns.hold * problem.time_step
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
    return turns.of(rates, vehicle)
