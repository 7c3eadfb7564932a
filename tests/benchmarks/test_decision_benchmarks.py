"""How long decisions of the default planner take while it flies each scenario of the suite, and a mission of harbor-survey.

In CPU time, recorded and never asserted; of decisions the middle one and the one in a hundred that takes longest. Run alone:
``pytest tests/benchmarks/test_decision_benchmarks.py -o addopts= --benchmark-only``.
"""

from time import process_time

import numpy as np
import pytest

import obsplan as op
from obsplan.campaign import plan_cells
from obsplan.campaign.worker import Batch, fly_batch
from obsplan.scenario import suite
from obsplan.simulation import ClosedLoop, loop

WORKS = "suite/one-lawnmower"  # which shows, where nothing is timed, that this runs
NAMES = [
    name if name == WORKS else pytest.param(name, marks=pytest.mark.costly)
    for name in suite("suite")
]
SEED = 3001
survey = pytest.mark.benchmark(
    group="one mission of harbor-survey under the default planner", timer=process_time
)


def built(scenario):
    return ClosedLoop(scenario=scenario, planner=scenario.team())


@pytest.mark.benchmark(group="decisions of the default planner", timer=process_time)
@pytest.mark.parametrize("name", NAMES)
def test_mission(benchmark, monkeypatch, name):
    monkeypatch.setattr(loop, "perf_counter", process_time)
    scenario = op.load(name)
    flight = built(scenario)
    flight.fly(SEED)
    run = benchmark.pedantic(flight.fly, args=(SEED,), rounds=1)
    middle, longest = np.percentile(run.timing.decision_seconds, [50, 99])
    benchmark.extra_info["seed"] = SEED
    benchmark.extra_info["decisions"] = {
        "AUVs": len(run.names),
        "decisions": len(run.timing.decision_seconds),
        "p50": middle,
        "p99": longest,
    }


@survey
def test_from_the_file_to_the_run(benchmark):
    benchmark.pedantic(op.simulate, args=("harbor-survey",), rounds=5)


@survey
def test_on_a_step_already_built(benchmark):
    flight = built(op.load("harbor-survey"))
    benchmark.pedantic(flight.fly, args=(SEED,), rounds=10, warmup_rounds=1)


@survey
def test_of_a_campaign_with_its_figures(benchmark):
    (cell,) = plan_cells(["harbor-survey"])
    batch = Batch(1, cell.content, (SEED,), True)
    benchmark.pedantic(fly_batch, args=(batch,), rounds=10, warmup_rounds=1)
