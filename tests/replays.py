"""Recordings for tests: simulated missions as tapes, with what a filter is said to have made of them."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np

import obsplan as op
from obsplan.fates import Fate
from obsplan.replay.estimates import Estimates
from obsplan.replay.result import run_of

BEGAN = datetime(2025, 6, 1, 23, 59, 58, tzinfo=UTC)
MISSION = {
    "name": "trial",
    "origin": {"lat": 47.6, "lon": -122.3},
    "duration": 120.0,
    "cna": {"speed": 2.0, "min_turn_radius": 5.0, "start": {"x": 0.0, "y": -30.0}},
    "auv": [
        {"name": "a", "survey": {"kind": "waypoints", "points": [[0, 0], [200, 0]]}, "speed": 1.0},
        {
            "name": "b",
            "survey": {"kind": "waypoints", "points": [[0, 40], [200, 40]]},
            "speed": 1.2,
        },
    ],
    "ranging": {"interval": 4.0, "sigma": 1.0},
    "planner": {"kind": "circle"},
}
NODES = [{"name": "n1", "x": -20.0, "y": 10.0}, {"name": "n2", "x": 90.0, "y": 70.0}]


@dataclass
class Replayed:
    simulated: op.Run
    tape: op.Tape
    estimates: Estimates
    smoothed: SimpleNamespace

    def run(self, truth=True, **changes):
        tape = self.tape if truth else replace(self.tape, truth=None)
        scenario = self.simulated.scenario
        return run_of(
            tape,
            scenario,
            replace(self.estimates, **changes),
            smoothed=self.smoothed,
            began=BEGAN,
            seconds=1.0,
        )


def replayed(**changes):
    """A mission's own estimates as a replay's, with innovations whose NIS is 1 for each AUV."""
    simulated = op.simulate(op.from_dict(MISSION | changes), seed=3)
    tape = op.to_tape(simulated)
    random, count = np.random.default_rng(7), tape.measurements.value.size
    variance, drawn = random.uniform(1.0, 4.0, count), random.normal(size=count)
    for auv in range(len(tape.auvs)):
        own = tape.measurements.auv == auv
        drawn[own] /= np.sqrt(np.mean(drawn[own] ** 2))
    estimates = Estimates(
        time=tape.time,
        mean=simulated.mean,
        covariance=simulated.covariance,
        fate=np.full(count, Fate.ACCEPTED.value),
        innovation=np.sqrt(variance) * drawn,
        innovation_variance=variance,
        hypotheses=np.ones(simulated.mean.shape[:2]),
    )
    smoothed = SimpleNamespace(
        mean=tape.truth + 0.25, covariance=0.1 * simulated.covariance[..., :2, :2], words=()
    )
    return Replayed(simulated, tape, estimates, smoothed)
