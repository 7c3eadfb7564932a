"""Claims about what plans (QGroundControl) and waypoint files (QGC WPL 110) have of their own."""

import json
import random
import re
from importlib.resources import files
from itertools import pairwise

import numpy as np
import pytest
from mavlink_files import (
    HOME,
    RING,
    A,
    B,
    C,
    D,
    corners,
    fence,
    go,
    item,
    jump,
    plan,
    said,
    simple,
    track,
    wpl,
    write,
)
from pymap3d.vincenty import vdist
from pymavlink.mavwp import MAVWPLoader

from obsplan.missions import READERS, Mission, Track, read_mission, write_waypoints
from obsplan.types import ObsplanError

HARBOR = files("obsplan") / "scenarios" / "harbor.plan"


# --- fences ---------------------------------------------------------------------------------------

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
def test_fences_not_to_be_left_and_not_to_be_entered_are_limits(tmp_path, name):
    mission = read_mission(write(tmp_path, name, FENCED[name]()))
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


def test_two_polygons_of_one_kind_one_after_the_other_are_told_apart_by_their_corners(tmp_path):
    rings = corners(5002, *RING[:3]) + corners(5002, *RING[1:])
    path = write(tmp_path, "fence.waypoints", wpl(*rings, home=None))
    with pytest.raises(ObsplanError, match="holds no line to follow"):
        read_mission(path)
    fences = READERS[".waypoints"](path).keep_outs  # a file of limits alone
    np.testing.assert_array_equal([area.points for area in fences], [RING[:3], RING[1:]])


def test_corners_that_do_not_say_how_many_they_are_are_one_polygon(tmp_path):
    rings = [item(5001, place) for place in RING] + [item(5002, place) for place in RING[1:]]
    mission = read_mission(write(tmp_path, "a.waypoints", wpl(*go(A, B), *rings)))
    np.testing.assert_array_equal(mission.geofences[0].points, RING)
    np.testing.assert_array_equal(mission.keep_outs[0].points, RING[1:])


def test_the_fence_of_an_early_plan_is_not_to_be_left(tmp_path):
    early = {"polygon": [list(p) for p in RING], "version": 1, "breachReturn": list(A)}
    mission = read_mission(write(tmp_path, "a.plan", plan(*go(A, B), geoFence=early)))
    np.testing.assert_array_equal(mission.geofences[0].points, RING)
    assert said(mission, "return to from behind the fence: passed over")


def test_rally_points_of_a_plan_are_counted(tmp_path):
    rally = {"points": [[*B, 0], [*C, 0]], "version": 2}
    mission = read_mission(write(tmp_path, "a.plan", plan(*go(A, B), rallyPoints=rally)))
    assert said(mission, "^rally points, passed over: 2$")


# --- plans ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["survey", "CorridorScan"])
def test_a_pattern_is_flown_by_its_items_and_else_by_its_drawn_points(tmp_path, kind):
    def pattern(**stored):
        return {"type": "ComplexItem", "complexItemType": kind, "TransectStyleComplexItem": stored}

    camera = simple(item(206, frame=2))
    lanes = [simple(lane) for lane in go(B, C)]
    flown = pattern(Items=[camera, *lanes], VisualTransectPoints=[[1.0, 2.0]])
    drawn = pattern(Items=[camera], VisualTransectPoints=[list(B), [*C, None]])
    for node in (flown, drawn):
        mission = read_mission(write(tmp_path, "a.plan", plan(*go(A), node)))
        np.testing.assert_array_equal(track(mission).points, [A, B, C])


def test_patterns_without_a_stored_path_are_passed_over_by_name_and_the_rest_is_read(tmp_path):
    kinds = ["StructureScan", "fwLandingPattern", "fwLandingPattern", "a\x1b[2J", None]
    patterns = [{"type": "ComplexItem", "complexItemType": kind} for kind in kinds]
    mission = read_mission(write(tmp_path, "a.plan", plan(*go(A), *patterns, *go(B))))
    np.testing.assert_array_equal(track(mission).points, [A, B])
    assert said(mission, r"no path stored .*: 2 fwLandingPattern, 1 StructureScan, ")
    assert all(remark.isprintable() for remark in mission.remarks)


def test_places_of_early_plans_stand_in_their_coordinate(tmp_path):
    def early(place, **others):
        return {"type": "SimpleItem", "command": 16, "coordinate": [*place, 5], **others}

    nodes = [early(A, params=[0, 0, 0, None]), early(B, params=[0] * 7), early(C)]
    points = track(read_mission(write(tmp_path, "a.plan", plan(*nodes))))
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
def test_a_waypoint_file_is_read_however_it_is_written(tmp_path, name, content):
    mission = read_mission(write(tmp_path, name, content))
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    assert mission.origin == A
    assert said(mission, "row 0, is the home, .* not flown to") == (str(HOME[0]) in content)


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
def test_row_0_is_the_home_if_it_is_a_global_waypoint_of_version_110(
    tmp_path, heading, first, is_home
):
    rest = "\n".join(wpl(*go(B, C)).splitlines()[2:])
    row = f"{first}\t0\t0\t0\t0\t{A[0]}\t{A[1]}\t0\t1"
    mission = read_mission(write(tmp_path, "a.waypoints", f"{heading}\n{row}\n{rest}\n"))
    np.testing.assert_array_equal(track(mission).points, [B, C] if is_home else [A, B, C])
    assert mission.origin == (B if is_home else A)
    doubtful = "110" in heading and first.startswith("0") and not is_home
    assert said(mission, "row 0, is not a home .* and flown to") == doubtful


def test_our_own_waypoint_file_gives_our_own_track_back(tmp_path):
    ours = np.array([A, B, C, D])
    path = tmp_path / "cna.waypoints"
    write_waypoints(path, Mission(tracks={"cna": Track(points=ours)}, geographic=True))
    again = read_mission(path)
    np.testing.assert_allclose(again.tracks["cna"].points, ours, rtol=0, atol=1e-9)
    home, end = again.remarks
    assert home.endswith("row 0, is the home, where the vehicle was: not flown to")
    assert end.startswith("loiters without limit")


def test_rows_are_numbered_by_their_order_whatever_the_index_says(tmp_path):
    way = [*go(A, B), jump(2, 1), *go(C)]
    rows = [re.sub(r"^[1-9]\d*\t", "1\t", row) for row in wpl(*way).splitlines()]
    mission = read_mission(write(tmp_path, "a.txt", "\n".join(rows)))
    np.testing.assert_array_equal(track(mission).points, [A, B, C])
    assert said(mission, "jumps, their repeated items written out: line 5")
    assert said(mission, "rows are not numbered one after the other")


@pytest.mark.parametrize("seed", range(20))
def test_positions_are_those_that_pymavlink_reads(tmp_path, seed):
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
    path = write(tmp_path, "a.waypoints", wpl(*way, blank=rng.choice(["\t", " ", "  "])))
    loader = MAVWPLoader()
    loader.load(str(path))
    flown = [loader.wp(i) for i in range(1, loader.count())]
    flown = [row for row in flown if row.command in (16, 21, 22, 82)]
    mission = read_mission(path)
    np.testing.assert_array_equal(track(mission).points, [(row.x, row.y) for row in flown])
    np.testing.assert_array_equal(track(mission).altitude, [row.z for row in flown])
