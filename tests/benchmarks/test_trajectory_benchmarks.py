"""A decision of twenty turns among limits: fatrop from the last trajectory, fatrop from several manoeuvres, IPOPT from the best one.

Times are recorded, never asserted; every result is checked. Programs are built before, and the processor's time is counted. Compare
within one run only, and without the shape checks of the tests:
``pytest tests/benchmarks/test_trajectory_benchmarks.py -o addopts= --benchmark-sort=mean --benchmark-columns=min,median,rounds``.
"""

import itertools
import math
import time

import numpy as np
import pytest

import obsplan as op
from formulations.solution import Status
from formulations.trajectory import search
from obsplan.constraints import Constraints, Disc

STEP, DECISIONS = 0.25, 20
CNA = op.Unicycle(speed=1.0, min_turn_radius=0.5)
LIMITS = Constraints(
    keep_out=(Disc(x=2.5, y=1.0, radius=1.0),), max_separation=11.0
)  # 8 m, and three standard deviations of the AUVs
BY = {
    "fatrop, warm": {Status.OPTIMAL, Status.RESTARTED},
    "fatrop, cold": {Status.OPTIMAL},
    "IPOPT, cold": {Status.SECOND_SOLVER, Status.BEST_MANOEUVRE},  # now and then it fails
}


def fleet(count, speed):
    """AUVs within two metres of the origin."""
    places = np.random.default_rng(1).uniform(-2, 2, (count, 2))
    covariance = np.diag([1.0, 1.0, 0.01, 0.01])
    return [
        op.Belief.at(*map(float, place), heading=0.3, speed=speed, covariance=covariance)
        for place in places
    ]


def planner(objective):
    situation = op.Situation(CNA, ping_interval=STEP, decision_interval=STEP, constraints=LIMITS)
    return op.Trajectory(situation, horizon=5.0, stages=20, objective=objective)


def flown(asked, auvs):
    """Poses and times of successive decisions, and what the planner then remembered of the one before."""
    pose, met = op.Pose(4.0, -3.0, 0.7), []
    for k in range(DECISIONS):
        last = dict(asked._memory)
        decision = asked.plan(pose, auvs, time=k * STEP)
        met.append((pose, k * STEP, last))
        half = 0.5 * decision.turn_rate * STEP
        chord = decision.speed * STEP * float(np.sinc(half / np.pi))
        x, y = (
            pose.x + chord * math.cos(pose.heading + half),
            pose.y + chord * math.sin(pose.heading + half),
        )
        pose = op.Pose(x, y, pose.heading + 2 * half, decision.turn_rate)
    return met[1:]


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("by", BY)
@pytest.mark.parametrize(
    ("objective", "count"),
    [
        ("log-det", 1),
        pytest.param("log-det", 16, marks=pytest.mark.costly),
        ("covariance", 1),
        pytest.param("covariance", 4, marks=pytest.mark.costly),
    ],
)
def test_decision(benchmark, monkeypatch, objective, count, by):
    benchmark.group = f"{objective}, {count} AUV{'s' * (count > 1)}"
    auvs, asked = fleet(count, speed=0.0), planner(objective)
    met = flown(asked, auvs)
    if by == "IPOPT, cold":
        monkeypatch.setattr(
            search,
            "_attempts",
            lambda _tried, k, _best, **_: [search.Attempt([k], "ipopt", Status.SECOND_SOLVER)],
        )
    endless = itertools.cycle(met)

    def decide():
        pose, now, last = next(endless)
        asked._memory.clear()
        asked._memory.update(last if by == "fatrop, warm" else {})
        return asked.plan(pose, auvs, time=now)

    asked.build(met[0][0], auvs)
    decide()  # at the first, no solver converges from afar
    said = benchmark.pedantic(decide, rounds=2 * DECISIONS).status
    assert said in BY[by]
