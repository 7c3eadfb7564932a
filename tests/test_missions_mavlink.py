"""Claims about missions of MAVLink autopilots: QGroundControl's plans and waypoint files (QGC WPL 110)."""

import json
import random
import re
import time
from importlib.resources import files
from itertools import pairwise

import numpy as np
import pytest
from pymap3d.vincenty import vdist
from pymavlink import mavutil
from pymavlink.mavwp import MAVWPLoader

from obsplan.missions import READERS, Mission, Track, read_mission, to_local, write_waypoints
from obsplan.missions.mavlink import commands, flight, items, jumps
from obsplan.types import ObsplanError

HARBOR = files("obsplan") / "scenarios" / "harbor.plan"
HOME = (63.4396, 10.3992)
A, B, C, D = (63.44, 10.4), (63.442, 10.4), (63.442, 10.401), (63.44, 10.401)
MAV_CMD = mavutil.mavlink.enums["MAV_CMD"]


def item(command, place=(0, 0), *params, altitude=0, frame=3):
    """A mission item: command, frame and seven parameters."""
    params = (*params, 0, 0, 0, 0)[:4]
    return command, frame, [*params, *place, altitude]


def go(*places):
    """Waypoints."""
    return [item(16, place) for place in places]


def simple(mission_item, number=None):
    """A simple item of a plan, as QGroundControl writes it."""
    command, frame, params = mission_item
    node = {"type": "SimpleItem", "command": command, "frame": frame, "params": params}
    return {**node, "autoContinue": True, "doJumpId": number}


def plan(*mission_items, home=HOME, **others):
    """A plan; dictionaries among the items are taken as they are."""
    nodes = [
        node if isinstance(node, dict) else simple(node, number)
        for number, node in enumerate(mission_items, start=1)
    ]
    mission = {"items": nodes, "version": 2, "cruiseSpeed": 15, "hoverSpeed": 5}
    if home is not None:
        mission["plannedHomePosition"] = [*home, 0]
    mission.update(others.pop("mission", {}))
    return {"fileType": "Plan", "version": 1, "mission": mission, **others}


def wpl(*mission_items, home=HOME, heading="QGC WPL 110", end="\n", blank="\t"):
    """A waypoint file; row 0 is the home, if there is one."""
    rows = list(mission_items)
    first = 1
    if home is not None:
        rows.insert(0, item(16, home, frame=0))
        first = 0
    lines = [heading]
    for index, (command, frame, params) in enumerate(rows, start=first):
        numbers = ["nan" if value is None else value for value in params]
        lines.append(blank.join(map(str, [index, int(index == 0), frame, command, *numbers, 1])))
    return end.join(lines) + end


FORMATS = {"a.plan": plan, "a.waypoints": wpl}
both_formats = pytest.mark.parametrize("name", FORMATS)


@pytest.fixture
def save(tmp_path):
    """Write text, bytes or JSON under a name; give the path."""

    def write(name, content):
        path = tmp_path / name
        if isinstance(content, dict):
            content = json.dumps(content)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def fly(save):
    """Read the items in a format; give the mission."""

    def read(name, *mission_items, **others):
        return read_mission(save(name, FORMATS[name](*mission_items, **others)))

    return read


def track(mission):
    """The one track."""
    (only,) = mission.tracks.values()
    return only


def check_one_sentence(message):
    """A message is one line, without a full stop inside."""
    assert "\n" not in message
    assert ". " not in message


def said(mission, pattern):
    """How many remarks match a pattern."""
    return sum(re.search(pattern, remark) is not None for remark in mission.remarks)


# --- places ---------------------------------------------------------------------------------------


@both_formats
def test_waypoints_are_one_track_named_after_its_file_and_the_home_is_no_vertex(fly, name):
    mission = fly(name, *go(A, B, C))
    assert mission.geographic
    assert list(mission.tracks) == ["a"]
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    assert mission.home == mission.origin == HOME
    assert track(mission).altitude is track(mission).speed is track(mission).hold is None


# what MAVLink says has a position, but is to be looked at, followed, fenced by or fallen back to
NOT_FLOWN = {23, 24, 25, 80, 5000, 5001, 5002, 5003, 5004, 5100}
WITH_POSITION = {n for n, entry in MAV_CMD.items() if entry.has_location}
NAVIGATION = sorted(
    {n for n in WITH_POSITION if MAV_CMD[n].name.startswith("MAV_CMD_NAV_")} - NOT_FLOWN
)


@both_formats
@pytest.mark.parametrize("number", [int, float])
@pytest.mark.parametrize("command", NAVIGATION)
def test_every_navigation_command_that_has_a_position_is_flown_to(fly, name, command, number):
    mission = fly(name, *go(A), item(number(command), B))
    np.testing.assert_array_equal(track(mission).points, [A, B])


@both_formats
@pytest.mark.parametrize("command", [80, 179, 189, 192, 195, 201, 5000, 5100])
def test_places_that_are_not_flown_to_are_said_by_name(fly, name, command):
    mission = fly(name, *go(A, B), item(command, C), item(command, D))
    np.testing.assert_array_equal(track(mission).points, [A, B])
    known = MAV_CMD[command].name.removeprefix("MAV_CMD_")
    assert said(mission, rf"not flown to, passed over: 2 {known} \({command}\)")


def test_commands_have_their_names_and_positions_as_in_mavlink():
    for command in commands.Command:
        assert MAV_CMD[command].name == f"MAV_CMD_{command.name}"
    placed = commands.FLOWN | commands.PLACES | commands.POLYGONS | commands.CIRCLES
    assert placed == {command for command in commands.Command if command in WITH_POSITION}


@both_formats
def test_actions_are_said_once_and_counted_by_name(fly, name):
    camera = [item(206), item(206), item(203), item(50000)]
    mission = fly(name, *go(A), *camera, *go(B))
    np.testing.assert_array_equal(track(mission).points, [A, B])
    counted = r"2 DO_SET_CAM_TRIGG_DIST \(206\), 1 DO_DIGICAM_CONTROL \(203\), 1 command 50000$"
    assert said(mission, counted) == 1


@both_formats
def test_long_lists_of_what_was_passed_over_are_cut_and_counted(fly, name):
    kinds = [item(40000 + n) for n in range(15)]
    mission = fly(name, *go(A), *(item(82, place) for place in (B, C, D, A, B)), *kinds)
    assert said(mission, r"^splines, [^,]*: [^,]*, [^,]*, [^,]* and 2 more$")
    assert said(mission, r"^actions .*: (1 command \d+, ){11}1 command \d+ and 3 other kinds$")


@both_formats
@pytest.mark.parametrize("nowhere", [(0, 0), (None, None)])
def test_an_item_without_a_place_is_done_at_the_place_before(fly, name, nowhere):
    mission = fly(name, item(22, nowhere), *go(A, B), item(19, nowhere, 30), *go(C))
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    np.testing.assert_array_equal(track(mission).hold, [0, 30, 0])
    assert said(mission, "without a place before the first waypoint, passed over: ")
    assert said(mission, "without a place of their own, done at the place before: ")


@both_formats
def test_places_repeated_one_after_the_other_are_one_vertex(fly, name):
    mission = fly(name, item(22, A, altitude=5), item(16, A, altitude=10), *go(B, B, C, A))
    np.testing.assert_array_equal(track(mission).points, [A, B, C, A])


@both_formats
def test_altitudes_are_kept_where_there_are_any_and_their_datums_told_apart(fly, name):
    deep = fly(name, item(16, A, altitude=-5), item(16, B, altitude=None), item(16, C))
    np.testing.assert_array_equal(track(deep).altitude, [-5, -5, 0])
    assert not said(deep, "altitudes")
    mixed = fly(name, item(16, A, altitude=-5), item(16, B, altitude=3, frame=0))
    assert said(mixed, "altitudes are above home and sea level")


@both_formats
def test_splines_arcs_and_loiters_to_an_altitude_are_said_to_be_simplified(fly, name):
    mission = fly(name, *go(A), item(82, B), item(36, C, 90), item(31, D), item(82, A))
    np.testing.assert_array_equal(track(mission).points, [A, B, C, D, A])
    assert said(mission, "splines, flown as straight lines: .*, .*[^e]$")
    assert said(mission, "arcs, flown as straight lines: ")
    assert said(mission, "loiters to an altitude, flown to without circles: ")


# --- circles, holds and the end -------------------------------------------------------------------


def distance_and_bearing(centre, points):
    """Geodesics on the ellipsoid from a centre [m], and their bearings [rad], clockwise from north."""
    distance, bearing = vdist(*centre, points[:, 0], points[:, 1])
    return np.asarray(distance), np.unwrap(np.deg2rad(bearing))


@both_formats
@pytest.mark.parametrize(("radius", "turns"), [(40, 2), (-40, 1), (75, 1.5), (0.5, 1), (-900, 3)])
def test_loiter_turns_are_circles_of_the_radius_from_the_nearest_point(fly, name, radius, turns):
    points = track(fly(name, *go(A), item(18, B, turns, 0, radius), *go(D))).points
    np.testing.assert_array_equal(points[[0, -1]], [A, D])
    distance, bearing = distance_and_bearing(B, points[1:-1])
    np.testing.assert_allclose(distance, abs(radius), rtol=1e-4)
    wound = bearing[-1] - bearing[0]  # a positive radius is clockwise, as bearings are
    assert wound == pytest.approx(2 * np.pi * turns * np.sign(radius), abs=1e-3)
    towards_a = np.deg2rad(vdist(*B, *A)[1])
    entry = np.remainder(bearing[0] - towards_a + np.pi, 2 * np.pi) - np.pi
    assert entry == pytest.approx(0, abs=1e-4)
    half_chord = np.abs(np.diff(bearing)).max() / 2
    assert abs(radius) * (1 - np.cos(half_chord)) <= flight.SAGITTA * (1 + 1e-6)


@both_formats
def test_a_circle_without_a_vertex_before_it_begins_in_the_north(fly, name):
    points = track(fly(name, item(18, B, 1, 0, 40))).points
    assert points[0, 0] > B[0]
    assert points[0, 1] == pytest.approx(B[1], abs=1e-9)


@both_formats
@pytest.mark.parametrize(("turns", "radius"), [(2, 0), (2, None), (0, 40)])
def test_loiter_turns_without_a_radius_or_turns_are_flown_to_and_said(fly, name, turns, radius):
    mission = fly(name, *go(A), item(18, B, turns, 0, radius), *go(C))
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    assert said(mission, "without a number of turns or a radius, flown to without circles: ")


@both_formats
def test_times_to_hold_and_delays_add_up_at_their_vertex(fly, name):
    stops = [item(93, (0, 0), 9), item(16, A, 5), item(93, (0, 0), 7), item(19, B, 60, 0, 20)]
    mission = fly(name, *stops, item(82, C, 3), item(93, (0, 0), -1, 12), *go(D))
    np.testing.assert_array_equal(track(mission).hold, [12, 60, 3, 0])
    assert said(mission, "delays before the first place, passed over: ")
    assert said(mission, "delays until a time of day, passed over: ")
    assert said(mission, "loiters for a time, held in place without circles: ")


@both_formats
def test_a_loiter_without_limit_ends_the_track_and_is_said(fly, name):
    mission = fly(name, *go(A), item(17, B), *go(C, D))
    np.testing.assert_array_equal(track(mission).points, [A, B])
    assert said(mission, "loiters without limit, at which the track ends: ")
    assert said(mission, "never come to, passed over: 2")


@both_formats
def test_a_return_to_launch_flies_home_if_there_is_one(fly, name):
    mission = fly(name, *go(A, B), item(20, frame=2))
    np.testing.assert_array_equal(track(mission).points, [A, B, HOME])
    homeless = fly(name, *go(A, B), item(20, frame=2), home=None)
    np.testing.assert_array_equal(track(homeless).points, [A, B])
    assert said(homeless, "returns to a home that the file does not give, passed over: ")


# --- speeds ---------------------------------------------------------------------------------------


def speed(value, kind=1):
    """DO_CHANGE_SPEED."""
    return item(178, (0, 0), kind, value, -1, frame=2)


@both_formats
def test_a_change_of_speed_holds_towards_every_vertex_from_then_on(fly, name):
    mission = fly(name, speed(0.8), *go(A, B), speed(1.2, 0), *go(C), speed(-1), *go(D))
    np.testing.assert_array_equal(track(mission).speed, [0.8, 1.2, 1.2])
    back = fly(name, *go(A, B), speed(0.8), *go(C), speed(-2), *go(D))
    np.testing.assert_array_equal(track(back).speed, [np.nan, 0.8, np.nan])


@both_formats
def test_speeds_of_climb_and_speeds_of_nothing_are_passed_over_and_said(fly, name):
    mission = fly(name, speed(0.8), *go(A), speed(3, 2), speed(0), speed(400), *go(B))
    np.testing.assert_array_equal(track(mission).speed, [0.8])
    assert said(mission, "speeds of climb or descent, passed over: ")
    assert said(mission, "speeds not above 0, or above 50 m/s, passed over: ")


@pytest.mark.parametrize("cruise", [15, 5, 5.0, 22.5, 0, -1])
def test_the_cruise_speed_of_an_aircraft_is_passed_over_and_said(fly, cruise):
    mission = fly("a.plan", *go(A, B), mission={"cruiseSpeed": cruise})
    assert track(mission).speed is None
    assert said(mission, f"^cruise speed {cruise:g} m/s is not that of an AUV .* passed over$")


def test_a_cruise_speed_holds_until_another_is_commanded_and_again_by_default(fly):
    way = [*go(A, B), speed(0.8), *go(C), speed(-2), *go(D)]
    mission = fly("a.plan", *way, mission={"cruiseSpeed": 1.5})
    np.testing.assert_array_equal(track(mission).speed, [1.5, 0.8, 1.5])
    assert not said(mission, "speed")


# --- jumps ----------------------------------------------------------------------------------------


def jump(target, repeats):
    """DO_JUMP."""
    return item(177, (0, 0), target, repeats, frame=2)


@both_formats
@pytest.mark.parametrize(
    ("way", "places"),
    [
        ([*go(A, B, C), jump(1, 1), *go(D)], [A, B, C, A, B, C, D]),
        ([*go(A, B, C), jump(2.0, 2.0), *go(D)], [A, B, C, B, C, B, C, D]),
        ([*go(A, B), jump(1, 0), *go(C)], [A, B, C]),
        ([*go(A), jump(4, 1), *go(B, C)], [A, C]),
        # an inner jump that is spent stays so when the outer one comes back to it
        ([*go(A, B), jump(1, 1), *go(C), jump(1, 1), *go(D)], [A, B, A, B, C, A, B, C, D]),
        ([*go(A), item(600, (0, 0), 7), *go(B), item(601, (0, 0), 7, 1), *go(C)], [A, B, B, C]),
        # for ever: once more, and there it ends
        ([*go(A, B, C), jump(2, -1), *go(D)], [A, B, C, B, C]),
    ],
)
def test_jumps_are_written_out(fly, name, way, places):
    mission = fly(name, *way)
    joined = [place for before, place in pairwise([None, *places]) if place != before]
    np.testing.assert_array_equal(track(mission).points, joined)


@both_formats
def test_what_jumps_change_is_said(fly, name):
    assert said(fly(name, *go(A, B), jump(1, 1)), "jumps, their repeated items written out: ")
    forward = fly(name, *go(A), jump(4, 1), *go(B, C))
    assert said(forward, "never come to, passed over: 1")
    endless = fly(name, *go(A, B), jump(1, -1), *go(C))
    assert said(endless, "repeat for ever, flown once more and ended there: ")
    assert said(endless, "never come to, passed over: 1")
    lost = fly(name, *go(A, B), jump(70, 1), item(601, (0, 0), 7, 1), *go(C))
    np.testing.assert_array_equal(track(lost).points, [A, B, C])
    assert said(lost, "jumps to an item that is not in the file, passed over: .*, ")


@both_formats
def test_jumps_and_circles_are_bounded(fly, name):
    times = jumps.MOST_REPEATED // 3
    assert len(track(fly(name, *go(A, B), jump(1, times))).points) == 2 * (times + 1)
    with pytest.raises(
        ObsplanError, match=r"jumps add more than 10000 items .* lower their repeat"
    ):
        fly(name, *go(A, B), jump(1, 2 * times))
    with pytest.raises(ObsplanError, match=r"circles add more than 10000 vertices .* lower their"):
        fly(name, *go(A), item(18, B, 600, 0, 20), jump(2, 1))


# --- home -----------------------------------------------------------------------------------------


@both_formats
def test_a_home_at_0_0_is_a_placeholder_and_no_origin(fly, name):
    mission = fly(name, *go(A, B), item(20), home=(0, 0))
    assert mission.home is None
    assert mission.origin == A
    np.testing.assert_array_equal(track(mission).points, [A, B])
    assert said(mission, "^home is a placeholder .* passed over$")


@both_formats
def test_a_home_on_another_continent_is_a_placeholder_and_no_origin(fly, name):
    zurich = (47.3977, 8.5456)
    mission = fly(name, *go(A, B), item(20), home=zurich)
    assert mission.home is None
    assert mission.origin == A
    np.testing.assert_array_equal(track(mission).points, [A, B])
    kilometres = vdist(*zurich, *A)[0] / 1e3
    found = re.search(r"^home at .* is (\d+) km from the nearest waypoint", mission.remarks[-2])
    found = found or re.search(r"^home at .* is (\d+) km from", mission.remarks[-1])
    assert float(found[1]) == pytest.approx(kilometres, rel=0.005)


@pytest.mark.parametrize("stored", [None, [], [None, None, None], [0, 0], [0.0, -0.0, 50]])
def test_no_home_in_a_plan_is_said(fly, stored):
    mission = fly("a.plan", *go(A, B), mission={"plannedHomePosition": stored})
    assert mission.home is None
    assert said(mission, "^home is a placeholder")


def test_home_of_a_plan_is_where_local_metres_begin(fly):
    mission = fly("a.plan", *go(A, B))
    east, north = track(to_local(mission)).points[0]
    assert np.hypot(east, north) == pytest.approx(vdist(*HOME, *A)[0], abs=1e-3)


# --- fences ---------------------------------------------------------------------------------------


def fence(polygons=(), circles=()):
    """The fence of a plan: areas and whether they include."""
    return {
        "polygons": [{"polygon": p, "inclusion": i, "version": 1} for p, i in polygons],
        "circles": [
            {"circle": {"center": c, "radius": r}, "inclusion": i, "version": 1}
            for c, r, i in circles
        ],
        "version": 2,
    }


def corners(command, *places):
    """A polygon among the items: each corner has their number."""
    return [item(command, place, len(places)) for place in places]


RING = [A, B, C, D]
FENCED = {
    "a.plan": lambda: plan(
        *go(A, C),
        geoFence=fence(
            polygons=[([*map(list, RING), list(A)], True), ([*map(list, RING[:3])], False)],
            circles=[(list(B), 15.0, False), (list(C), 800, True)],
        ),
    ),
    "a.waypoints": lambda: wpl(
        *go(A, C),
        *corners(5001, *RING),
        *corners(5002, *RING[:3]),
        item(5004, B, 15.0),
        item(5003, C, 800),
    ),
}


@pytest.mark.parametrize("name", FENCED)
def test_fences_not_to_be_left_and_not_to_be_entered_are_limits(save, name):
    mission = read_mission(save(name, FENCED[name]()))
    polygon, circle = mission.geofences
    np.testing.assert_array_equal(polygon.points, RING)
    assert polygon.radius is None
    np.testing.assert_array_equal(circle.points, [C])
    assert circle.radius == 800
    assert said(mission, "not to be left, of which every one is kept to: 2")
    kept_out = {len(area.points): area for area in mission.keep_outs}
    np.testing.assert_array_equal(kept_out[3].points, RING[:3])
    np.testing.assert_array_equal(kept_out[1].points, [B])
    assert kept_out[1].radius == 15
    np.testing.assert_array_equal(track(mission).points, [A, C])


def test_two_polygons_of_one_kind_one_after_the_other_are_told_apart_by_their_corners(save):
    rings = corners(5002, *RING[:3]) + corners(5002, *RING[1:])
    path = save("fence.waypoints", wpl(*rings, home=None))
    with pytest.raises(ObsplanError, match="holds no line to follow"):
        read_mission(path)
    fences = READERS[".waypoints"](path).keep_outs  # a file of limits alone
    np.testing.assert_array_equal([area.points for area in fences], [RING[:3], RING[1:]])


def test_corners_that_do_not_say_how_many_they_are_are_one_polygon(save):
    rings = [item(5001, place) for place in RING] + [item(5002, place) for place in RING[1:]]
    mission = read_mission(save("a.waypoints", wpl(*go(A, B), *rings)))
    np.testing.assert_array_equal(mission.geofences[0].points, RING)
    np.testing.assert_array_equal(mission.keep_outs[0].points, RING[1:])


def test_the_fence_of_an_early_plan_is_not_to_be_left(save):
    early = {"polygon": [list(p) for p in RING], "version": 1, "breachReturn": list(A)}
    mission = read_mission(save("a.plan", plan(*go(A, B), geoFence=early)))
    np.testing.assert_array_equal(mission.geofences[0].points, RING)
    assert said(mission, "return to from behind the fence: passed over")


def test_rally_points_of_a_plan_are_counted(save):
    rally = {"points": [[*B, 0], [*C, 0]], "version": 2}
    mission = read_mission(save("a.plan", plan(*go(A, B), rallyPoints=rally)))
    assert said(mission, "^rally points, passed over: 2$")


# --- plans ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["survey", "CorridorScan"])
def test_a_pattern_is_flown_by_its_items_and_else_by_its_drawn_points(save, kind):
    def pattern(**stored):
        return {"type": "ComplexItem", "complexItemType": kind, "TransectStyleComplexItem": stored}

    camera = simple(item(206, frame=2))
    lanes = [simple(lane) for lane in go(B, C)]
    flown = pattern(Items=[camera, *lanes], VisualTransectPoints=[[1.0, 2.0]])
    drawn = pattern(Items=[camera], VisualTransectPoints=[list(B), [*C, None]])
    for node in (flown, drawn):
        mission = read_mission(save("a.plan", plan(*go(A), node)))
        np.testing.assert_array_equal(track(mission).points, [A, B, C])


def test_patterns_without_a_stored_path_are_passed_over_by_name_and_the_rest_is_read(save):
    kinds = ["StructureScan", "fwLandingPattern", "fwLandingPattern", "a\x1b[2J", None]
    patterns = [{"type": "ComplexItem", "complexItemType": kind} for kind in kinds]
    mission = read_mission(save("a.plan", plan(*go(A), *patterns, *go(B))))
    np.testing.assert_array_equal(track(mission).points, [A, B])
    assert said(mission, r"no path stored .*: 2 fwLandingPattern, 1 StructureScan, ")
    assert all(remark.isprintable() for remark in mission.remarks)


def test_places_of_early_plans_stand_in_their_coordinate(save):
    def early(place, **others):
        return {"type": "SimpleItem", "command": 16, "coordinate": [*place, 5], **others}

    nodes = [early(A, params=[0, 0, 0, None]), early(B, params=[0] * 7), early(C)]
    points = track(read_mission(save("a.plan", plan(*nodes))))
    np.testing.assert_array_equal(points.points, [A, B, C])
    np.testing.assert_array_equal(points.altitude, [5, 5, 5])


def test_shipped_harbor_plan_is_a_lawnmower_of_six_legs_of_300_m_40_m_apart():
    content = json.loads(HARBOR.read_text())
    assert {"fileType", "geoFence", "groundStation", "mission", "rallyPoints", "version"} == set(
        content
    )
    assert [node["doJumpId"] for node in content["mission"]["items"]] == list(range(1, 13))
    mission = read_mission(str(HARBOR))
    assert mission.home == (47.629, -122.337)
    points = mission.tracks["harbor"].points
    sides = [vdist(*a, *b)[0] for a, b in pairwise(points)]  # geodesics on the ellipsoid [m]
    np.testing.assert_allclose(sides, [300, 40] * 5 + [300], atol=0.01)
    np.testing.assert_allclose(vdist(*points[0], *points[-1])[0], 200.0, atol=0.01)
    assert (points[:, 0] < 47.632).all()  # between the lake's shores
    assert (points[:, 1] < -122.334).all()


# --- waypoint files -------------------------------------------------------------------------------

COMMENTED = wpl(*go(A, B, C)).replace("110\n", "110\n# lawn\n\n // of a lake\n")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.txt", wpl(*go(A, B, C))),
        ("A.WAYPOINTS", wpl(*go(A, B, C))),
        ("a.txt", wpl(*go(A, B, C), end="\r\n", blank="   ")),
        ("a.txt", "\ufeff" + wpl(*go(A, B, C))),
        ("a.txt", "\n# a comment\n" + COMMENTED),
        ("a.txt", COMMENTED.replace("1\n", "1  # here\n").replace("0\t1", "0 \t 1")),
        ("a.txt", wpl(*go(A, B, C), home=None)),
        ("a.txt", wpl(*go(A, B, C), home=None, heading="QGC WPL 120")),
        ("a.txt", wpl(*(item(16, p, None, None, None, None) for p in (A, B, C)))),
        ("a.txt", wpl(*(item(16, p, frame=f) for p, f in [(A, 0), (B, 10), (C, 6)]))),
    ],
)
def test_a_waypoint_file_is_read_however_it_is_written(save, name, content):
    mission = read_mission(save(name, content))
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    assert mission.home == (HOME if str(HOME[0]) in content else None)


@pytest.mark.parametrize(
    ("heading", "first", "is_home"),
    [
        ("QGC WPL 110", "0\t1\t0\t16", True),  # Mission Planner, QGroundControl, and we
        ("QGC WPL 110", "0\t0\t0\t16", True),  # MAVProxy
        ("QGC WPL 110", "0\t1\t3\t0", True),  # Mission Planner long ago
        ("QGC WPL 110", "0\t1\t3\t16", False),
        ("QGC WPL 110", "0\t1\t0\t22", False),
        ("QGC WPL 110", "1\t1\t0\t16", False),
        ("QGC WPL 120", "0\t1\t0\t16", False),  # QGroundControl for a while
    ],
)
def test_row_0_is_the_home_if_it_is_a_global_waypoint_of_version_110(save, heading, first, is_home):
    rest = "\n".join(wpl(*go(B, C)).splitlines()[2:])
    row = f"{first}\t0\t0\t0\t0\t{A[0]}\t{A[1]}\t0\t1"
    mission = read_mission(save("a.waypoints", f"{heading}\n{row}\n{rest}\n"))
    np.testing.assert_array_equal(track(mission).points, [B, C] if is_home else [A, B, C])
    assert mission.home == (A if is_home else None)
    doubtful = "110" in heading and first.startswith("0") and not is_home
    assert said(mission, "row 0, is not a home .* and flown to") == doubtful


def test_our_own_waypoint_file_gives_our_own_track_back(tmp_path):
    ours = np.array([A, B, C, D])
    path = tmp_path / "cna.waypoints"
    write_waypoints(path, Mission(tracks={"cna": Track(points=ours)}, geographic=True))
    again = read_mission(path)
    np.testing.assert_allclose(again.tracks["cna"].points, ours, rtol=0, atol=1e-9)
    assert again.home == A
    assert not again.remarks


def test_rows_are_numbered_by_their_order_whatever_the_index_says(save):
    way = [*go(A, B), jump(2, 1), *go(C)]
    rows = [re.sub(r"^[1-9]\d*\t", "1\t", row) for row in wpl(*way).splitlines()]
    mission = read_mission(save("a.txt", "\n".join(rows)))
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    assert said(mission, "jumps, their repeated items written out: line 5")
    assert said(mission, "rows are not numbered one after the other")


@pytest.mark.parametrize("seed", range(20))
def test_positions_are_those_that_pymavlink_reads(save, seed):
    rng = random.Random(seed)
    way = [
        item(
            rng.choice([16, 16, 16, 21, 22, 82, 206, 195, 178]),
            (rng.uniform(-80, 80), 10 + rng.uniform(-1, 1)),
            altitude=rng.uniform(-50, 50),
            frame=rng.choice([0, 3, 10]),
        )
        for _ in range(30)
    ]
    path = save("a.waypoints", wpl(*way, blank=rng.choice(["\t", " ", "  "])))
    loader = MAVWPLoader()
    loader.load(str(path))
    flown = [loader.wp(i) for i in range(1, loader.count())]
    flown = [row for row in flown if row.command in (16, 21, 22, 82)]
    mission = read_mission(path)
    np.testing.assert_array_equal(track(mission).points, [(row.x, row.y) for row in flown])
    np.testing.assert_array_equal(track(mission).altitude, [row.z for row in flown])


# --- what is refused ------------------------------------------------------------------------------


def bad(*mission_items, **others):
    """The same fault in both formats."""
    return {name: write(*mission_items, **others) for name, write in FORMATS.items()}


ROW = "1\t0\t3\t16\t0\t0\t0\t0\t63.44\t10.4\t0\t1\n"
HUGE = "9" * 5000
BOTH = {
    "local frame": (bad(item(16, A, frame=1)), r"frame, must be global \(one of 0, 3, .*, got 1"),
    "half a place": (bad(item(16, (63.44, None))), r"longitude \(parameter 6\), must be"),
    "infinite place": (bad(item(16, (63.44, float("inf")))), "must be a finite number, got inf"),
    "swapped": (bad(item(16, (-122.3, 47.6))), "look swapped: latitude comes first"),
    "not on Earth": (bad(item(16, (63.44, 400))), "longitude 400.0, beyond 360"),
    "metres": (bad(item(16, (550000, 5275000))), "beyond 90 degrees: give WGS 84"),
    "endless hold": (bad(item(16, A, 1e9)), r"time to hold \(parameter 1\), must be from 0 to"),
    "negative hold": (bad(item(16, A, -1)), "time to hold .* must be from 0 to 604800, got -1"),
    "endless delay": (bad(*go(A), item(93, A, 1e9)), "delay .* must be from -1 to 604800"),
    "wide circle": (bad(item(18, A, 1, 0, 1e6)), r"radius \(parameter 3\), must be from -10000"),
    "many turns": (bad(item(18, A, 1e6, 0, 10)), "number of turns .* from 0 to 1000"),
    "infinite turns": (bad(item(18, A, float("inf"), 0, 9)), "turns .* must be a finite number"),
    "in space": (bad(item(16, A, altitude=1e7)), r"altitude \(parameter 7\), must be from"),
    "infinite speed": (bad(*go(A, B), speed(float("inf"))), "speed .* must be a finite number"),
    "unknown speed": (bad(*go(A, B), speed(1, 9)), "type of speed .* must be from 0 to 3, got 9"),
    "jump to nowhere": (bad(*go(A), jump(-4, 1)), "target .* must be from 0 to 65535, got -4"),
    "many repeats": (bad(*go(A), jump(1, 1e9)), "repeat count .* from -1 to 65535"),
    "many commands": (bad(item(70000, A)), "command,? must be a whole number from 0 to 65535"),
    "part of a command": (bad(item(16.5, A)), "command,? must be a whole number .* got 16.5"),
    "no command": (bad(item(-16, A)), "command,? must be a whole number .* got -16"),
    "fence with a corner missing": (
        bad(*corners(5001, *RING)[:3]),
        "begins a fence of 4 corners, of which 3 follow: save the fence again",
    ),
    "fence of two corners": (bad(*corners(5002, A, B)), "fence of fewer than three corners"),
    "fence without a place": (bad(item(5003, (0, 0), 5)), "part of a fence without a place"),
    "fence without a radius": (bad(item(5004, A, 0)), "radius, must be positive and at most"),
    "identical waypoints": (bad(*go(A, A)), 'no line to follow .track "a" has a single place'),
    "nothing": (bad(), "holds no line to follow"),
}
PLANS = {
    "geojson": ({"features": []}, "not a QGroundControl plan .*rename it to .geojson"),
    "other": ({"fileType": "Fence"}, "\"fileType\" is 'Fence'.*save it from QGroundControl"),
    "no mission": ({"fileType": "Plan"}, "has no list mission.items"),
    "cut short": (json.dumps(plan(*go(A)))[:-9], r"not valid JSON \(line 1, column \d+: .*cut"),
    "huge number": (
        json.dumps(plan(*go(A))).replace("63.44", HUGE),
        "is not JSON that can be read",
    ),
    "deep": ('{"fileType":"Plan","mission":{"items":' + "[" * 100_000, "nested too deeply"),
    "item not an object": (
        plan(*go(A), mission={"items": [5]}),
        r"mission.items\[0\] must be an object, got int",
    ),
    "item of no kind": ({**plan({"command": 16})}, r'type must be "SimpleItem" or "ComplexItem"'),
    "command of no kind": (
        plan({"type": "SimpleItem", "command": "go", "params": []}),
        r"items\[0\].command must be a number, got 'go'",
    ),
    "short params": (
        plan({"type": "SimpleItem", "command": 16, "params": [0]}),
        r"items\[0\].params must be a list of seven numbers, got \[0\]",
    ),
    "text in params": (
        plan(item(16, ("north", 2))),
        r"\(parameter 5\), must be a number, got 'nor",
    ),
    "flag in params": (plan(item(16, (True, 2))), r"\(parameter 5\), must be a number, got True"),
    "only a pattern": (
        plan({"type": "ComplexItem", "complexItemType": "StructureScan"}),
        r"holds no line to follow \(patterns with no path .*: 1 StructureScan\)",
    ),
    "half a home": (
        plan(*go(A), mission={"plannedHomePosition": [1]}),
        "plannedHomePosition must be .latitude, longitude., got .1.",
    ),
    "text as home": (
        plan(*go(A), mission={"plannedHomePosition": "here"}),
        "plannedHomePosition must be .latitude, longitude., got 'here'",
    ),
    "home in space": (plan(*go(A), home=(95, 190)), "plannedHomePosition has latitude 95"),
    "text as speed": (
        plan(*go(A), mission={"cruiseSpeed": "fast"}),
        "mission.cruiseSpeed must be a number, got 'fast'",
    ),
    "list as fence": (plan(*go(A), geoFence=[1]), "geoFence must be an object, got list"),
    "number as polygons": (plan(*go(A), geoFence={"polygons": 3}), "polygons must be a list"),
    "number as circle": (
        plan(*go(A), geoFence={"circles": [3]}),
        r"geoFence.circles\[0\] must be an object, got int",
    ),
    "circle without a circle": (
        plan(*go(A), geoFence={"circles": [{"inclusion": True}]}),
        r"circles\[0\].circle must be an object, got NoneType",
    ),
    "neither in nor out": (
        plan(*go(A), geoFence={"polygons": [{"polygon": [list(A)] * 4, "inclusion": 1}]}),
        r"polygons\[0\].inclusion must be true or false, got 1",
    ),
    "corner of a kind": (
        plan(*go(A), geoFence=fence(polygons=[([list(A), 3], True)])),
        r"polygon\[1\] must be .latitude, longitude., got 3",
    ),
    "circle without a radius": (
        plan(*go(A), geoFence=fence(circles=[(list(A), -3, True)])),
        r"circles\[0\].circle, radius, must be positive and at most 100000 m, got -3",
    ),
    "flat fence": (
        plan(*go(A), geoFence=fence(polygons=[([list(A), list(B), list(A)], False)])),
        r"polygons\[0\] is a fence of fewer than three corners",
    ),
    "number as rally points": (plan(*go(A), rallyPoints=3), "rallyPoints must be an object"),
}
ROWS = {
    "prose": ("dear diary\n", 'does not begin with "QGC WPL 110"'),
    "table": ("lat,lon\n1,2\n", "rename the file to what it is, say .csv"),
    "fence of ArduPilot": ("63.44 10.4\n63.442 10.4\n", 'does not begin with "QGC WPL 110"'),
    "other version": ("QGC WPL 100\n" + ROW, "version '100', and 110 can be read"),
    "protobuf": ("QGC WPL PB 110\n", "version 'PB 110'"),
    "binary": (b"\x89PNG\r\n\x1a\n\x00\x01", r"not UTF-8 text \(byte 0x89 at position 0\)"),
    "no rows": ("QGC WPL 110\n", "holds no line to follow"),
    "short row": ("QGC WPL 110\n" + ROW[:-3], "line 2 has 11 columns, and a row has 12"),
    "long row": ("QGC WPL 110\n" + ROW + ROW[:-1] + "\t1\n", "line 3 has 13 columns"),
    "text": (
        "QGC WPL 110\n" + ROW.replace("63.44", "north"),
        "column 9, must be a number, got 'no",
    ),
    "decimal comma": ("QGC WPL 110\n" + ROW.replace(".", ","), "column 9, .* got '63,44'"),
    "underscore": ("QGC WPL 110\n" + ROW.replace("63.44", "6_3"), "must be a number, got '6_3'"),
    "other digits": ("QGC WPL 110\n" + ROW.replace("63.44", "٦٣"), "must be a number, got '٦٣'"),
    "huge number": (
        "QGC WPL 110\n" + ROW.replace("63.44", HUGE),
        "must be a finite number, got inf",
    ),
    "huge index": ("QGC WPL 110\n" + HUGE + ROW, "index, must be a finite number, got inf"),
    "part of a frame": (
        "QGC WPL 110\n" + ROW.replace("\t3\t", "\t3.5\t"),
        "frame, must be a whole",
    ),
}
BAD = {
    **{f"{key} in {n}": (n, c, why) for key, (both, why) in BOTH.items() for n, c in both.items()},
    **{f"{key} as plan": ("a.plan", content, why) for key, (content, why) in PLANS.items()},
    **{f"{key} as rows": ("a.txt", content, why) for key, (content, why) in ROWS.items()},
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_in_one_sentence_that_says_where_what_and_how_to_mend(save, case):
    name, content, message = BAD[case]
    path = save(name, content)
    with pytest.raises(ObsplanError, match=message) as caught:
        read_mission(path)
    check_one_sentence(str(caught.value).replace(str(path), "FILE"))
    assert str(path) in str(caught.value)


@both_formats
def test_more_items_than_a_mission_may_have_are_refused(fly, name, monkeypatch):
    monkeypatch.setattr(items, "MOST_ITEMS", 3)
    assert len(track(fly(name, *go(A, B, C), home=None)).points) == 3
    with pytest.raises(ObsplanError, match="holds more than 3 items, more than any autopilot"):
        fly(name, *go(A, B, C, D), home=None)


# --- damaged files --------------------------------------------------------------------------------

EVERYTHING = [
    item(22, A, altitude=5),
    speed(0.8),
    *go(B),
    item(18, C, 2, 0, 20),
    item(19, D, 30),
    jump(3, 2),
    item(206),
    item(195, B),
    item(93, (0, 0), 4),
    item(82, A, altitude=-3),
    item(20),
]
WHOLE = {
    "a.plan": json.dumps(
        plan(
            *EVERYTHING,
            {
                "type": "ComplexItem",
                "TransectStyleComplexItem": {"Items": [simple(go(B)[0])]},
            },
            geoFence=fence(polygons=[([list(p) for p in RING], True)], circles=[(A, 9, False)]),
            rallyPoints={"points": [[*B, 0]]},
        )
    ).encode(),
    "a.waypoints": wpl(*EVERYTHING, *corners(5001, *RING), item(5004, B, 9)).encode(),
}
VALUES = ["", "0", "-1", "1e308", "65535", "nan", "null", "[]", "{}", '"x"', "true", HUGE, "1e-9"]


def flip(content, rng):
    """Other bytes here and there."""
    broken = bytearray(content)
    for _ in range(rng.randint(1, 8)):
        broken[rng.randrange(len(broken))] = rng.randrange(256)
    return bytes(broken)


def truncate(content, rng):
    """No end."""
    return content[: rng.randrange(len(content))]


def cut(content, rng):
    """A part left out."""
    start, end = sorted(rng.choices(range(len(content)), k=2))
    return content[:start] + content[end:]


def swap(content, rng):
    """Other values in place of numbers."""
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?", content))
    for number in sorted(rng.sample(numbers, k=rng.randint(1, 3)), key=lambda n: -n.start()):
        value = rng.choice(VALUES).encode()
        content = content[: number.start()] + value + content[number.end() :]
    return content


def graft(content, rng):
    """Something else in place of a part of a JSON document, or of a row."""
    if not content.startswith(b"{"):
        rows = content.split(b"\n")
        rows[rng.randrange(len(rows))] = rng.choice(VALUES).encode()
        return b"\n".join(rows)
    document = json.loads(content)
    node = document
    while True:
        key = rng.choice(list(node) if isinstance(node, dict) else range(len(node)))
        if not isinstance(node[key], dict | list) or not node[key] or rng.random() < 0.2:
            node[key] = rng.choice([None, True, -1, 1e300, "", "x", [], {}, [None], [[]], {"a": 1}])
            return json.dumps(document).encode()
        node = node[key]


@pytest.mark.parametrize("name", WHOLE)
def test_300_damaged_files_give_a_mission_or_our_error_and_soon(save, name):
    assert track(read_mission(save(name, WHOLE[name])))
    rng = random.Random(name)
    read = 0
    for _ in range(300):
        path = save(name, rng.choice([flip, truncate, cut, swap, graft])(WHOLE[name], rng))
        begin = time.perf_counter()
        try:
            mission = read_mission(path)
            read += 1
            assert np.isfinite(track(mission).points).all()
            assert all(remark.isprintable() for remark in mission.remarks)
        except ObsplanError as error:
            check_one_sentence(str(error).replace(str(path), "FILE"))
        assert time.perf_counter() - begin < 20
    assert 10 < read < 290  # some are harmless, and some are not
