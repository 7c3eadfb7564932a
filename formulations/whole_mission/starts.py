"""Where the search for a mission's turns begins: the receding horizon's way, orbits of the AUVs, constant turns, and turns at random."""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from formulations import beam_search
from formulations.beam_search import search_manoeuvres, turn_candidates

from ..model.arcs import arcs
from ..model.covariance import Tracks, conditioned
from ..model.schedule import ROUNDING, Stages, ping_stages
from .mission import Mission, advance
from .path import Turns

HORIZON = 20.0  # least look-ahead of the receding horizon [s]
TREES = ((6, 7, 32), (10, 7, 256), (16, 7, 128))  # its levels, branches and beam
ORBITS = (1.0, 2.0, 4.0, 8.0)  # radii, in smallest turning radii beyond the farthest AUV
STRAIGHTER = (1.0, 1.0 / 3.0)  # constant turns, in units of the limit
RANDOM = ((1, 1.0), (2, 1.0), (4, 0.3), (8, 0.3))  # turns that random ones last, and their largest
WINDOWS = (4, 8, 16, 32)  # turns of the best that are shaken
SHAKE = 0.4  # their standard deviation, in units of the limit

Violation = Callable[
    [Float[np.ndarray, "*batch 2"], Float[np.ndarray, " *samples"]], Float[np.ndarray, "*batch"]
]


def starts(
    turns: Turns, random: np.random.Generator, violation: Violation | None
) -> Iterator[Float[np.ndarray, " n"]]:
    """Turns to begin with, one after the other as they are asked for."""
    yield from (receding_horizon(turns, *tree, violation) for tree in TREES)
    yield from (orbit(turns, radius, left) for radius in ORBITS for left in (1.0, -1.0))
    yield from (np.full(turns.count, scale * left) for scale in STRAIGHTER for left in (1.0, -1.0))
    for longer, scale in RANDOM:
        yield np.repeat(random.uniform(-scale, scale, -(-turns.count // longer)), longer)[
            : turns.count
        ]


def shaken(w: Float[np.ndarray, " n"], random: np.random.Generator) -> Float[np.ndarray, " n"]:
    """Turns of which some in a row are other than they were."""
    first, changed = random.integers(w.size), w.copy()
    window = changed[first : first + random.choice(WINDOWS)]
    window += random.normal(0.0, SHAKE, window.size)
    return np.clip(changed, -1.0, 1.0)


def receding_horizon(
    turns: Turns, levels: int, branches: int, beam: int, violation: Violation | None
) -> Float[np.ndarray, " n"]:
    """Turns of a search over a horizon repeated at every stage, as covariances are predicted along the surveys."""
    mission, stages = turns.mission, turns.mission.stages
    P, pose, rates, begin, dt = (
        mission.covariance,
        mission.start,
        np.empty(mission.steps),
        0,
        mission.time_step,
    )
    for k, end in enumerate(stages.end.tolist()):
        since, every = (
            (begin - mission.first_ping) % mission.ping_every * dt,
            mission.ping_every * dt,
        )
        ahead = within(ping_stages(since, every, HORIZON, levels), (mission.steps - begin) * dt)
        found = search_manoeuvres(
            pose,
            P,
            tracks=tracks(mission, begin, ahead.duration),
            process_noise=mission.process_noise,
            weights=mission.weights,
            stages=ahead,
            turn_rates=turn_candidates(mission.max_turn_rate, branches),
            speed=mission.cna_speed,
            ranging=mission.ranging,
            beam_width=beam,
            violation=None if violation is None else _after(violation, begin * dt),
        )
        rates[begin:end] = found.turn_rates[0]
        lasts = np.array([(end - begin) * dt])
        pose = arcs(pose, found.turn_rates[:1].reshape(()), mission.cna_speed, lasts)[0]
        P = advance(advance(P, stages.halves[0], k), stages.halves[1], k)
        if stages.pings[k]:
            x = pose[:2] - mission.position[end]
            P = conditioned(P, x, mission.ranging, float(stages.pings[k]))
        begin = end
    return turns.of(rates)


def _after(violation: Violation, begin: float) -> beam_search.Violation:
    return lambda positions, time: violation(positions, np.array(begin + time))


def within(ahead: Stages, left: float) -> Stages:
    """The stages that begin before a time [s], at least the first."""
    count = max(1, int(np.searchsorted(np.cumsum(ahead.duration), left - ROUNDING)) + 1)
    return Stages(ahead.duration[:count], ahead.pings[:count])


def tracks(mission: Mission, sample: int, durations: Float[np.ndarray, " S"]) -> Tracks:
    """Where the AUVs are at the ends of stages from a sample on, and how they move through the water during them."""
    ends = sample + np.concatenate([[0.0], np.cumsum(durations)]) / mission.time_step
    position = np.stack(
        [
            np.stack(
                [np.interp(ends, np.arange(mission.steps + 1), axis) for axis in auv.T], axis=-1
            )
            for auv in mission.position.swapaxes(0, 1)
        ],
        axis=1,
    )
    during = np.minimum((0.5 * (ends[1:] + ends[:-1])).astype(int), mission.steps - 1)
    heading = mission.heading[during]
    return Tracks(position[1:], np.arctan2(heading[..., 1], heading[..., 0]), mission.speed[during])


def orbit(turns: Turns, radius: float, left: float) -> np.ndarray:
    """Turns about the AUVs' moving centroid, ``radius`` smallest turning radii beyond the farthest of them."""
    mission = turns.mission
    smallest = mission.cna_speed / mission.max_turn_rate
    center = np.einsum("kmi,m->ki", mission.position, mission.weights)
    far = (
        np.hypot(*np.moveaxis(mission.position - center[:, None], -1, 0)).max(axis=-1)
        + radius * smallest
    )
    velocity = np.diff(center, axis=0) / mission.time_step
    pose, rates, dt = mission.start, np.empty(mission.steps), turns.hold * mission.time_step
    for k in range(0, mission.steps, turns.hold):
        away = pose[:2] - center[k]
        outside = np.hypot(*away) - far[k]
        course = np.arctan2(away[1], away[0]) + left * (
            0.5 * np.pi + np.arctan(outside / (2 * smallest))
        )
        water = (
            mission.cna_speed * np.array([np.cos(course), np.sin(course)]) + velocity[k]
        )  # so that the orbit moves with the AUVs
        error = (
            np.arctan2(water[1], water[0]) + left * 0.5 * mission.cna_speed / far[k] * dt - pose[2]
        )
        rates[k : k + turns.hold] = rate = np.clip(
            np.arctan2(np.sin(error), np.cos(error)) / dt,
            -mission.max_turn_rate,
            mission.max_turn_rate,
        )
        pose = arcs(pose, np.asarray(rate), mission.cna_speed, np.array([dt]))[0]
    return turns.of(rates)
