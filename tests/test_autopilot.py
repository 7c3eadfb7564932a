"""Claims about how a mission is sailed, and about missions whose commands are fixed beforehand."""

import itertools
import math

import numpy as np
import pytest
import shapely

from obsplan.missions import Track
from obsplan.missions.export import simplify
from obsplan.missions.flown_path import Allowance
from obsplan.scenario import load
from obsplan.simulation import simulate
from obsplan.simulation.autopilot import Autopilot, FixedPath, in_wider_turns
from obsplan.simulation.loop import ClosedLoop
from obsplan.types import Pose
from obsplan.vehicles import Unicycle

BOAT = Unicycle(speed=2.0, min_turn_radius=10.0)
AUTOPILOT = Autopilot(cna=BOAT, acceptance=2.0)
STEP = 0.5


def sail(track, start, seconds, **options):
    """Commands, and the poses that they lead to by small straight steps (apart from the house's arcs)."""
    steps = round(seconds / STEP)
    commands = AUTOPILOT.commands(track, start, time_step=STEP, steps=steps, **options)
    poses, fine = [(start.x, start.y, start.heading)], 200
    for turn_rate, speed in commands:
        x, y, heading = poses[-1]
        angles = heading + turn_rate * (np.arange(fine) + 0.5) * STEP / fine
        advance = speed * STEP / fine
        x, y = x + advance * np.cos(angles).sum(), y + advance * np.sin(angles).sum()
        poses.append((x, y, heading + turn_rate * STEP))
    return commands, np.array(poses)


def square(side=120.0, speed=2.0):
    corners = side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 2.0]])
    return Track(points=corners, speed=np.full(4, speed))


def test_vehicle_sails_along_the_lines_and_stops_at_the_end():
    track = square()
    commands, poses = sail(track, Pose(0.0, 0.0, 0.0), 300.0)
    away = shapely.distance(shapely.points(poses[:, :2]), shapely.LineString(track.points))
    # a right angle takes a vehicle that turns on 10 m out by less than its turning radius
    assert away.max() < 10.0
    assert np.median(away) < 0.1
    assert np.hypot(*(poses[-1, :2] - track.points[-1])) <= 2.0
    assert (commands[-20:] == 0).all()
    assert (abs(commands[:, 0]) <= commands[:, 1] / 10.0 + 1e-12).all()
    done = np.flatnonzero(commands[:, 1])[-1] * STEP
    assert done == pytest.approx(480.0 / 2.0, abs=10.0)  # corners are cut


def test_vehicle_that_begins_beside_its_mission_comes_to_it():
    track = Track(points=np.array([[0.0, 0.0], [400.0, 0.0]]), speed=np.array([2.0]))
    _, poses = sail(track, Pose(-50.0, 30.0, math.pi / 2), 250.0)
    passed = poses[poses[:, 0] > 60.0]
    assert abs(passed[:, 1]).max() < 0.1


def test_each_leg_has_its_speed_and_each_hold_its_time():
    points = np.array([[0.0, 0.0], [100.0, 0.0], [200.0, 0.0], [300.0, 0.0]])
    track = Track(
        points=points, speed=np.array([2.0, 0.5, 1.0]), hold=np.array([5.0, 0.0, 20.0, 0.0])
    )
    commands, poses = sail(track, Pose(0.0, 0.0, 0.0), 600.0)
    # a leg begins within the acceptance radius of 2 m
    for (a, b), speed in zip(itertools.pairwise(points[:, 0]), (2.0, 0.5, 1.0), strict=True):
        on = (poses[:-1, 0] > a + 0.1) & (poses[:-1, 0] < b - 2.1) & (commands[:, 1] > 0)
        assert set(commands[on, 1]) == {speed}
    standing = (commands[:, 1] == 0) & (poses[:-1, 0] < 290)
    at = poses[:-1, 0][standing]
    assert np.count_nonzero(at < 1) * STEP == 5.0
    assert np.count_nonzero((at > 197) & (at < 201)) * STEP == 20.0


@pytest.mark.parametrize("late", [0.0, 60.0, 180.0])
def test_a_late_start_is_the_same_mission_later(late):
    on_time, _ = sail(square(), Pose(0.0, 0.0, 0.3), 200.0)
    commands, _ = sail(square(), Pose(0.0, 0.0, 0.3), 200.0, late=late)
    waited = round(late / STEP)
    assert (commands[:waited] == 0).all()
    np.testing.assert_array_equal(commands[waited:], on_time[: len(on_time) - waited])


def test_a_simplified_path_is_sailed_near_the_path_and_in_time():
    rng = np.random.default_rng(4)
    rates = np.repeat(rng.choice([-0.2, -0.06, 0.0, 0.06, 0.2], 200), 4)
    heading = np.append(0.0, np.cumsum(rates * STEP))
    middle = (heading[1:] + heading[:-1]) / 2
    moves = 2.0 * STEP * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
    places = np.vstack([[0.0, 0.0], np.cumsum(moves, axis=0)])
    flown = Track(points=places, time=STEP * np.arange(len(places)))
    mission = simplify(flown, Allowance(tolerance=0.5, timing=1.0))
    _, poses = sail(mission.track, Pose(0.0, 0.0, 0.0), 400.0)
    astray = np.hypot(*(poses[:, :2] - places).T)
    assert astray.max() < 0.5 + 2.0 * (1.0 + 1.5)  # tolerance, timing, corners cut


# --- fixed commands ----------------------------------------------------------------------------


def fixed(commands):
    return FixedPath(commands=commands, time_step=STEP)


class Stepwise:
    """The same commands from a planner that is asked for each."""

    def __init__(self, commands):
        self.path = fixed(commands)

    def plan(self, pose, auvs, *, time=0.0):
        return self.path.plan(pose, auvs, time=time)


@pytest.fixture(scope="module")
def short():
    return load("harbor-survey", settings=["duration=90.0", "planner.interval=0.5"])


def test_a_runs_own_commands_give_the_run_again(short):
    run = simulate(short, planner="information", seed=5)
    again = ClosedLoop(
        scenario=short, planner=fixed(np.column_stack([run.turn_rate, run.speed])[:-1])
    ).fly(5)
    for name in ("cna", "truth", "mean", "covariance", "range", "turn_rate", "speed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    assert again.planner == "FixedPath"


def test_fixed_commands_are_what_a_planner_that_is_asked_for_them_gives(short):
    rng = np.random.default_rng(1)
    speed = rng.uniform(0.0, 2.0, short.time.size - 1)
    commands = np.column_stack([rng.uniform(-0.1, 0.1, speed.size) * speed, speed])
    folded = ClosedLoop(scenario=short, planner=fixed(commands)).fly(3)
    asked = ClosedLoop(scenario=short, planner=Stepwise(commands)).fly(3)
    for name in ("cna", "truth", "mean", "covariance", "range", "turn_rate", "speed"):
        np.testing.assert_array_equal(getattr(folded, name), getattr(asked, name))
    np.testing.assert_array_equal(folded.turn_rate[:-1], commands[:, 0])


def test_fixed_commands_are_flown_whatever_the_limits():
    scenario = load(
        "harbor-survey",
        settings=["duration=60.0", "constraints.keep_out=[{x=0.0,y=0.0,radius=20.0}]"],
    )
    straight = np.tile([0.0, 2.0], (scenario.time.size - 1, 1))
    run = ClosedLoop(scenario=scenario, planner=fixed(straight)).fly(1)
    np.testing.assert_allclose(run.cna[:, 0], 0.0, atol=1e-9)  # from (0, -50) due north
    assert run.violation.max() == pytest.approx(20.0, abs=0.5)


def test_a_vehicle_may_stand(short):
    still = np.zeros((short.time.size - 1, 2))
    run = ClosedLoop(scenario=short, planner=fixed(still)).fly(1)
    np.testing.assert_array_equal(run.cna, np.tile(run.cna[0], (run.time.size, 1)))


# --- wider turns -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("radius", [10.0, 15.0, 30.0])
def test_wider_turns_are_kept_and_the_plan_is_not_left_behind(radius):
    run = simulate(load("harbor-survey", planner="random"))
    plan = run.cna[:, :2]
    cna = Unicycle(speed=2.0, min_turn_radius=radius)
    path = in_wider_turns(plan, Pose(*run.cna[0].tolist()), cna, STEP)
    assert path.shape == plan.shape
    a, b, c = path[:-2], path[1:-1], path[2:]
    sides = [np.hypot(*(q - p).T) for p, q in ((a, b), (b, c), (a, c))]
    area = 0.5 * abs(
        np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2]
    )
    moving = np.minimum(sides[0], sides[1]) > 0.5
    circumradius = np.prod(sides, axis=0)[moving] / (4 * np.maximum(area[moving], 1e-12))
    assert circumradius.min() >= radius * (1 - 1e-2)  # of two arcs, a little less than the wider's
    assert max(sides[0].max(), sides[1].max()) <= 2.0 * STEP + 1e-9
    apart = np.hypot(*(path - plan).T)
    assert np.median(apart[-500:]) < 5 * radius


@pytest.mark.parametrize("told", [True, False])
def test_vehicle_that_a_current_carries_holds_its_line_and_speed_over_ground_if_it_is_told(told):
    track = Track(points=np.array([[0.0, 0.0], [400.0, 0.0]]), speed=np.array([1.5]))
    current, steps = np.array([0.3, 0.5]), round(240.0 / STEP)
    stream = {"stream": np.tile(current, (steps, 1))} if told else {}
    # what is sailed in the water, and with it
    commands, poses = sail(track, Pose(0.0, 0.0, 0.0), 240.0, **stream)
    over_ground = poses[:, :2] + current * STEP * np.arange(steps + 1)[:, None]
    assert (commands[:, 1] <= BOAT.speed).all()
    if not told:
        assert abs(over_ground[-1, 1]) > 100.0
        return
    assert np.median(abs(over_ground[:, 1])) < 0.1
    assert over_ground[steps // 2, 0] == pytest.approx(1.5 * 120.0, abs=2.0)
