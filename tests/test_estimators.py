from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from pykalman import KalmanFilter

from obsplan.estimators import ESTIMATORS, Ekf, Process
from obsplan.sensors import Heading, Range, SquaredRange
from obsplan.vehicles import State


@dataclass(frozen=True)
class LinearSensor:
    """A weighted sum of the states."""

    row: tuple
    sigma: float
    periodic: bool = False

    def measure(self, x, beacon):
        return ca.dot(ca.DM(self.row), x)

    def deviation(self, x, beacon):
        return self.sigma


@dataclass(frozen=True)
class LinearVehicle:
    """x+ = A x + B u."""

    A: tuple
    B: tuple

    @property
    def states(self):
        return dict.fromkeys(map(str, range(len(self.A))), State("1"))

    def step(self, x, u, dt):
        return ca.DM(self.A) @ x + ca.DM(self.B) @ u


def linear(A, B, variances):
    """What a filter of a linear vehicle assumes, a sample being a second."""
    vehicle = LinearVehicle(A.tolist(), B.tolist())
    return Process(model=vehicle, noise=tuple(np.sqrt(variances)), dt=1.0)


every_kind = pytest.mark.parametrize("kind", ESTIMATORS)


def updated(sensor, n=4, kind="ekf"):
    """A filter's update as a Function of mean, covariance, measurement and beacon."""
    x, P, z, beacon = (
        ca.SX.sym("x", n),
        ca.SX.sym("P", n, n),
        ca.SX.sym("z"),
        ca.SX.sym("beacon", 2),
    )
    after = ESTIMATORS[kind]().update(x, P, z, sensor, beacon)
    return ca.Function("update", [x, P, z, beacon], list(after))


def positive(rng, n, scale=1.0):
    """A random covariance."""
    A = rng.normal(size=(n, n))
    return scale * (A @ A.T + 0.1 * np.eye(n))


@every_kind
@pytest.mark.parametrize("seed", range(3))
def test_filter_of_a_linear_system_is_the_kalman_filter_of_pykalman(seed, kind):
    rng = np.random.default_rng(seed)
    A, B, C = rng.normal(size=(3, 3)) * 0.6, rng.normal(size=(3, 2)), rng.normal(size=3)
    Q, P0, sigma = np.diag(rng.uniform(0.01, 0.3, 3)), positive(rng, 3), 0.7
    x0, u, z = rng.normal(size=3), rng.normal(size=(40, 2)), rng.normal(size=40)

    kernel, sensor = ESTIMATORS[kind](), LinearSensor(tuple(C), sigma)
    process = linear(A, B, np.diag(Q))
    x, P, control, measured = (
        ca.SX.sym("x", 3),
        ca.SX.sym("P", 3, 3),
        ca.SX.sym("u", 2),
        ca.SX.sym("z"),
    )
    step = ca.Function(
        "step",
        [x, P, control, measured],
        list(kernel.update(*kernel.predict(x, P, control, process), measured, sensor, ca.SX(0))),
    )
    means, covariances = [x0], [P0]
    for k in range(40):
        mean, covariance = step(means[-1], covariances[-1], u[k], z[k])
        means.append(mean.full().ravel())
        covariances.append(covariance.full())

    theirs = KalmanFilter(
        transition_matrices=A,
        observation_matrices=C[None, :],
        transition_covariance=Q,
        observation_covariance=[[sigma**2]],
        transition_offsets=np.array([B @ each for each in u]),
        initial_state_mean=x0,
        initial_state_covariance=P0,
    )
    unmeasured = np.ma.masked_array(np.append(0.0, z), mask=[True] + [False] * 40)[
        :, None
    ]  # nothing is measured at time 0
    their_means, their_covariances = theirs.filter(unmeasured)
    np.testing.assert_allclose(means, their_means, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(covariances, their_covariances, rtol=1e-10, atol=1e-10)


def test_update_is_the_conditional_gaussian_of_mean_and_measurement():
    rng = np.random.default_rng(9)
    x, P, beacon, z, sigma = rng.normal(size=4), positive(rng, 4), np.array([4.0, -3.0]), 4.4, 0.5
    away = x[:2] - beacon
    H = np.array([*away / np.hypot(*away), 0.0, 0.0])
    joint = np.block(
        [[P, (P @ H)[:, None]], [(H @ P)[None, :], np.array([[H @ P @ H + sigma**2]])]]
    )
    mean, covariance = updated(Range(sigma=sigma))(x, P, z, beacon)
    np.testing.assert_allclose(
        np.linalg.inv(covariance.full()), np.linalg.inv(joint)[:4, :4], rtol=1e-9
    )  # Schur complement
    np.testing.assert_allclose(
        mean.full().ravel(), x + joint[:4, 4] / joint[4, 4] * (z - np.hypot(*away)), rtol=1e-12
    )


@every_kind
@pytest.mark.parametrize("turns", [-3, 0, 1])
def test_innovation_of_the_heading_does_not_count_whole_turns(turns, kind):
    x, P = np.array([0.0, 0.0, 3.1, 1.0]), np.diag([1.0, 1.0, 0.04, 1.0])
    mean, covariance = updated(Heading(sigma=0.2), kind=kind)(
        x, P, 3.3 + 2 * np.pi * turns, [0.0, 0.0]
    )
    assert mean.full()[2, 0] == pytest.approx(3.2, abs=1e-12)  # half way: P and R are equal
    assert covariance.full()[2, 2] == pytest.approx(0.02, abs=1e-15)


def test_innovation_of_a_range_is_not_wrapped():
    mean, _ = updated(Range(sigma=1e-6))(
        np.array([10.0, 0.0, 0.0, 0.0]), np.eye(4), 30.0, [0.0, 0.0]
    )
    assert mean.full()[0, 0] == pytest.approx(30.0, abs=1e-6)


@every_kind
@pytest.mark.parametrize(
    "sensor", [Range(sigma=1e-3), SquaredRange(sigma=1e-3), Heading(sigma=1e-6)]
)
def test_covariance_stays_symmetric_and_positive_after_ten_thousand_precise_updates(sensor, kind):
    rng, count = np.random.default_rng(4), 10_000
    x, P = np.array([0.0, 0.0, 0.5, 1.0]), np.diag([1e4, 1e4, 1.0, 1.0])
    bearing = rng.uniform(-np.pi, np.pi, count)
    beacons = 50.0 * np.stack([np.cos(bearing), np.sin(bearing)])
    z = {"Range": 50.0, "SquaredRange": 2500.0, "Heading": 0.5}[type(sensor).__name__]
    means, covariances = updated(sensor, kind=kind).mapaccum("all", count, 2)(
        x, P, np.full((1, count), z), beacons
    )
    P = covariances.full().T.reshape(count, 4, 4)
    np.testing.assert_array_equal(P, np.swapaxes(P, 1, 2))
    eigenvalues = np.linalg.eigvalsh(P)
    assert (
        eigenvalues >= -4 * np.finfo(float).eps * eigenvalues[:, -1:]
    ).all()  # what LAPACK can tell of zero
    assert np.isfinite(means.full()).all()


def test_prediction_keeps_the_covariance_symmetric_to_the_last_bit():
    rng = np.random.default_rng(5)
    A, Q, P0 = rng.normal(size=(4, 4)), np.diag(rng.uniform(0.1, 1.0, 4)), positive(rng, 4)
    x, P, u = ca.SX.sym("x", 4), ca.SX.sym("P", 4, 4), ca.SX.sym("u", 2)
    after = Ekf().predict(x, P, u, linear(A, np.zeros((4, 2)), np.diag(Q)))
    predicted = ca.Function("predict", [x, P, u], list(after))(np.zeros(4), P0, np.zeros(2))[
        1
    ].full()
    np.testing.assert_array_equal(predicted, predicted.T)
    np.testing.assert_allclose(predicted, A @ P0 @ A.T + Q, rtol=1e-13)


@every_kind
@pytest.mark.parametrize("sensor", [Range(sigma=0.5), SquaredRange(sigma=0.5)])
def test_range_on_top_of_the_beacon_leaves_the_estimate_as_it_is(sensor, kind):
    x, P = np.array([3.0, 4.0, 0.1, 1.0]), np.diag([4.0, 9.0, 0.1, 0.2])
    mean, covariance = updated(sensor, kind=kind)(x, P, 1.0, [3.0, 4.0])
    np.testing.assert_array_equal(mean.full().ravel(), x)
    np.testing.assert_array_equal(covariance.full(), P)
