"""Observability of the linear time-varying systems, Theorem 1 both ways, and the analytic circle."""

import subprocess
import sys

import control as ct
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipe, ellipk

import obsplan as op
from formulations.ltv import (
    A,
    circle_gramian,
    fixed_auv_rate,
    fixed_cna_rate,
    ltv_gramian,
    output_map,
    recover_initial_state,
    transition_matrix,
    unobservable_subspace,
    validate_circle,
)


def smooth_path(rng, samples=401, duration=7.0):
    """A wandering path: constant drift and three random harmonics."""
    t = np.linspace(0, duration, samples)
    waves = rng.normal(size=(3, 2, 2))
    path = rng.normal(size=2) + t[:, None] * rng.normal(size=2)
    for k, (a, b) in enumerate(waves, start=1):
        path = path + np.cos(k * t / 2)[:, None] * a + np.sin(k * t / 2)[:, None] * b
    return t, path


def swim(rate, start, heading, speed, times):
    """Nonlinear trajectory under a heading that is a function of time, by an independent integrator."""
    run = solve_ivp(
        lambda t, x: rate(x, heading(t), speed),
        (times[0], times[-1]),
        start,
        "DOP853",
        times,
        rtol=1e-12,
        atol=1e-12,
    )
    return run.y.T


def squared_range(states):
    return np.sum(states[:, :2] ** 2, axis=1)


# --- the systems ---


@pytest.mark.parametrize("rate", [fixed_cna_rate, fixed_auv_rate])
def test_output_map_is_the_derivative_of_the_nonlinear_output(rate):
    """Central differences of a simulation; the squared range is quadratic in the start, so they are exact at any step."""
    start, times = np.array([3.0, -2.0, 0.2, 0.1]), np.linspace(0.0, 5.0, 30)
    outputs = lambda x0: squared_range(swim(rate, x0, lambda t: 0.4 + 0.9 * t, 1.2, times))  # noqa: E731
    slope = np.column_stack(
        [(outputs(start + e) - outputs(start - e)) / 0.2 for e in 0.1 * np.eye(4)]
    )
    nominal = swim(rate, start, lambda t: 0.4 + 0.9 * t, 1.2, times)
    np.testing.assert_allclose(output_map(times, nominal[:, :2]), slope, rtol=1e-8, atol=1e-8)


def test_transition_matrix_is_the_exponential_of_the_dynamics():
    t = np.array([0.0, 0.3, 12.0])
    expected = [
        ct.c2d(ct.ss(A, np.zeros((4, 1)), np.eye(4), 0), h).A for h in t[1:]
    ]  # python-control
    np.testing.assert_allclose(transition_matrix(t), [np.eye(4), *expected], atol=1e-13)


def test_fixed_cna_and_fixed_auv_share_path_and_gramian():
    start, times = np.array([3.0, -2.0, 0.2, 0.1]), np.linspace(0.0, 5.0, 101)
    heading = lambda t: 0.4 + 0.9 * np.sin(t)  # noqa: E731
    x = swim(fixed_cna_rate, start, heading, 1.2, times)
    r = swim(fixed_auv_rate, -start, heading, 1.2, times)
    np.testing.assert_allclose(r, -x, atol=1e-9)
    np.testing.assert_allclose(
        ltv_gramian(times, r[:, :2]), ltv_gramian(times, x[:, :2]), rtol=1e-9, atol=1e-8
    )


# --- Gramians ---


def thesis_gramian(x, t):
    """Integrand of (3.4), (3.11) as the thesis prints it."""
    a, b, c = x[0] ** 2, x[0] * x[1], x[1] ** 2
    return 4 * np.array(
        [
            [a, b, t * a, t * b],
            [b, c, t * b, t * c],
            [t * a, t * b, t * t * a, t * t * b],
            [t * b, t * c, t * t * b, t * t * c],
        ]
    )


def test_gramian_of_a_sampled_path_converges_at_fourth_order_to_the_thesis_integral():
    path = lambda t: np.array([2 + np.cos(t), 0.3 * t + np.sin(2 * t)])  # noqa: E731
    exact = solve_ivp(
        lambda t, _: thesis_gramian(path(t), t).ravel(),
        (0, 6.0),
        np.zeros(16),
        "DOP853",
        rtol=1e-12,
        atol=1e-12,
    )
    exact = exact.y[:, -1].reshape(4, 4)
    errors = []
    for intervals in (40, 80, 160):
        t = np.linspace(0, 6.0, intervals + 1)
        errors.append(np.abs(ltv_gramian(t, path(t).T) - exact).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.2)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4, abs=0.1)
    assert errors[2] < 1e-5 * np.abs(exact).max()


def test_gramian_counts_time_from_the_first_sample():
    t, path = smooth_path(np.random.default_rng(0))
    np.testing.assert_allclose(ltv_gramian(t + 100.0, path), ltv_gramian(t, path), rtol=1e-11)


@pytest.mark.parametrize(
    ("radius", "rate", "turns"), [(2.0, 1.0, 2), (0.5, -3.0, 1), (30.0, 0.05, 3)]
)
def test_circle_gramian_over_whole_turns_has_the_textbook_entries(radius, rate, turns):
    T = 2 * np.pi * turns / abs(rate)
    first = np.array([[T / 2, 0], [0, T / 2]])
    second = np.array([[T**2 / 4, -T / (4 * rate)], [-T / (4 * rate), T**2 / 4]])
    c2, s2, sc = T**3 / 6 + T / (4 * rate**2), T**3 / 6 - T / (4 * rate**2), -(T**2) / (4 * rate)
    expected = 4 * radius**2 * np.block([[first, second], [second, np.array([[c2, sc], [sc, s2]])]])
    np.testing.assert_allclose(
        circle_gramian(radius, rate, T), expected, rtol=1e-12, atol=1e-12 * expected.max()
    )


@pytest.mark.parametrize(
    ("turns", "condition"), [(0.25, 4.50), (0.5, 1.0), (0.75, 1.54), (1.0, 1.0), (2.0, 1.0)]
)
def test_position_block_is_evenly_conditioned_at_half_and_whole_turns(turns, condition):
    W = circle_gramian(2.0, 1.0, 2 * np.pi * turns)
    assert np.linalg.cond(W[:2, :2]) == pytest.approx(condition, abs=0.005)


def test_whole_gramian_is_not_evenly_conditioned():
    assert np.linalg.cond(circle_gramian(2.0, 1.0, 4 * np.pi)) == pytest.approx(277, abs=0.5)


# --- python-control on the circle ---


@pytest.mark.parametrize("seed", range(6))
def test_python_control_agrees_by_every_route_and_a_frozen_time_test_is_wrong(seed):
    rng = np.random.default_rng(seed)
    radius, rate, turns = (
        10 ** rng.uniform(-1, 2),
        10 ** rng.uniform(-2, 0.5) * (-1) ** seed,
        rng.uniform(0.3, 4.0),
    )
    verdict = validate_circle(radius, rate, turns)
    assert verdict.duration == pytest.approx(2 * np.pi * turns / abs(rate), rel=1e-14)
    # rounding over epsilon, 2e-13, and DOP853 at 1e-13 a step, over some hundred steps
    assert verdict.errors["linearised"] < 1e-10
    assert verdict.errors["rotating_frame"] < 1e-11
    assert verdict.errors["simulation"] < 1e-11  # DOP853 at 1e-13
    assert verdict.errors["response"] < 1e-10  # Simpson at 1000 intervals a turn
    assert verdict.errors["ours"] < 1e-10
    assert verdict.rotating_frame_rank == 4
    assert verdict.frozen_time_rank == 2
    assert not unobservable_subspace(
        np.linspace(0, verdict.duration, 50),
        circle(radius, rate, np.linspace(0, verdict.duration, 50)),
    ).size


def circle(radius, rate, t):
    return radius * np.column_stack([np.cos(rate * t), np.sin(rate * t)])


def test_infinite_horizon_gramian_of_python_control_does_not_exist_here():
    with pytest.raises(ValueError, match="unstable"):
        ct.gram(ct.ss(A, np.zeros((4, 1)), np.array([[2.0, 0, 0, 0]]), 0), "o")


@pytest.mark.parametrize(
    "arguments",
    [(0.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 1.0), (1.0, np.nan, 1.0)],
)
def test_circle_needs_a_radius_a_rate_and_a_turn(arguments):
    with pytest.raises(ValueError, match="must be positive and rate not zero"):
        validate_circle(*arguments)


@pytest.mark.slow
def test_importing_the_module_does_not_load_python_control():
    code = "import sys, formulations.ltv; sys.exit('control' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- Theorem 1 ---


@pytest.mark.parametrize("seed", range(5))
def test_a_regular_gramian_gives_the_initial_state_back(seed):
    rng = np.random.default_rng(seed)
    t, path = smooth_path(rng)
    x0 = rng.normal(size=4)
    output = np.array([2 * p @ (x0[:2] + s * x0[2:]) for s, p in zip(t, path, strict=True)])
    condition = np.linalg.cond(ltv_gramian(t, path))
    np.testing.assert_allclose(
        recover_initial_state(t, path, output), x0, atol=100 * condition * 2.2e-16
    )
    assert condition < 1e6
    assert unobservable_subspace(t, path).shape == (4, 0)


T = np.linspace(0.0, 10.0, 101)
EAST_NORTH = np.array([0.8, 0.6])
ACROSS = np.array([-0.6, 0.8])
UNOBSERVABLE_MOTIONS = {
    "straight pass through the beacon": ((T - 4.0)[:, None] * EAST_NORTH, 2),
    "radial run": ((T + 3.0)[:, None] * EAST_NORTH, 2),
    "radial run at varying speed": ((5 + np.sin(T) + T)[:, None] * EAST_NORTH, 2),
    "straight pass beside the beacon": (2 * ACROSS + (T - 4.0)[:, None] * EAST_NORTH, 1),
    "rest": (np.tile([3.0, 1.0], (101, 1)), 2),
    "rest upon the beacon": (np.zeros((101, 2)), 4),
    "arc": (circle(2.0, 0.1, T), 0),
}


@pytest.mark.parametrize(
    ("path", "hidden"), UNOBSERVABLE_MOTIONS.values(), ids=UNOBSERVABLE_MOTIONS
)
def test_a_singular_gramian_leaves_two_initial_states_with_one_output(path, hidden):
    basis = unobservable_subspace(T, path)
    assert basis.shape == (4, hidden)
    scale = np.abs(path).max() * np.abs(basis).max(initial=0.0) + 1
    for v in basis.T:
        output = [2 * p @ (v[:2] + s * v[2:]) for s, p in zip(T, path, strict=True)]
        np.testing.assert_allclose(output, 0.0, atol=1e-12 * scale)
    W = ltv_gramian(T, path)
    assert np.linalg.matrix_rank(W, tol=1e-10 * max(np.linalg.norm(W, 2), 1)) == 4 - hidden
    if hidden:
        with pytest.raises(ValueError, match=f"leaves {hidden} of 4 directions unobservable"):
            recover_initial_state(T, path, np.zeros(len(T)))


def test_a_radial_run_hides_what_lies_across():
    basis = unobservable_subspace(*radial_run())
    across = np.kron(np.eye(2), ACROSS).T  # position and velocity
    np.testing.assert_allclose(across @ (np.linalg.pinv(across) @ basis), basis, atol=1e-12)


def radial_run():
    return T, (T + 3.0)[:, None] * EAST_NORTH


def test_the_hidden_direction_of_a_straight_pass_is_a_rotation_about_the_beacon():
    start, velocity = np.array([-4.0, 2.0]), np.array([1.0, 0.3])
    (v,) = unobservable_subspace(T, start + T[:, None] * velocity).T
    rotation = np.array([-start[1], start[0], -velocity[1], velocity[0]])
    np.testing.assert_allclose(
        abs(v @ rotation), np.linalg.norm(v) * np.linalg.norm(rotation), rtol=1e-10
    )


@pytest.mark.parametrize(
    "start", [[-4.0, 0.0], [-4.0, 2.0]], ids=["through the beacon", "beside the beacon"]
)
def test_straight_passes_hide_the_initial_state_of_the_nonlinear_system_too(start):
    """Start and current turned about the beacon: another state, far away, with the same ranges (3.1)."""
    speed, current = 1.0, np.array([0.1, 0.0])
    turn = np.array([[np.cos(0.8), -np.sin(0.8)], [np.sin(0.8), np.cos(0.8)]])
    swimming = np.array([speed, 0.0])
    other = np.r_[turn @ start, turn @ (swimming + current) - swimming]
    times = np.linspace(0.0, 8.0, 40)
    one, two = (
        swim(fixed_cna_rate, x0, lambda _: 0.0, speed, times)
        for x0 in (np.r_[start, current], other)
    )
    assert np.abs(one - two).max() > 1.0
    np.testing.assert_allclose(squared_range(one), squared_range(two), atol=1e-9)


def test_a_known_current_leaves_only_the_position_to_find_and_a_straight_pass_beside_the_beacon_finds_it():
    """Up to its mirror image in the track, which no information matrix shows."""
    beside, through = (
        UNOBSERVABLE_MOTIONS["straight pass beside the beacon"][0],
        UNOBSERVABLE_MOTIONS["straight pass through the beacon"][0],
    )
    assert np.linalg.matrix_rank(ltv_gramian(T, beside)[:2, :2]) == 2
    assert np.linalg.matrix_rank(ltv_gramian(T, through)[:2, :2]) == 1
    mirrored = beside - 4 * ACROSS
    np.testing.assert_allclose(np.sum(mirrored**2, axis=1), np.sum(beside**2, axis=1), rtol=1e-12)


@pytest.mark.parametrize(
    "time",
    [
        np.array([0.0]),
        np.array([0.0, 1.0, 1.0]),
        np.array([0.0, 2.0, 1.0]),
        np.array([0.0, np.nan]),
    ],
)
@pytest.mark.parametrize("function", [ltv_gramian, unobservable_subspace])
def test_a_path_needs_increasing_instants(function, time):
    with pytest.raises(ValueError, match="at least 2 increasing instants"):
        function(time, np.ones((len(time), 2)))


# --- the analytic circle in a uniform flow ---


def circle_in_a_flow(radius, speed, flow):
    """Period and Gramian's diagonal, along the flow and across it, on a circle about the beacon, by complete elliptic integrals.

    With W = flow and V = speed, a vehicle that crabs to keep to the circle has over ground, at the angle θ from the flow,
    -W sin θ + √(V² - W² cos² θ), so that dt = R (W sin θ + √(V² - W² cos² θ)) dθ / (V² - W²); odd terms vanish over a turn.
    """
    m = (flow / speed) ** 2
    E, K = ellipe(m), ellipk(m)
    total = 4 * E
    along = 4 * ((2 * m - 1) * E + (1 - m) * K) / (3 * m)  # of cos² θ √(1 - m cos² θ)
    scale = radius * speed / (speed**2 - flow**2)
    return scale * total, 4 * radius**2 * scale * np.array([along, total - along])


@pytest.mark.parametrize("side", [1, -1])
def test_circle_about_the_beacon_in_a_uniform_flow_is_the_elliptic_integrals(side):
    """A polygon for the circle: perimeter and second moments are low by the order of (π/n)²."""
    n, radius, speed, flow, toward = 720, 3.0, 1.0, 0.6, 0.7
    angle = side * np.linspace(0.0, 2 * np.pi, n + 1)
    corners = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    current = flow * np.array([np.cos(toward), np.sin(toward)])
    swum = op.Reference(polyline=corners, speed=speed, current=current)
    times = np.linspace(0.0, swum.duration, 8 * n + 1)
    turn = np.array([[np.cos(toward), np.sin(toward)], [-np.sin(toward), np.cos(toward)]])
    block = turn @ ltv_gramian(times, swum.position(times))[:2, :2] @ turn.T
    period, diagonal = circle_in_a_flow(radius, speed, flow)
    close = 2 * (np.pi / n) ** 2
    assert swum.duration == pytest.approx(period, rel=close)
    np.testing.assert_allclose(block, np.diag(diagonal), rtol=close, atol=close * diagonal.max())
    assert diagonal[1] / diagonal[0] > 1.1  # in still water 1: the flow spoils the circle by that
