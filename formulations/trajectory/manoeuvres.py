"""Candidate manoeuvres: constant turns, pairs of turns, the last trajectory, a beam search."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from ..beam_search import Violation, search_manoeuvres, turn_candidates
from ..model.covariance import Tracks
from ..model.schedule import Stages
from .program import Controls
from .rollout import ramped
from .task import Task

CONSTANT = 21  # turns held over the horizon
PAIRED = 7  # turns held over half of it, each followed by each
BRANCHES, LEVELS, BEAM = 7, 5, 16  # of the search for covariances


def manoeuvres(
    task: Task, objective: str, last: Controls | None, violation: Violation | None
) -> tuple[Float[np.ndarray, "K N"], Float[np.ndarray, "K N"]]:
    """Turn rates and speeds, within the vehicle's limits.

    The last trajectory comes first, so that of equals it is kept.
    """
    rates = _turns(len(task.durations)) * (task.speed[1] / task.min_turn_radius)
    if objective == "covariance":
        rates = np.concatenate([_searched(task, violation)[None], rates])
    speeds = np.full_like(rates, task.speed[1])
    if task.speed[0] < task.speed[1]:
        rates = np.concatenate([rates, rates * (task.speed[0] / task.speed[1])])
        speeds = np.concatenate([speeds, np.full_like(speeds, task.speed[0])])
    if last is not None:
        rates = np.concatenate([last.turn_rates[None], rates])
        speeds = np.concatenate([last.speeds[None], speeds])
    speeds = np.clip(speeds, *task.speed)
    return ramped(task, rates, speeds), speeds


@lru_cache(maxsize=8)
def _turns(stages: int) -> Float[np.ndarray, "K N"]:
    """Sequences of shares of the greatest turn rate.

    Straight on, then by pairs of mirror images, left first.
    """
    constant = np.linspace(1.0, -1.0, CONSTANT)[:, None] * np.ones(stages)
    some = np.linspace(1.0, -1.0, PAIRED)
    first = np.arange(stages) < stages // 2
    pairs = np.where(first, some[:, None, None], some[None, :, None])
    return np.concatenate([constant, pairs.reshape(-1, stages)])


def _searched(task: Task, violation: Violation | None) -> Float[np.ndarray, " N"]:
    """The beam search's turns, its stages being groups of the task's."""
    count = len(task.durations)
    groups = np.array_split(np.arange(count), min(LEVELS, count))
    found = search_manoeuvres(
        task.pose,
        task.covariance,
        tracks=_tracks(task, groups),
        process_noise=task.process_noise,
        weights=task.weights,
        stages=_stages(task, groups),
        turn_rates=turn_candidates(task.speed[1] / task.min_turn_radius, BRANCHES),
        speed=task.speed[1],
        ranging=task.ranging,
        beam_width=BEAM,
        violation=violation,
    )
    return np.repeat(found.x, [len(group) for group in groups])


def _stages(task: Task, groups: list[np.ndarray]) -> Stages:
    """Groups of stages, each taken as one."""
    duration = [task.durations[group].sum() for group in groups]
    pings = [task.pings[group].sum(axis=0) for group in groups]
    return Stages(np.array(duration), np.array(pings))


def _tracks(task: Task, groups: list[np.ndarray]) -> Tracks:
    """Where the AUVs are at the ends of groups of stages, and their mean velocities."""
    ends = np.array([group[-1] for group in groups])
    direction = np.stack([np.cos(task.headings), np.sin(task.headings)], axis=-1)
    velocity = task.speeds[..., None] * direction
    means = []
    for group in groups:
        means.append(np.average(velocity[group], axis=0, weights=task.durations[group]))
    east, north = np.moveaxis(np.stack(means), -1, 0)
    last = 2 * ends + 2
    return Tracks(
        task.positions[last],
        np.arctan2(north, east),
        np.hypot(east, north),
        task.heights[last],
    )
