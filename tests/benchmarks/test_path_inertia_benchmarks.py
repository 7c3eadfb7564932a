"""The radius decision by every route: one AUV, γ = 1, the same answer each time.

Times are recorded, never asserted; every result is checked. Compare within one run only, and without the shape checks of the tests:
``pytest tests/benchmarks/test_path_inertia_benchmarks.py -o addopts= --benchmark-sort=mean --benchmark-columns=min,median,rounds``.
"""

import itertools

import casadi as ca
import cvxpy as cp
import numpy as np
import osqp
import pytest
from scipy.sparse import csc_matrix

from formulations import PathInertiaProblem, lateral_offset, path_inertia_radius
from formulations.path_inertia.solvers import OSQP_SETTINGS

X1, X2, HEADING, GAMMA, MIN_RADIUS = 3.0, 1.0, 0.7, 1.0, 0.5
POSITION = np.array([[X1, X2]])
OFFSET = np.sin(HEADING) * X1 - np.cos(HEADING) * X2
RADIUS = OFFSET - 0.25  # γ = 1: a quarter metre off
EXACT, SOLVED = 1e-12, 1e-6 * RADIUS
decision = pytest.mark.benchmark(group="radius decision, 1 AUV")


@decision
def test_closed_form_of_floats(benchmark):
    radius, _ = benchmark(
        lambda: path_inertia_radius(lateral_offset(X1, X2, HEADING), GAMMA, MIN_RADIUS)
    )
    assert radius == pytest.approx(RADIUS, abs=EXACT)


@decision
def test_closed_form_of_arrays_of_one(benchmark):
    x1, x2, heading = np.array([X1]), np.array([X2]), np.array([HEADING])
    radius, _ = benchmark(
        lambda: path_inertia_radius(lateral_offset(x1, x2, heading), GAMMA, MIN_RADIUS)
    )
    assert radius == pytest.approx(RADIUS, abs=EXACT)


@decision
def test_closed_form_as_an_expression_through_its_buffer(benchmark):
    pose = ca.SX.sym("pose", 3)
    function = ca.Function(
        "radius",
        [pose],
        [path_inertia_radius(lateral_offset(pose[0], pose[1], pose[2]), GAMMA, MIN_RADIUS)[0]],
    )
    buffer, evaluate = function.buffer()
    given, result = np.array([X1, X2, HEADING]), np.zeros(1)
    buffer.set_arg(0, memoryview(given))
    buffer.set_res(0, memoryview(result))
    benchmark(evaluate)
    assert result[0] == pytest.approx(RADIUS, abs=EXACT)


@pytest.mark.benchmark(group="a million radius decisions")
def test_closed_form_of_a_million(benchmark):
    x1, x2, heading = np.full(10**6, X1), np.full(10**6, X2), np.full(10**6, HEADING)
    radius, _ = benchmark.pedantic(
        lambda: path_inertia_radius(lateral_offset(x1, x2, heading), GAMMA, MIN_RADIUS), rounds=5
    )
    np.testing.assert_allclose(radius, RADIUS, atol=EXACT)


@decision
@pytest.mark.parametrize(
    "solver", ["closed-form", "osqp", "clarabel", "cvxpy-osqp", "cvxpy-clarabel"]
)
def test_compiled_problem_certified(benchmark, solver):
    problem = PathInertiaProblem(min_radius=MIN_RADIUS, gamma=GAMMA, solver=solver)
    solution = benchmark(lambda: problem.solve(POSITION, HEADING))
    assert solution.x[0] == pytest.approx(RADIUS, abs=SOLVED)
    assert solution.duality_gap < 1e-9


@decision
def test_osqp_raw_update_and_solve(benchmark):
    """The least that OSQP itself can take, through its public interface: the program of this decision, its vectors handed over anew."""
    # deviation from the centre in units of the threshold: u ≤ t, −u − fold ≤ t, −2 ≤ u ≤ 2, u = y; the optimum is u = −1
    A = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [1.0, 0.0, 0.0], [1.0, -1.0, 0.0]])
    q, lower, upper = (
        np.array([0.0, 0.0, 1.0]),
        np.array([-np.inf, -np.inf, -2.0, 0.0]),
        np.array([0.0, 4.0, 2.0, 0.0]),
    )
    solver = osqp.OSQP()
    solver.setup(
        csc_matrix(np.diag([0.0, 1.0, 0.0])), q, csc_matrix(A), lower, upper, **OSQP_SETTINGS
    )

    def decide():
        solver.update(q=q, l=lower, u=upper)
        return OFFSET + 0.25 * solver.solve(raise_error=False).x[0]

    assert benchmark(decide) == pytest.approx(RADIUS, abs=SOLVED)


@decision
@pytest.mark.parametrize("solver", ["OSQP", "CLARABEL"])
def test_cvxpy_rebuilt_each_time(benchmark, solver):
    """What is to be avoided: the problem as one first writes it."""

    def decide():
        r = cp.Variable()
        cost = (1 + GAMMA) * (cp.square(r) - 2 * OFFSET * r) + GAMMA * cp.abs(r)
        cp.Problem(cp.Minimize(cost)).solve(solver=solver)
        return float(r.value)

    assert benchmark.pedantic(decide, rounds=30, warmup_rounds=2) == pytest.approx(
        RADIUS, abs=1e-3
    )  # at the solvers' own settings


@pytest.mark.benchmark(group="radius decision, changing from call to call")
@pytest.mark.parametrize("solver", ["closed-form", "osqp", "clarabel"])
@pytest.mark.parametrize("auvs", [1, 4, 16, 100])
def test_growth_with_auvs(benchmark, solver, auvs):
    rng = np.random.default_rng(1)
    problem = PathInertiaProblem(min_radius=MIN_RADIUS, gamma=GAMMA, solver=solver)
    cases = [(rng.normal(size=(auvs, 2)) * 5, float(heading)) for heading in rng.uniform(-3, 3, 50)]
    endless = itertools.cycle(cases)
    benchmark(lambda: problem.solve(*next(endless)))
    for positions, heading in cases:
        offset = float(lateral_offset(positions[:, 0], positions[:, 1], heading).mean())
        assert problem.solve(positions, heading).x[0] == pytest.approx(
            path_inertia_radius(offset, GAMMA, MIN_RADIUS)[0], abs=1e-5
        )
