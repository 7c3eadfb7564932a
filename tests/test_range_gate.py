"""What a filter makes of ranges that it does not expect: each is rejected with its reason, and none shuts it off from the truth."""

from dataclasses import replace

import numpy as np
import pytest
from filters import beacon_at, course, filter_of, flown, ranges_of
from oracles import NumpyEkf
from oracles import scenario as two_auvs
from scipy.stats import chi2

import obsplan as op
from obsplan.estimators.filtering import Filtering
from obsplan.fates import Fate
from obsplan.replay.estimate import estimate
from obsplan.sensors import Range

PATIENCE = Filtering.patience
MEAN, SIGMAS = (0.0, 0.0, 0.0, 1.0), (3.0, 1.0, 0.05, 0.1)
EAST = beacon_at(100.0, 0.0)
# deviation of the innovation of a range to the east: of the position, and of the range
EXPECTED = np.hypot(3.0, 1.0)


@pytest.mark.parametrize(
    ("z", "told", "fate"),
    [
        (100.0 + 3.99 * EXPECTED, EAST, Fate.ACCEPTED),
        (100.0 - 3.99 * EXPECTED, EAST, Fate.ACCEPTED),
        (100.0 + 4.01 * EXPECTED, EAST, Fate.INNOVATION),
        (100.0 - 4.01 * EXPECTED, EAST, Fate.INNOVATION),
        # four standard deviations of the range itself are granted
        (303.9, beacon_at(300.0, 0.0), Fate.ACCEPTED),
        (304.1, beacon_at(300.0, 0.0), Fate.OUT_OF_REACH),
    ],
)
def test_a_range_is_rejected_for_what_is_wrong_with_it(z, told, fate):
    one = filter_of(MEAN, SIGMAS, gate=4.0, reach=300.0)
    mean, covariance = one.mean.tobytes(), one.covariance.tobytes()
    outcome = one.range(z, Range(sigma=1.0), told, 0)
    assert outcome.fate == fate
    assert outcome.innovation == pytest.approx(z - told[0], abs=1e-12)
    assert outcome.variance == pytest.approx(EXPECTED**2, rel=1e-12)
    unchanged = one.mean.tobytes() == mean and one.covariance.tobytes() == covariance
    assert unchanged == (fate != Fate.ACCEPTED)


@pytest.mark.parametrize(("z", "fate"), [(27.0, Fate.ACCEPTED), (25.9, Fate.SHORTER_THAN_DEPTH)])
def test_a_slant_range_cannot_be_shorter_than_depths_are_apart(z, fate):
    # straight above, where what is expected has no slope and position no part in it
    one = filter_of((0.0, 0.0, 0.0, 1.0), SIGMAS, gate=4.0, slant=True)
    outcome = one.range(
        z, Range(geometry="slant"), beacon_at(0.0, 0.0, depth=5.0, auv_depth=35.0), 0
    )
    assert outcome.fate == fate


def test_ranges_that_fit_are_taken_as_a_plain_filter_takes_them():
    rng = np.random.default_rng(3)
    places, noise = course(60, turn=0.03), np.array([0.05, 0.05, 0.005, 0.01])
    beacons = np.array([[40.0, 30.0 - k] for k in range(61)])
    ranges = ranges_of(places, beacons, rng)
    first = ((1.0, -2.0, 0.02, 1.05), (2.0, 2.0, 0.05, 0.1))
    gated = flown(filter_of(*first, gate=5.0), ranges, beacons, turn=0.03)
    free = flown(filter_of(*first), ranges, beacons, turn=0.03)
    assert set(gated[2]) == {Fate.ACCEPTED}
    assert gated[0].tobytes() == free[0].tobytes()
    assert gated[1].tobytes() == free[1].tobytes()
    plain = NumpyEkf(
        np.array(first[0]), np.diag(np.array(first[1]) ** 2), np.diag(noise**2), 1.0, (0.0, 0.0)
    )
    for k, (z, place) in enumerate(zip(ranges, beacons, strict=True)):
        if k:
            plain.predict(0.03, 0.0)
        plain.range(z, place, 1.0, squared=False)
        np.testing.assert_allclose(free[0][k], plain.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(free[1][k], plain.P, rtol=1e-8, atol=1e-10)


def test_an_outlier_leaves_the_track_as_it_was():
    rng = np.random.default_rng(4)
    places = course(60, turn=0.03)
    beacons = np.array([[40.0, 30.0 - k] for k in range(61)])
    ranges = ranges_of(places, beacons, rng)
    false, without = ranges.copy(), ranges.copy()
    false[30] += 20.0
    without[30] = np.nan
    first = (0.0, 0.0, 0.0, 1.0), (2.0, 2.0, 0.05, 0.1)
    kept = flown(filter_of(*first, gate=4.0), false, beacons, turn=0.03)
    clean = flown(filter_of(*first, gate=4.0), without, beacons, turn=0.03)
    pulled = flown(filter_of(*first), false, beacons, turn=0.03)
    assert kept[0].tobytes() == clean[0].tobytes()
    assert kept[1].tobytes() == clean[1].tobytes()
    assert np.hypot(*(pulled[0] - clean[0])[30, :2]) > 1.0


@pytest.mark.parametrize("bearing", [0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi])
def test_a_filter_that_is_sure_and_wrong_is_opened_again_and_finds_the_truth(bearing):
    rng = np.random.default_rng(3)
    places = course(200, turn=0.02)
    angles = 0.05 * np.arange(201)
    beacons = places + 40.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    ranges = ranges_of(places, beacons, rng)
    wrong = 30.0 * np.cos(bearing), 30.0 * np.sin(bearing), 0.0, 1.0
    one = filter_of(wrong, (0.5, 0.5, 0.02, 0.05), gate=4.0)
    means, covariances, fates = flown(one, ranges, beacons, turn=0.02)
    reopened = fates.index(Fate.REOPENED)
    assert fates[reopened - PATIENCE : reopened] == [Fate.INNOVATION] * PATIENCE
    assert set(fates[150:]) == {Fate.ACCEPTED}
    away = means[-1, :2] - places[-1]
    assert np.hypot(*away) < 2.0
    assert away @ np.linalg.inv(covariances[-1, :2, :2]) @ away < chi2.ppf(0.999, 2)


def test_opening_again_and_again_makes_nothing_uncertain_that_the_range_does_not_tell_of():
    one = filter_of((0.0, 0.0, 0.0, 0.0), (1.0, 2.0, 0.1, 0.1), gate=4.0)
    reopened, greatest = 0, 0.0
    for k in range(200):
        outcome = one.range(100.0 + 30.0 * (-1) ** k, Range(sigma=1.0), EAST, 0)
        reopened += outcome.fate == Fate.REOPENED
        greatest = max(greatest, abs(outcome.innovation))
        assert one.covariance[0, 0] < 2.0  # by the range itself 1
    assert reopened > 50
    deviations = np.sqrt(np.diag(one.covariance))
    assert deviations[1] < 0.5 * greatest  # across, as half of the greatest surprise
    np.testing.assert_array_equal(deviations[2:], 0.1)


def test_beacons_are_doubted_each_on_its_own():
    one = filter_of(MEAN, (0.5, 0.5, 0.02, 0.05), gate=4.0, beacons=2)
    false, sensor = 200.0, Range(sigma=1.0)
    fates = []
    for _ in range(PATIENCE):
        fates.append(one.range(false, sensor, EAST, 0).fate)
        fates.append(one.range(100.0, sensor, beacon_at(0.0, 100.0), 1).fate)
    assert fates == [Fate.INNOVATION, Fate.ACCEPTED] * PATIENCE
    assert one.range(false, sensor, EAST, 0).fate == Fate.REOPENED


BACKWARDS = {"speed": 1.0, "start": (0.0, 0.0, np.pi)}


def test_a_heading_half_a_turn_off_does_not_shut_the_ranges_out():
    rng = np.random.default_rng(6)
    places = course(600, turn=0.01, **BACKWARDS)
    posts = np.array([[-60.0, 0.0], [60.0, 20.0], [0.0, -230.0]])
    beacons = posts[np.arange(601) % 3]
    ranges = ranges_of(places, beacons, rng)
    one = filter_of(MEAN, (0.5, 0.5, 0.03, 0.05), gate=4.0)
    means, _, fates = flown(one, ranges, beacons, turn=0.01)
    away = np.hypot(*(means[:, :2] - places).T)
    assert np.mean([not Fate(fate).taken for fate in fates]) < 0.2
    assert np.sqrt(np.mean(away**2)) < 15.0


SEA = {
    "ranging__interval": 1.0,
    "ranging__bearing_sigma_deg": 3.0,
    "estimator": {"kind": "ekf", "gate": 4.0},
    "planner": {"kind": "circle"},
}


@pytest.fixture(scope="module")
def bearings():
    return op.simulate(two_auvs(**SEA), seed=2)


def with_rows(tape, **columns):
    return replace(tape, measurements=tape.measurements._replace(**columns))


def of_rows(tape, rows):
    return replace(tape, measurements=tape.measurements._make(a[rows] for a in tape.measurements))


def same(one, other):
    return (
        one.mean.tobytes() == other.mean.tobytes()
        and one.covariance.tobytes() == other.covariance.tobytes()
    )


def test_a_rejected_range_changes_nothing_and_nor_does_its_bearing(bearings):
    tape, first = op.to_tape(bearings), bearings.mean[:, 0]
    z = tape.measurements
    pair = np.flatnonzero((z.received == z.received[20]) & (z.auv == z.auv[20]))
    assert [[*tape.sensors][k] for k in z.sensor[pair]] == ["range", "bearing"]
    value = z.value.copy()
    value[pair] += 50.0, 1.0
    false = estimate(with_rows(tape, value=value), bearings.scenario, first=first)
    assert false.fate[pair[0]] == Fate.INNOVATION
    others = np.setdiff1d(np.arange(z.value.size), pair)
    without = estimate(of_rows(tape, others), bearings.scenario, first=first)
    assert same(false, without)
    value[pair[0]] = z.value[pair[0]]  # the range is true now, and the bearing is taken
    taken = estimate(with_rows(tape, value=value), bearings.scenario, first=first)
    assert not same(taken, without)


def test_a_range_that_comes_twice_is_taken_once(bearings):
    tape, first = op.to_tape(bearings), bearings.mean[:, 0]
    rows = np.repeat(np.arange(tape.measurements.value.size), 2)
    ranges = tape.measurements.sensor[rows] == 0
    again = np.r_[False, rows[1:] == rows[:-1]]
    twice = estimate(of_rows(tape, rows[ranges | ~again]), bearings.scenario, first=first)
    once = estimate(tape, bearings.scenario, first=first)
    assert same(twice, once)
    came = tape.measurements.sensor == 0
    assert (twice.fate == Fate.DUPLICATE).sum() == came.sum()
    assert not (once.fate == Fate.DUPLICATE).any()
