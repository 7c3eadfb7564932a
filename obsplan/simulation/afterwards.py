"""Where the AUVs of a mission were by all that they measured in it, before and after."""

from dataclasses import replace

import numpy as np

from obsplan.run import Run
from obsplan.scenario import Scenario
from obsplan.simulation.taped import to_tape
from obsplan.smoothing import Smoothed, smooth
from obsplan.tape import Measurements, Tape
from obsplan.types import UNCOMPUTABLE, ObsplanError, uncomputable

MOST = 100_000  # samples of all AUVs together: some ten seconds, and half a gigabyte


def with_smoothed(run: Run) -> tuple[Run, tuple[str, ...]]:
    """The run with smoothed tracks, and in words what is to be known of them.

    Each AUV is smoothed alone: in a simulation none ranges to another. Where that is too much work
    or cannot be done, the run is as it was, and the words say why.
    """
    samples = run.mean.shape[0] * run.time.size
    if samples > MOST:
        return run, (
            f"Tracks are not smoothed: that is done up to {MOST} samples, and there are {samples}; "
            "obsplan.smooth does it.",
        )
    try:
        tape = to_tape(run)
        found = [_of_one(run, tape, i) for i in range(len(run.names))]
    except ObsplanError as error:
        return run, (f"Tracks are not smoothed: {error}.",)
    except UNCOMPUTABLE as error:
        return run, (f"Tracks are not smoothed: {uncomputable(error)}.",)
    mean = np.concatenate([one.mean[..., :2] for one in found])
    covariance = np.concatenate([one.covariance for one in found])
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
        return run, ("Tracks are not smoothed: what the smoother finds is no number.",)
    words = [
        f"Smoother of {name}: {said}."
        for name, one in zip(run.names, found, strict=True)
        for said in one.words
    ]
    return replace(run, smoothed=mean, smoothed_covariance=covariance), tuple(words)


def _of_one(run: Run, tape: Tape, i: int) -> Smoothed:
    """An AUV's track."""
    return smooth(tape_of(tape, i), alone(run.scenario, i), start=run.mean[i : i + 1])


def alone(scenario: Scenario, i: int) -> Scenario:
    """The scenario of one of its AUVs."""
    table = scenario.table.model_copy(update={"auv": [scenario.table.auv[i]]})
    return replace(scenario, table=table)


def tape_of(tape: Tape, i: int) -> Tape:
    """What one AUV moved and measured."""
    own = slice(i, i + 1)
    mine = tape.measurements.auv == i
    rows = Measurements(*(column[mine] for column in tape.measurements))
    return replace(
        tape,
        auvs=tape.auvs[own],
        turn=tape.turn[own],
        change_of_speed=tape.change_of_speed[own],
        sway=tape.sway[own],
        heading=tape.heading[own],
        depth=tape.depth[own],
        measurements=rows._replace(auv=np.zeros_like(rows.auv)),
        truth=None if tape.truth is None else tape.truth[own],
    )
