"""Planners that others would use: each does what its name says, against geometry by hand."""

import math

import numpy as np
import pytest
from oracles import arc, scenario
from scipy.stats import kstest

import obsplan as op
from formulations.solution import Status
from obsplan.planners.centroid_orbit import CentroidOrbit
from obsplan.planners.error_ellipse import ErrorEllipse
from obsplan.planners.random_turns import RandomTurns
from obsplan.planners.trail import Trail

CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)
CAPABLE = {
    "speed": 2.0,
    "min_turn_radius": 5.0,
    "start": {"x": 80.0, "y": -30.0, "heading_deg": 140.0},
}


def flown(planner, pose, auvs, steps, dt=0.5):
    """Poses and speeds under a planner asked every dt; ``auvs`` are the beliefs at a time."""
    poses, speeds, pose = [np.array(pose)], [], np.array(pose)
    for k in range(steps):
        decision = planner.plan(op.Pose(*map(float, pose)), auvs(k * dt), time=k * dt)
        pose = arc(pose, decision.turn_rate, decision.speed, dt)
        poses.append(pose)
        speeds.append(decision.speed)
    return np.array(poses), np.array(speeds)


def sailing(x, y, heading, speed, weight=1.0):
    """Beliefs about an AUV on a straight course, as a function of time."""
    return lambda t: op.Belief.at(
        x + speed * t * math.cos(heading),
        y + speed * t * math.sin(heading),
        heading=heading,
        speed=speed,
        weight=weight,
    )


# Centroid orbit


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.0, 0.5, 1.2])
@pytest.mark.parametrize(
    ("start", "side"), [((40.0, 0.0, 1.0), 1), ((40.0, 0.0, -1.0), -1), ((1.0, 2.0, 0.0), 0)]
)
def test_orbit_stays_at_its_radius_from_the_moving_centroid(speed, start, side):
    auvs = [sailing(-10.0, 0.0, 0.3, speed, 1.0), sailing(10.0, 6.0, 0.3, speed, 3.0)]
    poses, _ = flown(
        CentroidOrbit(op.Situation(CNA), orbit_radius=25.0),
        start,
        lambda t: [auv(t) for auv in auvs],
        500,
    )
    time = 0.5 * np.arange(501)
    center = np.array([[5.0, 4.5]]) + speed * time[:, None] * [
        math.cos(0.3),
        math.sin(0.3),
    ]  # weights 1 and 3
    away = poses[:, :2] - center
    np.testing.assert_allclose(np.hypot(*away.T)[200:], 25.0, atol=1.0)  # turns are held for 0.5 s
    bearing = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    assert abs(bearing[-1] - bearing[200]) > math.pi
    if side:
        assert np.sign(bearing[-1] - bearing[200]) == side  # the shorter way round


def test_orbit_is_by_default_a_turning_diameter_beyond_the_farthest_auv():
    auvs = [
        op.Belief.at(0.0, 0.0),
        op.Belief.at(12.0, 0.0, weight=2.0),
        op.Belief.at(500.0, 0.0, weight=0.0),
    ]
    decision = CentroidOrbit(op.Situation(CNA)).plan(op.Pose(8.0, 30.0, 0.0), auvs)
    assert decision.score == pytest.approx((30.0 - (8.0 + 10.0)) ** 2)
    with pytest.raises(
        ValueError, match=r"orbit_radius must be at least the turning radius 5\.0 m, got 4\.9"
    ):
        CentroidOrbit(op.Situation(CNA), orbit_radius=4.9)


# Trail


@pytest.mark.parametrize(("behind", "left"), [(None, 0.0), (20.0, -8.0), (0.0, 15.0)])
def test_trail_takes_its_place_and_slows_to_the_speed_of_the_auvs(behind, left):
    auv = sailing(3.0, 4.0, 0.7, 0.8)
    poses, speeds = flown(
        Trail(op.Situation(CNA), behind=behind, left=left),
        (60.0, -20.0, 2.0),
        lambda t: [auv(t)],
        400,
    )
    ahead, abeam = (
        np.array([math.cos(0.7), math.sin(0.7)]),
        np.array([-math.sin(0.7), math.cos(0.7)]),
    )
    gap = poses[-1, :2] - auv(200.0).mean[:2]
    assert gap @ ahead == pytest.approx(-10.0 if behind is None else -behind, abs=0.1)
    assert gap @ abeam == pytest.approx(left, abs=0.1)
    assert speeds[-1] == pytest.approx(0.8, abs=0.01)
    assert speeds.max() == 2.0
    turned = np.abs(np.diff(poses[:, 2])) / 0.5
    assert (turned <= speeds / 5.0 * (1 + 1e-9)).all()  # never tighter than it can


def test_trail_turns_no_tighter_when_it_is_slow():
    decision = Trail(op.Situation(CNA)).plan(
        op.Pose(-10.0, 0.0, 3.0), [op.Belief.at(0.0, 0.0, speed=0.3)]
    )  # in its place, the wrong way round
    assert decision.speed == pytest.approx(0.3)
    assert decision.turn_rate == pytest.approx(-0.3 / 5.0)


def test_trail_keeps_its_place_in_the_current():
    mission = scenario(
        planner={"kind": "trail", "interval": 0.5, "knowledge": "truth"},
        environment={"current": [0.3, -0.2]},
        auv=[
            {
                "name": "a",
                "speed": 1.2,
                "survey": {"kind": "waypoints", "points": [[0.0, 0.0], [150.0, 0.0]]},
            }
        ],
        duration=100.0,
        cna=CAPABLE,
    )
    run = op.simulate(mission)
    truth = run.truth[0, -1]
    place = truth[:2] - 10.0 * np.array([math.cos(truth[2]), math.sin(truth[2])])
    assert math.dist(run.cna[-1, :2], place) < 0.5


def test_trail_refuses_a_place_that_is_no_number():
    with pytest.raises(ValueError, match=r"left must be from -100000 to 100000 m .*, got nan"):
        Trail(op.Situation(CNA), behind=3.0, left=math.nan)


# Error ellipse


def uncertain(x, y, axis, *, weight=1.0):
    """Belief whose error ellipse is long along an axis [rad]."""
    R = np.eye(4)
    R[:2, :2] = [[math.cos(axis), -math.sin(axis)], [math.sin(axis), math.cos(axis)]]
    return op.Belief.at(x, y, covariance=R @ np.diag([9.0, 1.0, 0.0, 0.0]) @ R.T, weight=weight)


def test_error_ellipse_takes_the_turn_that_leaves_least_variance_across_the_next_range():
    rng = np.random.default_rng(1)
    rates = np.linspace(0.4, -0.4, 21)
    for _ in range(20):
        pose, time = rng.uniform([-20, -20, -3], [20, 20, 3]), float(rng.uniform(0, 50))
        auvs = [
            uncertain(*rng.uniform(-30, 30, 2), rng.uniform(-3, 3), weight=w) for w in (1.0, 2.0)
        ]
        wait = 6.0 - time % 6.0
        left = []
        for u in rates:
            place = arc(pose, u, 2.0, wait)[:2]
            sight = [(place - auv.mean[:2]) / math.dist(place, auv.mean[:2]) for auv in auvs]
            across = [np.array([-s[1], s[0]]) for s in sight]
            left.append(
                np.average(
                    [a @ auv.covariance[:2, :2] @ a for a, auv in zip(across, auvs, strict=True)],
                    weights=[1, 2],
                )
            )
        decision = ErrorEllipse(op.Situation(CNA, ping_interval=6.0)).plan(
            op.Pose(*map(float, pose)), auvs, time=time
        )
        assert decision.score == pytest.approx(min(left), rel=1e-9)
        assert decision.turn_rate == rates[np.argmin(left)]


def test_error_ellipse_of_a_moving_auv_is_where_it_will_be():
    still, moving = uncertain(20.0, 0.0, 1.0), uncertain(20.0 - 6.0 * 1.5, 0.0, 1.0)
    moving = op.Belief(
        mean=np.array([11.0, 0.0, 0.0, 1.3]), covariance=moving.covariance, current=(0.2, 0.0)
    )
    plans = [
        ErrorEllipse(op.Situation(CNA, ping_interval=6.0)).plan(op.Pose(0.0, 3.0, 0.5), [auv])
        for auv in (still, moving)
    ]
    assert plans[1].turn_rate == plans[0].turn_rate
    assert plans[1].score == pytest.approx(plans[0].score, rel=1e-12)


def test_error_ellipse_brings_the_line_of_sight_to_the_long_axis():
    auv = uncertain(0.0, 0.0, 1.2)
    poses, _ = flown(
        ErrorEllipse(op.Situation(CNA, ping_interval=4.0)), (40.0, 0.0, 1.0), lambda _t: [auv], 80
    )
    sight = np.arctan2(poses[:, 1], poses[:, 0]) - 1.2
    assert np.abs(np.sin(sight)).min() < 0.02
    assert abs(math.sin(sight[0])) > 0.9


def test_error_ellipse_at_a_ping_waits_for_the_next_one_however_its_time_is_rounded():
    for side in (
        1.0,
        -1.0,
    ):  # one of them is not what it does when no time is left for any turn to matter
        planner, pose = (
            ErrorEllipse(op.Situation(CNA, ping_interval=0.7)),
            op.Pose(9.0, 3.0 * side, 0.5 * side),
        )
        plans = {
            planner.plan(pose, [uncertain(0.0, 0.0, side)], time=k * 0.7).turn_rate
            for k in range(200)
        }
        assert len(plans) == 1
    with pytest.raises(
        ValueError, match=r"ping_interval must be positive and finite \[s\], got 0.0"
    ):
        ErrorEllipse(op.Situation(CNA, ping_interval=0.0))
    with pytest.raises(ValueError, match=r"turn_rates must be from 2 to 1001 .*, got 1"):
        ErrorEllipse(op.Situation(CNA, ping_interval=1.0), turn_rates=1)


# Random


@pytest.mark.slow
def test_random_turns_are_uniform_held_and_repeatable():
    planner, pose = RandomTurns(op.Situation(CNA), seed=3, hold=2.0), op.Pose(0.0, 0.0, 0.0)
    turns = np.array([planner.plan(pose, [], time=2.0 * k).turn_rate for k in range(2000)])
    assert kstest(turns, "uniform", args=(-0.4, 0.8)).pvalue > 0.01
    assert abs(np.corrcoef(turns[:-1], turns[1:])[0, 1]) < 3 / math.sqrt(2000)
    assert [planner.plan(pose, [], time=7.0 + t).turn_rate for t in (-0.99, 0.0, 0.99)] == [
        turns[3]
    ] * 3
    assert (
        planner.plan(pose, [], time=3 * 0.7).turn_rate == planner.plan(pose, [], time=2.1).turn_rate
    )
    other = np.array(
        [
            RandomTurns(op.Situation(CNA), seed=4, hold=2.0).plan(pose, [], time=2.0 * k).turn_rate
            for k in range(2000)
        ]
    )
    assert abs(np.corrcoef(turns, other)[0, 1]) < 3 / math.sqrt(2000)


def test_random_turns_of_a_mission_are_those_of_its_seed_unless_the_scenario_has_one_for_them():
    mission = scenario(planner={"kind": "random"})
    first, again, other = (op.simulate(mission, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.turn_rate, again.turn_rate)
    assert (first.turn_rate[:-1] != other.turn_rate[:-1]).all()
    fixed = [
        op.simulate(scenario(planner={"kind": "random", "seed": 9}), seed=seed) for seed in (1, 2)
    ]
    np.testing.assert_array_equal(fixed[0].turn_rate, fixed[1].turn_rate)
    assert (fixed[0].turn_rate[:-1] != first.turn_rate[:-1]).all()


def test_random_turns_refuse_by_name_and_value():
    with pytest.raises(ValueError, match=r"seed must be from 0 to .*, got -1"):
        RandomTurns(op.Situation(CNA), seed=-1)
    with pytest.raises(ValueError, match=r"hold must be from 0.001 to 86400 s .*, got 0.0"):
        RandomTurns(op.Situation(CNA), seed=1, hold=0.0)


@pytest.mark.parametrize("kind", ["centroid-orbit", "trail", "error-ellipse", "random"])
def test_rivals_fly_a_mission_without_a_word(kind):
    run = op.simulate(
        scenario(planner={"kind": kind, "interval": 1.0, "knowledge": "estimate"}, duration=60.0)
    )
    assert set(run.status_counts) == {Status.OPTIMAL.label}
    assert np.isfinite(run.cna).all()
