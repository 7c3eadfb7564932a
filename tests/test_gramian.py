import casadi as ca
import control as ct
import mpmath as mp
import numpy as np
import pytest
from gramian_oracles import (
    arc,
    arc_jacobian,
    integral,
    slope,
    squared_range,
    unicycle,
    variational_gramian,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from formulations import condition_number, exact_gramian, quadrature_weights

T_REFERENCE = 2 * np.pi / 3


def arc_step(dt):
    """Exact step of the unicycle, for turn rates other than 0."""

    def step(t, x, u, p):  # noqa: ARG001
        half = u[0] * dt / 2
        chord = dt * ca.sin(half) / half
        return x + ca.vertcat(chord * ca.cos(x[2] + half), chord * ca.sin(x[2] + half), 2 * half)

    return step


def linear(A, C, **options):
    return exact_gramian(
        lambda t, x, u, p: ca.DM(A) @ x, lambda t, x, u, p: ca.DM(C) @ x, n=len(A), **options
    )


def decay(t, x, u, p):  # noqa: ARG001
    return ca.exp(-t) * x


def at_rest(t, x, u, p):  # noqa: ARG001
    return 0 * x


def stable_system(seed):
    """A with eigenvalues left of -0.5, and two outputs."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(3, 3))
    return A - (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(3), rng.normal(size=(2, 3))


# --- closed forms -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_long_horizon_of_a_stable_continuous_system_solves_the_lyapunov_equation(seed):
    A, C = stable_system(seed)
    W = linear(A, C, steps=6000)(
        np.zeros(3), horizon=40.0
    )  # what is left out: exp(-2·0.5·40) = 4e-18; (|A| dt)^4 ~ 1e-9
    np.testing.assert_allclose(W, ct.lyap(A.T, C.T @ C), rtol=0, atol=1e-8 * np.abs(W).max())


@pytest.mark.parametrize("seed", range(5))
def test_long_horizon_of_a_stable_discrete_system_solves_the_discrete_lyapunov_equation(seed):
    rng = np.random.default_rng(seed)
    A, C = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()  # left out: 0.81^300 = 4e-28
    W = linear(A, C, steps=300, discrete=True)(np.zeros(3), horizon=300.0)
    np.testing.assert_allclose(W, ct.dlyap(A.T, C.T @ C), rtol=0, atol=1e-11 * np.abs(W).max())


def test_pendulum_at_rest_is_the_harmonic_oscillator():
    T = 3.0
    W = pendulum(steps=400)(np.zeros(2), horizon=T)
    expected = [
        [T / 2 + np.sin(2 * T) / 4, np.sin(T) ** 2 / 2],
        [np.sin(T) ** 2 / 2, T / 2 - np.sin(2 * T) / 4],
    ]
    np.testing.assert_allclose(
        W, expected, rtol=0, atol=1e-9
    )  # dt^4 = 3e-9, over Simpson's 180 and the Runge-Kutta method's 120


def pendulum(**options):
    return exact_gramian(
        lambda t, x, u, p: ca.vertcat(x[1], -ca.sin(x[0])), lambda t, x, u, p: x[0], n=2, **options
    )


def test_swinging_pendulum_equals_an_independent_variational_integration():
    x0 = np.array([2.5, 0.3])
    expected = variational_gramian(
        lambda t, x: np.array([x[1], -np.sin(x[0])]),
        lambda t, x: np.array([[0, 1], [-np.cos(x[0]), 0]]),
        lambda t, x: np.array([[1.0, 0.0]]),
        x0,
        6.0,
    )
    np.testing.assert_allclose(pendulum(steps=2000)(x0, horizon=6.0), expected, rtol=1e-9)


@pytest.mark.parametrize("acceleration", [0.0, 0.7, -2.0])
def test_camera_sees_depth_only_when_it_moves(acceleration):
    g, d, T = 0.4, 3.0, 2.0
    camera = exact_gramian(
        lambda t, x, u, p: ca.vertcat(u, 0), lambda t, x, u, p: x[0] / x[1], n=2, m=1, steps=2
    )
    W = camera(np.array([g, d]), np.full((1, 1), acceleration), horizon=T)
    first, second = (
        g * T + acceleration * T**2 / 2,
        g**2 * T + g * acceleration * T**2 + acceleration**2 * T**3 / 3,
    )
    expected = np.array([[T / d**2, -first / d**3], [-first / d**3, second / d**4]])
    np.testing.assert_allclose(
        W, expected, rtol=1e-14
    )  # integrand quadratic in time: two Simpson intervals are exact
    det = (acceleration * T**2) ** 2 / 12 / d**6
    np.testing.assert_allclose(np.linalg.det(W), det, rtol=1e-12, atol=1e-16)


def landmark_jacobian(x0, a, landmarks, t):
    """Ranges of a double integrator to landmarks, by its position and velocity at the start: unit vector times [1, t]."""
    t = t[:, None]
    offset = (x0[:3] + t * x0[3:] + t**2 / 2 * a)[:, None, :] - landmarks
    unit = offset / np.linalg.norm(offset, axis=-1, keepdims=True)
    return np.concatenate([unit, t[..., None] * unit], axis=-1)


def landmark_gramian(steps):
    def ranges(_t, x, _u, p):
        return ca.vertcat(*[ca.norm_2(x[:3] - p[3 * i : 3 * i + 3]) for i in range(2)])

    return exact_gramian(
        lambda t, x, u, p: ca.vertcat(x[3:], u), ranges, n=6, m=3, q=6, steps=steps
    )


def test_double_integrator_with_landmarks_equals_its_closed_form_under_any_noise():
    rng = np.random.default_rng(3)
    x0, a, landmarks = rng.normal(size=6), rng.normal(size=3), rng.normal(size=(2, 3)) + 5
    R = np.array([[0.5, 0.2], [0.2, 0.3]])
    W = landmark_gramian(400)(x0, a[None], p=landmarks.ravel(), horizon=2.0, R=R)
    expected = integral(lambda t: landmark_jacobian(x0, a, landmarks, t), 2.0, np.linalg.inv(R))
    np.testing.assert_allclose(
        W, expected, rtol=0, atol=1e-10 * np.abs(W).max()
    )  # dt^4 / 180 = 3e-12


def test_factor_holds_the_whitened_sensitivity_of_every_sample():
    rng = np.random.default_rng(4)
    x0, a, landmarks = rng.normal(size=6), rng.normal(size=3), rng.normal(size=(2, 3)) + 5
    R = np.array([[0.5, 0.2], [0.2, 0.3]])
    gramian = landmark_gramian(7)
    F = gramian.factor(x0, a[None], p=landmarks.ravel(), horizon=1.4, R=R)
    J = landmark_jacobian(x0, a, landmarks, np.linspace(0, 1.4, 8))
    weighed = np.sqrt(quadrature_weights(8, 1.4, "simpson"))[:, None, None] * np.linalg.solve(
        np.linalg.cholesky(R), J
    )
    np.testing.assert_allclose(F, weighed.reshape(16, 6), rtol=0, atol=1e-14)
    W = gramian(x0, a[None], p=landmarks.ravel(), horizon=1.4, R=R)
    np.testing.assert_allclose(F.T @ F, W, rtol=1e-13)
    np.testing.assert_array_equal(W, W.T)


def test_unicycle_on_a_circle_about_the_beacon_equals_its_closed_form():
    T = T_REFERENCE
    W = exact_gramian(unicycle, squared_range, n=3, m=1, steps=400)(
        np.array([1.0, 0.0, np.pi / 2]), np.ones((1, 1)), horizon=T
    )
    a, b, c = 2 * T + np.sin(2 * T), 2 * np.sin(T) ** 2, 2 * T - np.sin(2 * T)
    np.testing.assert_allclose(W, [[a, b, -b], [b, c, -c], [-b, -c, T + c]], rtol=1e-9)
    np.testing.assert_allclose(condition_number(W), 12.868868623, rtol=1e-9)


def test_reference_decision_turns_at_1_4_by_every_integral_rule():
    rates = np.linspace(-2, 2, 21)
    for rule in ("left", "trapezoid", "simpson"):
        gramian = exact_gramian(unicycle, squared_range, n=3, m=1, steps=21, rule=rule)
        W = gramian(np.array([1.0, 0.0, np.pi / 2]), rates[:, None, None], horizon=2.1)
        assert rates[np.argmin(condition_number(W))] == pytest.approx(1.4)
        assert rates[np.argmax(np.linalg.eigvalsh(W)[:, 0])] == pytest.approx(0.6)


# --- against an independent integration ---------------------------------------------------------------------------------------------

few = st.floats(-4.0, 4.0)


@settings(max_examples=30, deadline=None)
@given(
    x=few,
    y=few,
    heading=few,
    rate=st.one_of(st.just(0.0), st.floats(-1e-6, 1e-6), st.floats(-2, 2)),
    horizon=st.floats(0.2, 4.0),
)
def test_unicycle_equals_its_analytic_sensitivities_at_any_state_and_rate(
    x, y, heading, rate, horizon
):
    x0 = np.array([x, y, heading])
    expected = integral(lambda t: arc_jacobian(x0, rate, t), horizon)
    W = UNICYCLE_400(x0, np.full((1, 1), rate), horizon=horizon)
    np.testing.assert_allclose(
        W, expected, rtol=0, atol=1e-8 * np.abs(expected).max()
    )  # (2·4/400)^4 / 20 = 8e-9


UNICYCLE_400 = exact_gramian(unicycle, squared_range, n=3, m=1, steps=400)


def test_changing_controls_equal_an_integration_in_pieces():
    turns, horizon = np.array([1.5, -0.5, 0.8, 0.0]), 2.0
    x0, weight = np.array([2.0, -1.0, 0.3]), np.diag([1 / 0.01, 1 / 4.0])

    def turn(t):
        return turns[min(int(t / 0.5), 3)]

    W = np.zeros((3, 3))
    Phi, x = np.eye(3), x0
    for u in turns:  # W = Σ Φ' W_piece Φ
        J = lambda t, x=x, u=u: arc_jacobian(x, u, t)  # noqa: E731
        W += Phi.T @ integral(J, 0.5, weight) @ Phi
        d1, d2 = (end := arc(x, u, np.array([0.5]))[0])[:2] - x[:2]
        Phi, x = np.array([[1, 0, -d2], [0, 1, d1], [0, 0, 1]]) @ Phi, end
    gramian = exact_gramian(unicycle, squared_range, n=3, m=1, steps=200)
    ours = gramian(x0, np.repeat(turns, 50)[:, None], horizon=horizon, R=np.diag([0.01, 4.0]))
    np.testing.assert_allclose(ours, W, rtol=0, atol=1e-10 * np.abs(W).max())


@pytest.mark.parametrize("substeps", [1, 3])
def test_time_varying_dynamics_start_at_their_own_time(substeps):
    gramian = exact_gramian(
        lambda t, x, u, p: ca.cos(t) * x,
        lambda t, x, u, p: ca.sin(t) * x,
        n=1,
        steps=800,
        substeps=substeps,
    )
    W = gramian(np.array([1.7]), t0=0.6, horizon=3.0)
    expected = quad(
        lambda t: (np.sin(t) * np.exp(np.sin(t) - np.sin(0.6))) ** 2, 0.6, 3.6, epsabs=1e-13
    )[0]
    np.testing.assert_allclose(W, [[expected]], rtol=1e-9)


def test_measurement_sees_the_control_that_starts_at_its_sample():
    gramian = exact_gramian(at_rest, lambda t, x, u, p: u * x, n=1, m=1, steps=3, rule="trapezoid")
    W = gramian(np.ones(1), np.array([[1.0], [2.0], [3.0]]), horizon=6.0)
    np.testing.assert_allclose(
        W, 2.0 * (1 / 2 + 4 + 9 + 9 / 2), rtol=1e-15
    )  # the last sample sees the last control


def test_discrete_time_counts_samples_from_its_start():
    gramian = exact_gramian(
        lambda t, x, u, p: (1 + t) * x, lambda t, x, u, p: (t + 1) * x, n=1, steps=3, discrete=True
    )
    W = gramian(np.array([5.0]), t0=1.0, horizon=3.0)  # t = 1, 2, 3, 4; products 1, 2, 2·3, 2·3·4
    assert W[0, 0] == (2 * 1) ** 2 + (3 * 2) ** 2 + (4 * 6) ** 2 + (5 * 24) ** 2


# --- orders -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rule", "order", "first"),
    [("left", 1, 8), ("trapezoid", 2, 8), ("simpson", 4, 8), ("simpson", 4, 9)],
)
def test_quadrature_converges_at_its_order(rule, order, first):
    steps = np.array(
        [first * k for k in (1, 3, 9)]
    )  # stays even or odd: both endings of Simpson's rule
    exact = (1 - np.exp(-4.0)) / 2
    W = [
        exact_gramian(at_rest, decay, n=1, steps=int(k), rule=rule)(np.ones(1), horizon=2.0)[0, 0]
        for k in steps
    ]
    assert slope(steps, np.abs(np.array(W) - exact)) == pytest.approx(-order, abs=0.1)


@pytest.mark.parametrize("rule", ["left", "trapezoid", "simpson"])
@pytest.mark.parametrize("intervals", [2, 3, 4, 5, 7])
def test_quadrature_integrates_what_it_must(rule, intervals):
    t = np.linspace(0, 3.0, intervals + 1)
    w = quadrature_weights(intervals + 1, 3.0, rule)
    assert (w >= 0).all()
    for power in range({"left": 1, "trapezoid": 2, "simpson": 4}[rule]):
        np.testing.assert_allclose(w @ t**power, 3.0 ** (power + 1) / (power + 1), rtol=1e-14)


def test_integrator_is_of_fourth_order():
    steps, x0, u = np.array([8, 16, 32, 64]), np.array([1.0, -2.0, 0.3]), 1.3
    exact = arc_jacobian(x0, u, np.array([3.0]))[0]
    last = [
        exact_gramian(unicycle, squared_range, n=3, m=1, steps=int(k), rule="sum").factor(
            x0, np.full((1, 1), u), horizon=3.0
        )[-2:]
        for k in steps
    ]
    assert slope(steps, [np.abs(J - exact).max() for J in last]) == pytest.approx(-4, abs=0.1)


def test_substeps_integrate_between_pings():
    x0, u, pings = np.array([30.0, -20.0, 0.3]), 0.2, 15.0 * np.arange(5)
    W = exact_gramian(unicycle, squared_range, n=3, m=1, steps=4, rule="sum", substeps=60)(
        x0, np.full((1, 1), u), horizon=60.0
    )
    J = arc_jacobian(x0, u, pings)
    expected = np.einsum("tai,taj->ij", J, J)
    np.testing.assert_allclose(
        W, expected, rtol=0, atol=1e-7 * np.abs(expected).max()
    )  # (0.05)^4/120·60 steps = 3e-6 of 3 m in 1e3 m²


def camera_at(steps, jump):
    """W of the mono-camera whose acceleration changes sign at a fraction of 2 s; its integrand then has a kink."""
    camera = exact_gramian(
        lambda t, x, u, p: ca.vertcat(u, 0), lambda t, x, u, p: x[0] / x[1], n=2, m=1, steps=steps
    )
    return camera(
        np.array([0.4, 3.0]),
        np.where(np.arange(steps) < jump * steps, 1.5, -1.5)[:, None],
        horizon=2.0,
    )


def test_a_jump_of_the_control_costs_simpson_two_orders_unless_between_its_pairs():
    steps = [10, 30, 90]  # half of them is odd, a fifth of them even
    exact = camera_at(40, 1 / 2)  # piecewise quadratic: exact between pairs
    np.testing.assert_allclose(camera_at(80, 1 / 2), exact, rtol=1e-13)
    assert slope(
        steps, [np.abs(camera_at(n, 1 / 2) - exact).max() for n in steps]
    ) == pytest.approx(-2, abs=0.1)
    for n in steps:
        np.testing.assert_allclose(camera_at(n, 1 / 5), camera_at(40, 1 / 5), rtol=1e-13)


# --- convergence on request ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_converged_gramian_is_right_to_its_tolerance(rtol):
    x0, turns = np.array([2.0, -1.0, 0.3]), np.array([[1.5], [-0.5]])
    coarse = exact_gramian(unicycle, squared_range, n=3, m=1, steps=2)
    gramian = coarse.converged(x0, turns, horizon=2.0, rtol=rtol)
    W = gramian(x0, np.repeat(turns, gramian.steps // 2, axis=0), horizon=2.0)
    truth = exact_gramian(unicycle, squared_range, n=3, m=1, steps=1600)(
        x0, np.repeat(turns, 800, axis=0), horizon=2.0
    )
    assert np.all(np.abs(W - truth) <= rtol * np.sqrt(np.outer(np.diag(truth), np.diag(truth))))


def test_refined_gramian_keeps_its_substeps():
    gramian = exact_gramian(unicycle, squared_range, n=3, m=1, steps=4, substeps=3)
    assert gramian.refine(4).function.n_instructions() == gramian.function.n_instructions()


def test_what_cannot_converge_says_so():
    jump = exact_gramian(at_rest, lambda t, x, u, p: ca.if_else(t > 1 / 3, x, 0), n=1, steps=2)
    with pytest.raises(ValueError, match="did not converge to 1e-12 within 8192 steps"):
        jump.converged(np.ones(1), horizon=1.0, rtol=1e-12)
    with pytest.raises(ValueError, match="no step to refine"):
        linear(np.eye(1), np.eye(1), steps=3, discrete=True).converged(
            np.ones(1), horizon=3.0, rtol=1e-3
        )
    with pytest.raises(ValueError, match="no step to refine"):
        linear(np.eye(1), np.eye(1), steps=3, rule="sum").converged(
            np.ones(1), horizon=3.0, rtol=1e-3
        )


# --- digits -------------------------------------------------------------------------------------------------------------------------


def test_factor_keeps_the_condition_number_that_the_gramian_loses():
    d, u, T, steps = 1e5, 1.0, 2.0, 20  # an AUV 100 km away: κ grows as d^4
    x0, turn = np.array([d, 0.0, np.pi / 2]), np.full((1, 1), u)
    gramian = exact_gramian(
        arc_step(T / steps), squared_range, n=3, m=1, steps=steps, discrete=True
    )
    with mp.workdps(60):
        W = mp.zeros(3)
        for k in range(steps + 1):
            half = mp.mpf(u) * T * k / steps / 2
            chord = mp.mpf(T) * k / steps * mp.sinc(half)
            d1, d2 = chord * mp.cos(mp.mpf(x0[2]) + half), chord * mp.sin(mp.mpf(x0[2]) + half)
            J = mp.matrix([[0, 0, 1], [2 * (d + d1), 2 * d2, 2 * (d2 * d1 - (d + d1) * d2)]])
            W += J.T * J
        eigenvalues = mp.eigsy(W, eigvals_only=True)
        kappa = float(eigenvalues[2] / eigenvalues[0])
    assert kappa > 1e20
    sigma = np.linalg.svd(gramian.factor(x0, turn, horizon=T), compute_uv=False)
    np.testing.assert_allclose(
        (sigma[0] / sigma[-1]) ** 2, kappa, rtol=1e-4
    )  # eps·κ(F) = 2e-16·2e10 = 5e-6, over some rows
    eigenvalues = np.linalg.eigvalsh(gramian(x0, turn, horizon=T))
    assert abs(eigenvalues[-1] / abs(eigenvalues[0]) / kappa - 1) > 0.5
