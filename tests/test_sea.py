"""The sea: what is measured there, what is lost, late or false, and what filters and planners are told of it."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import binomtest, kstest

import obsplan as op
from obsplan.scenario import from_dict

DT = 0.5
CURRENT = (0.2, -0.1)


def scenario(**change):
    """Two AUVs at depth, an aid vehicle that wanders, ranges every 2 s."""
    auv = {
        "speed": 1.2,
        "first_estimate": {"sigma_position": 3.0, "sigma_heading_deg": 2.0, "sigma_speed": 0.2},
        "process_noise": {"position": 0.05, "heading_deg": 0.5, "speed": 0.02},
    }
    first = {
        **auv,
        "survey": {"kind": "waypoints", "points": [[0.0, 0.0], [9.0, 4.0], [9.0, 200.0]]},
    }
    second = {**auv, "survey": {"kind": "waypoints", "points": [[40.0, -20.0], [-200.0, -25.0]]}}
    data = {
        "origin": {"lat": 47.6, "lon": -122.3},
        "time_step": DT,
        "duration": 60.0,
        "cna": {"speed": 2.0, "min_turn_radius": 8.0, "start": {"x": 80.0, "y": -30.0}},
        "auv": [first, second],
        "ranging": {"interval": 2.0},
        "planner": {"kind": "random"},
    }
    made = from_dict(data)
    return made.replace(**change) if change else made


@dataclass
class PlainFilter:
    """An EKF in plain numpy whose Jacobians are central differences; measurements are plain functions of the state."""

    x: np.ndarray
    P: np.ndarray
    current: tuple

    def predict(self, turn, faster):
        _, _, psi, v = self.x
        c, s = math.cos(psi), math.sin(psi)
        way = np.array([v * c + self.current[0], v * s + self.current[1], 0.0, 0.0]) * DT
        F = np.eye(4)
        F[:2, 2:] = DT * np.array([[-v * s, c], [v * c, s]])
        Q = DT * np.diag([0.05, 0.05, np.deg2rad(0.5), 0.02]) ** 2
        self.x = self.x + way + [0.0, 0.0, turn, faster]
        self.P = F @ self.P @ F.T + Q

    def correct(self, z, h, sigma, angle=False):
        H = np.array([(h(self.x + e) - h(self.x - e)) / 2e-5 for e in 1e-5 * np.eye(4)])
        innovation = z - h(self.x)
        if angle:
            innovation = math.remainder(innovation, 2 * math.pi)
        gain = self.P @ H / (H @ self.P @ H + sigma**2)
        self.x = self.x + gain * innovation
        self.P = self.P - np.outer(gain, H @ self.P)


def travelled_two_ways(receiver, velocity, depth, pose, speed, turn_rate, beacon_depth, c, wait):
    """Half of the way of question and reply [m], by looking for the instants at which messages met vehicles."""

    def beacon(before):  # on its arc, so long ago
        x, y, psi = pose
        if abs(turn_rate) < 1e-12:
            return np.array(
                [
                    x - speed * before * math.cos(psi),
                    y - speed * before * math.sin(psi),
                    beacon_depth,
                ]
            )
        r, then = speed / turn_rate, psi - turn_rate * before
        return np.array(
            [
                x - r * (math.sin(psi) - math.sin(then)),
                y + r * (math.cos(psi) - math.cos(then)),
                beacon_depth,
            ]
        )

    def auv(before):
        return np.array([*(receiver - velocity * before), depth])

    reply = brentq(lambda t: np.linalg.norm(auv(0) - beacon(t)) - c * t, 0, 100, xtol=1e-13)
    asked = reply + wait
    question = brentq(
        lambda t: np.linalg.norm(beacon(asked) - auv(asked + t)) - c * t, 0, 100, xtol=1e-13
    )
    return c * (reply + question) / 2


SEA = {
    "ranging__timing": "two-way",
    "ranging__turn_around": 0.3,
    "ranging__turn_around_sigma": 1e-3,
    "ranging__geometry": "slant",
    "ranging__growth": 0.02,
    "ranging__sound_speed": 1480.0,
    "ranging__loss": 0.2,
    "ranging__half_distance": 300.0,
    "ranging__duplicates": 0.2,
    "ranging__outliers": 0.1,
    "ranging__bearing_sigma_deg": 3.0,
    "ranging__jitter": 0.4,
    "ranging__slot": 0.5,
    "ranging__interval": 4.0,
    "cna__transducer_depth": 2.0,
    "auv__0__depth": (10.0, 30.0, 40.0),
    "auv__1__depth": 25.0,
    "environment__current": CURRENT,
    "beacon": [{"x": 20.0, "y": 60.0, "depth": 50.0}],
}


def test_estimates_follow_from_the_tape_by_a_filter_in_plain_numpy():
    mission = scenario(**SEA).replace(estimator__gate=0.0)  # the plain filter takes all
    run = op.simulate(mission, seed=3)
    tape = op.to_tape(run)
    came = tape.measurements
    assert np.unique(came.beacon).size == np.unique(came.sensor).size == 2
    sigma = math.hypot(1.0, 1480.0 * 1e-3 / 2)
    depths = np.array(
        [
            [*np.interp(run.time, mission.references[0].arrival, [10.0, 30.0, 40.0])],
            [25.0] * run.time.size,
        ]
    )
    for i in range(2):
        plain = PlainFilter(run.mean[i, 0], run.covariance[i, 0], CURRENT)
        for k in range(1, run.time.size):
            plain.predict(tape.turn[i, k - 1], tape.change_of_speed[i, k - 1])
            plain.correct(tape.heading[i, k - 1], lambda x: x[2], np.deg2rad(1.0), angle=True)
            here = (came.auv == i) & (np.abs(came.received - run.time[k]) < 1e-9)
            for b in (0, 1):
                pose, speed, turn_rate, deep = (
                    run.cna[k],
                    run.speed[k - 1],
                    run.turn_rate[k - 1],
                    2.0,
                )
                if b == 1:
                    pose, speed, turn_rate, deep = (np.array([20.0, 60.0, 0.0]), 0.0, 0.0, 50.0)

                def way(x, told=(pose, speed, turn_rate, deep), depth=depths[i, k]):
                    velocity = x[3] * np.array([math.cos(x[2]), math.sin(x[2])]) + CURRENT
                    return travelled_two_ways(x[:2], velocity, depth, *told, 1480.0, 0.3)

                rows = np.flatnonzero(here & (came.beacon == b))
                for row in rows:
                    if came.sensor[row] == 0:
                        r = way(plain.x)
                        plain.correct(came.value[row], way, math.hypot(sigma, 0.02 * r))
                    else:
                        bearing = lambda x, p=pose: math.atan2(x[1] - p[1], x[0] - p[0])  # noqa: E731
                        plain.correct(came.value[row], bearing, np.deg2rad(3.0), angle=True)
            np.testing.assert_allclose(run.mean[i, k], plain.x, atol=2e-5)
            np.testing.assert_allclose(run.covariance[i, k], plain.P, atol=2e-5)


# What comes, and when


def test_ranges_are_lost_as_often_as_said_and_the_filter_goes_on():
    mission = scenario(ranging__loss=0.5, ranging__interval=0.5, duration=400.0)
    run = op.simulate(mission)
    due = run.scenario.pings.size * 2
    came = int(run.came.sum())
    assert binomtest(came, due, 0.5).pvalue > 1e-3
    assert np.isfinite(run.mean).all()
    assert np.array_equal(run.came[0], np.isfinite(run.range))


def test_no_range_comes_from_beyond_reach_and_fewer_from_afar():
    mission = scenario(
        ranging__interval=0.5,
        duration=600.0,
        ranging__half_distance=60.0,
        ranging__reach=110.0,
        planner__kind="stationary",
    )
    run = op.simulate(mission)
    apart, came = run.separation[:, 1:], run.came[0][:, 1:]
    assert not came[apart > 110.0].any()
    assert apart.max() > 150.0
    for low, high in ((50, 80), (80, 95), (95, 110)):
        ring = (apart >= low) & (apart < high)
        p = np.mean(2.0 ** -((apart[ring] / 60.0) ** 2))
        assert abs(came[ring].mean() - p) < 4 * math.sqrt(p * (1 - p) / ring.sum())


def test_auvs_and_beacons_take_turns_and_keep_silence():
    mission = scenario(
        ranging__interval=8.0,
        ranging__slot=1.5,
        ranging__silent=[[20.0, 30.0]],
        beacon=[{"x": 5.0, "y": 5.0}],
    )
    run = op.simulate(mission)
    for b in range(2):
        for i in range(2):
            begins = np.arange(1, 8) * 8.0 + (2 * b + i) * 1.5
            heard = begins[(begins <= 60.0) & ~((begins >= 20.0) & (begins <= 30.0))]
            np.testing.assert_array_equal(run.time[run.came[b, i]], heard)
    cast = op.simulate(mission.replace(ranging__access="broadcast"))
    np.testing.assert_array_equal(cast.came[:, 0], cast.came[:, 1])
    assert (cast.time[cast.came[1, 0]] - cast.time[cast.came[0, 0]][: cast.came[1, 0].sum()])[
        0
    ] == 1.5


def test_jitter_delays_each_range_by_less_than_it():
    mission = scenario(ranging__interval=10.0, ranging__jitter=4.0, duration=600.0)
    run = op.simulate(mission)
    late = run.time[run.came[0, 0]] - 10.0 * np.arange(1, 61)[: run.came[0, 0].sum()]
    assert late.min() >= 0.0
    assert late.max() <= 4.5
    assert np.unique(late).size > 5


# What is false


def differences(mission, plain, seed=1):
    """Ranges of a mission less those of another under the same noise, where both came."""
    ours, theirs = op.simulate(mission, seed=seed), op.simulate(plain, seed=seed)
    return (ours.range - ours.separation) - (theirs.range - theirs.separation)


def test_outliers_are_as_frequent_and_as_long_as_said_and_always_longer():
    plain = scenario(ranging__interval=0.5, duration=400.0, planner__kind="stationary")
    longer = differences(plain.replace(ranging__outliers=0.1, ranging__outlier_mean=50.0), plain)
    longer = longer[np.isfinite(longer)]
    strays = longer[np.abs(longer) > 1e-9]
    assert binomtest(strays.size, longer.size, 0.1).pvalue > 1e-3
    assert strays.min() > 0
    assert kstest(strays / 50.0, "expon").pvalue > 1e-3


def test_what_is_false_is_drawn_for_each_beacon_and_scales_are_common():
    beside = {"beacon": [{"x": 30.0, "y": 60.0}], "planner__kind": "stationary"}
    plain = scenario(ranging__interval=0.5, duration=200.0, **beside)
    false = plain.replace(
        ranging__outliers=0.3, ranging__outlier_mean=50.0, ranging__scale_sigma=0.02
    )
    ours, theirs = op.simulate(false), op.simulate(plain)
    scaled = ours.ranges / theirs.ranges
    scale = np.nanmedian(scaled)
    assert abs(scale - 1) > 1e-3
    longer = ours.ranges - scale * theirs.ranges
    strays = np.abs(longer) > 1e-6
    for b in range(2):  # all others have the scale alone
        assert 0.2 < strays[b][ours.came[b]].mean() < 0.4
        assert longer[b][strays[b]].min() > 0
    assert not np.array_equal(strays[0], strays[1])


def test_missions_range_when_planners_expect_it():
    mission = scenario(ranging__interval=8.0, ranging__slot=1.5, ranging__silent=[[20.0, 30.0]])
    run, schedule = op.simulate(mission), mission.situation.schedule
    for i in range(2):
        np.testing.assert_allclose(run.time[run.came[0, i]], schedule.times(i, 0.0, 60.0))


def test_clocks_lengthen_ranges_by_the_way_sound_makes_meanwhile():
    plain = scenario(planner__kind="stationary")
    late = differences(plain.replace(ranging__clock_offset=2e-3, ranging__clock_drift=1e-5), plain)
    expected = 1500.0 * (2e-3 + 1e-5 * op.simulate(plain).time)
    for row in late:
        np.testing.assert_allclose(row[np.isfinite(row)], expected[np.isfinite(row)], rtol=1e-9)


def test_an_untold_speed_of_sound_scales_ranges_and_a_told_one_does_not_harm():
    wrong = scenario(
        ranging__sound_speed=1530.0, ranging__assumed_sound_speed=1500.0, duration=300.0
    )
    run = op.simulate(wrong)
    error = run.range * 1.02 - run.separation
    assert np.nanstd(error) < 1.3
    assert abs(np.nanmean(error)) < 0.4
    untold = op.simulate(wrong.replace(estimator__ranging={"sound_speed": 1500.0}))
    assert np.nanmean(untold.nees[:, 60:]) > 5 * np.nanmean(run.nees[:, 60:])


def test_a_relative_error_holds_for_a_mission_and_differs_between_missions():
    plain = scenario(ranging__sigma=1e-3, planner__kind="stationary")
    scales = []
    for seed in range(40):
        run = op.simulate(plain.replace(ranging__scale_sigma=0.01), seed=seed)
        relative = (run.range / run.separation - 1)[run.came[0]]
        assert np.ptp(relative) < 1e-3
        scales.append(relative.mean() / 0.01)
    assert kstest(scales, "norm").pvalue > 1e-3


def test_no_range_is_negative():
    over = scenario(
        cna={"speed": 1.0, "min_turn_radius": 2.0},
        auv=[
            {
                "survey": {"kind": "static", "x": 0.0, "y": 0.0},
                "first_estimate": {"x": 0.0, "y": 0.0},
            }
        ],
        planner__kind="stationary",
        ranging__interval=0.5,
    )
    run = op.simulate(over)
    assert np.nanmin(run.range) > 0
    assert run.came[0, 0].sum() == 120


# What filter and planner are told


def test_position_at_reception_errs_by_the_way_of_the_sound_and_modelled_by_nothing():
    """An aid vehicle at 2 m/s, 2 km ahead of an AUV at rest: 2 · 2000 / 1500 = 2.7 m."""
    far = scenario(
        cna={
            "speed": 2.0,
            "min_turn_radius": 10.0,
            "start": {"x": 2000.0, "y": 0.0, "heading_deg": 0.0},
        },
        auv=[
            {
                "survey": {"kind": "static", "x": 0.0, "y": 0.0},
                "first_estimate": {"x": 0.0, "y": 0.0, "sigma_position": 10.0},
            }
        ],
        ranging={"interval": 2.0, "sigma": 0.001, "timing": "one-way"},
        planner={"kind": "gramian"},
        duration=20.0,
    )
    run = op.simulate(far, planner=Ahead())
    assert run.cna[-1, 0] == pytest.approx(2040.0)
    assert run.mean[0, -1, 0] == pytest.approx(0.0, abs=0.05)
    taken = op.simulate(far.replace(estimator__ranging={"timing": "instant"}), planner=Ahead())
    sent = taken.cna[-1, 0] / (1 + 2.0 / 1500.0)  # where the vehicle is when it sends, so far away
    by_hand = taken.cna[-1, 0] - sent
    assert by_hand == pytest.approx(2.7, abs=0.05)
    assert taken.mean[0, -1, 0] == pytest.approx(by_hand, abs=0.05)


class Ahead:
    """Goes straight on."""

    def plan(self, pose, auvs, *, time=0.0):
        return op.Decision(turn_rate=0.0, speed=2.0)


def test_told_keys_change_filter_and_planner_and_not_the_truth():
    plain = scenario(ranging__growth=0.02, planner__kind="information", duration=40.0)
    untold = plain.replace(estimator__ranging={"growth": 0.0, "sigma": 2.0})
    ours, theirs = op.simulate(plain), op.simulate(untold)
    np.testing.assert_array_equal(ours.truth, theirs.truth)
    assert not np.array_equal(ours.mean, theirs.mean)
    assert plain.situation.ranging.growth == 0.02
    assert (untold.situation.ranging.growth, untold.situation.ranging.sigma) == (0.0, 2.0)
    only = plain.replace(planner__ranging={"growth": 0.1})
    assert (only.situation.ranging.growth, only.filter_sensor.growth) == (0.1, 0.02)
    assert only.range_sensor.growth == 0.02


def test_a_current_that_is_not_told_carries_an_auv_off_its_line():
    plain = scenario(auv__0__process_noise={}, auv__1__process_noise={}, estimator__current=CURRENT)
    off = (
        op.simulate(plain.replace(environment__current=(0.5, -0.1))).truth
        - op.simulate(plain.replace(environment__current=CURRENT)).truth
    )
    time = op.simulate(plain).time
    np.testing.assert_allclose(off[..., 0], np.tile(0.3 * time, (2, 1)), atol=1e-9)
    np.testing.assert_allclose(off[..., 1:], 0.0, atol=1e-9)


def test_a_compass_bias_is_in_every_heading_measured():
    biased = op.to_tape(op.simulate(scenario(ranging__compass_bias_deg=2.0)))
    plain = op.to_tape(op.simulate(scenario()))
    np.testing.assert_allclose(biased.heading - plain.heading, np.deg2rad(2.0), atol=1e-12)


# Bounds


def test_cramer_rao_bound_counts_the_ranges_that_came_and_no_other():
    mission = scenario(
        ranging__loss=0.5, ranging__growth=0.01, ranging__geometry="slant", auv__0__depth=20.0
    )
    run = op.simulate(mission)
    assert 10 < run.came.sum() < 50
    for i, depth in enumerate((20.0, 0.0)):
        P = run.covariance[i, 0].copy()
        bound = [P[0, 0] + P[1, 1]]
        for k in range(1, run.time.size):
            _, _, psi, v = run.truth[i, k - 1]
            F = np.eye(4)
            F[:2, 2:] = DT * np.array(
                [[-v * math.sin(psi), math.cos(psi)], [v * math.cos(psi), math.sin(psi)]]
            )
            P = F @ P @ F.T + DT * np.diag([0.05, 0.05, np.deg2rad(0.5), 0.02]) ** 2
            J = np.diag([0.0, 0.0, np.deg2rad(1.0) ** -2, 0.0])
            if run.came[0, i, k]:
                away = run.truth[i, k, :2] - run.cna[k, :2]
                r = math.hypot(*away, depth)
                h, s2 = away / r, 1.0 + (0.01 * r) ** 2
                slope = 0.01**2 * r / math.sqrt(s2) * h  # of the standard deviation
                J[:2, :2] = (np.outer(h, h) + 2 * np.outer(slope, slope)) / s2
            P = np.linalg.inv(np.linalg.inv(P) + J)
            bound.append(P[0, 0] + P[1, 1])
        np.testing.assert_allclose(run.cramer_rao_variance[i], bound, rtol=1e-6)


def test_with_half_of_the_ranges_lost_no_estimator_beats_the_bound_nor_any_path_efficiency():
    mission = scenario(ranging__loss=0.5, planner__kind="information", duration=120.0)
    square, bound, efficiency = [], [], []
    for seed in range(12):
        run = op.simulate(mission, seed=seed)
        figures = run.summary()["all"]
        square.append(np.mean(run.error[:, 40:] ** 2))
        bound.append(np.mean(run.cramer_rao_variance[:, 40:]))
        efficiency.append(figures["efficiency"])
    assert np.mean(square) > 0.8 * np.mean(
        bound
    )  # 24 tracks, of some ten independent errors each: ± 10 %
    assert max(efficiency) <= 1.0


def test_a_forecast_is_the_bound_to_be_expected_before_it_is_known_what_comes():
    mission = scenario(ranging__loss=0.3, ranging__half_distance=150.0, planner__kind="circle")
    runs = [op.simulate(mission, seed=seed) for seed in range(30)]
    bound = np.mean([run.cramer_rao_variance[:, 40:].mean() for run in runs])
    forecast = np.mean([run.forecast_variance[:, 40:].mean() for run in runs])
    assert 0.85 * bound < forecast < 1.02 * bound  # of a convex function, so a little below
    sure = op.simulate(scenario())
    np.testing.assert_allclose(sure.forecast_variance, sure.cramer_rao_variance, rtol=1e-12)
    assert runs[0].summary()["all"]["pcrb_forecast_rms_m"] > 0
    assert "pcrb_forecast_rms_m" not in sure.summary()["all"]


# Bad input


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"ranging__loss": 1.5}, r"loss = 1.5 .*must be from 0 to 1 \(a probability\)"),
        ({"ranging__slot": 2.5}, r"slot: 2.5 s and jitter = 0.0 s make a round of .*longer interval"),
        ({"ranging__profile": ((0.0, 1500.0), (0.0, 1490.0))}, "increasing depths, got 0.0 after 0.0"),
        ({"estimator__ranging": {"sigmo": 1.0}}, "unknown key estimator__ranging.sigmo; did you mean .sigma"),
        ({"planner__ranging": {"growth": -1.0}}, r"planner__ranging.growth = -1.0"),
        ({"beacon": [{"on": 3}]}, "beacon-1.* is on aid vehicle 3, and the last is number 0"),
        ({"ranging": {"kind": "squared-range", "outliers": 0.1}}, 'ranging.outliers: is of ranges in metres.*kind "range"'),
        ({"cna__ranged": False}, "AUVs range to nothing: set ranged = true, or add"),
        ({"auv__0__depth": (1.0, 2.0)}, "one for each of the 3 points of the survey, got 2"),
        ({"auv__0__depth": -3.0}, "depth.*must be from 0 to 12000 m"),
        ({"ranging__silent": ((1.0, -2.0),)}, "silent"),
    ],
)  # fmt: skip
def test_wrong_key_of_the_sea_is_one_sentence(change, said):
    with pytest.raises(op.ObsplanError, match=said) as error:
        scenario(**change)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_told_that_errors_grow_planners_stay_near_and_errors_are_smaller():
    harbor = op.load("harbor-survey").replace(ranging__growth=0.01)
    untold = harbor.replace(estimator__ranging={"growth": 0.0})
    late = []
    for seed in range(101, 106):
        told, other = op.simulate(harbor, seed=seed), op.simulate(untold, seed=seed)
        assert told.separation.max() < 85.0 < other.separation.max()
        half = told.time.size // 2
        late.append([np.sqrt(np.mean(run.error[:, half:] ** 2)) for run in (told, other)])
    assert (np.diff(late) > 0).all()
