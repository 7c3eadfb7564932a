"""What a range is: travel times against messages followed by hand, information against differences, schedules against lists."""

import math
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from oracles import arc
from scipy.integrate import quad
from scipy.optimize import brentq

from formulations.model.covariance import conditioned, predicted
from formulations.model.ranging import (
    AFAR,
    EDGE,
    Ends,
    Ranging,
    arrival,
    expected_ranges,
    law_of,
    mean_sound_speed,
    one_way_time,
    one_way_travel_time,
    travelled,
    two_way_time,
    variance,
)
from formulations.model.schedule import Schedule, ping_stages

SOUND = 1500.0
DOUBLE = np.finfo(float).eps


# Travel times


def test_one_way_time_and_range_are_those_of_the_thesis_to_rounding():
    rng = np.random.default_rng(0)
    for flight, turn_around, speed in rng.uniform((0.1, 0, 1400), (9, 0.1, 1600), (50, 3)):
        time = (Fraction(flight) - Fraction(turn_around)) / 2  # (2.10)
        way = Fraction(speed) * time  # (2.11)
        found = one_way_travel_time(flight, turn_around)
        assert found == pytest.approx(float(time), rel=2 * DOUBLE)
        assert travelled(speed, found) == pytest.approx(float(way), rel=3 * DOUBLE)


class Meeting:
    """Two vehicles as one hears the other: the one that hears on a straight line, the other on an arc."""

    def __init__(self, rng):
        self.here, self.pose = rng.uniform(-2000, 2000, 2), np.array([*rng.normal(0, 300, 2), 0.4])
        self.velocity, self.speed = rng.normal(0, 1.5, 2), rng.uniform(0, 3)
        self.turn_rate = rng.choice([0.0, 1e-6, 0.05, -0.3])
        self.deep = rng.uniform(0, 1500)

    def heard(self, t):
        return np.array([*(self.here + self.velocity * t), self.deep])

    def said(self, t):
        return np.array([*arc(self.pose, self.turn_rate, self.speed, t)[:2], 5.0])

    @property
    def ends(self):
        course = np.array([math.cos(self.pose[2]), math.sin(self.pose[2])])
        return Ends(
            receiver=ca.DM(self.here),
            receiver_velocity=ca.DM(self.velocity),
            receiver_depth=self.deep,
            sender=ca.DM(self.pose[:2]),
            sender_velocity=ca.DM(self.speed * course),
            sender_turn_rate=self.turn_rate,
            sender_depth=5.0,
        )

    @property
    def tolerance(self):
        """The arc's mean velocity is taken over the time at rest, which is wrong by a share v/c [s]."""
        time = np.linalg.norm(self.heard(0) - self.said(0)) / SOUND
        moved = abs(self.turn_rate) * self.speed**2 / SOUND * time**2 / 2
        return 1.1 * moved / SOUND + 1e-12


def on_the_way(sent_from, received_at):
    """Time for which a message has been on the way, by bisection."""
    return brentq(
        lambda t: np.linalg.norm(received_at - sent_from(-t)) - SOUND * t, 0, 9, xtol=1e-14
    )


def test_one_way_time_is_the_root_for_the_true_trajectories():
    rng = np.random.default_rng(1)
    for _ in range(60):
        meeting = Meeting(rng)
        expected = on_the_way(meeting.said, meeting.heard(0.0))
        found = float(one_way_time(meeting.ends, SOUND))
        assert found == pytest.approx(expected, rel=0, abs=meeting.tolerance)


@pytest.mark.parametrize("turn_around", [0.0, 0.05, 2.0])
def test_two_way_time_is_that_of_a_question_and_its_reply_between_moving_vehicles(turn_around):
    rng = np.random.default_rng(2)
    for _ in range(40):
        meeting = Meeting(rng)
        reply = on_the_way(meeting.said, meeting.heard(0.0))
        asked = -reply - turn_around
        question = on_the_way(lambda t, at=asked, m=meeting: m.heard(at + t), meeting.said(asked))
        flight = question + turn_around + reply
        found = float(two_way_time(meeting.ends, SOUND, turn_around))
        # of the reply by half, and where the question met the other, by a share v/c of that again
        tolerance = meeting.tolerance + 1e-13 * flight
        assert found == pytest.approx((flight - turn_around) / 2, rel=0, abs=tolerance)


def test_position_as_the_message_is_received_errs_by_what_the_sender_has_moved():
    """2 km at 2 m/s: 2.67 m along track."""
    ahead, aside = ca.DM([2000.0, 0.0]), ca.DM([0.0, 2000.0])
    for place, error in ((ahead, 2000 * 2 / SOUND), (aside, 0.0)):
        ends = Ends(place, ca.DM.zeros(2), 0.0, ca.DM.zeros(2), ca.DM([2.0, 0.0]), 0.0, 0.0)
        distance = float(travelled(SOUND, one_way_time(ends, SOUND)))
        assert distance - 2000.0 == pytest.approx(error, abs=0.005)  # (v/c)^2 of 2 km: 4 mm
        sent_from = np.array([-2.0 * distance / SOUND, 0.0])
        way = np.linalg.norm(place.full()[:, 0] - sent_from)
        assert distance == pytest.approx(way, rel=1e-14)


def test_vehicles_at_the_same_place_have_no_travel_time_and_no_slope():
    place, east = ca.SX.sym("x", 2), ca.DM([1.0, 0.0])
    ends = Ends(place, ca.DM.zeros(2), 0.0, ca.DM.zeros(2), east, 0.0, 0.0)
    time = one_way_time(ends, SOUND)
    function = ca.Function("time", [place], [time, ca.jacobian(time, place)])
    time, slope = function([0.0, 0.0])
    assert float(time) == 0.0
    assert np.isfinite(slope.full()).all()


# Speed of sound

PROFILE = ((10.0, 1520.0), (80.0, 1490.0), (200.0, 1490.0), (900.0, 1512.0))


@pytest.mark.parametrize(
    ("top", "bottom"),
    [(0, 5), (0, 1500), (30, 60), (100, 150), (60, 400), (1200, 40), (950, 2000), (20, 20.001)],
)
def test_mean_sound_speed_is_the_span_over_the_integrated_slowness(top, bottom):
    depths, speeds = zip(*PROFILE, strict=True)
    corners = [depth for depth in depths if min(top, bottom) < depth < max(top, bottom)]
    time, _ = quad(
        lambda z: 1 / np.interp(z, depths, speeds),
        top,
        bottom,
        points=corners or None,
        epsabs=0,
        epsrel=1e-13,
    )
    found = float(mean_sound_speed(PROFILE, ca.DM(top), ca.DM(bottom)))
    rounding = 8 * DOUBLE * max(top, bottom) / abs(bottom - top)
    assert found == pytest.approx((bottom - top) / time, rel=1e-12 + rounding)


def test_mean_sound_speed_at_one_depth_is_that_depths():
    for depth, speed in ((0.0, 1520.0), (45.0, 1505.0), (150.0, 1490.0), (2000.0, 1512.0)):
        assert float(mean_sound_speed(PROFILE, ca.DM(depth), ca.DM(depth))) == speed
    assert mean_sound_speed(((0.0, 1481.0),), 3.0, 90.0) == 1481.0


# Errors and losses


def test_variance_grows_with_the_square_of_the_distance():
    for r in (0.0, 50.0, 800.0):
        grown = variance(law_of(Ranging(1.5, growth=0.01)), r * r)
        assert grown == pytest.approx(1.5**2 + (0.01 * r) ** 2)
        assert variance(law_of(Ranging(1.5)), r * r) == 1.5**2


def test_ranges_arrive_by_their_distance_and_none_beyond_reach():
    lossy = law_of(Ranging(1.0, loss=0.2, half_distance=400.0, reach=900.0))
    for r, expected in ((0, 0.8), (400, 0.4), (800, 0.8 / 16), (900.1, 0.0)):
        assert float(arrival(lossy, ca.DM(r * r))) == pytest.approx(expected, rel=1e-14)
    assert arrival(law_of(Ranging(1.0)), 1e12) == 1.0


def test_planners_see_the_reach_fade_out_and_little_else_changes():
    reach = 900.0
    faded = law_of(Ranging(1.0, reach=reach))
    seen = [float(arrival(faded, ca.DM(r * r), edge=EDGE)) for r in np.linspace(1, 4000, 300)]
    assert (np.diff(seen) <= 0).all()
    at = [float(arrival(faded, ca.DM((reach * s) ** 2), edge=EDGE)) for s in (0.5, 1, 1.5)]
    gone = 1 / (1 + math.exp(10))
    np.testing.assert_allclose(at, [1 - gone, 0.5, gone], rtol=0, atol=AFAR)
    lossy = law_of(Ranging(1.0, loss=0.3, half_distance=400.0))
    for r2 in (0.0, 1e4, 1e6):
        true, told = (float(arrival(lossy, ca.DM(r2), edge=edge)) for edge in (0.0, EDGE))
        assert told == pytest.approx(true, rel=0, abs=0.7 * AFAR)
    constant = law_of(Ranging(1.0, loss=0.3))
    assert float(arrival(constant, ca.DM(1e8), edge=EDGE)) == pytest.approx(0.7, rel=1e-15)


@pytest.mark.parametrize("law", [{"reach": 300.0}, {"half_distance": 300.0}])
def test_from_however_far_nearer_is_better(law):
    seen = [
        float(arrival(law_of(Ranging(1.0, **law)), ca.DM(r * r), edge=EDGE))
        for r in np.linspace(300, 30_000, 200)
    ]
    assert (np.diff(seen) < 0).all()
    assert seen[-1] > 1e-11


@pytest.mark.parametrize("pings", [1, 2, 5])
def test_expected_ranges_are_those_of_all_outcomes(pings):
    lossy = law_of(Ranging(1.0, loss=0.35, half_distance=300.0))
    for r in (0.0, 200.0, 700.0):
        p = float(arrival(lossy, ca.DM(r * r), edge=EDGE))
        chances = [math.comb(pings, k) * p**k * (1 - p) ** (pings - k) for k in range(pings + 1)]
        some, count = map(float, expected_ranges(lossy, ca.DM(r * r), pings))
        assert some == pytest.approx(sum(chances[1:]), rel=1e-13)
        of_some = sum(k * chance for k, chance in enumerate(chances)) / sum(chances[1:])
        assert count == pytest.approx(of_some, rel=1e-13)


# Information


def covariance(rng, n, scale=1.0):
    half = rng.normal(size=(n, n)) * scale
    return half @ half.T


def distance(x, height):
    """From the AUV's error (east, north, heading, speed, depth) to the aid vehicle, which is above it: depths count down."""

    def of(error):
        deeper = error[4] if len(error) > 4 else 0.0
        return math.hypot(x[0] - error[0], x[1] - error[1], height + deeper)

    return of


def derivatives(function, n, step):
    """Gradient and Hessian by differences."""
    E = step * np.eye(n)
    gradient = np.array([function(e) - function(-e) for e in E]) / (2 * step)
    mixed = [
        [function(a + b) - function(a - b) - function(b - a) + function(-a - b) for b in E]
        for a in E
    ]
    return gradient, np.array(mixed) / (4 * step**2)


@pytest.mark.parametrize("n", [4, 5])
def test_slant_ranges_add_the_information_of_the_distances_derivatives(n):
    rng = np.random.default_rng(3)
    for _ in range(20):
        P, x, height = covariance(rng, n), rng.uniform(-40, 40, 2), rng.uniform(-30, 60)
        ranging = Ranging(rng.uniform(0.2, 3), growth=rng.choice([0.0, 0.05]), slant=True)
        pings, r = rng.uniform(0.5, 6), math.hypot(*x, height)
        H, B = derivatives(distance(x, height), n, step=1e-3 * r)
        BP = B @ P
        left_out = (np.trace(BP) ** 2 + 2 * np.trace(BP @ BP)) / 4  # E (e'Be / 2)^2
        R = (ranging.sigma**2 + (ranging.growth * r) ** 2) / pings + left_out
        expected = np.linalg.inv(np.linalg.inv(P) + np.outer(H, H) / R)
        # differences err by the step's square, 1e-6, relative to each standard deviation
        scale = np.sqrt(np.diagonal(P))
        found = conditioned(P, x, ranging, pings, height)
        np.testing.assert_allclose(
            found / scale / scale[:, None], expected / scale / scale[:, None], atol=2e-5
        )


def test_second_order_error_of_slant_ranges_is_that_of_samples():
    rng = np.random.default_rng(4)
    samples, x, height = 1_000_000, np.array([12.0, 0.0]), 9.0
    half = np.array([[0.30, 0.0, 0.0], [0.22, 0.15, 0.0], [-0.1, 0.2, 0.2]])
    P = np.diag([0.0, 0.0, 0.01, 0.01, 0.0])
    place = np.ix_([0, 1, 4], [0, 1, 4])
    P[place] = half @ half.T
    e = rng.standard_normal((samples, 3)) @ half.T
    r = 15.0
    slope = np.array([-12.0, 0.0, 9.0]) / r
    away = np.array([12.0, 0.0, 9.0]) + e * [-1, -1, 1]
    left_out = np.linalg.norm(away, axis=1) - r - e @ slope
    H = np.array([slope[0], slope[1], 0, 0, slope[2]])
    gained = P - conditioned(P, x, Ranging(1e-9, slant=True), 1.0, height)
    along = H @ P @ H
    found = along**2 / (H @ gained @ H) - along  # what the update took for its range's variance
    # standard error of the fourth moment 0.33 %; terms left out (0.4 / 15)^2 = 0.1 % of it
    assert found == pytest.approx(np.mean(left_out**2), rel=4 * 0.0033 + 0.002)


def test_slant_ranges_of_no_height_are_horizontal_ones():
    rng = np.random.default_rng(5)
    for ranging in (Ranging(0.7), Ranging(0.7, growth=0.02), Ranging(0.7, loss=0.4, reach=50.0)):
        P, x = covariance(rng, 4), rng.uniform(-30, 30, 2)
        flat = conditioned(P, x, ranging, 2.0)
        over = conditioned(P, x, ranging._replace(slant=True), 2.0, 1e-7)
        np.testing.assert_allclose(over, flat, rtol=1e-11)
        deep = np.zeros((5, 5))
        deep[:4, :4] = P
        known = conditioned(deep, x, ranging._replace(slant=True), 2.0, 1e-7)
        np.testing.assert_allclose(known[:4, :4], flat, rtol=1e-11)
        np.testing.assert_array_equal(known[4], 0.0)


@pytest.mark.parametrize(("n", "places"), [(4, [0, 1]), (5, [0, 1, 4])])
def test_position_alone_is_conditioned_as_it_is_within_the_state(n, places):
    rng = np.random.default_rng(6)
    P, x, ranging = covariance(rng, n), np.array([9.0, -20.0]), Ranging(0.5, slant=True, loss=0.1)
    block = np.ix_(places, places)
    alone = conditioned(P[block], x, ranging, 1.0, 14.0)
    np.testing.assert_allclose(alone, conditioned(P, x, ranging, 1.0, 14.0)[block], rtol=1e-12)


@pytest.mark.parametrize("slant", [False, True])
def test_covariance_after_one_range_that_may_be_lost_is_the_mean_of_both_outcomes(slant):
    rng = np.random.default_rng(7)
    P, x, height = covariance(rng, 4), np.array([30.0, 40.0]), 20.0
    sure = Ranging(0.8, growth=0.01, slant=slant)
    lossy = sure._replace(loss=0.3, half_distance=60.0)
    r = math.hypot(30, 40, height if slant else 0.0)
    p = float(arrival(law_of(lossy), ca.DM(r * r), edge=EDGE))  # as planners count on it
    mean = p * conditioned(P, x, sure, 1.0, height) + (1 - p) * P
    np.testing.assert_allclose(conditioned(P, x, lossy, 1.0, height), mean, rtol=1e-12)


def test_unknown_depth_walks_by_itself():
    P, noise = np.diag([1.0, 2.0, 0.1, 0.1, 3.0]), np.array([0.1, 0.1, 0.05, 0.02, 0.3])
    motion = np.array([math.cos(0.4), math.sin(0.4), 1.2])
    after = predicted(P, motion, noise, 8.0)
    np.testing.assert_allclose(after[4], [0, 0, 0, 0, 3.0 + 0.3**2 * 8], rtol=1e-14)
    np.testing.assert_array_equal(after[:4, :4], predicted(P[:4, :4], motion, noise[:4], 8.0))


# Schedules

TENTH = Fraction(1, 10)
SLOTS = {
    "together": {"interval": 7, "offsets": (), "silent": ()},
    "slots": {"interval": 100, "offsets": (0, 12, 31), "silent": ()},
    "slots beyond the round": {"interval": 70, "offsets": (0, 50, 110), "silent": ()},
    "silent": {"interval": 40, "offsets": (), "silent": ((180, 330), (600, 610))},
    "silent slots": {"interval": 100, "offsets": (5, 5, 30), "silent": ((200, 405),)},
}


def tenths(name):
    """A schedule whose times are whole tenths of a second, and these of each AUV up to 300 s."""
    given = SLOTS[name]
    schedule = Schedule(
        interval=given["interval"] / 10,
        offsets=tuple(offset / 10 for offset in given["offsets"]),
        silent=tuple((start / 10, stop / 10) for start, stop in given["silent"]),
    )
    listed = [
        [
            t
            for t in range(3000)
            if t - offset >= given["interval"]
            and (t - offset) % given["interval"] == 0
            and not any(start <= t <= stop for start, stop in given["silent"])
        ]
        for offset in given["offsets"] or (0, 0, 0)
    ]
    return schedule, listed


@pytest.mark.parametrize("name", SLOTS)
def test_times_of_ranges_are_those_listed_one_by_one(name):
    schedule, listed = tenths(name)
    for begin, end in ((0, 900), (35, 36), (100, 400), (111, 112), (112, 500), (701, 1400)):
        for auv in range(3):
            expected = [t / 10 for t in listed[auv] if begin < t <= end]
            np.testing.assert_allclose(schedule.times(auv, begin / 10, end / 10), expected)


def of_each(pings):
    """Numbers of ranges to each of three AUVs."""
    return pings if pings.ndim > 1 else np.repeat(pings[:, None], 3, axis=1)


@pytest.mark.parametrize("name", SLOTS)
@pytest.mark.parametrize(("horizon", "count"), [(20.0, 6), (20.0, 2), (90.0, 5)])
def test_stages_end_at_listed_ranges_and_count_each_once(name, horizon, count):
    schedule, listed = tenths(name)
    shared = schedule.interval <= horizon / count and not schedule.silent
    if shared:
        stages = schedule.stages(3.0, horizon, count, 3)
        np.testing.assert_allclose(stages.pings.sum(axis=0), horizon / schedule.interval)
        np.testing.assert_allclose(stages.duration, horizon / count)
        return
    ranges = sorted({t for auv in listed for t in auv})
    for time in (0, 4, 100, 131, 185, 312, 599):
        stages = schedule.stages(time / 10, horizon, count, 3)
        begin = time
        for duration, pings in zip(stages.duration, of_each(stages.pings), strict=True):
            within = [t for t in ranges if begin < t <= begin + 10 * horizon / count]
            end = within[-1] if within else next(t for t in ranges if t > begin)
            assert duration * 10 == pytest.approx(end - begin)
            counted = [sum(begin < t <= end for t in auv) for auv in listed]
            np.testing.assert_array_equal(pings, counted)
            begin = end


def test_plain_schedules_have_the_stages_of_pings():
    for interval in (0.7, 15.0):
        plain = Schedule(interval=interval, offsets=(0.0, 0.0))
        assert plain.plain
        for time in (0.0, 3.21, 45.0):
            found, expected = plain.stages(time, 20.0, 6, 2), ping_stages(time, interval, 20.0, 6)
            np.testing.assert_array_equal(found.duration, expected.duration)
            np.testing.assert_array_equal(found.pings, expected.pings)


def test_squared_ranges_over_a_height_are_refused():
    squared = Ranging(1.0, squared=True, slant=True)
    with pytest.raises(ValueError, match="squared ranges are horizontal: leave slant False"):
        conditioned(np.eye(4), np.array([3.0, 4.0]), squared, 1.0, 5.0)
