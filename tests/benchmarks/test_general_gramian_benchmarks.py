"""The reference decision by Gramians that know nothing of the model, beside what one would write or install instead.

21 turn rates, 21 samples at 0.1 s, left Riemann sum; condition number, argmin. Times are recorded, never asserted; every result is checked
once. Compare within one run only, without the shape checks of the test settings:
``pytest -o addopts='' tests/benchmarks/test_general_gramian_benchmarks.py --benchmark-group-by=group --benchmark-sort=mean``.
"""

import warnings

import casadi as ca
import numpy as np
import pytest

import obsplan as op
from formulations import (
    SimulatedGramian,
    choose_input,
    condition_number,
    empirical_gramian,
    exact_gramian,
)

POSE, HORIZON = np.array([1.0, 0.0, np.pi / 2]), 2.1
RATES = np.linspace(-2.0, 2.0, 21)
BEST_RATE, BEST_CONDITION = 1.4, 8.879  # by the continuous integral over 2π/3
EPSILON = 1e-4  # of central differences
decision = pytest.mark.benchmark(group="reference decision, 21 rates, 21 steps")
planned = pytest.mark.benchmark(group="one decision of any model, 21 rates, 1 AUV")
growth = pytest.mark.benchmark(group="growth with steps, 21 rates")


def check(scores, steps=21):
    """A left Riemann sum finds the best of 21 turn rates (of 201, one near it), its κ within the rule's 5 % at 21 steps."""
    rates = np.linspace(-2.0, 2.0, len(scores))
    assert rates[np.argmin(scores)] == pytest.approx(
        BEST_RATE, abs=1e-9 if len(scores) == len(RATES) else 0.1
    )
    assert np.min(scores) == pytest.approx(BEST_CONDITION, rel=0.05 if steps == 21 else 0.01)


# --- exact --------------------------------------------------------------------------------------------------------------------------


def compiled(steps):
    def f(t, x, u, p):  # noqa: ARG001
        return ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), u)

    def h(t, x, u, p):  # noqa: ARG001
        return ca.vertcat(x[2], x[0] ** 2 + x[1] ** 2)

    return exact_gramian(f, h, n=3, m=1, steps=steps, rule="left")


def exact_decision(gramian, rates=RATES):
    return condition_number(gramian(POSE, rates[:, None, None], horizon=HORIZON))


@decision
def test_exact(benchmark):
    check(benchmark(exact_decision, compiled(21)))


@decision
def test_exact_one_rate_at_a_time(benchmark):
    gramian = compiled(21)
    check(
        benchmark(
            lambda: [
                condition_number(gramian(POSE, np.full((1, 1), u), horizon=HORIZON)) for u in RATES
            ]
        )
    )


@decision
def test_exact_compiled_for_the_occasion(benchmark):
    check(benchmark(lambda: exact_decision(compiled(21))))


@growth
@pytest.mark.parametrize("steps", [21, 100, 1000])
def test_growth_of_exact(benchmark, steps):
    check(benchmark(exact_decision, compiled(steps)), steps)


@pytest.mark.benchmark(group="growth with rates, 21 steps")
@pytest.mark.parametrize("rates", [21, 201])
def test_growth_of_exact_with_rates(benchmark, rates):
    check(benchmark(exact_decision, compiled(21), np.linspace(-2.0, 2.0, rates)))


# --- a planner of any model, beside the one that knows its unicycle -----------------------------------------------------------------


PLANNER = op.GramianHorizon(op.Situation(op.Unicycle(speed=1.0, min_turn_radius=0.5)))


def range_to(t, x, u, p):  # noqa: ARG001
    return [x[2], (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2]


def check_choice(choice):
    assert choice.x[0] == pytest.approx(BEST_RATE, abs=1e-9)
    assert choice.objective == pytest.approx(BEST_CONDITION, abs=5e-4)


def choose(gramian):
    return choose_input(gramian, POSE, PLANNER.candidates, horizon=PLANNER.look_ahead, p=[0.0, 0.0])


@planned
def test_planner_in_closed_form(benchmark):
    decision = benchmark(PLANNER.plan, op.Pose(*POSE), [op.Belief.at(0.0, 0.0)])
    assert decision.turn_rate == pytest.approx(BEST_RATE, abs=1e-9)


@planned
@pytest.mark.parametrize("steps", [50, 400])  # agree with it to 1e-6 and to 1e-9
def test_choice_by_an_exact_gramian(benchmark, steps):
    gramian = exact_gramian(
        lambda x, u: ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), u),
        lambda t, x, u, p: ca.vertcat(*range_to(t, x, u, p)),
        n=3,
        m=1,
        q=2,
        steps=steps,
    )
    check_choice(benchmark(choose, gramian))


@planned
def test_choice_by_a_simulated_gramian_in_numpy(benchmark):
    gramian = SimulatedGramian(f=lambda x, u: unicycle(x, u[0]), h=range_to, steps=50)
    check_choice(benchmark.pedantic(choose, args=(gramian,), rounds=3, warmup_rounds=1))


# --- empirical ----------------------------------------------------------------------------------------------------------------------


def simulate(x0, rates, steps):
    """Runge-Kutta for all rates at once, in numpy: outputs (rates, samples, 2)."""
    dt = HORIZON / steps
    x, outputs = np.tile(x0, (len(rates), 1)), []

    def rate(x):
        return np.stack([np.cos(x[:, 2]), np.sin(x[:, 2]), rates], axis=1)

    for _ in range(steps):
        outputs.append(np.stack([x[:, 2], x[:, 0] ** 2 + x[:, 1] ** 2], axis=1))
        k1 = rate(x)
        k2 = rate(x + dt / 2 * k1)
        k3 = rate(x + dt / 2 * k2)
        k4 = rate(x + dt * k3)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    outputs.append(np.stack([x[:, 2], x[:, 0] ** 2 + x[:, 1] ** 2], axis=1))
    return np.stack(outputs, axis=1)


def empirical_decision(simulator):
    return condition_number(
        empirical_gramian(simulator, POSE, horizon=HORIZON, epsilon=EPSILON, rule="left")
    )


@decision
def test_empirical_of_all_rates_at_once(benchmark):
    check(benchmark(empirical_decision, lambda x0: simulate(x0, RATES, 21)))


@growth
@pytest.mark.parametrize("steps", [21, 100, 1000])
def test_growth_of_empirical(benchmark, steps):
    check(benchmark(empirical_decision, lambda x0: simulate(x0, RATES, steps)), steps)


@decision
def test_empirical_of_a_plain_simulator_one_rate_at_a_time(benchmark):
    def decide():
        return [
            empirical_decision(lambda x0, u=u: plain_outputs(x0, u, 21, last=True)) for u in RATES
        ]

    check(benchmark(decide))


# --- what one would write or install ------------------------------------------------------------------------------------------------


def unicycle(x, u):
    return np.array([np.cos(x[2]), np.sin(x[2]), u])


def plain_outputs(x0, u, steps, last=False):
    """Simulate as one would by hand, one step after the other."""
    dt = HORIZON / steps
    x, outputs = np.array(x0, dtype=float), []
    for _ in range(steps):
        outputs.append([x[2], x[0] ** 2 + x[1] ** 2])
        k1 = unicycle(x, u)
        k2 = unicycle(x + dt / 2 * k1, u)
        k3 = unicycle(x + dt / 2 * k2, u)
        k4 = unicycle(x + dt * k3, u)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array([*outputs, [x[2], x[0] ** 2 + x[1] ** 2]] if last else outputs)


def plain_decision(steps):
    scores = []
    for u in RATES:
        d = [
            (
                plain_outputs(POSE + EPSILON * e, u, steps)
                - plain_outputs(POSE - EPSILON * e, u, steps)
            )
            / (2 * EPSILON)
            for e in np.eye(3)
        ]
        W = np.array([[HORIZON / steps * np.sum(d[i] * d[j]) for j in range(3)] for i in range(3)])
        scores.append(np.linalg.cond(W))
    return scores


@decision
def test_plain_numpy_loop(benchmark):
    check(benchmark(plain_decision, 21))


@growth
@pytest.mark.slow
@pytest.mark.parametrize("steps", [21, 100, 1000])
def test_growth_of_plain_numpy_loop(benchmark, steps):
    check(benchmark.pedantic(plain_decision, args=(steps,), rounds=2), steps)


class PlainSimulator:
    """The same loop in the form that pybounds takes."""

    def simulate(self, x0, u, aux=None):
        return plain_outputs(x0, u[0, 0], len(u))


@decision
def test_pybounds_with_a_plain_simulator(benchmark):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # do_mpc, which it imports, warns of parts not installed
        import pybounds

    def decide():
        scores = []
        for u in RATES:
            J = pybounds.EmpiricalObservabilityMatrix(
                PlainSimulator(), POSE, np.full((21, 1), u), eps=EPSILON
            ).O
            scores.append(np.linalg.cond(HORIZON / 21 * J.T @ J))
        return scores

    check(benchmark.pedantic(decide, rounds=3, warmup_rounds=1))
