"""What a range is worth by distance: information, the best distance, and what no path can beat."""

import math

import casadi as ca
import numpy as np
import pytest

from formulations.certified_bound import information_bound
from formulations.cramer_rao import (
    posterior_cramer_rao,
    range_information,
    ranging_information,
    squared_range_information,
)
from formulations.model.covariance import conditioned
from formulations.model.ranging import Ranging
from formulations.model.worth import best_distance, least_sigma
from obsplan.sensors import Range
from obsplan.sensors.sensor import BEACON

GROWING = Ranging(1.0, growth=0.01, slant=True)


def divergence(x, moved, ranging, height):
    """Kullback-Leibler divergence of a range's distribution from that at a target moved (east, north, down)."""

    def gaussian(east, north, down):
        up = height + down if ranging.slant else 0.0
        r = math.sqrt((x[0] - east) ** 2 + (x[1] - north) ** 2 + up**2)
        return r**2 if ranging.squared else r, math.hypot(ranging.sigma, ranging.growth * r)

    (m, s), (m1, s1) = gaussian(0.0, 0.0, 0.0), gaussian(*moved)
    return math.log(s1 / s) + (s**2 + (m - m1) ** 2) / (2 * s1**2) - 0.5


def curvature(x, ranging, height):
    """Its second derivatives, central differences."""
    h, J = 1e-3, np.empty((3, 3))
    for i, j in np.ndindex(3, 3):
        a, b = h * np.eye(3)[i], h * np.eye(3)[j]
        corners = [(a + b, 1), (a - b, -1), (b - a, -1), (-a - b, 1)]
        J[i, j] = sum(sign * divergence(x, moved, ranging, height) for moved, sign in corners)
    return J / (4 * h**2)


@pytest.mark.parametrize(
    "ranging",
    [
        Ranging(0.3, growth=0.5),
        Ranging(0.3, growth=0.5, slant=True),
        Ranging(0.7, slant=True),
        Ranging(5.0, squared=True),
    ],
    ids=str,
)
def test_information_is_the_curvature_of_the_divergence(ranging):
    rng = np.random.default_rng(3)
    x, height = rng.normal(size=(5, 2)) * 8, rng.uniform(3, 12, size=5)
    J = ranging_information(x, ranging, height)
    deep = ranging_information(x, ranging, height, with_depth=True)
    for k in range(5):
        expected = curvature(x[k], ranging, height[k])
        scale = np.abs(expected).max()
        # differences of order h^2, and their rounding eps / h^2
        np.testing.assert_allclose(deep[k], expected, atol=1e-5 * scale)
        np.testing.assert_array_equal(deep[k][:2, :2], J[k])


def test_plain_ranges_tell_what_they_always_told_and_lost_ones_nothing():
    x = np.array([[3.0, 4.0], [0.0, 0.0], [-60.0, 80.0]])
    for told, squared in ((range_information, False), (squared_range_information, True)):
        J = ranging_information(x, Ranging(2.0, squared=squared), 7.0)
        np.testing.assert_allclose(J, told(x, np.zeros(2), 2.0), rtol=1e-15)
    lossy = Ranging(2.0, loss=0.2, half_distance=10.0, reach=50.0)
    came, expected = (ranging_information(x, lossy, expected=flag) for flag in (False, True))
    share = [0.8 * 2 ** -(5**2 / 10**2), 1.0, 0.0]
    np.testing.assert_allclose(expected, came * np.reshape(share, (3, 1, 1)), rtol=1e-14)


def test_a_slant_range_ties_depth_to_position_as_the_predicted_covariance_does():
    """Of so small a covariance that the range's second-order error is nothing."""
    x, height = np.array([30.0, -20.0]), 15.0
    ranging = Ranging(1e-4, slant=True)
    rng = np.random.default_rng(4)
    root = 1e-4 * rng.normal(size=(3, 3))
    P = root @ root.T
    J = ranging_information(x, ranging, height, with_depth=True)
    expected = np.linalg.inv(np.linalg.inv(P) + J)
    after = conditioned(P, x, ranging, 1.0, height)
    np.testing.assert_allclose(after, expected, atol=1e-6 * np.abs(P).max())


@pytest.mark.parametrize(("depth", "radius"), [(50.0, 74.8), (200.0, 211.5), (1000.0, 1002.5)])
def test_the_best_distance_over_a_known_depth_is_that_of_the_closed_form(depth, radius):
    assert float(best_distance(GROWING, depth)) == pytest.approx(radius, abs=0.05)


LOSSY = [
    Ranging(1.0, slant=True, half_distance=300.0),
    Ranging(1.0, slant=True, reach=150.0),
    Ranging(1.0, growth=0.02, slant=True, loss=0.3, half_distance=200.0, reach=120.0),
]


@pytest.mark.parametrize("ranging", LOSSY, ids=str)
@pytest.mark.parametrize("height", [10.0, 60.0, 300.0])
def test_the_best_distance_is_where_brute_force_expects_most(ranging, height):
    d = np.arange(1, 400_001) * 1e-3
    r = np.hypot(d, height)
    arrives = 2.0 ** -((r / ranging.half_distance) ** 2)
    if ranging.reach < math.inf:
        arrives = arrives / (1 + np.exp((r / ranging.reach - 1) / 0.05))
    expected = arrives * (d / r) ** 2 / (ranging.sigma**2 + (ranging.growth * r) ** 2)
    assert float(best_distance(ranging, height)) == pytest.approx(d[expected.argmax()], abs=0.01)


def test_there_is_no_best_distance_where_farther_or_nearer_always_is_better():
    assert best_distance(Ranging(1.0, growth=0.01), 50.0) == 0.0
    assert float(best_distance(Ranging(1.0, slant=True, loss=0.5), 50.0)) == math.inf
    assert best_distance(Ranging(1.0, squared=True), 50.0) == math.inf


def told_along(d, ranging, height):
    """Information along the horizontal line of sight, the growth's by differences of the deviation."""
    r = np.hypot(d, height if ranging.slant else 0.0)
    step = 1e-6 * r
    sigma = np.hypot(ranging.sigma, ranging.growth * r)
    further = np.hypot(ranging.sigma, ranging.growth * (r + step))
    nearer = np.hypot(ranging.sigma, ranging.growth * (r - step))
    slope = (further - nearer) / (2 * step)
    return (d / r) ** 2 * (1 + 2 * slope**2) / sigma**2


@pytest.mark.parametrize("seed", range(12))
def test_no_distance_within_bounds_tells_more_than_the_least_sigma_and_one_does_as_much(seed):
    rng = np.random.default_rng(seed)
    ranging = Ranging(
        10 ** rng.uniform(-2, 1), growth=10 ** rng.uniform(-4, 0), slant=bool(seed % 3)
    )
    height = 10 ** rng.uniform(0, 3)
    nearest, farthest = np.sort(10 ** rng.uniform(-1, 4, size=2))
    least = float(least_sigma(ranging, nearest, farthest, height))
    d = np.geomspace(nearest, farthest, 200_001)
    most = told_along(d, ranging, height).max()
    assert 1 / least**2 == pytest.approx(most, rel=1e-7)
    assert 1 / least**2 >= most * (1 - 1e-9)  # rounding of the differences


def test_the_least_sigma_of_plain_and_squared_ranges_is_what_it_was():
    far = np.array([7.0, 3e3])
    assert (least_sigma(Ranging(0.3), 0.0, far) == 0.3).all()
    np.testing.assert_array_equal(least_sigma(Ranging(0.3, squared=True), 0.0, far), 0.3 / 2 / far)
    assert float(least_sigma(Ranging(0.3, slant=True), 0.0, 0.0, 5.0)) > 1e6  # from right above
    assert float(least_sigma(Ranging(0.3, growth=0.1), 0.0, 9.0)) == pytest.approx(0.3, rel=0.02)


def test_ranges_come_from_within_reach_alone():
    ranging = Ranging(0.3, slant=True, reach=13.0)
    assert float(least_sigma(ranging, 0.0, 500.0, 5.0)) == pytest.approx(0.3 * 13 / 12, rel=1e-12)


@pytest.mark.parametrize(("nearest", "farthest"), [(-1.0, 2.0), (3.0, 2.0), (0.0, math.inf)])
def test_least_sigma_refuses_distances_that_are_none(nearest, farthest):
    with pytest.raises(ValueError, match="distances must be finite, and the nearest from 0"):
        least_sigma(GROWING, nearest, farthest, 5.0)


def test_a_circle_at_the_best_distance_reaches_the_bound_and_no_path_beats_it():
    """A static AUV of isotropic prior; the bound for the nearest distance alone is beaten."""
    steps, height = 24, 50.0
    static = {
        "P0": 100.0 * np.eye(2),
        "F": np.tile(np.eye(2), (steps, 1, 1)),
        "Q": np.zeros((2, 2)),
        "J_other": np.zeros((steps, 2, 2)),
        "pings": np.arange(steps),
        "weights": np.eye(steps + 1)[-1],
    }
    bound = information_bound(**static, sigma=float(least_sigma(GROWING, 0.0, 500.0, height)))
    at_20_m = information_bound(**static, sigma=float(least_sigma(GROWING, 20.0, 20.0, height)))

    def covariances(x):
        J = ranging_information(x, GROWING, height)
        return posterior_cramer_rao(static["P0"], static["F"], static["Q"], J)

    bearing = 2 * np.pi * np.arange(steps) / 12
    circle = np.column_stack([np.cos(bearing), np.sin(bearing)])
    efficiency = {d: bound.efficiency(covariances(d * circle)) for d in (20.0, 74.77, 400.0)}
    assert efficiency[74.77] == pytest.approx(1.0, abs=1e-6)
    assert max(efficiency[20.0], efficiency[400.0]) < 0.8
    rng = np.random.default_rng(5)
    for _ in range(200):
        turns = np.cumsum(rng.normal(size=steps) * rng.choice([0.02, 0.3, 2.0]))
        moves = 15.0 * np.column_stack([np.cos(turns), np.sin(turns)])
        assert bound.efficiency(covariances(rng.normal(size=2) * 40 + moves.cumsum(axis=0))) <= 1
    assert at_20_m.efficiency(covariances(74.77 * circle)) > 1.2


@pytest.mark.parametrize("depth_sigma", [0.0, 0.5, 20.0])
def test_no_range_of_a_sensor_tells_more_along_the_line_of_sight_than_the_least_sigma(depth_sigma):
    """By differentiation of the sensor itself; depths that are measured with error only take away."""
    rng = np.random.default_rng(9)
    for growth in (0.0, 0.003, 0.3):
        sensor = Range(sigma=0.6, growth=growth, geometry="slant", depth_sigma=depth_sigma)
        x, height = rng.normal(size=(500, 2)) * 10 ** rng.uniform(0, 3, size=(500, 1)), 35.0
        beacon = np.zeros((len(BEACON), 500))
        beacon[:2], beacon[BEACON.index("depth")] = x.T, 5.0
        beacon[BEACON.index("auv_depth")] = 5.0 + height
        state, there = ca.SX.sym("x", 4), ca.SX.sym("b", len(BEACON))
        sigma = ca.SX(sensor.deviation(state, there))
        h, s = (ca.jacobian(of, state) for of in (sensor.measure(state, there), sigma))
        fisher = ca.Function("J", [state, there], [ca.vec((h.T @ h + 2 * s.T @ s) / sigma**2)])
        J = fisher.map(500)(np.zeros((4, 500)), beacon).full().T.reshape(500, 4, 4)
        u = x / np.linalg.norm(x, axis=1, keepdims=True)
        along = np.einsum("ki,kij,kj->k", u, J[:, :2, :2], u)
        d = np.linalg.norm(x, axis=1)
        most = 1 / least_sigma(sensor.ranging, d.min(), d.max(), height) ** 2
        assert along.max() <= most * (1 + 1e-12)
        if not depth_sigma:
            told = ranging_information(x, sensor.ranging, height)
            np.testing.assert_allclose(J[:, :2, :2], told, rtol=1e-9, atol=1e-15)
