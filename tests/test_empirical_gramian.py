import warnings

import casadi as ca
import numpy as np
import pytest
from gramian_oracles import arc_jacobian, arc_outputs, slope, squared_range, unicycle

from formulations import empirical_gramian, exact_gramian, quadrature_weights

X0, RATE, T = np.array([1.0, 0.5, 0.4]), 0.8, 2.0
TIMES = np.linspace(0, T, 21)
RULES = ("left", "trapezoid", "simpson", "sum")


def simulate(x0):
    return arc_outputs(x0, RATE, TIMES)


def analytic(rule="simpson", R=None):
    """The same weighted sum of samples, of analytic Jacobians."""
    J, weight = arc_jacobian(X0, RATE, TIMES), np.eye(2) if R is None else np.linalg.inv(R)
    return np.einsum("t,tai,ab,tbj->ij", quadrature_weights(21, T, rule), J, weight, J)


@pytest.mark.parametrize("rule", RULES)
def test_empirical_and_exact_agree_entry_by_entry_under_every_rule_and_noise(rule):
    R = np.array([[0.01, 0.02], [0.02, 0.25]])
    exact = exact_gramian(unicycle, squared_range, n=3, m=1, steps=20, substeps=20, rule=rule)
    W = empirical_gramian(simulate, X0, horizon=T, rule=rule, R=R)
    np.testing.assert_allclose(
        W, analytic(rule, R), rtol=1e-8
    )  # eps/epsilon = 2e-11, times the condition of the whitening
    np.testing.assert_allclose(
        W, exact(X0, np.full((1, 1), RATE), horizon=T, R=R), rtol=1e-8
    )  # (0.1/20)^4 / 120 = 5e-12


def test_error_falls_with_the_square_of_the_displacement():
    epsilons = np.array([1e-1, 3e-2, 1e-2, 3e-3])
    errors = [
        np.abs(empirical_gramian(simulate, X0, horizon=T, epsilon=e) - analytic()).max()
        for e in epsilons
    ]
    assert slope(epsilons, errors) == pytest.approx(2, abs=0.05)


def test_rounding_grows_as_one_over_the_displacement():
    epsilons = np.logspace(-9, -7, 20)
    errors = [
        np.abs(empirical_gramian(simulate, X0, horizon=T, epsilon=e) - analytic()).max()
        for e in epsilons
    ]
    assert slope(epsilons, errors) == pytest.approx(
        -1, abs=0.35
    )  # of twenty noisy points over two decades


def test_noise_of_the_simulator_adds_its_variance_over_the_displacement_squared():
    noise, epsilon, samples = (
        1e-6,
        1e-8,
        2001,
    )  # an adaptive integrator's tolerance, and a displacement far below it
    rng = np.random.default_rng(5)
    W = empirical_gramian(
        lambda x0: x0[:1] + noise * rng.normal(size=(samples, 1)),
        np.zeros(1),
        horizon=1.0,
        epsilon=epsilon,
        rule="trapezoid",
    )
    bias = noise**2 / (2 * epsilon**2)  # variance of the difference of two, over (2 epsilon)²
    assert W[0, 0] == pytest.approx(
        1 + bias, rel=4 * np.sqrt(2 / samples)
    )  # four standard errors of a variance


@pytest.mark.parametrize("epsilon", [1e-3, 1.0, 100.0])
def test_position_displacements_are_exact_at_any_size(epsilon):
    W = empirical_gramian(simulate, X0, horizon=T, epsilon=np.array([epsilon, epsilon, 1e-5]))
    np.testing.assert_allclose(
        W[:2, :2], analytic()[:2, :2], rtol=1e-11
    )  # squared range is quadratic in position


def test_each_state_has_its_own_displacement():
    scaled = np.array([1.0, 1e3, 1.0])  # north in millimetres
    W = empirical_gramian(
        lambda z: simulate(z / scaled), X0 * scaled, horizon=T, epsilon=1e-5 * scaled
    )
    np.testing.assert_allclose(
        W * np.outer(scaled, scaled),
        empirical_gramian(simulate, X0, horizon=T, epsilon=1e-5),
        rtol=1e-9,
    )


def test_casadi_function_and_plain_python_give_the_same():
    x = ca.SX.sym("x", 3)
    half = RATE * TIMES / 2
    chord = TIMES * np.sinc(half / np.pi)
    east, north = (
        x[i] + ca.DM(chord) * trig(x[2] + ca.DM(half)) for i, trig in enumerate((ca.cos, ca.sin))
    )
    function = ca.Function(
        "simulate", [x], [ca.horzcat(x[2] + ca.DM(2 * half), east**2 + north**2)]
    )
    np.testing.assert_allclose(
        empirical_gramian(function, X0, horizon=T),
        empirical_gramian(simulate, X0, horizon=T),
        rtol=1e-9,
    )  # rounding 2e-16 over 1e-5


def test_many_controls_in_one_simulation_are_many_gramians():
    rates = np.linspace(-2, 2, 5)
    W = empirical_gramian(
        lambda x0: arc_outputs(np.broadcast_to(x0, (5, 3)), rates, TIMES), X0, horizon=T
    )
    for k, rate in enumerate(rates):
        one = empirical_gramian(lambda x0, rate=rate: arc_outputs(x0, rate, TIMES), X0, horizon=T)
        np.testing.assert_allclose(W[k], one, rtol=1e-9)


class Arcs:
    """A simulator as pybounds wants it."""

    def simulate(self, x0, u, aux=None, **_):
        return arc_outputs(np.asarray(x0, dtype=float), RATE, TIMES)


@pytest.mark.slow
def test_sum_rule_is_the_gramian_of_the_observability_matrix_of_pybounds():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # do_mpc, which it imports, warns of parts not installed
        import pybounds
    O = pybounds.EmpiricalObservabilityMatrix(Arcs(), X0, np.full((21, 1), RATE), eps=1e-5).O  # noqa: E741
    np.testing.assert_allclose(
        empirical_gramian(simulate, X0, horizon=T, rule="sum"), O.T @ O, rtol=1e-12
    )
    F = exact_gramian(unicycle, squared_range, n=3, m=1, steps=20, substeps=40, rule="sum").factor(
        X0, np.full((1, 1), RATE), horizon=T
    )
    np.testing.assert_allclose(F, O, atol=1e-9)  # (dt/40)^4 = 4e-11; their epsilon² = 1e-10


def test_output_that_is_not_finite_gives_nan():
    assert np.isnan(
        empirical_gramian(lambda x0: np.nan * x0[:, None] + np.full((3, 1), np.nan), X0, horizon=T)
    ).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"epsilon": 0.0}, "epsilon must be positive, got 0.0"),
        ({"epsilon": np.array([1e-5, np.nan, 1e-5])}, "epsilon must be positive"),
        (
            {"simulate": lambda x0: x0},
            r"shape \(samples, outputs\), got \(3,\); one output is a column",
        ),
        ({"rule": "euler"}, "rule must be one of"),
        ({"horizon": -1.0}, "horizon must be positive"),
        ({"R": np.eye(3)}, "R must be 2 x 2"),
    ],
)
def test_bad_input_is_refused(changes, message):
    options = {"simulate": simulate, "horizon": T} | changes
    with pytest.raises(ValueError, match=message):
        empirical_gramian(options.pop("simulate"), X0, **options)


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0])
@pytest.mark.parametrize("at", [0.5, 0.5 - 4e-6])  # of a turn: only the longer step goes past it
def test_an_angle_that_wraps_is_refused_by_its_number(turn, at):
    time = np.linspace(0.0, 1.0, 21)

    def compass(x):
        heading = (x[0] + 0.5 * turn) % turn - 0.5 * turn
        return np.stack([x[0] + time, heading + 0.0 * time], axis=-1)

    with pytest.raises(ValueError, match=r"output 1 jumps by .* where state 0 is moved"):
        empirical_gramian(compass, np.array([at * turn]), horizon=1.0, epsilon=1e-5 * turn)
    free = empirical_gramian(compass, np.array([0.3 * turn]), horizon=1.0)
    np.testing.assert_allclose(free, [[2.0]], rtol=1e-6)


def test_a_list_is_as_good_as_an_array():
    def distance(x):
        return np.hypot(x[0] + np.linspace(0.0, 1.0, 21), x[1])[:, None]

    np.testing.assert_array_equal(
        empirical_gramian(distance, [30.0, 40.0], horizon=1.0),
        empirical_gramian(distance, np.array([30.0, 40.0]), horizon=1.0),
    )
    exact = exact_gramian(
        lambda t, x, u, p: ca.vertcat(1.0, 0.0), lambda t, x, u, p: ca.norm_2(x), n=2, steps=20
    )
    np.testing.assert_array_equal(
        exact([30.0, 40.0], horizon=2.0), exact(np.array([30.0, 40.0]), horizon=2.0)
    )
