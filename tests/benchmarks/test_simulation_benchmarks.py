"""How long a mission, a decision and the first word of the command line take.

Times are recorded, never asserted; every result is checked once. Run alone:
``pytest tests/benchmarks/test_simulation_benchmarks.py --benchmark-group-by=group --benchmark-sort=mean -n 0``.
"""

import subprocess
import sys
from time import perf_counter

import numpy as np
import pytest

import obsplan as op
from obsplan.planners import PLANNERS
from obsplan.simulation import ClosedLoop

SAMPLES = 3281
OPTIMISERS = ("trajectory", "whole-mission", "rolling")  # the costly planners
mission = pytest.mark.benchmark(group="survey-slow, 3281 samples", max_time=3.0)
beginning = pytest.mark.benchmark(
    group="first 300 steps of survey-slow, step already built", max_time=1.0
)
decision = pytest.mark.benchmark(group="one decision outside the step, 1 AUV")


def flown_whole(run, samples=SAMPLES):
    assert run.time.size == samples
    assert np.isfinite(run.cna).all()
    assert np.isfinite(run.mean).all()


@mission
def test_mission_with_the_gramian_planner_from_loading_to_the_run(benchmark):
    flown_whole(benchmark(lambda: op.simulate("survey-slow", planner="gramian")))


@mission
@pytest.mark.parametrize("compiled", [False, True], ids=["virtual-machine", "machine-code"])
def test_mission_on_a_step_already_built(benchmark, compiled):
    scenario = op.load("survey-slow", planner="gramian")
    loop = ClosedLoop(scenario=scenario, planner=scenario.planner(), compiled=compiled)
    loop.fly(0)
    flown_whole(benchmark(loop.fly, 1))


@beginning
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.costly if name in OPTIMISERS else ())
        for name in PLANNERS
    ],
)
def test_beginning_under_every_planner(benchmark, name):
    scenario = op.load("survey-slow", planner=name, settings=["duration=30.0"])
    loop = ClosedLoop(scenario=scenario, planner=scenario.planner())
    loop.fly(0)
    flown_whole(benchmark(loop.fly, 1), samples=301)


@decision
@pytest.mark.parametrize("name", PLANNERS)
def test_decision(benchmark, name):
    planner = op.load("survey-slow", planner=name, settings=["duration=30.0"]).planner()
    pose, auvs = (
        op.Pose(1.0, 0.0, np.pi / 2),
        [op.Belief.at(0.0, 0.0, speed=1.0, covariance=np.eye(4))],
    )
    assert np.isfinite(benchmark(planner.plan, pose, auvs).turn_rate)


@pytest.mark.benchmark(
    group="command line, wall time of a new process", min_rounds=3, max_time=2.0, timer=perf_counter
)
@pytest.mark.parametrize("words", [["--help"], ["scenarios"]], ids=" ".join)
def test_command_line(benchmark, words):
    command = [sys.executable, "-c", "from obsplan.cli import main; main()", *words]
    done = benchmark(subprocess.run, command, capture_output=True, text=True, check=True)
    assert done.stdout
