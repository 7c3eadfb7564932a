import math

import casadi as ca
import numpy as np
import pytest

from obsplan.estimators import Ekf
from obsplan.sensors import SPEED_SENSORS, Dvl, WaterSpeed
from obsplan.sensors.sensor import BEACON
from obsplan.vehicles import STATES
from obsplan.water import Tide, Water

PROFILE = ((10.0, 0.4, 0.0), (30.0, 0.2, -0.1), (100.0, 0.0, -0.1))


@pytest.mark.parametrize(
    ("depth", "added"),
    [
        (0.0, (0.4, 0.0)),  # above the first row
        (10.0, (0.4, 0.0)),
        (15.0, (0.35, -0.025)),  # a quarter of the way
        (65.0, (0.1, -0.1)),
        (4000.0, (0.0, -0.1)),  # below the last
    ],
)
def test_current_is_linear_between_the_depths_of_a_profile_which_adds_to_the_uniform_one(
    depth, added
):
    water = Water(current=(0.1, 0.2), profile=PROFILE)
    np.testing.assert_allclose(water.at(0.0, depth), np.add((0.1, 0.2), added), atol=1e-15)


def test_tide_is_greatest_at_its_phase_and_turns_half_a_period_later():
    water = Water(current=(0.1, 0.0), tide=Tide(amplitude=(0.3, -0.4), period=4000.0, phase=np.pi))
    times = np.array([0.0, 1000.0, 2000.0, 3000.0])
    found = water.at(times, 5.0) - (0.1, 0.0)
    np.testing.assert_allclose(found, [[-0.3, 0.4], [0, 0], [0.3, -0.4], [0, 0]], atol=1e-15)


def test_mean_is_that_over_a_tide_and_the_strongest_current_is_never_exceeded():
    water = Water(
        current=(0.1, 0.2),
        profile=PROFILE,
        tide=Tide(amplitude=(0.3, 0.1), period=600.0, phase=1.0),
    )
    times, depths = np.arange(600.0), np.array([0.0, 20.0, 50.0])
    found = water.at(times[:, None], depths)
    assert found.shape == (600, 3, 2)
    np.testing.assert_allclose(found.mean(axis=0), water.mean(depths), atol=1e-14)
    speed = np.linalg.norm(found, axis=-1).max(axis=0)
    # the nearest sample is half a second off the peak: relatively (π / 600)² / 2 of the tide
    np.testing.assert_allclose(speed, water.strongest(depths), rtol=2e-5)
    assert (speed <= water.strongest(depths) + 1e-15).all()


def test_still_water_is_uniform_and_at_rest():
    assert Water().is_uniform
    np.testing.assert_array_equal(Water().at(np.zeros(3), 7.0), np.zeros((3, 2)))
    assert not Water(profile=PROFILE).is_uniform
    assert not Water(tide=Tide()).is_uniform


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda: Water(current=(11.0, 0.0)), "current must be from -10 to 10 m/s .*, got 11.0"),
        (lambda: Water(current=(math.nan, 0.0)), "current must be .*, got nan"),
        (
            lambda: Water(profile=((5.0, 0.0, 0.0), (5.0, 0.1, 0.0))),
            "profile must have increasing depths, got 5.0 after 5.0: order it",
        ),
        (lambda: Water(profile=((-1.0, 0.0, 0.0),)), r"profile\[0\] must be a depth from 0"),
        (lambda: Water(profile=((1.0, 0.0, 99.0),)), r"profile\[0\] .*got \[1.0, 0.0, 99.0\]"),
        (lambda: Tide(period=1.0), "period must be from 60 to 2678400 s .*, got 1.0"),
        (lambda: Tide(amplitude=(0.0, -20.0)), "amplitude must be .*, got -20.0"),
        (lambda: Tide(phase=math.inf), r"phase must be finite \[rad\], got inf"),
    ],
)
def test_water_that_no_sea_has_is_refused(build, said):
    with pytest.raises(ValueError, match=said):
        build()


def told(east, north):
    """A beacon of which the current alone is known."""
    beacon = np.zeros(len(BEACON))
    beacon[BEACON.index("east_current")] = east
    beacon[BEACON.index("north_current")] = north
    return beacon


def measured(sensor, x, beacon):
    """What a sensor measures, as a number."""
    s, b = ca.SX.sym("x", len(x)), ca.SX.sym("b", len(beacon))
    return float(ca.Function("z", [s, b], [sensor.measure(s, b)])(x, beacon))


def test_a_log_measures_speed_through_the_water_and_a_dvl_the_velocity_over_ground_from_the_bow():
    rng = np.random.default_rng(1)
    for _ in range(20):
        x, c = rng.normal(size=4), complex(*rng.normal(size=2))
        beacon = told(c.real, c.imag)
        # over ground, turned until the bow points along the real axis
        seen = (x[3] * np.exp(1j * x[2]) + c) * np.exp(-1j * x[2])
        forward, left = Dvl().components([*STATES])
        (log,) = WaterSpeed().components([*STATES])
        assert measured(forward, x, beacon) == pytest.approx(seen.real, abs=1e-14)
        assert measured(left, x, beacon) == pytest.approx(seen.imag, abs=1e-14)
        assert measured(log, x, beacon) == x[3]
        own = [*STATES, "current_east", "current_north"]
        estimated = np.array([*x, c.real, c.imag])
        for component, z in zip(Dvl().components(own), (seen.real, seen.imag), strict=True):
            assert measured(component, estimated, told(9.0, 9.0)) == pytest.approx(z, abs=1e-14)


def corrected(x, P, z, sensors, beacon):
    """Mean and covariance of an EKF after measurements at once."""
    for value, sensor in zip(z, sensors, strict=True):
        x, P = Ekf().update(x, P, ca.SX(value), sensor, ca.SX(beacon))
    return ca.evalf(x).full().ravel(), ca.evalf(P).full()


@pytest.mark.parametrize("kind", SPEED_SENSORS)
def test_a_filter_finds_its_current_from_a_dvl_beside_a_log_and_not_from_a_log(kind):
    """Speed and heading known well, the DVL's error alone is left of the current's."""
    names = [*STATES, "current_east", "current_north"]
    truth = np.array([0.0, 0.0, 0.6, 1.2, 0.3, -0.2])
    first = np.array([0.0, 0.0, 0.6, 1.2, 0.0, 0.0])
    P = np.diag([1.0, 1.0, 1e-8, 1e-8, 0.25, 0.25])
    sensors = SPEED_SENSORS[kind](sigma=0.01).components(names)
    z = [measured(sensor, truth, told(0.3, -0.2)) for sensor in sensors]
    x, after = corrected(ca.SX(first), ca.SX(P), z, sensors, told(0.0, 0.0))
    sigma = np.sqrt(np.linalg.eigvalsh(after[4:, 4:]))
    if kind == "dvl":
        # 1/σ² = 1/0.01² + 1/0.5², and the same share of the first error is left
        np.testing.assert_allclose(sigma, (1 / 0.01**2 + 1 / 0.5**2) ** -0.5, rtol=1e-3)
        np.testing.assert_allclose(x[4:], truth[4:], rtol=1e-3)
    else:
        np.testing.assert_array_equal(sigma, 0.5)
        np.testing.assert_array_equal(x[4:], 0.0)


@pytest.mark.parametrize("cls", SPEED_SENSORS.values())
def test_a_log_errs_by_the_same_everywhere(cls):
    for sensor in cls(sigma=0.07).components([*STATES]):
        assert sensor.deviation(ca.SX.zeros(4), ca.SX.zeros(len(BEACON))) == 0.07
        assert not sensor.periodic
