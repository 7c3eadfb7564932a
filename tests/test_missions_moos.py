"""Claims about behaviour and mission files of MOOS-IvP that are read."""

import numpy as np
import pytest
import shapely
import shapely.affinity
from mission_files import LAWN, check_lawn, check_refused, check_survives_damage, read

from obsplan.missions import read_areas

LISTED = " : ".join(f"{x},{y}" for x, y in LAWN)


def behaviour(*lines, kind="BHV_Waypoint", name="survey"):
    """A behaviour as the helm reads it."""
    return "\n".join([f"Behavior = {kind}", "{", f"  name = {name}", *lines, "}", ""])


@pytest.mark.parametrize(
    "content",
    [
        behaviour(f"  points = {LISTED}"),
        behaviour(f"  POINTS={LISTED.replace(' ', '')}   // as drawn"),
        behaviour(f"  polygon = {LISTED}"),
        behaviour(f"  points = pts={{{LISTED}}}, label=lawn, edge_color=white"),
        behaviour(f'  points = label=lawn, pts="{LISTED}"'),
        behaviour(f"  points = label,lawn : {LISTED} : source,me"),
        behaviour(f"  points = points: {LISTED}"),
        behaviour("//  points = 1,1 : 2,2", f"  points = {LISTED}", "  condition = MODE == ON"),
        behaviour("  points = 1,1 : 2,2", f"  points = {LISTED}"),
        behaviour(
            f"  points = {' : '.join(f'{x},{y}' for x, y in LAWN[::-1])}", "  order = reverse"
        ),
        behaviour(f"  UPDATES = points = {LISTED} # speed = 2"),
        f"initialize DEPLOY = false\nset MODE = ON {{\n  DEPLOY = true\n}} OFF\n\n{behaviour(f'points = {LISTED}')}",
        f"name = survey\npoints = {LISTED}\n",
        behaviour(f"  points = {LISTED}")
        .replace("{\n", "")
        .replace("Waypoint", "Waypoint {")
        .encode("utf-16"),
    ],
)
def test_points_of_a_behaviour_are_a_track_however_they_are_listed(tmp_path, content):
    mission = read(tmp_path, "a.bhv", content)
    assert not mission.geographic
    check_lawn(mission, "survey")


def test_behaviours_are_tracks_by_their_names_at_their_speeds_and_others_are_said(tmp_path):
    content = (
        behaviour("speed = 1.2  // m/s", f"points = {LISTED}")
        + behaviour("speed = $(SPEED)", f"points = {LISTED}", name="again")
        + behaviour("points = 0,0", name="return")
        + behaviour("depth = 5", kind="BHV_ConstantDepth", name="deep")
        + "#include plugs.bhv\n"
    )
    mission = read(tmp_path, "a.bhv", content)
    assert list(mission.tracks) == ["survey", "again"]
    np.testing.assert_array_equal(mission.tracks["survey"].speed, [1.2] * 5)
    assert mission.tracks["again"].speed is None
    assert mission.remarks == (
        'track "return" has a single place, and no line: passed over',
        "1 speed with a placeholder passed over: expand the file with nsplug",
        '1 behaviour ("deep (BHV_ConstantDepth)") without points passed over',
        '1 line ("#include plugs.bhv") of the preprocessor passed over: expand the file with nsplug',
    )


@pytest.mark.parametrize(
    ("repeat", "rounds", "remark"),
    [
        ("0", 1, ()),
        ("2", 3, ('1 track ("survey") with repeat = 2: followed 3 times',)),
        ("100000", 1, ("1 track (\"survey\") with repeat = '100000': followed once",)),
        ("forever", 1, ("1 track (\"survey\") with repeat = 'forever': followed once",)),
    ],
)
def test_a_behaviour_that_repeats_is_followed_so_often_within_bounds(
    tmp_path, repeat, rounds, remark
):
    mission = read(tmp_path, "a.bhv", behaviour(f"points = {LISTED}", f"repeat = {repeat}"))
    np.testing.assert_array_equal(mission.tracks["survey"].points, LAWN * rounds)
    assert mission.remarks == remark


def test_points_that_other_applications_send_are_tracks(tmp_path):
    content = f"""LatOrigin = 43.825300
LongOrigin = -70.330400
ProcessConfig = uTimerScript
{{
  event = var=SURVEY_UPDATES, val="points={LISTED} # speed=0.8", time=10
}}
ProcessConfig = pMarineViewer
{{
  button_one = LAWN # SURVEY_UPDATES = points = format=lawnmower,label=delta,x=0,y=0,width=40,height=20,lane_width=20,rows=ew
}}
"""
    mission = read(tmp_path, "a.moos", content)
    np.testing.assert_array_equal(mission.tracks["a"].points, LAWN)
    np.testing.assert_array_equal(mission.tracks["a"].speed, [0.8] * 5)
    expected = [[20, 10], [-20, 10], [-20, -10], [20, -10]]
    np.testing.assert_allclose(mission.tracks["delta"].points, expected, atol=1e-9)
    assert mission.remarks == (
        "the origin of the file is at lat = 43.8253, lon = -70.3304: put it in the scenario's origin",
    )


# from the description of the pattern in MOOS-IvP: lanes from the side nearest to the start, the last on or beyond the other side
@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        (
            "format=lawnmower, x=0, y=0, height=60, width=40, lane_width=20, rows=north-south, startx=20, starty=-300",
            [[20, -30], [20, 30], [0, 30], [0, -30], [-20, -30], [-20, 30]],
        ),
        (
            "format=lawnmower, x=0, y=0, height=40, width=100, lane_width=30, rows=east-west",
            [[50, 20], [-50, 20], [-50, -10], [50, -10], [50, -40], [-50, -40]],
        ),
        (
            "lawnmower: x=10, y=20, height=40, width=100, swath=40, startx=-99, starty=-99",
            [[-40, 0], [60, 0], [60, 40], [-40, 40]],
        ),
        (
            "format=lawnmower, x=0, y=0, height=60, width=20, lane_width=20, rows=ns, degs=90, startx=-99, starty=99",
            [[-30, 10], [30, 10], [30, -10], [-30, -10]],
        ),
    ],
)
def test_a_lawnmower_is_the_vertices_that_the_helm_follows(tmp_path, pattern, expected):
    mission = read(tmp_path, "a.bhv", behaviour(f"points = {pattern}"))
    np.testing.assert_allclose(mission.tracks["survey"].points, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("degs", [0, 30, 200])
@pytest.mark.parametrize("rows", ["north-south", "east-west"])
def test_a_lawnmower_covers_its_box_turned_clockwise(tmp_path, degs, rows):
    pattern = f"format=lawnmower, x=5, y=-7, height=60, width=120, lane_width=20, rows={rows}, degs={degs}"
    points = read(tmp_path, "a.bhv", behaviour(f"points = {pattern}")).tracks["survey"].points
    box = shapely.affinity.rotate(shapely.box(-55, -37, 65, 23), -degs, origin=(5, -7))
    assert shapely.distance(box.exterior, shapely.points(points)).max() < 1e-4  # snapped to 1e-5 m
    assert shapely.hausdorff_distance(shapely.MultiPoint(points).convex_hull, box) < 1e-4
    legs = np.hypot(*np.diff(points, axis=0).T)
    lane = 60 if rows == "north-south" else 120
    np.testing.assert_allclose(legs, [lane, 20] * (len(legs) // 2) + [lane], rtol=0, atol=1e-4)


def test_op_regions_are_geofences_and_obstacles_keep_outs(tmp_path):
    content = (
        behaviour(f"points = {LISTED}")
        + behaviour(
            "polygon = pts={-9,-9:99,-9:99,300:-9,300}, label=area", kind="BHV_OpRegion", name="op"
        )
        + behaviour("poly = 1,1 : 5,1 : 5,5", kind="BHV_AvoidObstacleV24", name="ob")
        + behaviour("templating = spawn", kind="BHV_AvoidObstacleV24", name="later")
        + "ProcessConfig = pObstacleMgr\n{\n  given_obstacle = format=radial, x=50, y=50, radius=10, pts=4\n}\n"
    )
    mission = read(tmp_path, "a.bhv", content)
    (fence,) = mission.geofences
    np.testing.assert_array_equal(fence.points, [[-9, -9], [99, -9], [99, 300], [-9, 300]])
    drawn, radial = mission.keep_outs
    np.testing.assert_array_equal(drawn.points, [[1, 1], [5, 1], [5, 5]])
    side = 10 / np.sqrt(2)
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * side + 50
    np.testing.assert_allclose(radial.points, corners)
    assert mission.remarks == (
        '1 behaviour ("later (BHV_AvoidObstacleV24)") without points passed over',
    )
    assert not read_areas(tmp_path / "a.bhv", "keep-out")[1]
    counts = {
        role: len(read_areas(tmp_path / "a.bhv", role)[0]) for role in ("keep-out", "geofence")
    }
    assert counts == {"keep-out": 2, "geofence": 1}


def test_what_is_not_followed_as_it_stands_is_said(tmp_path):
    content = (
        behaviour("points = 0,0,5 : 10,0,5", name="deep")
        + behaviour(
            "points = format=bowtie, x=80, y=-80, wid1=10, wid2=25, wid3=30, height=20", name="tie"
        )
        + behaviour("points = zigzag:0,0,45,100,20,50", name="zig")
    )
    mission = read(tmp_path, "a.bhv", content)
    assert mission.tracks["deep"].altitude is None
    assert mission.remarks == (
        '1 track ("deep") with points that have a z passed over: MOOS-IvP follows x and y alone',
        '1 track ("tie") in a form that is not read (bowtie) passed over: write its points out',
        '1 track ("zig") in a form that is not read (zigzag) passed over: write its points out',
    )


PATTERN = "points = format=lawnmower, x=0, y=0, height=60, width=40, lane_width=20"
BAD = {
    "no points": ("initialize DEPLOY = false\n", "holds no line to follow: draw"),
    "text": (behaviour("points = 0,0 : here"), "line 4, point 2, x must be a number, got 'here'"),
    "letters": (behaviour("points = 0,0 : 1x,2"), "line 4, point 2, x must be a number, got '1x'"),
    "placeholder": (behaviour("points = $(POINTS)"), r"no line to follow \(1 track .* not read \(placeholder of nsplug\)"),
    "far": (behaviour("points = 0,0 : 550000,1"), r"line 4, point 2, has \(550000.0, 1.0\) m, more than 100 km"),
    "bad speed": (behaviour("speed = fast", "points = 0,0 : 1,1"), "line 5: its speed must be a number, got 'fast'"),
    "no width": (behaviour(PATTERN.replace("width=40,", "")), "line 4: width must be a number, got ''"),
    "no height": (behaviour(PATTERN.replace("=60", "=0")), "line 4: height must be positive, got 0.0"),
    "narrow lanes": (behaviour(PATTERN.replace("=20", "=1e-9")), "lane_width 1e-09 makes over 20000 vertices: widen it"),
    "negative turn": (behaviour(f"{PATTERN}, rows=ns, degs=-30"), "degs turns the lanes to heading -30.0, .*: add 360"),
    "fence as a wedge": (
        behaviour("polygon = format=wedge, x=1", kind="BHV_OpRegion"),
        r"line 4 has a geofence in a form that is not read \(wedge\): write its corners as pts=",
    ),
    "flat fence": (behaviour("polygon = 0,0 : 1,1", kind="BHV_OpRegion"), 'geofence "survey" has fewer than three corners'),
    "picture": (b"\x89PNG\r\n\x1a\n\x00\x01", "not UTF-8 text"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_behaviour_is_refused_in_one_sentence_that_says_where_what_and_how_to_mend(
    tmp_path, case
):
    check_refused(tmp_path, "a.bhv", *BAD[case])


@pytest.mark.slow
def test_damaged_behaviours_give_a_mission_or_our_error(tmp_path):
    content = (
        behaviour("speed = 1.2", f"points = {LISTED}", "repeat = 2")
        + behaviour(f"{PATTERN}, degs=30, snap=1", name="mow")
        + behaviour("polygon = pts={-9,-9:99,-9:99,300}", kind="BHV_OpRegion", name="op")
        + behaviour(
            "poly = radial:: x=50, y=50, radius=10, pts=8", kind="BHV_AvoidObstacle", name="ob"
        )
    )
    check_survives_damage(tmp_path, "a.bhv", content.encode())
