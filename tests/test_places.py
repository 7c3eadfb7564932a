"""Places in scenario files, in metres or in degrees; areas by their corners, their centre, or a file."""

import math

import numpy as np
import pymap3d
import pytest

from obsplan.constraints import Constraints, Disc, Polygon
from obsplan.missions import READERS, Area, Mission, Track
from obsplan.scenario import from_dict
from obsplan.scenario.schema import json_schema, sections
from obsplan.types import ObsplanError

LAT, LON = 63.44, 10.40
ORIGIN = {"lat": LAT, "lon": LON}
NORTH = 111_489.0  # [m] per degree of latitude there, to 1e-4: a(1-e²)/(1-e² sin²φ)^1.5 π/180
EAST = 49_892.0  # [m] per degree of longitude there, to 1e-4: a cos φ/(1-e² sin²φ)^0.5 π/180
LINE = {"kind": "waypoints", "points": [[0.0, 0.0], [100.0, 0.0]]}


def scenario(*, origin=ORIGIN, start=None, survey=LINE, folder=None, **tables):
    """A small scenario."""
    cna = {"speed": 2.0, "min_turn_radius": 10.0}
    data = {
        "origin": origin,
        "cna": cna | ({} if start is None else {"start": start}),
        "auv": [{"speed": 1.0, "survey": survey}],
        "duration": 60.0,
        **tables,
    }
    return from_dict(data) if folder is None else from_dict(data, folder=folder)


def degrees(east, north):
    """The place so many metres from the origin."""
    lat, lon, _ = pymap3d.enu2geodetic(east, north, 0.0, LAT, LON, 0.0)
    return {"lat": round(float(lat), 9), "lon": round(float(lon), 9)}


def refusal(**changes):
    """The one sentence that refuses a scenario."""
    with pytest.raises(ObsplanError) as caught:
        scenario(**changes)
    message = str(caught.value)
    assert "\n" not in message
    return message


# --- degrees ------------------------------------------------------------------------------------------------------------------------


def test_a_thousandth_of_a_degree_is_as_long_as_the_ellipsoid_says():
    start = scenario(start={"lat": LAT + 1e-3, "lon": LON - 1e-3}).start
    assert start.y == pytest.approx(1e-3 * NORTH, rel=3e-4)
    assert start.x == pytest.approx(-1e-3 * EAST, rel=3e-4)
    assert start.heading == math.pi / 2  # what is not given keeps its default


def test_every_place_of_a_scenario_may_be_given_in_degrees():
    corners = [(-80.0, -90.0), (250.0, -90.0), (250.0, 150.0), (-80.0, 150.0)]
    in_degrees = scenario(
        start=degrees(-50.0, 20.0) | {"heading_deg": 45.0},
        survey={"kind": "waypoints", "points": [degrees(0.0, 5.0), [100.0, 5.0]]},
        constraints={
            "keep_out": [
                degrees(30.0, -40.0) | {"radius": 12.0},
                {"points": [degrees(60.0, 60.0), [90.0, 60.0], degrees(90.0, 90.0)]},
            ],
            "geofence": [degrees(*corner) for corner in corners],
        },
        planner={"kind": "circle", "center": degrees(10.0, 20.0), "radius": 40.0},
    )
    in_metres = scenario(
        start={"x": -50.0, "y": 20.0, "heading_deg": 45.0},
        survey={"kind": "waypoints", "points": [[0.0, 5.0], [100.0, 5.0]]},
        constraints={
            "keep_out": [
                {"x": 30.0, "y": -40.0, "radius": 12.0},
                {"points": [[60.0, 60.0], [90.0, 60.0], [90.0, 90.0]]},
            ],
            "geofence": [list(corner) for corner in corners],
        },
        planner={"kind": "circle", "center": [10.0, 20.0], "radius": 40.0},
    )
    assert_same(in_degrees.resolved(), in_metres.resolved())


@pytest.mark.parametrize(
    "survey", [{"kind": "static"}, {"kind": "lawnmower", "legs": 2, "length": 50.0, "spacing": 9.0}]
)
def test_surveys_that_begin_at_a_place_take_it_in_degrees(survey):
    moved = scenario(survey=survey | degrees(70.0, -30.0)).references[0].polyline
    plain = scenario(survey=survey | {"x": 70.0, "y": -30.0}).references[0].polyline
    np.testing.assert_allclose(moved, plain, atol=1e-3)  # nine decimals of a degree: 0.1 mm


def test_a_first_estimate_may_be_a_place_in_degrees():
    auv = {"speed": 1.0, "survey": LINE, "first_estimate": degrees(3.0, 4.0)}
    first = scenario(auv=[auv]).table.auv[0].first_estimate
    assert (first.x, first.y) == pytest.approx((3.0, 4.0), abs=1e-3)


def assert_same(a, b):
    """Contents of two files agree, numbers to a millimetre."""
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_same(a[key], b[key])
    elif isinstance(a, list):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            assert_same(one, other)
    elif isinstance(a, float):
        assert a == pytest.approx(b, abs=1e-3)
    else:
        assert a == b


def test_a_resolved_scenario_holds_metres_and_is_the_same_again():
    limits = {"keep_out": [degrees(30.0, -40.0) | {"radius": 12.0}]}
    resolved = scenario(start=degrees(-50.0, 20.0), constraints=limits).resolved()
    assert set(resolved["cna"]["start"]) == {"x", "y", "heading_deg"}
    assert set(resolved["constraints"]["keep_out"][0]) == {"x", "y", "radius"}
    assert from_dict(resolved).resolved() == resolved


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"start": {"lat": 95.0, "lon": 10.4}},
            r"cna.start.lat = 95.0 (latitude [deg], WGS84, instead of x and y): must be less than or equal to 90",
        ),
        ({"start": {"lat": 63.44}}, "cna.start (pose at time 0): a place is x and y in metres, or"),
        ({"start": {"lat": 63.44, "lon": 10.4, "x": 1.0}}, "got x and lat and lon: give one pair"),
        (
            {"start": {"lat": 59.9, "lon": 10.7}},
            "latitude 59.9, longitude 10.7 lies 395 km from the origin at latitude 63.44, longitude 10.4",
        ),
        (
            {"constraints": {"geofence": [[0, 0], {"lat": 63.45, "lon": 200.0}, [9, 9]]}},
            "constraints.geofence.1.lon = 200.0 (longitude [deg], WGS84): must be less than",
        ),
        (
            {"constraints": {"geofence": [[0, 0], {"lat": 63.45, "long": 10.4}, [9, 9]]}},
            'unknown key constraints.geofence.1.long; did you mean "lon"?',
        ),
        (
            {"constraints": {"keep_out": [{"points": [[0, 0], {"lat": 63.45}, [9, 9]]}]}},
            "constraints.keep_out.0.points.1.lon is missing (longitude [deg], WGS84); add it",
        ),
        (
            {"survey": {"kind": "waypoints", "points": [[0.0, 0.0], {"lat": 0.0, "lon": 0.0}]}},
            "latitude 0.0, longitude 0.0 lies 7088 km from the origin",  # 63.9 degrees of arc
        ),
        (
            {"start": {"x": 2e5}},
            "cna.start.x = 200000.0 (east [m]): must be from -100000 to 100000 m (the map ends",
        ),
        (
            {"start": {"x": 1e308, "y": -1e308}},
            "cna.start.x = 1e+308 (east [m]): must be from -100000 to 100000 m (the map ends",
        ),
        ({"constraints": {"geofence": 3}}, "constraints.geofence = 3"),
        ({"origin": {"lat": 99.0, "lon": 0.0}, "start": {"lat": 1.0, "lon": 1.0}}, "origin.lat"),
    ],
)
def test_a_place_that_is_none_is_refused_by_key_and_value(changes, message):
    assert message in refusal(**changes)


# --- numbers that look like degrees -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"start": {"x": 63.441, "y": 10.401}},
            "cna.start (pose at time 0): (63.441, 10.401), where metres are meant, looks like degrees, "
            "so near to the origin's: write lat = 63.441, lon = 10.401",
        ),
        ({"start": {"x": 10.401, "y": 63.441}}, "write lat = 63.441, lon = 10.401"),
        (
            {"constraints": {"keep_out": [{"x": 10.40, "y": 63.44, "radius": 15.0}]}},
            "constraints.keep_out.0 (areas not to enter): (10.4, 63.44), where metres are meant",
        ),
        (
            {"constraints": {"geofence": [[63.4, 10.3], [63.5, 10.3], [63.5, 10.5]]}},
            "(63.4, 10.3), where metres are meant, looks like degrees, so near to the origin's: "
            "write { lat = 63.4, lon = 10.3 }",
        ),
        (
            {"survey": {"kind": "waypoints", "points": [[10.40, 63.44], [10.41, 63.44]]}},
            "auv.0.survey.points",
        ),
        ({"survey": {"kind": "static", "x": 63.44, "y": 10.40}}, "auv.0.survey"),
        ({"planner": {"kind": "circle", "center": [63.44, 10.40]}}, "planner.center"),
    ],
)
def test_degrees_where_metres_are_meant_are_refused_with_the_remedy(changes, message):
    assert message in refusal(**changes)


@pytest.mark.parametrize(
    ("origin", "x", "y"),
    [
        (ORIGIN, 63.0, 10.0),  # whole metres
        (ORIGIN, 63.44, 12.5),
        (ORIGIN, 64.1, 10.4),
        ({"lat": 0.0, "lon": 0.0}, 0.25, 0.125),  # a tank at no place
        ({"lat": 5.2, "lon": 4.3}, 5.25, 4.5),  # a tank, to the centimetre
    ],
)
def test_metres_are_not_taken_for_degrees(origin, x, y):
    start = scenario(origin=origin, start={"x": x, "y": y}).start
    assert (start.x, start.y) == (x, y)


def test_one_corner_that_looks_like_degrees_among_others_does_not():
    fence = [[63.44, 10.40], [-90.0, 10.0], [-90.0, -70.0]]
    corners = scenario(constraints={"geofence": fence}).constraints.geofence.points
    assert corners[0] == (63.44, 10.40)


# --- areas --------------------------------------------------------------------------------------------------------------------------


def test_a_geofence_may_be_round_and_stays_so():
    fence = scenario(constraints={"geofence": {"x": 10.0, "y": 20.0, "radius": 90.0}})
    assert fence.constraints.geofence == Disc(x=10.0, y=20.0, radius=90.0)
    at = np.array([[10.0, 20.0], [10.0, 109.0], [10.0, 111.0]])
    np.testing.assert_allclose(fence.constraints.fixed_violation(at), [-90.0, -1.0, 1.0])
    assert fence.resolved()["constraints"]["geofence"] == {"x": 10.0, "y": 20.0, "radius": 90.0}


def test_a_geofence_of_points_in_a_table_is_that_of_the_list():
    corners = [[0.0, 0.0], [90.0, 0.0], [0.0, 90.0]]
    table = scenario(constraints={"geofence": {"points": corners}}).constraints
    assert table == scenario(constraints={"geofence": corners}).constraints


def test_the_polygon_within_a_disc_is_within_it_and_hardly_smaller():
    disc = Disc(x=3.0, y=-4.0, radius=50.0)
    corners = np.array(disc.inscribed().points)
    np.testing.assert_allclose(disc.signed_distance(corners), 0.0, atol=1e-9)
    middles = (corners + np.roll(corners, 1, axis=0)) / 2
    sagitta = 50.0 * (1 - math.cos(math.pi / len(corners)))
    np.testing.assert_allclose(disc.signed_distance(middles), -sagitta, atol=1e-9)
    assert sagitta < 0.005 * 50.0


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["information", "trajectory", "gramian", "trail"])
def test_planners_keep_within_a_round_geofence(planner):
    from obsplan.simulation import simulate

    fence = {"x": -40.0, "y": 0.0, "radius": 45.0}
    options = {"kind": planner} | (
        {"horizon": 10.0, "stages": 4} if planner == "trajectory" else {}
    )
    run = simulate(
        scenario(
            start={"x": -50.0, "y": 0.0},
            constraints={"geofence": fence},
            planner=options,
            duration=45.0,
        )
    )
    out = np.hypot(run.cna[:, 0] + 40.0, run.cna[:, 1]) - 45.0
    assert out.max() <= 0.0
    assert Constraints(geofence=Disc(**fence)) == run.scenario.constraints


def test_the_trajectory_program_takes_a_round_fence_as_lines_within_it():
    fence = {"x": -40.0, "y": 7.0, "radius": 45.0}
    planner = scenario(constraints={"geofence": fence}, planner={"kind": "trajectory"}).planner()
    lines = planner._areas.fence
    assert len(lines) >= 24
    np.testing.assert_allclose(np.hypot(lines[:, 0], lines[:, 1]), 1.0, rtol=1e-12)
    room = lines[:, 2] - lines[:, :2] @ [-40.0, 7.0]  # from the centre to each edge
    assert ((room > 0.99 * 45.0) & (room < 45.0)).all()


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            {},
            "constraints.keep_out.0 (areas not to enter): give either x, y and radius, or points, or file",
        ),
        ({"lat": 63.441, "lon": 10.4}, "give either x, y and radius, or points, or file"),
        ({"file": "a.plan", "radius": 3.0}, "give either x, y and radius, or points, or file"),
        ({"file": "a.plan", "points": [[0, 0]]}, "give either x, y and radius, or points, or file"),
        ({"file": "none.geojson"}, "none.geojson does not exist"),
    ],
)
def test_an_area_is_one_thing(entry, message):
    assert message in refusal(constraints={"keep_out": [entry]})


@pytest.fixture
def areas(monkeypatch, tmp_path):
    """Write a file `name.areas` that its reader finds to hold these limits; give the folder."""

    def write(name="a", **limits):
        line = Track(points=np.array([[LAT, LON], [LAT, LON + 1e-3]]))
        mission = Mission(**({"tracks": {"t": line}, "geographic": True} | limits))
        held[name] = mission
        (tmp_path / f"{name}.areas").write_text(name)
        return tmp_path

    held = {}
    monkeypatch.setitem(READERS, ".areas", lambda path: held[path.stem])
    return write


def area(*points, radius=None):
    """An area about places so many metres from the origin."""
    return Area(points=np.array([list(degrees(*p).values()) for p in points]), radius=radius)


SQUARE = ((0.0, 0.0), (80.0, 0.0), (80.0, 80.0), (0.0, 80.0))


def test_one_entry_from_a_file_gives_all_its_keep_outs(areas):
    folder = areas(keep_outs=(area((30.0, 40.0), radius=12.0), area(*SQUARE)))
    entries = [{"file": "a.areas"}, {"x": 1.0, "y": 2.0, "radius": 3.0}]
    limits = scenario(folder=folder, constraints={"keep_out": entries})
    disc, square, last = limits.constraints.keep_out
    assert (disc.x, disc.y, disc.radius) == pytest.approx((30.0, 40.0, 12.0), abs=1e-3)
    np.testing.assert_allclose(square.points, SQUARE, atol=1e-3)
    assert last == Disc(x=1.0, y=2.0, radius=3.0)
    assert from_dict(limits.resolved()).constraints == limits.constraints  # without the file


def test_all_geofences_of_a_file_hold(areas):
    folder = areas(geofences=(area(*SQUARE), area((80.0, 40.0), radius=50.0)))
    fence = scenario(folder=folder, constraints={"geofence": {"file": "a.areas"}})
    inside = [[40.0, 40.0], [79.0, 70.0]]
    outside = [[25.0, 40.0], [90.0, 40.0], [70.0, 85.0], [5.0, 5.0]]
    at = np.array(inside + outside)
    np.testing.assert_array_equal(fence.constraints.fixed_violation(at) > 0, [0, 0, 1, 1, 1, 1])
    assert isinstance(fence.constraints.geofence, Polygon)
    assert from_dict(fence.resolved()).constraints == fence.constraints


def test_one_round_geofence_of_a_file_stays_round(areas):
    folder = areas(geofences=(area((5.0, 6.0), radius=50.0),))
    limits = scenario(folder=folder, constraints={"geofence": {"file": "a.areas"}}).constraints
    assert limits.geofence.radius == 50.0


@pytest.mark.parametrize(
    ("key", "limits", "message"),
    [
        (
            "geofence",
            {"geofences": (area((0, 0), radius=9.0), area((50, 0), radius=9.0))},
            "constraints.geofence: the 2 geofences, all of which hold, have no one area in common: draw one",
        ),
        ("geofence", {"keep_outs": (area(*SQUARE),)}, "no closed line for a geofence"),
        ("keep_out", {"geofences": (area(*SQUARE),)}, "no closed line for a keep-out"),
        ("keep_out", {}, "no circle and no closed line for a keep-out: draw the area as a polygon"),
        (
            "keep_out",
            {"keep_outs": (area(*SQUARE), area(*SQUARE[:2]))},
            "constraints.keep_out.0: a.areas, area 2: a polygon needs at least three corners, got 2",
        ),
        (
            "keep_out",
            {"keep_outs": (Area(points=np.array([[1.0, 2.0]]), radius=5.0),)},
            "constraints.keep_out.0: a.areas, area 1: latitude 1.0, longitude 2.0 lies",
        ),
    ],
)
def test_a_file_without_the_area_asked_for_is_refused(areas, key, limits, message):
    folder = areas(**limits)
    entry = {"file": "a.areas"}
    constraints = {key: [entry] if key == "keep_out" else entry}
    assert message in refusal(folder=folder, constraints=constraints)


def test_areas_of_a_file_in_metres_are_about_the_scenarios_origin(areas):
    line = Track(points=np.array([[0.0, 0.0], [9.0, 0.0]]))
    square = Area(points=np.array(SQUARE))
    folder = areas(tracks={"t": line}, geographic=False, keep_outs=(square,))
    limits = scenario(folder=folder, constraints={"keep_out": [{"file": "a.areas"}]}).constraints
    assert limits.keep_out == (Polygon(points=SQUARE),)


def test_schema_lists_the_keys_of_places_wherever_they_stand():
    keys = {path: {row[0]: row for row in rows} for path, rows in sections()}
    for path in ("cna.start", "constraints.keep_out[]", "constraints.geofence"):
        assert {"x", "y", "lat", "lon"} <= set(keys[path])
    kinds = {
        ("constraints", "geofence"): "list of [number, number] or { lat, lon } or a table",
        ('auv[].survey, kind = "waypoints"', "points"): "list of [number, number] or { lat, lon }",
        ('planner, kind = "circle"', "center"): "[number, number] or { lat, lon }",
    }
    for (path, key), kind in kinds.items():
        assert keys[path][key][1] == kind
    definitions = json_schema()["$defs"]
    assert "lat" in definitions["Start"]["properties"]
    assert "{'$ref': '#/$defs/Degrees'}" in str(definitions["AreaTable"]["properties"]["points"])
