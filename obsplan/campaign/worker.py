"""What a worker does: fly the missions of one batch, whatever becomes of each."""

import json
import threading
from functools import lru_cache
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

import obsplan
from obsplan.campaign.code import code_hash
from obsplan.plugins import in_words
from obsplan.run import Run
from obsplan.scenario import from_dict
from obsplan.simulation import ClosedLoop

CELLS_KEPT = 8  # compiled loops a worker keeps
# one mission at a time in a process, however many threads the worker was given
ALONE = threading.Lock()


class Outcome(NamedTuple):
    """One mission: its figures, or why there are none."""

    seed: int
    error: str | None
    figures: dict[str, float | None]  # over all AUVs
    auv: str  # the same of each, as JSON
    status_counts: str  # how often the planner gave each status, as JSON


class Flown(NamedTuple):
    """A batch: its outcomes, the time it took [s], and who flew it."""

    outcomes: list[Outcome]
    seconds: float
    version: str  # of obsplan
    code: str  # `code_hash`


class Batch(NamedTuple):
    """Seeds of one cell to fly together."""

    cell: int  # its number in the store
    content: str
    seeds: tuple[int, ...]
    compiled: bool


def fly_batch(batch: Batch) -> Flown:
    """Fly each mission of a batch; one that fails says why and the others go on."""
    with ALONE:
        began = perf_counter()
        outcomes = [fly_mission(batch, seed) for seed in batch.seeds]
        seconds = perf_counter() - began
        return Flown(outcomes, seconds, obsplan.__version__, code_hash())


def fly_mission(batch: Batch, seed: int) -> Outcome:
    """Fly one mission and keep its figures."""
    try:
        with np.errstate(all="ignore"):  # a filter that diverges is told from its estimates
            run = closed_loop(batch.content, batch.compiled).fly(seed)
            if reason := divergence(run):
                return failed(seed, reason)
            summary = run.summary(bounds=False)
    except Exception as error:  # whatever it is, it is the mission's result
        return failed(seed, in_words(error))
    return Outcome(seed, None, summary["all"], text(summary["auv"]), text(summary["status_counts"]))


def failed(seed: int, reason: str) -> Outcome:
    """The outcome of a mission that has no figures."""
    return Outcome(seed, " ".join(reason.split()), {}, "{}", "{}")


@lru_cache(CELLS_KEPT)
def closed_loop(content: str, compiled: bool) -> ClosedLoop:
    """The loop of a cell, built once."""
    scenario = from_dict(json.loads(content))
    return ClosedLoop(scenario=scenario, planner=scenario.team(), compiled=compiled)


def divergence(run: Run) -> str | None:
    """Say which filter diverged and when, or None if every estimate is finite."""
    finite = np.isfinite(run.mean).all(axis=2) & np.isfinite(run.covariance).all(axis=(2, 3))
    if finite.all():
        return None
    auv, sample = np.argwhere(~finite)[0]
    since = f"{run.time[sample]:g} s"
    return f"the filter diverged: the estimate of {run.names[auv]} is not finite from {since} on"


def text(value: Any) -> str:
    """JSON in one form only."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))
