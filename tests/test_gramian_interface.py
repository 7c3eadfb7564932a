from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from gramian_oracles import arc_jacobian, integral, squared_range, unicycle

from formulations import condition_number, exact_gramian, quadrature_weights

UNICYCLE_400 = exact_gramian(unicycle, squared_range, n=3, m=1, steps=400)


def at_rest(t, x, u, p):  # noqa: ARG001
    return 0 * x


def test_every_state_under_every_control_equals_one_at_a_time():
    rng = np.random.default_rng(0)
    x0, u = rng.normal(size=(4, 3)), rng.normal(size=(5, 9, 1))
    gramian = exact_gramian(unicycle, squared_range, n=3, m=1, steps=9)
    W = gramian(x0[:, None], u[None], horizon=1.8)
    assert W.shape == (4, 5, 3, 3)
    for i, j in np.ndindex(4, 5):
        np.testing.assert_array_equal(W[i, j], gramian(x0[i], u[j], horizon=1.8))
        np.testing.assert_array_equal(
            gramian.factor(x0[:, None], u[None], horizon=1.8)[i, j],
            gramian.factor(x0[i], u[j], horizon=1.8),
        )
    assert gramian(x0[:0], u[0], horizon=1.8).shape == (0, 3, 3)


def test_long_horizons_are_rolled_and_equal_the_unrolled():
    x0, u = np.array([1.0, 0.0, np.pi / 2]), np.full((1, 1), 0.7)
    long = exact_gramian(unicycle, squared_range, n=3, m=1, steps=6000)
    assert long.function.n_instructions() < 100 < UNICYCLE_400.function.n_instructions()
    np.testing.assert_allclose(
        long(x0, u, horizon=2.0), integral(lambda t: arc_jacobian(x0, 0.7, t), 2.0), rtol=1e-11
    )


def test_measurement_by_a_table_needs_no_scalar_form():
    grid = np.linspace(-10, 10, 21)
    depth = ca.interpolant("depth", "bspline", [grid], 2 * grid)
    gramian = exact_gramian(at_rest, lambda t, x, u, p: depth(x[0]), n=2, steps=4)
    np.testing.assert_allclose(
        gramian(np.array([0.3, 1.0]), horizon=2.0), [[8.0, 0.0], [0.0, 0.0]], atol=1e-14
    )


def test_gradient_through_the_function_equals_finite_differences():
    F = exact_gramian(unicycle, squared_range, n=3, m=1, steps=6).function
    u = ca.MX.sym("u", 1, 6)
    score = ca.trace(F(ca.DM([1, 0.5, 0.2]), u, [], 0, 1.2, ca.DM.eye(2))[0])
    value = ca.Function("value", [u], [score, ca.gradient(score, u)])
    u0 = np.linspace(-1, 1, 6)[None]
    for k, e in enumerate(1e-5 * np.eye(6)[:, None]):
        difference = float(value(u0 + e)[0] - value(u0 - e)[0]) / 2e-5
        assert float(value(u0)[1][k]) == pytest.approx(difference, rel=1e-7, abs=1e-8)


def test_threads_may_share_a_gramian():
    x0 = np.random.default_rng(1).normal(size=(64, 3))
    one_by_one = [UNICYCLE_400(x, np.ones((1, 1)), horizon=2.0) for x in x0]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda x: UNICYCLE_400(x, np.ones((1, 1)), horizon=2.0), x0))
    np.testing.assert_array_equal(together, one_by_one)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_input_that_is_not_finite_spoils_its_own_case_entirely(bad):
    gramian = exact_gramian(unicycle, squared_range, n=3, m=1, steps=4)
    x0 = np.array([[1.0, 0.0, 0.0], [1.0, bad, 0.0]])
    u = np.ones((1, 1))
    W = gramian(x0, u, horizon=1.0)
    np.testing.assert_array_equal(W[0], gramian(x0[0], u, horizon=1.0))
    assert np.isnan(W[1]).all()
    assert np.isnan(gramian(x0[0], bad * u, horizon=1.0)).all()
    assert np.isnan(gramian(x0[0], u, horizon=1.0, t0=bad)).all()
    assert condition_number(W)[1] == np.inf


def test_a_measurement_without_a_derivative_gives_nan_in_every_entry():
    range_alone = exact_gramian(unicycle, lambda t, x, u, p: ca.norm_2(x[:2]), n=3, m=1, steps=4)
    x0 = np.array([[0.0, 0.0, 0.4], [1.0, 0.0, 0.4]])  # the first on the beacon
    np.testing.assert_array_equal(
        np.isnan(range_alone(x0, np.ones((1, 1)), horizon=1.0)).all(axis=(1, 2)), [True, False]
    )


def test_unobservable_heading_without_a_compass_is_rotation_about_the_beacon():
    range_alone = exact_gramian(unicycle, lambda t, x, u, p: ca.norm_2(x[:2]), n=3, m=1, steps=40)
    x0 = np.array([3.0, 1.0, 0.4])
    F = range_alone.factor(x0, np.sin(np.arange(40.0))[:, None], horizon=4.0)
    np.testing.assert_allclose(F @ [-x0[1], x0[0], 1.0], 0, atol=1e-13)


# --- bad input ----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rule": "midpoint"}, "rule must be one of left, trapezoid, simpson, sum, got 'midpoint'"),
        ({"steps": 1}, "'simpson' needs at least 3 samples, got 2"),
        ({"steps": 0}, "must be at least 1"),
        ({"m": -1}, "at least 0"),
        ({"n": 4}, "f must return 4 x 1, one row per state, got 3 x 1"),
        ({"discrete": True, "substeps": 2}, "got substeps=2; leave substeps out"),
    ],
)
def test_a_model_that_does_not_fit_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        exact_gramian(unicycle, squared_range, **{"n": 3, "m": 1, "steps": 4} | options)


def test_a_measurement_must_be_a_column():
    with pytest.raises(ValueError, match="h must return a column, one row per output, got 1 x 3"):
        exact_gramian(unicycle, lambda t, x, u, p: x.T, n=3, m=1, steps=4)


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"x0": np.zeros(2)}, r"x0 must have shape \(..., 3\), got \(2,\)"),
        ({"u": None}, "the model takes 1 controls u, got none"),
        ({"u": np.zeros((5, 1))}, r"u must broadcast to \(4, 1\), got \(5, 1\)"),
        ({"u": np.zeros((4, 2))}, r"u must have shape \(..., 4, 1\), got \(4, 2\)"),
        ({"p": np.zeros(1)}, r"p must have shape \(..., 0\), got \(1,\)"),
        ({"horizon": 0.0}, "horizon must be positive and finite"),
        ({"horizon": np.nan}, "horizon must be positive and finite"),
        ({"R": np.eye(3)}, r"R must be 2 x 2, one row per output, got shape \(3, 3\)"),
        ({"R": np.array([[1.0, 0.5], [0.4, 1.0]])}, "R must be finite and symmetric"),
        ({"R": np.diag([1.0, np.nan])}, "R must be finite and symmetric"),
        ({"R": np.diag([1.0, 0.0])}, "R must be positive definite"),
    ],
)
def test_conditions_that_do_not_fit_are_refused(conditions, message):
    gramian = exact_gramian(unicycle, squared_range, n=3, m=1, steps=4)
    with pytest.raises(ValueError, match=message):
        gramian(**{"x0": np.zeros(3), "u": np.zeros((4, 1)), "horizon": 1.0} | conditions)


@pytest.mark.parametrize(
    ("samples", "horizon", "message"),
    [(2, 1.0, "at least 3 samples, got 2"), (3, -1.0, "horizon must be positive")],
)
def test_quadrature_that_cannot_be_is_refused(samples, horizon, message):
    with pytest.raises(ValueError, match=message):
        quadrature_weights(samples, horizon, "simpson")
