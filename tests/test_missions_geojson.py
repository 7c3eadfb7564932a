"""Claims about GeoJSON files that are read, and about areas by their names."""

import json
import re

import numpy as np
import pyogrio.raw
import pytest
import shapely
from mission_files import (
    LONLAT,
    TRACK,
    check_refused,
    check_survives_damage,
    collection,
    feature,
    line,
    read,
    write,
)
from pymap3d.vincenty import vdist

from obsplan.missions import read_areas, to_local
from obsplan.types import ObsplanError

SQUARE = [[10.4, 63.44], [10.402, 63.44], [10.402, 63.441], [10.4, 63.441], [10.4, 63.44]]
CORNERS = [[lat, lon] for lon, lat in SQUARE[:-1]]
HOLE = [[10.4005, 63.4402], [10.401, 63.4402], [10.401, 63.4405], [10.4005, 63.4402]]


# --- lines ----------------------------------------------------------------------------------------


def test_lines_keep_their_names_and_other_geometries_are_counted(tmp_path):
    multi = feature("MultiLineString", [LONLAT, LONLAT[1:]], name="m")
    empty = {"type": "Feature", "properties": {}, "geometry": None}
    points = (feature("Point", [1, 2], name=name) for name in ("buoy", "mark"))
    features = (line(name="alpha"), *points, empty, line(name="alpha"), multi, line())
    mission = read(tmp_path, "a.geojson", collection(*features))
    assert list(mission.tracks) == ["alpha", "alpha-2", "m", "m-2", "a"]
    np.testing.assert_array_equal(mission.tracks["m-2"].points, TRACK[1:])
    assert mission.remarks == (
        '2 points ("buoy" and "mark") passed over: only lines are tracks',
        "1 feature without geometry passed over",
    )


def test_empty_and_stub_lines_are_passed_over_with_one_remark_a_kind(tmp_path):
    stubs = [line([], name="none"), line(LONLAT[:1], name="q"), line([LONLAT[0]] * 2, name="r")]
    mission = read(tmp_path, "a.geojson", collection(*stubs, line(name="whole")))
    assert list(mission.tracks) == ["whole"]
    assert mission.remarks == (
        'track "none" has no place, and no line: passed over',
        '2 tracks ("q" and "r") have a single place, and no line: passed over',
    )


def test_places_repeated_one_after_the_other_are_one_vertex(tmp_path):
    mission = read(tmp_path, "a.geojson", line([LONLAT[0], LONLAT[1], LONLAT[1], LONLAT[2]]))
    np.testing.assert_array_equal(mission.tracks["a"].points, TRACK)


@pytest.mark.parametrize(
    "pieces",
    [
        [
            [[179.9985, -16.8], [180.0, -16.8]],
            [[-180.0, -16.8], [-179.9985, -16.8], [-179.9985, -16.801]],
        ],
        [[[179.9985, -16.8], [180.0015, -16.8], [180.0015, -16.801]]],
        [[[-180.0015, -16.8], [-179.9985, -16.8], [-179.9985, -16.801]]],
    ],
)
def test_a_line_over_180_degrees_is_one_track_as_long_as_on_earth(tmp_path, pieces):
    mission = read(tmp_path, "a.geojson", feature("MultiLineString", pieces))
    assert list(mission.tracks) == ["a"]
    points = to_local(mission).tracks["a"].points
    length = np.hypot(*np.diff(points, axis=0).T).sum()
    there = vdist(-16.8, 179.9985, -16.8, -179.9985)[0]
    back = vdist(-16.8, -179.9985, -16.801, -179.9985)[0]
    np.testing.assert_allclose(length, there + back, rtol=0, atol=1e-3)


@pytest.mark.slow
def test_more_vertices_than_a_mission_has_are_refused_at_once(tmp_path):
    message = r"geometry has 200001 vertices, more than 200000: export the mission, not the log"
    check_refused(tmp_path, "a.geojson", line([[1, 2]] * 200_001), message)


def test_lines_that_only_touch_stay_apart(tmp_path):
    halves = feature("MultiLineString", [LONLAT[:2], LONLAT[1:]])
    assert list(read(tmp_path, "a.geojson", halves).tracks) == ["a", "a-2"]


@pytest.mark.parametrize(
    "name",
    [
        "urn:ogc:def:crs:OGC:1.3:CRS84",
        "urn:ogc:def:crs:OGC::CRS84h",
        "urn:ogc:def:crs:EPSG::4979",
        "EPSG:4326",
        "WGS 84",
    ],
)
def test_every_name_of_wgs84_is_read_and_the_third_coordinate_is_altitude(tmp_path, name):
    deep = line([[*position, -5.0] for position in LONLAT])
    crs = {"type": "name", "properties": {"name": name}}
    mission = read(tmp_path, "a.geojson", {**collection(deep), "crs": crs})
    np.testing.assert_array_equal(mission.tracks["a"].points, TRACK)
    np.testing.assert_array_equal(mission.tracks["a"].altitude, [-5.0] * 3)


def test_a_height_at_some_vertices_alone_is_passed_over_with_a_remark(tmp_path):
    mission = read(tmp_path, "a.geojson", line([[*LONLAT[0], -5.0], *LONLAT[1:]]))
    assert mission.tracks["a"].altitude is None
    assert mission.remarks == ("1 track with a height at only some vertices: heights passed over",)


def test_speeds_holds_and_times_are_read_from_properties(tmp_path):
    told = {"name": "t", "speed_mps": [1.5, None], "hold_s": [0, 30, 0], "time_s": [5, 100, 300]}
    track = read(tmp_path, "a.geojson", line(**told)).tracks["t"]
    np.testing.assert_array_equal(track.speed, [1.5, np.nan])
    np.testing.assert_array_equal(track.hold, [0, 30, 0])
    np.testing.assert_array_equal(track.time, [0, 95, 295])
    track = read(tmp_path, "a.geojson", line(speed_mps=0.8)).tracks["a"]
    np.testing.assert_array_equal(track.speed, [0.8, 0.8])


def test_times_alone_give_the_speed_on_each_leg_after_the_hold_before_it(tmp_path):
    track = read(tmp_path, "a.geojson", line(time_s=[0, 200, 330], hold_s=[10, 30, 0])).tracks["a"]
    lengths = [vdist(*TRACK[0], *TRACK[1])[0], vdist(*TRACK[1], *TRACK[2])[0]]
    np.testing.assert_allclose(track.speed, [lengths[0] / 190, lengths[1] / 100], rtol=1e-6)


@pytest.mark.parametrize(
    ("told", "remark"),
    [
        ({"speed_mps": [1.0]}, "with speed_mps that is not a number of at least 0 for each leg"),
        ({"speed_mps": "fast"}, "with speed_mps that is not"),
        ({"hold_s": [0, -1, 0]}, "with hold_s that is not a number of at least 0 for each vertex"),
        ({"time_s": [0, True, 2]}, "with time_s that is not"),
        ({"time_s": [0, None, 300]}, "with a time at only some vertices: times passed over"),
        ({"time_s": [0, 1, 300]}, r"with times that no vehicle keeps \(over 30 m/s\)"),
        (
            {"time_s": [0, 300, 200]},
            "with legs along which the times do not run on: no speed there",
        ),
    ],
)
def test_what_the_properties_say_amiss_is_passed_over_with_a_remark(tmp_path, told, remark):
    mission = read(tmp_path, "a.geojson", line(name="t", **told))
    np.testing.assert_array_equal(mission.tracks["t"].points, TRACK)
    (said,) = mission.remarks
    assert said.startswith('1 track ("t") ')
    assert re.search(remark, said)


# --- areas ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("properties", "limit"),
    [
        ({"name": "Keep-out 1"}, "keep-out"),
        ({"name": "KEEPOUT"}, "keep-out"),
        ({"name": "keep_out"}, "keep-out"),
        ({"Name": "exclusion fence"}, "keep-out"),
        ({"name": "survey_nogo"}, "keep-out"),
        ({"name": "No Go zone"}, "keep-out"),
        ({"name": "the Wreck"}, "keep-out"),
        ({"name": "A1", "description": "restricted area"}, "keep-out"),
        ({"name": "wreck survey", "kind": "geofence"}, "geofence"),
        ({"name": "GeoFence"}, "geofence"),
        ({"type": "inclusion"}, "geofence"),
        ({"name": "Survey boundary"}, "geofence"),
        ({"name": "OpArea west"}, "geofence"),
        ({"name": "operating area"}, "geofence"),
        ({"name": "casino gold"}, ""),
        ({"name": "offence"}, ""),
        ({}, ""),
    ],
)
def test_a_polygon_is_the_limit_that_its_properties_call_it(tmp_path, properties, limit):
    polygon = feature("Polygon", [SQUARE], **properties)
    mission = read(tmp_path, "a.geojson", collection(line(), polygon))
    holders = {"keep-out": mission.keep_outs, "geofence": mission.geofences, "": mission.areas}
    assert [bool(areas) for areas in holders.values()] == [limit == other for other in holders]
    np.testing.assert_array_equal(holders[limit][0].points, CORNERS)
    name = properties.get("name")
    named = f' ("{name}")' if name else ""
    passed = (
        f'1 polygon{named} passed over: name it "keep-out ..." or "geofence ..." to make it a limit'
    )
    assert mission.remarks == (() if limit else (passed,))


def test_holes_are_filled_in_a_keep_out_and_are_keep_outs_in_a_geofence(tmp_path):
    fence = feature("Polygon", [SQUARE, HOLE], name="fence")
    wreck = feature("MultiPolygon", [[SQUARE, HOLE], [HOLE]], name="wreck")
    mission = read(tmp_path, "a.geojson", collection(line(), fence, wreck))
    assert [len(area.points) for area in mission.geofences] == [4]
    assert [len(area.points) for area in mission.keep_outs] == [3, 4, 3]
    assert mission.remarks == (
        '1 geofence ("fence") with holes: the holes are keep-outs',
        '1 keep-out ("wreck") with holes: the holes are kept out of, too',
    )


def test_a_point_with_a_radius_is_a_circle(tmp_path):
    buoy = feature("Point", [10.4, 63.44], name="b", kind="keep-out", radius_m=15)
    (area,) = read(tmp_path, "a.geojson", collection(line(), buoy)).keep_outs
    np.testing.assert_array_equal(area.points, [[63.44, 10.4]])
    assert area.radius == 15


def test_areas_asked_for_as_keep_outs_are_all_that_the_file_does_not_call_a_geofence(tmp_path):
    features = (
        feature("Polygon", [SQUARE]),
        feature("Point", [10.4, 63.44], radius_m=15, name="wreck"),
        feature("LineString", SQUARE, name="closed"),
        feature("Polygon", [SQUARE], name="fence"),
    )
    path = write(tmp_path, "a.geojson", collection(*features))
    areas, geographic = read_areas(path, "keep-out")
    assert geographic
    assert [area.radius for area in areas] == [15, None]
    np.testing.assert_array_equal(areas[1].points, CORNERS)
    (fence,), _ = read_areas(path, "geofence")
    np.testing.assert_array_equal(fence.points, CORNERS)


def test_areas_without_a_name_are_a_geofence_where_one_is_asked_for(tmp_path):
    path = write(tmp_path, "a.geojson", collection(feature("Polygon", [SQUARE]), line()))
    (fence,), _ = read_areas(path, "geofence")
    np.testing.assert_array_equal(fence.points, CORNERS)


@pytest.mark.parametrize("role", ["keep-out", "geofence"])
def test_closed_lines_are_areas_in_a_file_that_has_no_other(tmp_path, role):
    closed = feature("LineString", SQUARE, name="closed")
    (area,), _ = read_areas(write(tmp_path, "a.geojson", collection(line(), closed)), role)
    np.testing.assert_array_equal(area.points, CORNERS)


@pytest.mark.parametrize(("role", "other"), [("keep-out", "fence"), ("geofence", "wreck")])
def test_a_file_without_areas_is_refused_where_areas_are_asked_for(tmp_path, role, other):
    features = (line(), feature("Polygon", [SQUARE], name=other))
    path = write(tmp_path, "a.geojson", collection(*features))
    with pytest.raises(ObsplanError, match=f"no circle and no closed line for a {role}: draw"):
        read_areas(path, role)


# --- what is refused, and what survives -------------------------------------------------------------

BAD = {
    "plan as geojson": (
        {"fileType": "Plan"},
        r'not GeoJSON \("type" is None\): rename it to .plan',
    ),
    "other json": ({"type": "Topology"}, "is not GeoJSON .*Topology"),
    "no features": ({"type": "FeatureCollection"}, 'needs a list "features", got NoneType'),
    "feature not an object": (collection(3), r"features\[0\] must be a GeoJSON object, got int"),
    "no line": (
        {"type": "Point", "coordinates": [1, 2]},
        r"holds no line to follow \(1 point passed",
    ),
    "no features inside": (collection(), "holds no line to follow: draw"),
    "one point": (line(LONLAT[:1], name="q"), 'no line to follow .track "q" has a single place'),
    "projected": (
        {**line(), "crs": {"properties": {"name": "urn:ogc:def:crs:EPSG::32610"}}},
        r"crs .*32610.* is not WGS 84",
    ),
    "geocentric": (
        {**line(), "crs": {"properties": {"name": "urn:ogc:def:crs:EPSG::4978"}}},
        "is not WGS 84",
    ),
    "projected geometry": (
        collection(
            {
                "geometry": {**line()["geometry"], "crs": {"properties": {"code": 32610}}},
                "type": "Feature",
            }
        ),
        r"features\[0\].geometry: crs .* is not WGS 84",
    ),
    "swapped": (
        line([list(p) for p in TRACK]),
        r"coordinates\[0\] has latitude -122.337 .*look swapped: exchange them, GeoJSON has \[long",
    ),
    "metres": (
        line([[550000, 5275000], [0, 0]]),
        "latitude 5275000.0, beyond 90 degrees: give WGS 84",
    ),
    "nan": (
        '{"type": "LineString", "coordinates": [[-122.3, 47.6], [NaN, 47.7]]}',
        r"coordinates\[1\]\[0\] must be a finite",
    ),
    "infinite": (
        line([[10**400, 1], [1, 2]]),
        r"coordinates\[0\]\[0\] must be a finite number, got inf",
    ),
    "text number": (
        collection(line([["1", 2], [3, 4]])),
        r"features\[0\].geometry.coordinates\[0\]\[0\] must be a number, got '1'",
    ),
    "flag number": (line([[True, 2], [3, 4]]), "must be a number, got True"),
    "flat coordinates": (line([1, 2]), r"coordinates\[0\] must be \[longitude, latitude\], got 1"),
    "unprintable name": (line(name="a\x00b"), r"track name 'a\\x00b' cannot be printed"),
    "keep-out of two corners": (
        collection(line(), feature("Polygon", [SQUARE[:2]], name="wreck")),
        'keep-out "wreck" has fewer than three corners',
    ),
    "fence of no ring": (
        collection(line(), feature("Polygon", [], name="fence")),
        'geofence "fence" has fewer than three',
    ),
    "fence in two parts": (
        collection(line(), feature("MultiPolygon", [[SQUARE], [HOLE]], name="fence")),
        'geofence "fence" has 2 parts, and a vehicle cannot be in all: draw one polygon',
    ),
    "negative radius": (
        collection(line(), feature("Point", [1, 2], radius_m=-3)),
        r"features\[1\].geometry: radius_m must be positive \[m\], got -3.0",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_geojson_is_refused_in_one_sentence_that_says_where_what_and_how_to_mend(
    tmp_path, case
):
    check_refused(tmp_path, "a.geojson", *BAD[case])


WHOLE = collection(
    line(
        [[*position, -5.0] for position in LONLAT], name="q", speed_mps=[1, 2], time_s=[0, 200, 300]
    ),
    feature("MultiLineString", [LONLAT, LONLAT[1:]]),
    feature("Polygon", [SQUARE, HOLE], name="fence"),
    feature("Point", [10.4, 63.44], name="wreck", radius_m=15),
)


def test_damaged_geojson_gives_a_mission_or_our_error(tmp_path):
    check_survives_damage(tmp_path, "a.geojson", json.dumps(WHOLE).encode())


def test_lines_and_areas_are_those_that_gdal_reads(tmp_path):
    path = write(tmp_path, "a.geojson", WHOLE)
    _, _, shapes, _ = pyogrio.raw.read(path)
    shapes = [shapely.from_wkb(shape) for shape in shapes]
    mission = read(tmp_path, "a.geojson", WHOLE)
    lines = [shapely.get_coordinates(part)[:, ::-1] for part in shapely.get_parts(shapes[:2])]
    for track, expected in zip(mission.tracks.values(), lines, strict=True):
        np.testing.assert_array_equal(track.points, expected)
    np.testing.assert_array_equal(
        mission.geofences[0].points, np.array(shapes[2].exterior.coords)[:-1, ::-1]
    )
