"""Claims about the filters beside the EKF: how they take functions for linear ones."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from pykalman import AdditiveUnscentedKalmanFilter
from scipy.optimize import minimize

import obsplan as op
from obsplan.estimators import ESTIMATORS, Ekf, IteratedEkf, Process, SecondOrderEkf, SigmaPoint
from obsplan.estimators.sigma_point import square_root
from obsplan.sensors import BEACON, Bearing, Heading, Range, SquaredRange
from obsplan.vehicles import State

NODES = 60  # of quadratures, in each direction


def function(kernel, sensor, n=4, *, method="update"):
    """A filter's method as a Function of mean, covariance, measurement and beacon."""
    x, P = ca.SX.sym("x", n), ca.SX.sym("P", n, n)
    z, beacon = ca.SX.sym("z"), ca.SX.sym("beacon", len(BEACON))
    results = getattr(kernel, method)(x, P, z, sensor, beacon)
    whole = ca.Function(method, [x, P, z, beacon], list(results))

    def evaluate(x, P, z, beacon=(0.0, 0.0)):
        given = np.zeros(len(BEACON))
        given[: len(beacon)] = beacon
        return [np.squeeze(found.full()) for found in whole(x, P, z, given)]

    return evaluate


def turned(angle, long, short):
    """The covariance of an ellipse."""
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return axes @ np.diag([long**2, short**2]) @ axes.T


def moments(measure, variance, mean, P):
    """Mean and variance of a measurement of a Gaussian state in the plane, by quadrature."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    first, second = np.meshgrid(nodes, nodes)
    joint = np.outer(weights, weights) / weights.sum() ** 2
    places = mean[:, None, None] + np.einsum(
        "ij,jkl->ikl", np.linalg.cholesky(P), np.array([first, second])
    )
    values = measure(places)
    expected = np.sum(joint * values)
    return expected, np.sum(joint * ((values - expected) ** 2 + variance(places)))


# a body falling through the air, tracked by radar: Julier & Uhlmann (1997), section 4
GAMMA, ABOVE, ASIDE = 5e-5, 1e5, 1e5
ROUNDING = 1e-8  # of what is computed with sixteen digits by two ways, after 30 steps


@dataclass(frozen=True)
class FallingBody:
    """Height [ft], speed downwards and ballistic coefficient."""

    states = dict.fromkeys("abc", State("1"))

    def step(self, x, u, dt):
        drag = ca.exp(-GAMMA * x[0]) * x[1] ** 2 * x[2]
        return ca.vertcat(x[0] - dt * x[1], x[1] - dt * drag, x[2])


@dataclass(frozen=True)
class Radar:
    periodic: bool = False
    sigma: float = 100.0

    def measure(self, x, beacon):
        return ca.sqrt(ASIDE**2 + (x[0] - ABOVE) ** 2)

    def deviation(self, x, beacon):
        return self.sigma


def falling(kernel, x, P, z):
    """Means and covariances after each measurement, the first before any motion; a second between."""
    process = Process(model=FallingBody(), noise=(1.0, 1.0, 1e-6), dt=0.5)
    mean, covariance, u = ca.SX.sym("x", 3), ca.SX.sym("P", 3, 3), ca.SX.sym("u", 2)
    after = kernel.predict(mean, covariance, u, process)
    predict = ca.Function("predict", [mean, covariance, u], list(after))
    update = function(kernel, Radar(), 3)
    means, covariances = [], []
    for k, each in enumerate(z):
        if k:
            x, P = (found.full() for found in predict(x, P, np.zeros(2)))
        x, P = update(x, P, each)
        means.append(x)
        covariances.append(P)
    return np.array(means), np.array(covariances)


def test_sigma_point_filter_of_a_falling_body_is_that_of_pykalman():
    def step(s):
        drag = np.exp(-GAMMA * s[0]) * s[1] ** 2 * s[2]
        return np.array([s[0] - s[1] / 2, s[1] - drag / 2, s[2]])

    def seen(s):
        return np.array([np.hypot(ASIDE, s[0] - ABOVE)])

    rng = np.random.default_rng(3)
    x, P = np.array([3e5, 2e4, 8e-4]), np.diag([1e6, 4e6, 9e-8])
    true = [np.array([3.005e5, 1.9e4, 1e-3])]
    for _ in range(30):
        true.append(step(true[-1]))
    z = np.array([seen(each) for each in true]) + rng.normal(size=(31, 1)) * 100.0
    Q = np.diag([0.5, 0.5, 0.5e-12])
    theirs = AdditiveUnscentedKalmanFilter(step, seen, Q, [[1e4]], x, P)
    means, covariances = theirs.filter(z)
    ours, spread = falling(SigmaPoint(), x, P, z[:, 0])
    other, _ = falling(Ekf(), x, P, z[:, 0])
    sigma = np.sqrt(np.einsum("kii->ki", covariances))
    unit = sigma[:, :, None] * sigma[:, None, :]
    np.testing.assert_allclose(ours / sigma, means / sigma, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(spread / unit, covariances / unit, rtol=0, atol=ROUNDING)
    assert np.abs((other - means) / sigma).max() > 0.1  # the case is not linear


@pytest.mark.parametrize("seed", range(3))
def test_states_that_a_range_does_not_depend_on_change_nothing_of_its_sigma_points(seed):
    """Pykalman scatters points over all four states; ours are of the place alone."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(4, 4)) * [[8.0], [8.0], [0.1], [0.3]]
    x, P, z = np.array([9.0, -5.0, 0.4, 1.2]), A @ A.T, 14.0
    theirs = AdditiveUnscentedKalmanFilter(
        lambda s: s, lambda s: np.array([np.hypot(*s[:2])]), np.eye(4), [[0.25]], x, P
    )
    means, covariances = theirs.filter(np.array([[z]]))
    mean, covariance = function(SigmaPoint(), Range(sigma=0.5))(x, P, z)
    np.testing.assert_allclose(mean, means[0], rtol=1e-10)
    np.testing.assert_allclose(covariance, covariances[0], rtol=1e-8, atol=1e-10)
    assert not np.allclose(function(Ekf(), Range(sigma=0.5))(x, P, z)[0], mean, rtol=1e-3)


def test_sigma_point_prediction_has_the_mean_of_a_rotating_vector():
    """E[cos(heading)] is exp(-s²/2) cos(mean): the points miss it by their sixth moment, s⁶/120."""
    spread, speed = 0.3, 2.0
    process = Process(model=op.DeadReckoning(), noise=(0.0,) * 4, dt=1.0)
    x, P, u = ca.SX.sym("x", 4), ca.SX.sym("P", 4, 4), ca.SX.sym("u", 2)
    predict = ca.Function("predict", [x, P, u], list(SigmaPoint().predict(x, P, u, process)))
    before = np.diag([4.0, 9.0, spread**2, 0.0])
    mean, covariance = predict([0.0, 0.0, 0.7, speed], before, [0.0, 0.0])
    exact = speed * np.exp(-(spread**2) / 2) * np.array([np.cos(0.7), np.sin(0.7)])
    np.testing.assert_allclose(mean.full()[:2, 0], exact, atol=speed * spread**6 / 120)
    assert np.hypot(*exact) < 0.96 * speed  # what the EKF has
    turn = covariance.full()[1, 2] * np.cos(0.7) - covariance.full()[0, 2] * np.sin(0.7)
    assert turn == pytest.approx(speed * spread**2 * np.exp(-(spread**2) / 2), rel=spread**4 / 8)


@pytest.mark.parametrize("rank", [0, 1])
def test_sigma_points_bear_what_is_known_exactly(rank):
    """A singular covariance is the limit of regular ones."""
    x, z, line = np.array([6.0, 8.0, 0.0, 1.0]), 12.0, np.array([3.0, -1.0])
    P = np.diag([0.0, 0.0, 0.1, 0.2])
    P[:2, :2] = rank * np.outer(line, line)
    kernel, sensor = SigmaPoint(), Range(sigma=0.5)
    mean, covariance = function(kernel, sensor)(x, P, z)
    near = P + np.diag([1e-9, 1e-9, 0.0, 0.0])
    mean_near, covariance_near = function(kernel, sensor)(x, near, z)
    np.testing.assert_allclose(mean, mean_near, atol=1e-6)
    np.testing.assert_allclose(covariance, covariance_near, atol=1e-6)
    _, S, H = function(kernel, sensor, method="innovation")(x, P, z)
    if rank == 0:
        np.testing.assert_allclose(H, [0.6, 0.8, 0.0, 0.0], rtol=1e-12)
        assert pytest.approx(0.25, rel=1e-12) == S


def test_square_root_of_a_singular_covariance_gives_it_back():
    rng = np.random.default_rng(8)
    thin = rng.normal(size=(5, 3))
    thin[1] = 0.0  # known exactly
    P = thin @ thin.T
    L = ca.DM(ca.evalf(square_root(ca.SX(ca.DM(P))))).full()
    np.testing.assert_array_equal(L, np.tril(L))
    np.testing.assert_allclose(L @ L.T, P, atol=1e-13)
    assert np.count_nonzero(np.abs(L).sum(axis=0) > 1e-6) == 3


@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_sigma_points_of_a_bearing_do_not_see_where_angles_begin(turns):
    """A beacon to the west: bearings of points lie on both sides of the half turn."""
    x, P = np.array([-10.0, 0.2, 0.0, 1.0]), np.diag([1.0, 4.0, 0.1, 0.1])
    z = np.pi + 0.1 + 2 * np.pi * turns
    mean, covariance = function(SigmaPoint(), Bearing(sigma=0.1))(x, P, z)
    there, spread = function(SigmaPoint(), Bearing(sigma=0.1))(-x, P, 0.1)
    np.testing.assert_allclose(mean[:2], -there[:2], rtol=1e-12)
    np.testing.assert_allclose(covariance, spread, rtol=1e-12, atol=1e-15)


def posterior(x, P, z, sigma):
    """Twice the negative logarithm of the density of a place after a range to the origin."""
    information = np.linalg.inv(P)
    return lambda s: (s - x) @ information @ (s - x) + ((z - np.hypot(*s)) / sigma) ** 2


def ellipses(count, rng):
    """Places, their covariances, and ranges to the origin that fit: many long, near and precise."""
    for _ in range(count):
        P = turned(rng.uniform(0, np.pi), rng.uniform(5, 60), rng.uniform(0.5, 10))
        x = rng.normal(size=2) * 60
        true = x + np.linalg.cholesky(P) @ rng.normal(size=2)
        yield x, P, float(np.hypot(*true)) + rng.normal()


def above_the_best(kernel, cases):
    """By how much twice the negative log density exceeds the least near the mean, of each case."""
    update, found = function(kernel, Range(), 2), []
    for x, P, z in cases:
        density = posterior(x, P, z, 1.0)
        best = minimize(density, x, method="BFGS")
        found.append(density(update(x, P, z)[0]) - best.fun)
    return np.array(found)


def test_iterated_filter_finds_the_most_probable_place(monkeypatch):
    cases = [*ellipses(30, np.random.default_rng(1))]
    assert above_the_best(IteratedEkf(iterations=12), cases).max() < 1e-4
    assert np.mean(above_the_best(IteratedEkf(), cases) < 0.1) > 0.95
    assert np.mean(above_the_best(Ekf(), cases) < 0.1) < 0.7
    monkeypatch.setattr("obsplan.estimators.iterated.SHARES", (1.0,))
    assert above_the_best(IteratedEkf(iterations=12), cases).max() > 10  # they run to and fro


def test_covariance_of_the_iterated_filter_is_that_of_the_tangent_at_the_most_probable_place():
    x, P, z, sigma = np.array([30.0, 10.0]), turned(1.0, 5.0, 2.0), 27.0, 0.7
    mean, covariance = function(IteratedEkf(iterations=12), Range(sigma=sigma), 2)(x, P, z)
    H = mean / np.hypot(*mean)
    information = np.linalg.inv(P) + np.outer(H, H) / sigma**2
    np.testing.assert_allclose(covariance, np.linalg.inv(information), rtol=1e-9)


def test_iterated_filter_finds_the_most_probable_place_of_a_bearing():
    """Bearings bend either way, so the step that counts curvature may lead up."""
    x, P, sensor = np.array([8.0, 3.0]), turned(1.0, 6.0, 3.0), Bearing(sigma=0.05)
    update = function(IteratedEkf(iterations=12), sensor, 2)
    for z in (-0.4, 0.3, 1.2):

        def density(s, z=z):
            away = s - x
            nu = (z - np.arctan2(s[1], s[0])) / 0.05
            return away @ np.linalg.inv(P) @ away + nu**2

        best = minimize(density, x, method="BFGS")
        assert density(update(x, P, z)[0]) < best.fun + 1e-4


@pytest.mark.parametrize("kernel", [SecondOrderEkf(), SigmaPoint()], ids=["second", "points"])
def test_innovation_of_a_near_range_has_its_true_mean_and_variance(kernel):
    """A place that is known along the line of sight, and not across: the EKF has neither."""
    x, P, sensor = np.array([40.0, 0.0]), np.diag([0.2**2, 8.0**2]), Range(sigma=0.5)
    mean, variance = moments(lambda s: np.hypot(*s), lambda s: 0.25 + 0 * s[0], x, P)
    nu, S, _ = function(kernel, sensor, 2, method="innovation")(x, P, mean)
    flat_nu, flat_S, _ = function(Ekf(), sensor, 2, method="innovation")(x, P, mean)
    fourth = 8.0**2 / 40.0**2  # the next order is smaller by so much, times 3/4 and 3
    assert abs(nu) < fourth * abs(flat_nu)
    assert abs(S - variance) < 3 * fourth * abs(flat_S - variance)
    assert flat_nu > 0.7
    assert flat_S < 0.3 * variance


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0])
def test_second_order_filter_is_exact_of_squared_ranges(angle):
    """Their curvature is all there is."""
    x, P, sensor = np.array([5.0, -3.0]), turned(angle, 6.0, 2.0), SquaredRange(sigma=4.0)
    mean, variance = moments(lambda s: np.sum(s**2, axis=0), lambda s: 16.0 + 0 * s[0], x, P)
    nu, S, H = function(SecondOrderEkf(), sensor, 2, method="innovation")(x, P, mean)
    assert nu == pytest.approx(0.0, abs=1e-9)
    assert pytest.approx(variance, rel=1e-10) == S
    np.testing.assert_allclose(H, 2 * x, rtol=1e-12)
    flat_nu, flat_S, _ = function(Ekf(), sensor, 2, method="innovation")(x, P, mean)
    assert flat_nu == pytest.approx(np.trace(P))
    assert flat_S < 0.95 * variance


def test_sigma_points_count_errors_that_grow_with_distance_over_the_whole_ellipse():
    x, P = np.array([5.0, -3.0]), turned(0.4, 6.0, 4.0)
    growing, plain = Range(sigma=0.5, growth=0.2), Range(sigma=0.5)
    S, without = (
        function(SigmaPoint(), sensor, 2, method="innovation")(x, P, 5.0)[1]
        for sensor in (growing, plain)
    )
    assert S - without == pytest.approx(0.04 * (x @ x + np.trace(P)), rel=1e-12)


@pytest.mark.parametrize("kind", ["ekf", "second-order", "sigma-point"])
@pytest.mark.parametrize(
    ("sensor", "z"), [(Range(sigma=0.5, growth=0.05), 14.0), (Heading(sigma=0.1), 0.5 + 2 * np.pi)]
)
def test_update_follows_from_the_innovation(kind, sensor, z):
    x, P = np.array([9.0, -5.0, 0.4, 1.2]), np.diag([16.0, 9.0, 0.1, 0.2])
    P[0, 1] = P[1, 0] = 5.0
    nu, S, H = function(ESTIMATORS[kind](), sensor, method="innovation")(x, P, z)
    mean, covariance = function(ESTIMATORS[kind](), sensor)(x, P, z)
    np.testing.assert_allclose(mean, x + P @ H / S * nu, rtol=1e-12)
    np.testing.assert_allclose(covariance, P - np.outer(P @ H, P @ H) / S, atol=1e-12)


@pytest.mark.parametrize("kind", ESTIMATORS)
def test_compass_costs_every_filter_what_it_costs_the_ekf(kind):
    x, P, z, beacon = ca.SX.sym("x", 4), ca.SX.sym("P", 4, 4), ca.SX.sym("z"), ca.SX.sym("b", 10)
    costs = [
        ca.Function(
            "update", [x, P, z, beacon], list(kernel().update(x, P, z, Heading(sigma=0.1), beacon))
        ).n_instructions()
        for kernel in (Ekf, ESTIMATORS[kind])
    ]
    assert costs[0] == costs[1]


UNSURE = {
    "origin": {"lat": 63.44, "lon": 10.40},
    "cna": {"speed": 2.0, "min_turn_radius": 10.0, "start": {"x": -50.0, "y": 0.0}},
    "auv": [
        {
            "speed": 1.2,
            "survey": {"kind": "lawnmower", "legs": 6, "length": 200.0, "spacing": 30.0},
            "first_estimate": {
                "sigma_position": 25.0,
                "sigma_heading_deg": 2.0,
                "sigma_speed": 0.3,
            },
            "process_noise": {"position": 0.03, "heading_deg": 0.1, "speed": 0.01},
        }
    ],
    "planner": {"kind": "trail"},
}


def lost(kind):
    """How many of 20 missions of an AUV that begins unsure of where it is end far off.

    Of one hypothesis: several lose none, whatever filter each of them has.
    """
    alone = {"kind": kind, "hypotheses": 1, "gate": 0.0}
    scenario = op.from_dict({**UNSURE, "estimator": alone})
    return sum(op.simulate(scenario, seed=seed).rms_error > 150 for seed in range(20))


@pytest.mark.slow
def test_filters_that_count_curvature_lose_fewer_auvs():
    assert max(lost("second-order"), lost("sigma-point")) < lost("ekf") / 2


@pytest.mark.parametrize("kind", ESTIMATORS)
def test_every_kind_flies_from_a_file(kind):
    scenario = op.from_dict(
        {**UNSURE, "duration": 60.0, "estimator": {"kind": kind, "hypotheses": 1}}
    )
    run = op.simulate(scenario, seed=1)
    assert np.isfinite(run.mean).all()
    spread = np.trace(run.covariance[0, :, :2, :2], axis1=1, axis2=2)
    assert spread[-1] < 0.8 * spread[0]


@pytest.mark.parametrize("iterations", [0, 21])
def test_iterations_are_bounded(iterations):
    with pytest.raises(op.ObsplanError, match=r"estimator.iterations.*from 1 to 20"):
        op.from_dict({**UNSURE, "estimator": {"kind": "iterated-ekf", "iterations": iterations}})
    with pytest.raises(ValueError, match="iterations must be from 1 to 20"):
        IteratedEkf(iterations=iterations)
