"""Claims about the simplest path that an autopilot takes."""

import itertools
import math

import numpy as np
import pytest
import shapely

from obsplan.constraints import Constraints, Disc, Polygon
from obsplan.missions import Track
from obsplan.missions.export import simplify
from obsplan.missions.flown_path import Allowance
from obsplan.missions.writers.items import mission_items

SPEED = 2.0


def sailed(points, speed=SPEED):
    """A path sailed at one speed."""
    points = np.asarray(points, dtype=float)
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    return Track(points=points, time=way / speed)


def arc(radius, angle, samples):
    turned = np.linspace(0.0, angle, samples)
    return radius * np.stack([np.cos(turned), np.sin(turned)], axis=-1)


def wandering(seed, samples=1500, step=1.0):
    """A path of arcs and straights with turns of 10 m and more, as the planners fly."""
    rng = np.random.default_rng(seed)
    rates = np.repeat(rng.choice([-0.1, -0.03, 0.0, 0.03, 0.1], samples // 8), 8)
    heading = np.append(0.0, np.cumsum(rates * step))
    middle = (heading[:-1] + heading[1:]) / 2
    moves = step * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
    return np.vstack([[0.0, 0.0], np.cumsum(moves, axis=0)])


def legs_of(flown, simplified):
    """For each leg the samples it stands for, found by the times of its waypoints."""
    chosen = np.searchsorted(flown.time, simplified.track.time)
    for (i, a), (j, b) in itertools.pairwise(zip(chosen, simplified.track.points, strict=True)):
        yield shapely.LineString([a, b]), flown.points[i : j + 1]


def departure(flown, simplified):
    """Greatest distance of a sample from the leg that stands for it [m], by shapely."""
    return max(
        shapely.distance(shapely.points(samples), leg).max()
        for leg, samples in legs_of(flown, simplified)
    )


def place_at(mission, time):
    """Where a vehicle is at times, that goes straight from waypoint to waypoint at their speeds with their holds."""
    track = mission.track
    hold = np.zeros(len(track.points)) if track.hold is None else track.hold
    knots, places, now = [0.0], [track.points[0]], 0.0
    for k, point in enumerate(track.points):
        if k:
            now += np.hypot(*(point - track.points[k - 1])) / track.speed[k - 1]
            knots.append(now)
            places.append(point)
        now += hold[k]
        knots.append(now)
        places.append(point)
    return np.stack([np.interp(time, knots, xy) for xy in np.transpose(places)], axis=-1)


# --- near the path -----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("tolerance", "spacing"), [(0.5, 2.0), (0.1, 0.0), (2.0, 5.0)])
def test_path_keeps_to_its_tolerance_its_spacing_and_its_time(seed, tolerance, spacing):
    flown = sailed(wandering(seed))
    allowance = Allowance(items=5000, spacing=spacing, tolerance=tolerance, timing=1.0)
    mission = simplify(flown, allowance)
    assert departure(flown, mission) == pytest.approx(mission.deviation, abs=1e-9)
    assert mission.deviation <= tolerance
    assert np.hypot(*np.diff(mission.track.points, axis=0).T).min() >= spacing
    assert mission.timing <= 1.0
    astray = np.hypot(*(place_at(mission, flown.time) - flown.points).T).max()
    assert astray <= mission.deviation + SPEED * mission.timing + 1e-9
    np.testing.assert_array_equal(mission.track.points[[0, -1]], flown.points[[0, -1]])
    where = np.searchsorted(flown.time, mission.track.time)
    np.testing.assert_array_equal(mission.track.points, flown.points[where])


def test_a_circle_takes_no_more_waypoints_than_its_sagitta_asks_for():
    radius, tolerance = 30.0, 0.4
    angle = 2 * math.pi * 1.9
    flown = sailed(arc(radius, angle, 12001))
    mission = simplify(flown, Allowance(tolerance=tolerance, spacing=2.0))
    least = math.ceil(angle / (2 * math.acos(1 - tolerance / radius)))
    legs = len(mission.track.points) - 1
    # a fiftieth of the tolerance goes into the choice of samples: sqrt(1 / 0.98) as many legs
    assert least <= legs <= math.ceil(least * math.sqrt(1 / 0.98)) + 1


def test_straight_legs_need_only_their_corners():
    corners = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0], [-20.0, 50.0]])
    dense = [np.linspace(a, b, 400, endpoint=False) for a, b in itertools.pairwise(corners)]
    mission = simplify(sailed(np.vstack([*dense, corners[-1:]])), Allowance())
    np.testing.assert_allclose(mission.track.points, corners, atol=1e-9)
    assert (mission.items, mission.deviation) == (6, pytest.approx(0.0, abs=1e-9))  # home, a speed


def test_fewest_waypoints_are_as_few_as_trying_all_ways_finds():
    points = wandering(5, samples=120)
    flown = sailed(points)
    tolerance = 0.5
    mission = simplify(flown, Allowance(tolerance=tolerance, spacing=2.0, timing=100.0))

    def fits(i, j):
        leg = shapely.LineString(points[[i, j]])
        near = shapely.distance(shapely.points(points[i : j + 1]), leg).max() <= 0.98 * tolerance
        return near and leg.length >= 2.0

    fewest = [0] + [math.inf] * (len(points) - 1)
    for j in range(1, len(points)):
        fewest[j] = min((fewest[i] + 1 for i in range(j) if fits(i, j)), default=math.inf)
    assert len(mission.track.points) - 1 == fewest[-1]


# --- in the vehicle's room ---------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("most", "end"), [(60, "loiter"), (30, "return"), (8, "stop")])
def test_items_fit_and_the_tolerance_grows_by_as_much_as_that_takes(most, end):
    flown = sailed(wandering(1, samples=800, step=0.25))
    room = Allowance(items=most, tolerance=0.02, spacing=0.0)
    mission = simplify(flown, room, end=end)
    counted = 1 + len(mission_items(mission.track, end=end))
    assert mission.items == counted <= most
    assert departure(flown, mission) == pytest.approx(mission.deviation, abs=1e-9)
    assert mission.deviation > room.tolerance
    tighter = Allowance(items=5000, tolerance=mission.deviation / 1.3, timing=1e3, spacing=0.0)
    assert simplify(flown, tighter, end=end).items > most  # no more was given away


@pytest.mark.parametrize("radius", [0.5, 0.9, 1.2])
def test_a_path_in_less_room_than_a_leg_is_told_for_what_it_is(radius):
    flown = sailed(arc(radius, 40.0, 4001))
    mission = simplify(flown, Allowance(spacing=2.0))
    lengths = np.hypot(*np.diff(mission.track.points, axis=0).T)
    assert (lengths >= 2.0).all()
    if radius < 1.0:
        assert len(mission.track.points) == 1
        farthest = np.hypot(*(flown.points - flown.points[0]).T).max()
        assert mission.deviation == pytest.approx(farthest)
    else:
        assert mission.deviation == pytest.approx(departure(flown, mission))


def test_an_end_nearer_than_a_leg_to_its_start_is_left_out_and_counted():
    out, back = np.linspace(0.0, 3.0, 31), np.linspace(3.0, 1.5, 16)[1:]
    along = np.concatenate([out, back])
    mission = simplify(sailed(np.stack([along, np.zeros_like(along)], axis=-1)), Allowance())
    assert mission.deviation >= 1.0  # the last place is 1.5 m from every one that a leg leads to
    assert np.hypot(*np.diff(mission.track.points, axis=0).T) == pytest.approx([2.0], abs=1.0)


def test_a_vehicle_that_stays_put_has_one_waypoint():
    still = Track(points=np.zeros((50, 2)), time=np.arange(50.0))
    mission = simplify(still, Allowance())
    assert len(mission.track.points) == 1
    assert (mission.items, mission.deviation, mission.timing) == (2, 0.0, 0.0)
    assert mission.track.speed is mission.track.hold is None


# --- in time -----------------------------------------------------------------------------------


def test_one_speed_does_where_chords_are_short_by_the_same():
    mission = simplify(sailed(arc(20.0, 30.0, 6001)), Allowance())
    assert np.unique(mission.track.speed).size == 1
    lengths = np.hypot(*np.diff(mission.track.points, axis=0).T)
    assert mission.track.speed[0] == pytest.approx(lengths.sum() / 300.0, rel=1e-2)
    assert mission.track.speed[0] < SPEED


def test_speeds_change_where_the_vehicle_changed_its_own():
    out = np.stack([np.linspace(0, 400, 401), np.zeros(401)], axis=-1)
    time = np.concatenate([np.arange(0, 101) * 0.5, 50 + np.arange(1, 301) * 2.0])
    mission = simplify(Track(points=out, time=time), Allowance(timing=0.5))
    np.testing.assert_allclose(mission.track.speed, [2.0, 0.5], rtol=1e-2)
    np.testing.assert_allclose(mission.track.points[1], [100.0, 0.0], atol=2.0)
    assert mission.timing <= 0.5


def test_a_vehicle_that_stood_is_told_to_hold():
    out = np.linspace(0.0, 60.0, 61)
    along = np.concatenate([out, np.full(80, 60.0), 60 + out[1:]])
    places = np.stack([along, np.zeros_like(along)], axis=-1)
    flown = Track(points=places, time=0.5 * np.arange(along.size))
    mission = simplify(flown, Allowance(timing=0.5))
    np.testing.assert_allclose(mission.track.points[:, 0], [0.0, 60.0, 120.0])
    np.testing.assert_allclose(mission.track.hold, [0.0, 40.0, 0.0])
    assert mission.timing <= 0.5
    astray = np.hypot(*(place_at(mission, flown.time) - flown.points).T).max()
    assert astray <= mission.deviation + SPEED * mission.timing + 1e-9


def test_holds_at_the_start_on_the_way_and_where_the_speed_changes_are_kept():
    fast, on = np.linspace(0.0, 50.0, 51), np.linspace(50.0, 100.0, 51)[1:]
    slow = np.linspace(100.0, 200.0, 201)[1:]
    slower = np.linspace(200.0, 220.0, 81)[1:]
    standing = [np.full(40, 0.0), np.full(60, 50.0), np.full(20, 200.0)]
    parts = [standing[0], fast, standing[1], on, slow, standing[2], slower]
    along = np.concatenate(parts)
    places = np.stack([along, np.zeros_like(along)], axis=-1)
    flown = Track(points=places, time=0.5 * np.arange(along.size))
    mission = simplify(flown, Allowance(timing=0.2))
    np.testing.assert_allclose(mission.track.points[:, 0], [0.0, 50.0, 100.0, 200.0, 220.0])
    np.testing.assert_allclose(mission.track.hold, [20.0, 30.0, 0.0, 10.0, 0.0])
    np.testing.assert_allclose(mission.track.speed, [2.0, 2.0, 1.0, 0.5])
    assert np.hypot(*(place_at(mission, flown.time) - places).T).max() <= 2.0 * 0.2


@pytest.mark.parametrize("seed", range(3))
def test_no_speed_is_above_what_the_vehicle_sailed(seed):
    rng = np.random.default_rng(seed)
    points = wandering(seed)
    speeds = np.repeat(rng.uniform(0.4, 2.0, len(points) // 20 + 1), 20)[: len(points) - 1]
    time = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T) / speeds))
    mission = simplify(Track(points=points, time=time), Allowance(items=2000, timing=1.0))
    assert mission.timing <= 1.0
    assert mission.track.speed.max() <= 2.0
    astray = np.hypot(*(place_at(mission, time) - points).T).max()
    assert astray <= mission.deviation + 2.0 * mission.timing + 1e-9


# --- within limits -----------------------------------------------------------------------------


def hugging(clearance, radius=15.0):
    """Half round a disc at the origin, at a clearance, with straights before and after."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 400)
    turn = (radius + clearance) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    before, after = np.linspace(-60, 0, 100, endpoint=False), np.linspace(0, -60, 100)[1:]
    lead = np.stack([before, np.full(before.size, turn[0, 1])], axis=-1)
    tail = np.stack([after, np.full(after.size, turn[-1, 1])], axis=-1)
    return np.vstack([lead, turn, tail])


DISC = shapely.Point(0, 0).buffer(15.0, 512)
STADIUM = DISC.union(shapely.box(-80, -15, 0, 15))
ROOM = shapely.box(-70, -40, 40, 40).difference(STADIUM)  # goes round the disc as the path does
LIMITS = {
    "disc": Constraints(keep_out=(Disc(x=0.0, y=0.0, radius=15.0),)),
    "polygon": Constraints(keep_out=(Polygon(points=tuple(DISC.exterior.coords)[:-1]),)),
    "fence": Constraints(geofence=Polygon(points=tuple(ROOM.exterior.coords)[:-1])),
}


@pytest.mark.parametrize("limit", LIMITS)
def test_no_leg_breaks_a_limit_that_the_path_keeps(limit):
    flown = sailed(hugging(0.1))  # a leg of 2 m is 3 cm from its arc
    mission = simplify(flown, Allowance(), constraints=LIMITS[limit])
    cut = shapely.LineString(mission.track.points).intersection(STADIUM.buffer(-1e-3))
    assert cut.is_empty
    assert mission.deviation <= 0.5
    free = simplify(flown, Allowance())
    assert shapely.LineString(free.track.points).intersection(STADIUM.buffer(-1e-3)).length > 1.0
    assert len(free.track.points) < len(mission.track.points)


def test_a_leg_stays_within_a_round_fence_that_the_path_keeps():
    fence = Constraints(geofence=Disc(x=0.0, y=0.0, radius=30.0))
    circle = sailed(arc(29.99, 5.0, 800))
    mission = simplify(circle, Allowance(), constraints=fence)
    assert np.hypot(*mission.track.points.T).max() <= 30.0
    assert mission.items == simplify(circle, Allowance()).items  # chords are inside


@pytest.mark.parametrize("limit", LIMITS)
def test_where_no_long_leg_keeps_a_limit_the_path_is_kept_to(limit):
    flown = sailed(hugging(0.005))
    mission = simplify(flown, Allowance(), constraints=LIMITS[limit])
    assert departure(flown, mission) == pytest.approx(mission.deviation, abs=1e-9)
    assert mission.deviation <= 0.5
    assert mission.track.points[:, 0].max() > 14.0


def test_legs_may_break_what_the_path_breaks_and_keep_the_rest():
    crossed = Disc(x=-40.0, y=-15.1, radius=6.0)
    limits = Constraints(keep_out=(*LIMITS["disc"].keep_out, crossed))
    mission = simplify(sailed(hugging(0.1)), Allowance(), constraints=limits)
    line = shapely.LineString(mission.track.points)
    assert line.intersects(shapely.Point(-40.0, -15.1).buffer(5.9))
    assert line.intersection(DISC.buffer(-1e-3)).is_empty


# --- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("room", "message"),
    [
        ({"items": 7}, "at least 8 items, got 7"),
        ({"spacing": -1.0}, r"spacing must be at least 0 \[m\] and finite, got -1"),
        ({"spacing": math.inf}, "spacing must be at least 0"),
        ({"tolerance": 0.0}, r"tolerance must be positive and finite \[m\], got 0"),
        ({"timing": math.nan}, r"timing must be positive and finite \[s\], got nan"),
    ],
)
def test_room_refuses_numbers_out_of_range(room, message):
    with pytest.raises(ValueError, match=message):
        Allowance(**room)


def test_a_path_without_times_is_refused():
    with pytest.raises(ValueError, match="needs a time at each sample"):
        simplify(Track(points=arc(10.0, 1.0, 20)), Allowance())
