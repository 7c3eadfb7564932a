"""What the information horizon makes of depth, errors that grow, reach, loss and slots: the orbits it settles on against closed forms."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from oracles import arc

import obsplan as op
from formulations.model.ranging import Ranging
from obsplan.planners.information import believed

SPEED = 2.0  # of the aid vehicle [m/s]


def situation(ranging, interval, **change):
    cna = op.Unicycle(speed=SPEED, min_turn_radius=10.0)
    told = {"ping_interval": interval, "decision_interval": interval} | change
    return op.Situation(cna, ranging=ranging, **told)


def after_range(P, apart, height, variance):
    """Covariance of (east, north, heading, speed[, depth]) after one slant range, by the filter's gain."""
    r = math.hypot(*apart, height)
    H = np.zeros(len(P))
    H[:2] = -apart / r  # away from the AUV the range grows
    H[4:] = height / r  # and as it dives
    gain = P @ H / (H @ P @ H + variance)
    return P - np.outer(gain, H @ P)


@dataclass
class Static:
    """An AUV at rest in the origin, at a depth, and what it knows: its filter in numpy."""

    depth: float
    walk: float  # of each coordinate of its position [m/s^0.5]
    depth_known: bool = True
    sigma: float = 1.0  # of each coordinate at first

    def __post_init__(self):
        self.P = np.zeros((4, 4) if self.depth_known else (5, 5))
        self.places = [0, 1] if self.depth_known else [0, 1, 4]
        self.P[self.places, self.places] = self.sigma**2

    @property
    def belief(self):
        return op.Belief(
            mean=np.zeros(4),
            covariance=self.P,
            process_noise=(self.walk, 0.0, 0.0),
            depth_noise=0.0 if self.depth_known else self.walk,
            depth=self.depth,
        )

    def wait(self, time):
        self.P[self.places, self.places] += self.walk**2 * time

    def hear(self, ranging, apart):
        r2 = apart @ apart + self.depth**2
        if r2 > ranging.reach**2:
            return
        variance = ranging.sigma**2 + ranging.growth**2 * r2
        self.P = after_range(self.P, apart, self.depth, variance)


def distances(planner, auv, *, start, pings):
    """Horizontal distances of the aid vehicle from the AUV at its pings, a decision after each."""
    interval, ranging = planner.situation.ping_interval, planner.situation.ranging
    pose, flown = np.array(start), []
    for k in range(pings):
        decision = planner.plan(op.Pose(*map(float, pose)), [auv.belief], time=k * interval)
        pose = arc(pose, decision.turn_rate, decision.speed, interval)
        auv.wait(interval)
        auv.hear(ranging, pose[:2])
        flown.append(math.hypot(*pose[:2]))
    return np.array(flown)


# Orbits. The AUV at rest forgets within five to ten orbits: by what it has forgotten within one, the
# aid vehicle cuts inwards, across the direction that was measured last.


def settled(planner, auv, *, radius, orbits, starts=(1.4,)):
    """Mean distance over the last three orbits of flights from beside the orbit."""
    interval = planner.situation.ping_interval
    an_orbit = 2 * math.pi * radius / SPEED / interval
    flown = [
        distances(planner, auv, start=(start * radius, 0.0, 1.5), pings=int(orbits * an_orbit))
        for start in starts
    ]
    return np.mean([flight[-int(3 * an_orbit) :].mean() for flight in flown])


def walk(sigma, radius, interval, orbits):
    """Of a position [m/s^0.5] that ranges of a standard deviation make known, and forgotten, within some orbits.

    In a steady state the variance is about sigma walk sqrt(3 interval), and walk^2 a second is forgotten.
    """
    return sigma * math.sqrt(3 * interval) / (orbits * 2 * math.pi * radius / SPEED)


@pytest.mark.slow
def test_orbit_about_an_auv_of_unknown_depth_has_the_radius_sqrt_2_times_that_depth():
    r"""Ranges at an angle θ from the vertical tell sin²θ/2, sin²θ/2 and cos²θ of the coordinates.

    4 / sin²θ + 1 / cos²θ is least at tan θ = √2, and so is the trace of steady covariances of equal
    random walks, 2√2 / sin θ + 1 / cos θ. All coordinates are known equally well then, and any one
    range is worth the same from anywhere: the horizon has to be long enough to see an orbit.
    """
    depth, interval = 50.0, 5.0
    best = math.sqrt(2) * depth
    auv = Static(depth, walk(1.0, best, interval, 10), depth_known=False)
    told = situation(Ranging(1.0, slant=True), interval)
    planner = op.InformationHorizon(told, horizon=2 * math.pi * best / SPEED, stages=12)
    assert settled(planner, auv, radius=best, orbits=30) == pytest.approx(best, rel=0.05)


def best_radius(depth, sigma, growth):
    """Where the information d² / r² / (sigma² + growth² r²) of the horizontal position is greatest, on a grid."""
    d = depth * np.linspace(0.5, 3, 250_001)
    r2 = d**2 + depth**2
    return d[np.argmax(d**2 / r2 / (sigma**2 + growth**2 * r2))]


@pytest.mark.parametrize(
    ("depth", "sigma", "interval", "expected"),
    [
        (50.0, 0.01, 5.0, 50.0),
        (50.0, 1.0, 10.0, 74.8),
        (200.0, 1.0, 30.0, 211.5),
        (1000.0, 1.0, 120.0, 1002.5),
    ],
)
def test_orbit_about_an_auv_of_known_depth_is_where_errors_that_grow_leave_most_information(
    depth, sigma, interval, expected
):
    """In proportion to the distance alone (sigma: 1 cm): the depth; else √(h²/b² + h⁴)^½."""
    growth = 0.01
    best = best_radius(depth, sigma, growth)
    assert best == pytest.approx(expected, rel=1e-3)
    error = math.hypot(sigma, growth * math.hypot(best, depth))
    auv = Static(depth, walk(error, best, interval, 5))
    told = situation(Ranging(sigma, growth=growth, slant=True), interval)
    found = settled(op.InformationHorizon(told), auv, radius=best, orbits=15)
    assert found == pytest.approx(best, rel=0.05)


# Reach, loss and slots


def nearest_and_last(ranging, start, pings=60, depth=0.0):
    """Of a flight about an AUV at rest that walks by 0.3 m in a second."""
    auv = Static(depth, 0.3)
    flown = distances(
        op.InformationHorizon(situation(ranging, 10.0)), auv, start=start, pings=pings
    )
    return flown.min(), flown[-20:].mean()


def test_far_beyond_reach_it_comes_nearer():
    away = (1500.0, 200.0, 0.3)  # heading away
    nearest, last = nearest_and_last(Ranging(1.0, reach=300.0), away, pings=120)
    assert last < 300.0
    assert nearest < 300.0


def test_where_loss_grows_with_distance_it_stays_nearer():
    """Farther out slant ranges are flatter, and tell more, as long as they come."""
    start, slant = (150.0, 0.0, 1.5), Ranging(1.0, slant=True)
    _, free = nearest_and_last(slant, start, depth=60.0)
    _, lossy = nearest_and_last(slant._replace(half_distance=50.0), start, depth=60.0)
    assert lossy < 0.85 * free


def test_each_auv_is_counted_on_in_its_slot():
    """Of two AUVs that differ in their slots alone, the decision is for the one whose range is expected in this stage."""
    left, right = (
        op.Belief(mean=np.array([0.0, y, 0.0, 0.0]), covariance=np.diag([9.0, 9.0, 0, 0]))
        for y in (60.0, -60.0)
    )
    pose = op.Pose(0.0, 0.0, 0.0)
    scores = {}
    for slots in ((), (0.0, 10.0), (10.0, 0.0)):
        told = situation(Ranging(1.0), 20.0, slots=slots)
        planner = op.InformationHorizon(told, horizon=20.0, stages=2)
        scores[slots] = planner.plan(pose, [left, right], time=15.0)
    early, late = scores[0.0, 10.0], scores[10.0, 0.0]
    assert early.turn_rate == -late.turn_rate != 0.0  # mirrored, as the AUVs are
    assert early.score == pytest.approx(late.score)
    assert len(early.path) == len(scores[()].path) == 3
    times = [np.array([5.0, 15.0]), np.array([5.0, 25.0])]  # of the stages' ends
    for decision, ends in zip((early, scores[()]), times, strict=True):
        moved = np.hypot(*np.diff(decision.path[:, :2], axis=0).T)
        assert (moved <= SPEED * np.diff([0.0, *ends]) + 1e-9).all()


# Beliefs with a depth


def test_auv_that_knows_its_depth_counts_the_same_beside_one_that_does_not():
    """Its depth is known to a micrometre then: the log-determinant is its own, and that of the micrometre."""
    rng = np.random.default_rng(0)
    half = rng.normal(size=(5, 5))
    deep = op.Belief(mean=np.zeros(4), covariance=half @ half.T, depth=20.0, depth_noise=0.1)
    flat = op.Belief(mean=np.array([40.0, 5.0, 0.3, 0.0]), covariance=np.diag([4.0, 9, 0, 0]))
    P, noise = believed([deep, flat])
    np.testing.assert_array_equal(P[0], deep.covariance)
    np.testing.assert_array_equal(P[1, :4, :4], flat.covariance)
    assert 0 < P[1, 4, 4] <= 1e-12
    np.testing.assert_array_equal(noise, [[0, 0, 0, 0, 0.1], [0, 0, 0, 0, 0]])
    pose = op.Pose(-30.0, 10.0, 0.2)
    told = situation(Ranging(1.0, slant=True), 10.0)
    planner = op.InformationHorizon(told, criterion="log-det")
    muted = op.Belief(mean=np.zeros(4), covariance=np.eye(5), weight=0.0)
    both, alone = planner.plan(pose, [flat, muted]), planner.plan(pose, [flat])
    assert both.turn_rate == alone.turn_rate
    assert both.score == pytest.approx(alone.score + math.log(1e-12), rel=1e-6)


def test_depth_counts_in_the_criterion_where_it_is_to_be_estimated():
    """An AUV that knows all but its depth is best measured from above."""
    auv = op.Belief(mean=np.zeros(4), covariance=np.diag([0.01, 0.01, 0, 0, 9.0]), depth=60.0)
    planner = op.InformationHorizon(situation(Ranging(1.0, slant=True), 10.0))
    pose = np.array([150.0, 0.0, 1.5])
    for k in range(8):
        decision = planner.plan(op.Pose(*map(float, pose)), [auv], time=10.0 * k)
        pose = arc(pose, decision.turn_rate, decision.speed, 10.0)
    assert math.hypot(*pose[:2]) < 30.0
