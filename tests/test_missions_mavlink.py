"""Claims about the items of autopilots' missions, the same in plans and waypoint files."""

import re
from itertools import pairwise

import numpy as np
import pytest
from mavlink_files import (
    HOME,
    A,
    B,
    C,
    D,
    both_formats,
    fly,
    go,
    item,
    jump,
    said,
    speed,
    track,
)
from pymap3d.vincenty import vdist
from pymavlink import mavutil

from obsplan.missions import to_local
from obsplan.missions.mavlink import commands, flight, jumps
from obsplan.types import ObsplanError

MAV_CMD = mavutil.mavlink.enums["MAV_CMD"]


# --- places ---------------------------------------------------------------------------------------


@both_formats
def test_waypoints_are_one_track_named_after_its_file_and_the_home_is_no_vertex(tmp_path, name):
    mission = fly(tmp_path, name, *go(A, B, C))
    assert mission.geographic
    assert list(mission.tracks) == ["a"]
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    assert mission.home == (HOME if name == "a.plan" else None)
    assert mission.origin == (mission.home or A)
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
def test_every_navigation_command_that_has_a_position_is_flown_to(tmp_path, name, command, number):
    mission = fly(tmp_path, name, *go(A), item(number(command), B))
    np.testing.assert_array_equal(track(mission).points, [A, B])


@both_formats
@pytest.mark.parametrize("command", [80, 179, 189, 192, 195, 201, 5000, 5100])
def test_places_that_are_not_flown_to_are_said_by_name(tmp_path, name, command):
    mission = fly(tmp_path, name, *go(A, B), item(command, C), item(command, D))
    np.testing.assert_array_equal(track(mission).points, [A, B])
    known = MAV_CMD[command].name.removeprefix("MAV_CMD_")
    assert said(mission, rf"not flown to, passed over: 2 {known} \({command}\)")


def test_commands_have_their_names_and_positions_as_in_mavlink():
    for command in commands.Command:
        assert MAV_CMD[command].name == f"MAV_CMD_{command.name}"
    placed = commands.FLOWN | commands.PLACES | commands.POLYGONS | commands.CIRCLES
    assert placed == {command for command in commands.Command if command in WITH_POSITION}


@both_formats
def test_actions_are_said_once_and_counted_by_name(tmp_path, name):
    camera = [item(206), item(206), item(203), item(50000)]
    mission = fly(tmp_path, name, *go(A), *camera, *go(B))
    np.testing.assert_array_equal(track(mission).points, [A, B])
    counted = r"2 DO_SET_CAM_TRIGG_DIST \(206\), 1 DO_DIGICAM_CONTROL \(203\), 1 command 50000$"
    assert said(mission, counted) == 1


@both_formats
def test_long_lists_of_what_was_passed_over_are_cut_and_counted(tmp_path, name):
    kinds = [item(40000 + n) for n in range(15)]
    mission = fly(tmp_path, name, *go(A), *(item(82, place) for place in (B, C, D, A, B)), *kinds)
    assert said(mission, r"^splines, [^,]*: [^,]*, [^,]*, [^,]* and 2 more$")
    assert said(mission, r"^actions .*: (1 command \d+, ){11}1 command \d+ and 3 other kinds$")


@both_formats
@pytest.mark.parametrize("nowhere", [(0, 0), (None, None)])
def test_an_item_without_a_place_is_done_at_the_place_before(tmp_path, name, nowhere):
    mission = fly(tmp_path, name, item(22, nowhere), *go(A, B), item(19, nowhere, 30), *go(C))
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    np.testing.assert_array_equal(track(mission).hold, [0, 30, 0])
    assert said(mission, "without a place before the first waypoint, passed over: ")
    assert said(mission, "without a place of their own, done at the place before: ")


@both_formats
def test_places_repeated_one_after_the_other_are_one_vertex(tmp_path, name):
    mission = fly(
        tmp_path, name, item(22, A, altitude=5), item(16, A, altitude=10), *go(B, B, C, A)
    )
    np.testing.assert_array_equal(track(mission).points, [A, B, C, A])


@both_formats
def test_altitudes_are_kept_where_there_are_any_and_their_datums_told_apart(tmp_path, name):
    deep = fly(tmp_path, name, item(16, A, altitude=-5), item(16, B, altitude=None), item(16, C))
    np.testing.assert_array_equal(track(deep).altitude, [-5, -5, 0])
    assert not said(deep, "altitudes")
    mixed = fly(tmp_path, name, item(16, A, altitude=-5), item(16, B, altitude=3, frame=0))
    assert said(mixed, "altitudes are above home and sea level")


@both_formats
def test_splines_arcs_and_loiters_to_an_altitude_are_said_to_be_simplified(tmp_path, name):
    mission = fly(tmp_path, name, *go(A), item(82, B), item(36, C, 90), item(31, D), item(82, A))
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
def test_loiter_turns_are_circles_of_the_radius_from_the_nearest_point(
    tmp_path, name, radius, turns
):
    points = track(fly(tmp_path, name, *go(A), item(18, B, turns, 0, radius), *go(D))).points
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
def test_a_circle_without_a_vertex_before_it_begins_in_the_north(tmp_path, name):
    points = track(fly(tmp_path, name, item(18, B, 1, 0, 40))).points
    assert points[0, 0] > B[0]
    assert points[0, 1] == pytest.approx(B[1], abs=1e-9)


@both_formats
@pytest.mark.parametrize(("turns", "radius"), [(2, 0), (2, None), (0, 40)])
def test_loiter_turns_without_a_radius_or_turns_are_flown_to_and_said(
    tmp_path, name, turns, radius
):
    mission = fly(tmp_path, name, *go(A), item(18, B, turns, 0, radius), *go(C))
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    assert said(mission, "without a number of turns or a radius, flown to without circles: ")


@both_formats
def test_times_to_hold_and_delays_add_up_at_their_vertex(tmp_path, name):
    stops = [item(93, (0, 0), 9), item(16, A, 5), item(93, (0, 0), 7), item(19, B, 60, 0, 20)]
    mission = fly(tmp_path, name, *stops, item(82, C, 3), item(93, (0, 0), -1, 12), *go(D))
    np.testing.assert_array_equal(track(mission).hold, [12, 60, 3, 0])
    assert said(mission, "delays before the first place, passed over: ")
    assert said(mission, "delays until a time of day, passed over: ")
    assert said(mission, "loiters for a time, held in place without circles: ")


@both_formats
def test_a_loiter_without_limit_is_a_place_on_the_way_and_is_said(tmp_path, name):
    mission = fly(tmp_path, name, *go(A), item(17, B), *go(C, D))
    np.testing.assert_array_equal(track(mission).points, [A, B, C, D])
    assert said(mission, "loiters without limit, passed without a stop: an operator ends them: ")


@both_formats
def test_a_return_to_launch_is_no_part_of_the_survey_and_is_said(tmp_path, name):
    mission = fly(tmp_path, name, *go(A, B), item(20, frame=2))
    np.testing.assert_array_equal(track(mission).points, [A, B])
    assert said(mission, "returns to launch, which are no part of the survey, passed over: ")


# --- speeds ---------------------------------------------------------------------------------------


@both_formats
def test_a_change_of_speed_holds_towards_every_vertex_from_then_on(tmp_path, name):
    mission = fly(tmp_path, name, speed(0.8), *go(A, B), speed(1.2, 0), *go(C), speed(-1), *go(D))
    np.testing.assert_array_equal(track(mission).speed, [0.8, 1.2, 1.2])
    back = fly(tmp_path, name, *go(A, B), speed(0.8), *go(C), speed(-2), *go(D))
    np.testing.assert_array_equal(track(back).speed, [np.nan, 0.8, np.nan])


@both_formats
def test_speeds_of_climb_and_speeds_of_nothing_are_passed_over_and_said(tmp_path, name):
    mission = fly(tmp_path, name, speed(0.8), *go(A), speed(3, 2), speed(0), speed(400), *go(B))
    np.testing.assert_array_equal(track(mission).speed, [0.8])
    assert said(mission, "speeds of climb or descent, passed over: ")
    assert said(mission, "speeds not above 0, or above 50 m/s, passed over: ")


@pytest.mark.parametrize("cruise", [15, 5, 5.0, 22.5, 0, -1])
def test_the_cruise_speed_of_an_aircraft_is_passed_over_and_said(tmp_path, cruise):
    mission = fly(tmp_path, "a.plan", *go(A, B), mission={"cruiseSpeed": cruise})
    assert track(mission).speed is None
    assert said(mission, f"^cruise speed {cruise:g} m/s is not that of an AUV .* passed over$")


def test_a_cruise_speed_holds_until_another_is_commanded_and_again_by_default(tmp_path):
    way = [*go(A, B), speed(0.8), *go(C), speed(-2), *go(D)]
    mission = fly(tmp_path, "a.plan", *way, mission={"cruiseSpeed": 1.5})
    np.testing.assert_array_equal(track(mission).speed, [1.5, 0.8, 1.5])
    assert not said(mission, "speed")


# --- jumps ----------------------------------------------------------------------------------------


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
def test_jumps_are_written_out(tmp_path, name, way, places):
    mission = fly(tmp_path, name, *way)
    joined = [place for before, place in pairwise([None, *places]) if place != before]
    np.testing.assert_array_equal(track(mission).points, joined)


@both_formats
def test_what_jumps_change_is_said(tmp_path, name):
    assert said(
        fly(tmp_path, name, *go(A, B), jump(1, 1)), "jumps, their repeated items written out: "
    )
    forward = fly(tmp_path, name, *go(A), jump(4, 1), *go(B, C))
    assert said(forward, "never come to, passed over: 1")
    endless = fly(tmp_path, name, *go(A, B), jump(1, -1), *go(C))
    assert said(endless, "repeat for ever, flown once more and ended there: ")
    assert said(endless, "never come to, passed over: 1")
    lost = fly(tmp_path, name, *go(A, B), jump(70, 1), item(601, (0, 0), 7, 1), *go(C))
    np.testing.assert_array_equal(track(lost).points, [A, B, C])
    assert said(lost, "jumps to an item that is not in the file, passed over: .*, ")


@pytest.mark.slow
@both_formats
def test_jumps_and_circles_are_bounded(tmp_path, name):
    times = jumps.MOST_REPEATED // 3
    assert len(track(fly(tmp_path, name, *go(A, B), jump(1, times))).points) == 2 * (times + 1)
    with pytest.raises(
        ObsplanError, match=r"jumps add more than 10000 items .* lower their repeat"
    ):
        fly(tmp_path, name, *go(A, B), jump(1, 2 * times))
    with pytest.raises(ObsplanError, match=r"circles add more than 10000 vertices .* lower their"):
        fly(tmp_path, name, *go(A), item(18, B, 600, 0, 20), jump(2, 1))


# --- home -----------------------------------------------------------------------------------------


def test_a_home_at_0_0_is_a_placeholder_and_no_origin(tmp_path):
    mission = fly(tmp_path, "a.plan", *go(A, B), item(20), home=(0, 0))
    assert mission.home is None
    assert mission.origin == A
    np.testing.assert_array_equal(track(mission).points, [A, B])
    assert said(mission, "^home is a placeholder .* passed over$")


def test_a_home_on_another_continent_is_a_placeholder_and_no_origin(tmp_path):
    zurich = (47.3977, 8.5456)
    mission = fly(tmp_path, "a.plan", *go(A, B), item(20), home=zurich)
    assert mission.home is None
    assert mission.origin == A
    np.testing.assert_array_equal(track(mission).points, [A, B])
    kilometres = vdist(*zurich, *A)[0] / 1e3
    (remark,) = (remark for remark in mission.remarks if remark.startswith("home at "))
    found = re.search(r" is (\d+) km from the nearest waypoint: passed over$", remark)
    assert float(found[1]) == pytest.approx(kilometres, rel=0.005)


@pytest.mark.parametrize("stored", [None, [], [None, None, None], [0, 0], [0.0, -0.0, 50]])
def test_no_home_in_a_plan_is_said(tmp_path, stored):
    mission = fly(tmp_path, "a.plan", *go(A, B), mission={"plannedHomePosition": stored})
    assert mission.home is None
    assert said(mission, "^home is a placeholder")


def test_home_of_a_plan_is_where_local_metres_begin(tmp_path):
    mission = fly(tmp_path, "a.plan", *go(A, B))
    east, north = track(to_local(mission)).points[0]
    assert np.hypot(east, north) == pytest.approx(vdist(*HOME, *A)[0], abs=1e-3)
