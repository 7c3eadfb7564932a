"""The reference decision: of 21 turn rates held for two thirds of the smallest circle, which gives the best-conditioned Gramian?

Times are recorded, never asserted; every result is checked once. Compare within one run only:
``pytest tests/benchmarks/test_gramian_benchmarks.py --benchmark-group-by=group --benchmark-sort=mean``.
"""

import casadi as ca
import numpy as np
import pytest

from formulations.gramian.range import displacement_moments, range_gramian_function, range_gramians
from formulations.metrics import condition_number

SPEED, HORIZON, LIMIT = 1.0, 2 * np.pi / 3, 2.0
POSE = np.array([1.0, 0.0, np.pi / 2])
BEST_RATE, BEST_CONDITION = 1.4, 8.879  # by the continuous integral
SAMPLES, STEP = 21, 0.1  # of the peers, whose time integral is a left Riemann sum
decision = pytest.mark.benchmark(group="reference decision, 21 turn rates, 1 AUV")


def rates(count):
    return np.linspace(-LIMIT, LIMIT, count)


def auvs_around(count):
    """The AUV of the reference decision, and more on a grid of 3 m about it."""
    side = int(np.ceil(np.sqrt(count)))
    grid = (
        3.0
        * np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)[:count]
    )
    return np.ascontiguousarray(grid)


def function_decision(count, auvs):
    """Return the decision by one CasADi Function read through its buffer: mean condition number, argmin."""
    moments = displacement_moments(SPEED, rates(count), HORIZON)
    function = range_gramian_function(len(auvs), moments=moments)
    buffer, evaluate = function.buffer()
    positions, scores = np.ascontiguousarray(auvs.T), np.zeros((len(auvs), count))
    buffer.set_arg(0, memoryview(POSE))
    buffer.set_arg(1, memoryview(positions))
    buffer.set_res(0, memoryview(scores))

    def decide():
        evaluate()
        return scores[0] if len(auvs) == 1 else scores.mean(axis=0)

    decide.keeps_alive = (function, buffer, positions)  # the buffer holds bare addresses of them
    return decide


@decision
def test_closed_form_through_one_function(benchmark):
    scores = benchmark(function_decision(21, auvs_around(1)))
    assert rates(21)[np.argmin(scores)] == pytest.approx(BEST_RATE)
    assert scores.min() == pytest.approx(BEST_CONDITION, abs=5e-4)


@decision
def test_closed_form_in_numpy(benchmark):
    auvs = auvs_around(1)

    def decide():
        return condition_number(
            range_gramians(
                POSE[:2] - auvs, POSE[2], turn_rates=rates(21), speed=SPEED, horizon=HORIZON
            )
        )[:, 0]

    scores = benchmark(decide)
    assert rates(21)[np.argmin(scores)] == pytest.approx(BEST_RATE)
    assert scores.min() == pytest.approx(BEST_CONDITION, abs=5e-4)


def check_peer(scores):
    """A left Riemann sum at 0.1 s finds the same turn rate, its condition number within the rule's 5 %."""
    assert rates(21)[np.argmin(scores)] == pytest.approx(BEST_RATE)
    assert np.min(scores) == pytest.approx(BEST_CONDITION, rel=0.05)


def unicycle(x, u):
    return np.array([SPEED * np.cos(x[2]), SPEED * np.sin(x[2]), u])


def runge_kutta_outputs(x0, u):
    """Simulate as one would by hand, one step after the other."""
    x, outputs = np.array(x0, dtype=float), []
    for _ in range(SAMPLES):
        outputs.append([x[2], x[0] ** 2 + x[1] ** 2])
        k1 = unicycle(x, u)
        k2 = unicycle(x + STEP / 2 * k1, u)
        k3 = unicycle(x + STEP / 2 * k2, u)
        k4 = unicycle(x + STEP * k3, u)
        x = x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(outputs)


@decision
def test_plain_numpy_loop(benchmark):
    eps = 1e-4

    def decide():
        scores = []
        for u in rates(21):
            d = [
                (runge_kutta_outputs(POSE + eps * e, u) - runge_kutta_outputs(POSE - eps * e, u))
                / (2 * eps)
                for e in np.eye(3)
            ]
            W = np.array([[STEP * np.sum(d[i] * d[j]) for j in range(3)] for i in range(3)])
            scores.append(np.linalg.cond(W))
        return scores

    check_peer(benchmark(decide))


class NumpySimulator:
    """A simulator of our own in the form that pybounds takes."""

    state_names, measurement_names = ("x", "y", "heading"), ("heading", "squared range")

    def simulate(self, x0, u, aux=None):
        return runge_kutta_outputs(x0, u[0, 0])


def pybounds_decision(simulator):
    pybounds = pytest.importorskip("pybounds")
    scores = []
    for u in rates(21):
        J = pybounds.EmpiricalObservabilityMatrix(
            simulator, POSE, np.full((SAMPLES, 1), u), eps=1e-4
        ).O
        scores.append(np.linalg.cond(STEP * J.T @ J))
    return scores


@decision
def test_pybounds_with_a_numpy_simulator(benchmark):
    check_peer(
        benchmark.pedantic(pybounds_decision, args=(NumpySimulator(),), rounds=3, warmup_rounds=1)
    )


@decision
@pytest.mark.slow
def test_pybounds_as_documented(benchmark):
    pybounds = pytest.importorskip("pybounds")
    simulator = pybounds.Simulator(
        lambda x, u: [SPEED * ca.cos(x[2]), SPEED * ca.sin(x[2]), u[0]],
        lambda x, _: [x[2], x[0] ** 2 + x[1] ** 2],
        dt=STEP,
        state_names=["x", "y", "heading"],
        input_names=["turn_rate"],
        measurement_names=["heading", "squared range"],
    )
    check_peer(benchmark.pedantic(pybounds_decision, args=(simulator,), rounds=1))


def check_against_numpy(scores, count, auvs):
    W = range_gramians(
        POSE[:2] - auvs, POSE[2], turn_rates=rates(count), speed=SPEED, horizon=HORIZON
    )
    np.testing.assert_allclose(scores, condition_number(W).mean(axis=-1), rtol=1e-7)


@pytest.mark.benchmark(group="closed form, growth with candidates, 1 AUV")
@pytest.mark.parametrize("count", [21, 201])
def test_growth_with_candidates(benchmark, count):
    check_against_numpy(benchmark(function_decision(count, auvs_around(1))), count, auvs_around(1))


@pytest.mark.benchmark(group="closed form, growth with AUVs, 21 candidates")
@pytest.mark.parametrize("n_auvs", [1, 4, 16, 100])
def test_growth_with_auvs(benchmark, n_auvs):
    auvs = auvs_around(n_auvs)
    check_against_numpy(benchmark(function_decision(21, auvs)), 21, auvs)
