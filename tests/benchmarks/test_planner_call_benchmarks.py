"""What a public `plan()` costs beside the mathematics in it: the planner's bare Function.

The bare Function is evaluated in two ways: as CasADi does when it is called with numbers, and by a
buffer that was prepared beforehand, the least there is. Times are recorded, never asserted; compare
within one run only:
``pytest tests/benchmarks/test_planner_call_benchmarks.py -o addopts= --benchmark-group-by=group``.
"""

import numpy as np
import pytest

import obsplan as op
from obsplan.planning.expressions import compiled, fill

SITUATION = op.Situation(op.Unicycle(speed=1.0, min_turn_radius=0.5))
POSE = op.Pose(1.0, 0.0, np.pi / 2)
AUVS = [op.Belief.at(0.0, 0.0, covariance=np.eye(4))]
CLOSED = {
    "path-inertia": op.PathInertia(SITUATION),
    "circle": op.Circle(SITUATION, center=(0.0, 0.0), radius=3.0),
    "centroid-orbit": op.CentroidOrbit(SITUATION),
    "trail": op.Trail(SITUATION),
    "error-ellipse": op.ErrorEllipse(SITUATION),
    "gramian": op.GramianHorizon(SITUATION),
}
INFORMATION = op.InformationHorizon(SITUATION)


def prepared(planner):
    """The planner's Function with its input filled."""
    call = compiled(planner, len(AUVS))
    fill(call.given, POSE, AUVS, 0.0)
    return call


@pytest.mark.parametrize("name", CLOSED)
def test_public_plan(name, benchmark):
    benchmark.group = f"one decision of `{name}`, public plan and its bare Function"
    decision = benchmark(CLOSED[name].plan, POSE, AUVS)
    assert np.isfinite([decision.turn_rate, decision.speed]).all()


@pytest.mark.parametrize("name", CLOSED)
def test_bare_function_by_a_prepared_buffer(name, benchmark):
    benchmark.group = f"one decision of `{name}`, public plan and its bare Function"
    result = benchmark(prepared(CLOSED[name]))
    assert result[0] == CLOSED[name].plan(POSE, AUVS).turn_rate


@pytest.mark.parametrize("name", CLOSED)
def test_bare_function_called_with_numbers(name, benchmark):
    benchmark.group = f"one decision of `{name}`, public plan and its bare Function"
    call = prepared(CLOSED[name])
    result = benchmark(call.function, call.given)
    assert float(result[0]) == CLOSED[name].plan(POSE, AUVS).turn_rate


def test_public_plan_of_the_default_planner(benchmark):
    benchmark.group = "one decision of `information`, 1 AUV"
    decision = benchmark(INFORMATION.plan, POSE, AUVS)
    assert decision.status is op.Status.OPTIMAL
