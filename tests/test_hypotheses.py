"""Several hypotheses where one would not do: against the posterior on a grid, and where a beacon has a mirror."""

import numpy as np
import pytest
from filters import AID, beacon_at, course, filter_of, flown, ranges_of, unchecked
from oracles import NumpyEkf
from scipy.stats import norm

import obsplan as op
from obsplan.estimators.filtering import GONE
from obsplan.estimators.hypotheses import Hypothesis, hypotheses, merged, places, tidied
from obsplan.sensors import Range

WIDE = 50.0  # standard deviation of first estimates [m]
STEP = 0.5  # of the grid, half of a range's standard deviation [m]


def posterior(first, ranges, moved, beacon):
    """Mean, covariance and share north of the beacon, of all places on a grid; moved eastward."""
    axes = [np.arange(-5.2 * WIDE, 5.2 * WIDE, STEP) + middle for middle in first]
    east, north = np.meshgrid(*axes, indexing="ij")
    log = -((east - first[0]) ** 2 + (north - first[1]) ** 2) / (2 * WIDE**2)
    for z, way in zip(ranges, moved, strict=True):
        log -= (z - np.hypot(east + way - beacon[0], north - beacon[1])) ** 2 / 2
    weights = np.exp(log - log.max())
    weights /= weights.sum()
    place = np.stack([east + moved[-1], north])
    mean = (weights * place).sum(axis=(1, 2))
    away = place - mean[:, None, None]
    return mean, np.einsum("iab,jab,ab->ij", away, away, weights), weights[north > beacon[1]].sum()


@pytest.mark.parametrize(
    ("first", "beacon"), [((0.0, 0.0), (80.0, 0.0)), ((0.0, -20.0), (10.0, 5.0))]
)
def test_hypotheses_are_the_posterior_on_a_grid(first, beacon):
    """One range, then two more on a straight path past the beacon, with a mirror."""
    rng, moved = np.random.default_rng(1), np.array([0.0, 30.0, 60.0])
    truth = np.array([30.0, -40.0]) + first
    ranges = np.hypot(truth[0] + moved - beacon[0], truth[1] - beacon[1])
    ranges += rng.standard_normal(3)
    sure = (WIDE, WIDE, 1e-4, 1e-4)
    one = filter_of((*first, 0.0, 1.0), sure, noise=(0.0,) * 4, hypotheses=24)
    for k, z in enumerate(ranges):
        if k:
            one.predict(np.zeros(3), 30.0)
        one.range(float(z), Range(), beacon_at(*beacon), 0)
        one.tidy()
        mean, P, north = posterior(first, ranges[: k + 1], moved[: k + 1], beacon)
        own = sum(
            each.share * norm.sf(beacon[1], each.mean[1], np.sqrt(each.covariance[1, 1]))
            for each in one.hypotheses
        )
        assert own == pytest.approx(north, abs=0.02)
        # each hypothesis is wide along the ring: 2 of 50 m of the mean, 3 m of deviations
        np.testing.assert_allclose(one.mean[:2], mean, rtol=0, atol=2.5)
        deviations = np.sqrt(np.diag(one.covariance))[:2]
        np.testing.assert_allclose(deviations, np.sqrt(np.diag(P)), rtol=0, atol=3.0)
        if k == 0:
            np.testing.assert_allclose(one.mean[:2], mean, rtol=0, atol=0.2)
            np.testing.assert_allclose(deviations, np.sqrt(np.diag(P)), rtol=0.01)
    assert one.fitting == 2
    nearest = min(np.hypot(*(each.mean[:2] - truth - (60, 0))) for each in one.hypotheses)
    assert nearest < 5.0


def some(rng, count):
    """Hypotheses about the origin, some of which overlap."""
    found = []
    for share in rng.dirichlet(np.ones(count)):
        A = rng.normal(size=(4, 4))
        found.append(Hypothesis(float(share), 1.5 * rng.normal(size=4), A @ A.T + np.eye(4)))
    return found


def moments(known):
    """Mean and covariance of a mixture by its first and second moments."""
    mean = sum(one.share * one.mean for one in known)
    second = sum(one.share * (one.covariance + np.outer(one.mean, one.mean)) for one in known)
    return mean, second - np.outer(mean, mean)


def bank_of(known, room):
    rows = [
        np.concatenate([one.mean, one.covariance[np.tril_indices(4)], [np.log(one.share)]])
        for one in known
    ]
    rows += [np.concatenate([rows[0][:-1], [GONE]])] * (room - len(known))
    return np.concatenate([[0.0], *rows])


@pytest.mark.parametrize("seed", range(4))
def test_merging_keeps_mean_and_covariance(seed):
    known = some(np.random.default_rng(seed), 8)
    fewer = merged(known)
    assert len(fewer) < len(known)
    for before, after in zip(moments(known), moments(fewer), strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_tidy_bank_stays_as_it_is(seed):
    bank = bank_of(some(np.random.default_rng(seed), 8), 12)
    rows, known = tidied(bank, 4)
    again, same = tidied(rows, 4)
    np.testing.assert_allclose(again, rows, rtol=1e-12, atol=1e-12)
    assert len(same) == len(known) < 8
    # what a bank is written over with is not what was read of it
    before = [one.mean.copy() for one in hypotheses(rows, 4)]
    read = hypotheses(rows, 4)
    rows[:] = 0.0
    np.testing.assert_array_equal([one.mean for one in read], before)


def at(east, share, sigma=1.0):
    mean = np.array([east, 0.0, 0.0, 1.0])
    return Hypothesis(share, mean, np.diag([sigma, sigma, 0.1, 0.1]) ** 2)


@pytest.mark.parametrize(
    ("known", "count"),
    [
        ([at(0.0, 1.0)], 1),
        ([at(0.0, 0.5), at(10.0, 0.5)], 2),
        # of deviations 1 both, distances count in roots of 2: 3 of them are 4.24 m
        ([at(0.0, 0.5), at(4.2, 0.5)], 1),
        ([at(0.0, 0.5), at(4.3, 0.5)], 2),
        # a chain is of one place
        ([at(0.0, 0.4), at(8.0, 0.3), at(4.0, 0.3)], 1),
        # one in two hundred is none
        ([at(0.0, 0.995), at(50.0, 0.005)], 1),
        ([at(0.0, 0.3), at(50.0, 0.3), at(100.0, 0.4)], 3),
    ],
)
def test_positions_that_fit_are_counted_where_they_are_apart(known, count):
    assert places(known) == count


def test_where_one_gaussian_does_several_hypotheses_are_the_plain_filter():
    rng, noise = np.random.default_rng(3), np.array([0.05, 0.05, 0.005, 0.01])
    beacons = np.tile([40.0, 30.0], (20, 1))
    ranges = ranges_of(course(19, turn=0.03), beacons, rng)
    first = (1.0, -2.0, 0.02, 1.05), (2.0, 2.0, 0.05, 0.1)
    several = flown(filter_of(*first, hypotheses=8), ranges, beacons, turn=0.03)
    single = flown(filter_of(*first), ranges, beacons, turn=0.03)
    plain = NumpyEkf(
        np.array(first[0]), np.diag(np.array(first[1]) ** 2), np.diag(noise**2), 1.0, (0.0, 0.0)
    )
    for k, z in enumerate(ranges):
        if k:
            plain.predict(0.03, 0.0)
        plain.range(z, beacons[k], 1.0, squared=False)
        np.testing.assert_allclose(several[0][k], plain.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(several[1], single[1], rtol=1e-9, atol=1e-12)


# the aid vehicle goes along y = 50, the AUV along y = 0: the first estimate is at the image
PASS = {
    "name": "pass",
    "duration": 200.0,
    **AID,
    "auv": [
        {
            "name": "a",
            "speed": 1.0,
            "survey": {"kind": "waypoints", "points": [[0.0, 0.0], [400.0, 0.0]]},
            "first_estimate": {
                **{"x": 0.0, "y": 100.0, "heading_deg": 0.0, "speed": 1.0},
                **{"sigma_position": 50.0, "sigma_heading_deg": 2.0, "sigma_speed": 0.1},
            },
            "process_noise": {"position": 0.03, "heading_deg": 0.1, "speed": 0.01},
        }
    ],
    "ranging": {"interval": 10.0, "sigma": 1.0},
    "planner": {"kind": "trail"},
}
TURN = 120.0


class Turning:
    """Heads on, and turns to the left once."""

    def plan(self, pose, auvs, *, time=0.0):
        return op.Decision(turn_rate=0.1 if TURN <= time < TURN + 16.0 else 0.0, speed=2.0)


def distances(run):
    return np.hypot(*(run.mean - run.truth)[0, :, :2].T)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_mirror_is_announced_before_the_turn_and_gone_within_two_pings_after_it(seed):
    run = op.simulate(op.from_dict(PASS), planner=Turning(), seed=seed)
    (words,) = run.announcements
    assert words.startswith("a: two positions fit since 00:00:")
    assert words.endswith("; one left at 00:02:10.")
    assert distances(run)[run.time == TURN] > 80.0
    assert distances(run)[run.time >= TURN + 20.0].max() < 10.0


def test_without_hypotheses_the_image_is_believed():
    alone = op.from_dict(PASS).replace(estimator={"kind": "ekf", "hypotheses": 1})
    run = op.simulate(alone, planner=Turning(), seed=0)
    assert run.announcements == ()
    assert distances(run)[-1] > 50.0


@pytest.mark.parametrize("planner", ["information", "trail"])
def test_planners_turn_at_once_and_leave_no_mirror(planner):
    run = op.simulate(op.from_dict(PASS).replace(planner=planner), seed=0)
    turned = np.abs(np.unwrap(run.cna[:, 2])) > 0.5
    assert run.time[turned][0] < 20.0
    assert distances(run)[run.time > 60.0].max() < 10.0
    fitting = run.hypotheses[0]
    assert fitting[run.time > 40.0].max() == 1


UNSURE = {
    "name": "unsure",
    "origin": {"lat": 63.44, "lon": 10.40},
    "cna": {"speed": 2.0, "min_turn_radius": 10.0, "start": {"x": -50.0, "y": 0.0}},
    "auv": [
        {
            "speed": 1.2,
            "survey": {"kind": "lawnmower", "legs": 6, "length": 200.0, "spacing": 30.0},
            "first_estimate": {
                **{"sigma_position": 25.0, "sigma_heading_deg": 2.0, "sigma_speed": 0.3}
            },
            "process_noise": {"position": 0.03, "heading_deg": 0.1, "speed": 0.01},
        }
    ],
    "planner": {"kind": "trail"},
}


@pytest.mark.slow
def test_no_auv_is_lost_that_begins_unsure_but_with_one_hypothesis_some_are():
    mission = op.from_dict(UNSURE)
    alone = mission.replace(estimator={"kind": "ekf", "hypotheses": 1})
    with unchecked():
        several, single = (
            [op.simulate(one, seed=seed).rms_error for seed in range(6)] for one in (mission, alone)
        )
    assert max(several) < 15.0
    assert max(single) > 150.0
