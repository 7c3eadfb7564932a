"""The gradient of a whole mission's mean variance: as machine code, in CasADi's virtual machine, and by CasADi's own differentiation.

The last is how one first writes it: a stage of all AUVs, folded over the mission, and its gradient. Times are recorded, never asserted;
the results are the same to the last bit. Compare within one run only:
``pytest tests/benchmarks/test_whole_mission_benchmarks.py -n 0 --benchmark-group-by=group --benchmark-columns=min,median``.
"""

import os
import time

import casadi as ca
import numpy as np
import pytest
from test_whole_mission import mission

from formulations.model import compiler, recursion
from formulations.whole_mission import covariance, search
from formulations.whole_mission.covariance import (
    PACKED,
    PredictedVariance,
    rows_of,
    stage_function,
)
from formulations.whole_mission.path import Turns
from formulations.whole_mission.search import Objective, descend


def by_casadi(problem):
    """The mean variance and its gradient as one Function, fed with what the sweeps are fed with."""
    fed, auvs = PredictedVariance(problem), len(problem.weights)
    forms = (problem.vehicles[0].ranging.form,)
    rows = rows_of(forms)
    P, total, x = ca.SX.sym("P", PACKED, auvs), ca.SX.sym("total"), ca.SX.sym("x", 2)
    told = ca.SX.sym("told", rows, auvs)
    stage, after, mean = stage_function(forms), [], total
    for i in range(auvs):
        end, share = stage(P[:, i], x, told[:, i])
        after.append(end)
        mean += share
    one = ca.Function("stage", [P, total, x, told], [ca.horzcat(*after), mean])
    count = len(problem.stages.end)
    first, path = ca.MX.sym("first", PACKED, auvs), ca.MX.sym("path", 2, count)
    of_stages = ca.MX.sym("of_stages", rows, auvs * count)
    sums = one.mapaccum("stages", count, 2)(first, 0, path, of_stages)[1]
    found = [sums[-1], ca.gradient(sums[-1], path)]
    function = ca.Function("variance", [path, first, of_stages], found)
    flat = np.moveaxis(fed._told, 0, 1).reshape(-1, rows).T
    begin, numbers = ca.DM(fed._first.T), ca.DM(flat)

    def evaluated(x):
        value, gradient = function(x[:, 0].T, begin, numbers)
        return float(value), gradient.full().T[:, None]

    return evaluated


@pytest.fixture
def road(request, monkeypatch):
    """How the sweeps are run: compiled at once, or never."""
    covariance.sweeps.cache_clear()
    monkeypatch.setattr(recursion, "BREAK_EVEN", -1)
    if request.param == "virtual machine":
        monkeypatch.setattr(compiler, "find_compiler", lambda: None)
    yield request.param
    covariance.sweeps.cache_clear()


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("auvs", [1, 4])
@pytest.mark.parametrize("road", ["machine code", "virtual machine", "CasADi's own"], indirect=True)
def test_gradient(benchmark, road, auvs):
    benchmark.group = f"gradient of 320 stages, {auvs} AUVs"
    problem = mission(steps=1600, auvs=auvs)
    x = np.random.default_rng(1).normal(0.0, 25.0, (len(problem.stages.end), 1, 2))
    rival = by_casadi(problem)
    asked = rival if road == "CasADi's own" else PredictedVariance(problem)
    value, gradient = benchmark(asked, x)
    expected_value, expected = rival(x)
    assert value == expected_value
    np.testing.assert_array_equal(gradient, expected)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("at", ["turns and ranges", "every sample"])
def test_objective(benchmark, at, monkeypatch):
    benchmark.group = "objective and gradient of a mission of 2400 steps, 4 AUVs"
    objective = Objective(Turns(mission(steps=2400, auvs=4, every=10), 8))
    w = np.random.default_rng(1).uniform(-0.3, 0.3, objective.turns.size)
    expected, _ = objective.penalised(w, 0.0)
    if at == "every sample":  # as limits need it
        monkeypatch.setitem(objective.__dict__, "samples", objective.turns.samples)
        objective.__dict__.pop("_ends")
    value, _ = benchmark(objective.penalised, w, 0.0)
    assert value == pytest.approx(expected, rel=1e-9)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("threads", ["one", "one for each processor"])
def test_descent(benchmark, threads, monkeypatch):
    benchmark.group = "descent of 30 iterations over 300 turns, threads of linear algebra"
    problem = mission(steps=1200, auvs=1, every=10)
    w = np.random.default_rng(1).uniform(-0.3, 0.3, 300)
    if threads != "one":
        many = search._linear_algebra()
        monkeypatch.setattr(
            search, "one_thread", lambda: many.limit(limits=os.cpu_count(), user_api="blas")
        )
    found = benchmark(descend, Objective(Turns(problem, 4)), w, 30)
    assert found.value > 0
