"""What more AUVs cost planners: source to compile, and time of a decision.

Times are recorded, never asserted, and are to be compared within one run:
``pytest tests/benchmarks/test_fleet_benchmarks.py -n 0 --benchmark-group-by=group``.
"""

import numpy as np
import pytest

import obsplan as op
from formulations.model.casadi import generate
from obsplan.planning.expressions import decision_function

SITUATION = op.Situation(op.Unicycle(speed=1.0, min_turn_radius=0.5))
POSE = op.Pose(1.0, 0.0, np.pi / 2)
EXPRESSIONS = {
    "gramian": op.GramianHorizon(SITUATION),
    "error-ellipse": op.ErrorEllipse(SITUATION),
    "path-inertia": op.PathInertia(SITUATION),
}
PLANNERS = EXPRESSIONS | {"default": op.InformationHorizon(SITUATION)}
TRUSTED = {op.Status.OPTIMAL, op.Status.CLIPPED}


def fleet(count):
    return [op.Belief.at(3.0 * i, 1.0, speed=0.5, covariance=np.eye(4)) for i in range(count)]


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_source_of_a_decision_is_hardly_longer_for_many_auvs(name):
    expression = EXPRESSIONS[name].expression
    cna = SITUATION.cna
    few, many = (len(generate(decision_function(expression, n, cna))) for n in (8, 64))
    assert many < 1.2 * few


@pytest.mark.parametrize("count", [1, 8, 64])
@pytest.mark.parametrize("name", PLANNERS)
def test_decision(name, count, benchmark):
    benchmark.group = f"one decision for 1 to 64 AUVs, {name}"
    decision = benchmark(PLANNERS[name].plan, POSE, fleet(count))
    assert decision.status in TRUSTED
