"""Claims about mission files that are written, each read back by somebody else's reader."""

import csv
import json
import os
import xml.etree.ElementTree as ET
from datetime import UTC, datetime, timedelta

import fastkml
import gpxpy
import numpy as np
import pyogrio
import pytest
import shapely
from missions import (
    BUOY,
    BUOY_RADIUS,
    FENCE,
    HOLD,
    ORIGIN,
    POINTS,
    SPEED,
    TIME,
    WRECK,
    degrees,
    full_mission,
    metres,
    moos_behaviours,
    moos_points,
)
from pymavlink.mavwp import MAVWPLoader

from obsplan.files import write_atomically
from obsplan.missions import (
    WRITERS,
    Area,
    Mission,
    Track,
    to_geographic,
    to_local,
    write_csv,
    write_geojson,
    write_gpx,
    write_kml,
    write_moos,
    write_plan,
    write_waypoints,
)
from obsplan.types import ObsplanError

MORNING = datetime(2026, 5, 1, 8, 0, tzinfo=UTC)
STAMPED = [0.0, 50.0, 80.0, 110.0, 206.0, 249.6]  # with the end of the hold
STAMPED_PLACES = POINTS[[0, 1, 2, 2, 3, 4]]
MILLIMETRE = 2e-3  # 1e-9 degrees are 0.1 mm, the curvature within 200 m 3 mm upwards
every_writer = pytest.mark.parametrize("suffix", WRITERS)


def items_of(path):
    """Items as pymavlink reads them from a waypoint file."""
    loader = MAVWPLoader()
    return [loader.wp(i) for i in range(loader.load(str(path)))]


# --- waypoint files ----------------------------------------------------------------------------


def test_pymavlink_reads_home_waypoints_speeds_and_holds(tmp_path):
    write_waypoints(tmp_path / "a.waypoints", full_mission())
    home, *items = items_of(tmp_path / "a.waypoints")
    assert [item.seq for item in items] == [1, 2, 3, 4, 5, 6, 7]
    assert (home.current, home.frame, home.command) == (1, 0, 16)
    np.testing.assert_allclose(metres(np.array([(home.x, home.y)])), [(-5, -5)], atol=MILLIMETRE)
    assert [item.command for item in items] == [178, 16, 16, 16, 178, 16, 17]
    assert [item.frame for item in items] == [2, 3, 3, 3, 2, 3, 3]
    assert [item.param2 for item in items if item.command == 178] == [2.0, 1.25]
    assert {(item.param1, item.param3) for item in items if item.command == 178} == {(1, -1)}
    assert [item.param1 for item in items if item.command == 16] == [0, 0, 30, 0]
    places = metres(np.array([(item.x, item.y) for item in items if item.command != 178]))
    np.testing.assert_allclose(places, POINTS, atol=MILLIMETRE)
    assert {(item.current, item.autocontinue, item.z) for item in items} == {(0, 1, 0)}


@pytest.mark.parametrize(
    ("end", "last"), [("loiter", [16, 17]), ("return", [16, 20]), ("stop", [16, 16])]
)
@pytest.mark.parametrize("write", [write_waypoints, write_plan])
def test_mission_ends_as_asked_and_at_its_last_place(tmp_path, write, end, last):
    write(tmp_path / "a", full_mission(), end=end)
    if write is write_waypoints:
        items = [(item.command, item.x, item.y) for item in items_of(tmp_path / "a")]
    else:
        content = json.loads((tmp_path / "a").read_text())
        items = [(i["command"], *i["params"][4:6]) for i in content["mission"]["items"]]
    assert [command for command, *_ in items[-2:]] == last
    placed = [(lat, lon) for command, lat, lon in items if command in (16, 17)]
    np.testing.assert_allclose(metres(np.array(placed[-1:])), POINTS[-1:], atol=MILLIMETRE)


def test_home_is_the_first_waypoint_unless_it_is_given(tmp_path):
    write_waypoints(tmp_path / "a.waypoints", full_mission(home=None))
    home, *items = items_of(tmp_path / "a.waypoints")
    assert (home.x, home.y) == (items[1].x, items[1].y)
    write_plan(tmp_path / "a.plan", full_mission(home=None))
    content = json.loads((tmp_path / "a.plan").read_text())
    np.testing.assert_allclose(content["mission"]["plannedHomePosition"], [*ORIGIN, 0], atol=1e-9)


def test_a_vehicle_that_stays_put_has_one_waypoint_and_no_speed(tmp_path):
    mission = Mission(tracks={"cna": Track(points=np.array([ORIGIN]))}, geographic=True)
    write_waypoints(tmp_path / "a.waypoints", mission)
    assert [item.command for item in items_of(tmp_path / "a.waypoints")] == [16, 17]


def test_a_speed_not_known_is_not_commanded(tmp_path):
    track = Track(points=degrees(POINTS), speed=np.array([np.nan, 2.0, np.nan, 2.0]))
    write_waypoints(tmp_path / "a.waypoints", full_mission(tracks={"cna": track}))
    commands = [item.command for item in items_of(tmp_path / "a.waypoints")]
    assert commands == [16, 16, 16, 178, 16, 16, 17]


# --- QGroundControl plans ----------------------------------------------------------------------


def test_plan_has_every_key_that_qgroundcontrol_requires(tmp_path):
    # JsonHelper::validateKeys in QGroundControl's MissionController, MissionItem, SimpleMissionItem,
    # GeoFenceController, QGCFencePolygon, QGCFenceCircle and RallyPointController
    write_plan(tmp_path / "a.plan", full_mission())
    content = json.loads((tmp_path / "a.plan").read_text())
    assert (content["fileType"], content["version"]) == ("Plan", 1)
    assert isinstance(content["groundStation"], str)
    mission, fence, rally = content["mission"], content["geoFence"], content["rallyPoints"]
    assert (mission["version"], fence["version"], rally["version"]) == (2, 2, 2)
    assert (mission["firmwareType"], mission["vehicleType"]) == (3, 11)  # ArduPilot, boat
    assert mission["cruiseSpeed"] == mission["hoverSpeed"] == 2.0
    assert len(mission["plannedHomePosition"]) == 3
    for number, item in enumerate(mission["items"], start=1):
        assert (item["type"], item["autoContinue"], item["doJumpId"]) == (
            "SimpleItem",
            True,
            number,
        )
        assert isinstance(item["command"], int)
        assert isinstance(item["frame"], int)
        assert len(item["params"]) == 7
        placed = item["command"] in (16, 17)
        assert ({"Altitude", "AltitudeMode", "AMSLAltAboveTerrain"} <= set(item)) == placed
    assert rally["points"] == []


def test_plan_has_the_waypoint_files_items_and_the_limits(tmp_path):
    write_plan(tmp_path / "a.plan", full_mission())
    write_waypoints(tmp_path / "a.waypoints", full_mission())
    content = json.loads((tmp_path / "a.plan").read_text())
    items = content["mission"]["items"]
    expected = [
        (i.command, i.frame, i.param1, i.param2, i.param3, i.param4, i.x, i.y, i.z)
        for i in items_of(tmp_path / "a.waypoints")[1:]
    ]
    assert [(i["command"], i["frame"], *i["params"]) for i in items] == expected
    fence = content["geoFence"]
    assert [polygon["inclusion"] for polygon in fence["polygons"]] == [True, False]
    for polygon, corners in zip(fence["polygons"], (FENCE, WRECK), strict=True):
        np.testing.assert_allclose(metres(np.array(polygon["polygon"])), corners, atol=MILLIMETRE)
        assert polygon["version"] == 1
    (circle,) = fence["circles"]
    assert (circle["inclusion"], circle["version"]) == (False, 1)
    assert circle["circle"]["radius"] == BUOY_RADIUS
    np.testing.assert_allclose(
        metres(np.array([circle["circle"]["center"]])), BUOY, atol=MILLIMETRE
    )


# --- GPX ---------------------------------------------------------------------------------------


def test_gpxpy_reads_places_and_times_and_what_they_count_from(tmp_path):
    write_gpx(tmp_path / "a.gpx", full_mission(), start=MORNING)
    gpx = gpxpy.parse((tmp_path / "a.gpx").read_text(encoding="utf-8"))
    (track,) = gpx.tracks
    (segment,) = track.segments
    assert track.name == "cna"
    places = metres(np.array([(p.latitude, p.longitude) for p in segment.points]))
    np.testing.assert_allclose(places, STAMPED_PLACES, atol=MILLIMETRE)
    assert [p.time for p in segment.points] == [MORNING + timedelta(seconds=s) for s in STAMPED]
    assert gpx.description == (
        "The mission starts at 2026-05-01T08:00:00Z. "
        "GPX holds no areas: the limits of the mission are not in this file."
    )
    moving = [segment.get_speed(i) for i in (1, 4)]
    assert moving == pytest.approx([2.0, 1.25], rel=0.35)  # the mean of both legs about a point


def test_times_of_a_mission_whose_start_is_not_known_say_so(tmp_path):
    write_gpx(tmp_path / "a.gpx", full_mission(geofences=(), keep_outs=()))
    gpx = gpxpy.parse((tmp_path / "a.gpx").read_text(encoding="utf-8"))
    assert gpx.tracks[0].segments[0].points[-1].time == datetime.fromtimestamp(249.6, UTC)
    assert gpx.description == (
        "Times count from 1970-01-01T00:00:00Z, which stands for the start of the mission."
    )


def test_gdal_reads_our_gpx_and_kml(tmp_path):
    write_gpx(tmp_path / "a.gpx", full_mission())
    _, _, geometry, _ = pyogrio.raw.read(tmp_path / "a.gpx", layer="tracks")
    line = shapely.get_coordinates(shapely.from_wkb(geometry[0]))[:, ::-1]
    np.testing.assert_allclose(metres(line), STAMPED_PLACES, atol=MILLIMETRE)
    write_kml(tmp_path / "a.kml", full_mission())
    meta, _, geometry, fields = pyogrio.raw.read(tmp_path / "a.kml")
    names = fields[list(meta["fields"]).index("Name")].tolist()
    assert names == ["cna", "geofence", "keep-out-1", "keep-out-2"]
    shapes = [shapely.from_wkb(wkb) for wkb in geometry]
    line = shapely.get_coordinates(shapes[0])[:, 1::-1]
    np.testing.assert_allclose(metres(line), STAMPED_PLACES, atol=MILLIMETRE)
    ring = shapely.get_coordinates(shapes[2])[:, 1::-1]
    np.testing.assert_allclose(metres(ring), WRECK[[0, 1, 2, 0]], atol=MILLIMETRE)


# --- KML ---------------------------------------------------------------------------------------


def test_fastkml_reads_places_times_and_limits(tmp_path):
    write_kml(tmp_path / "a.kml", full_mission(), start=MORNING)
    kml = fastkml.KML.parse(tmp_path / "a.kml")
    document = kml.features[0]
    assert document.description == "The mission starts at 2026-05-01T08:00:00Z."
    path, fence, wreck, buoy = document.features
    assert [p.name for p in document.features] == ["cna", "geofence", "keep-out-1", "keep-out-2"]
    track = path.kml_geometry
    coords = np.array([(item.coord.y, item.coord.x) for item in track.track_items])
    np.testing.assert_allclose(metres(coords), STAMPED_PLACES, atol=MILLIMETRE)
    whens = [item.when.dt for item in track.track_items]
    assert whens == [MORNING + timedelta(seconds=s) for s in STAMPED]
    for placemark, corners in ((fence, FENCE), (wreck, WRECK)):
        ring = np.array(placemark.geometry.exterior.coords)[:, 1::-1]
        np.testing.assert_allclose(metres(ring)[:-1], corners, atol=MILLIMETRE)
    ring = metres(np.array(buoy.geometry.exterior.coords)[:, 1::-1])
    away = shapely.distance(shapely.Point(*BUOY[0]), shapely.LineString(ring))
    assert BUOY_RADIUS - MILLIMETRE <= away <= BUOY_RADIUS + 0.02  # about the circle, not within


@pytest.mark.parametrize("radius", [0.5, 12.5, 1000.0])
@pytest.mark.parametrize("kind", ["geofences", "keep_outs"])
def test_a_circle_is_drawn_on_its_safe_side_and_near_it(tmp_path, kind, radius):
    nothing = {"geofences": (), "keep_outs": ()}
    area = Area(points=degrees(BUOY), radius=radius)
    write_kml(tmp_path / "a.kml", full_mission(**nothing | {kind: (area,)}))
    document = fastkml.KML.parse(tmp_path / "a.kml").features[0]
    ring = np.array(document.features[1].geometry.exterior.coords)[:, 1::-1]
    corners = np.hypot(*(metres(ring) - BUOY).T)
    edges = shapely.distance(shapely.Point(*BUOY[0]), shapely.LinearRing(metres(ring)))
    inner, outer = corners.max() - radius, radius - edges
    assert abs(inner) < 0.05
    assert abs(outer) < 0.05
    assert (inner if kind == "geofences" else outer) < MILLIMETRE  # no farther than the circle


def test_tracks_without_times_are_lines_and_a_single_place_is_a_point(tmp_path):
    tracks = {"a": Track(points=degrees(POINTS)), "b": Track(points=degrees(POINTS[:1]))}
    write_kml(tmp_path / "a.kml", full_mission(tracks=tracks))
    kinds = [
        p.geometry.geom_type for p in fastkml.KML.parse(tmp_path / "a.kml").features[0].features
    ]
    assert kinds[:2] == ["LineString", "Point"]
    assert "<when>" not in (tmp_path / "a.kml").read_text()


@pytest.mark.parametrize("write", [write_gpx, write_kml])
def test_names_cannot_break_out_of_markup(tmp_path, write):
    name = "a</name><script>&'\"é"
    write(tmp_path / "a", full_mission(tracks={name: Track(points=degrees(POINTS))}))
    root = ET.parse(tmp_path / "a").getroot()
    assert name in [element.text for element in root.iter() if element.tag.endswith("name")]


# --- GeoJSON -----------------------------------------------------------------------------------


def test_gdal_reads_our_geojson_back(tmp_path):
    write_geojson(
        tmp_path / "a.geojson",
        full_mission(
            tracks={
                "cna": full_mission().tracks["cna"],
                "still": Track(points=degrees(POINTS[:1]), time=np.zeros(1)),
            }
        ),
    )
    meta, _, geometry, fields = pyogrio.raw.read(tmp_path / "a.geojson")
    assert meta["crs"] == "EPSG:4326"
    columns = dict(zip(meta["fields"], fields, strict=True))
    assert columns["name"].tolist() == ["cna", "still", "geofence", "keep-out-1", "keep-out-2"]
    assert columns["kind"].tolist() == ["track", "track", "geofence", "keep-out", "keep-out"]
    np.testing.assert_allclose(columns["time_s"][0], TIME)
    np.testing.assert_allclose(columns["speed_mps"][0], SPEED)
    np.testing.assert_allclose(columns["hold_s"][0], HOLD)
    assert columns["radius_m"][4] == BUOY_RADIUS
    shapes = [shapely.from_wkb(wkb) for wkb in geometry]
    kinds = ["LineString", "Point", "Polygon", "Polygon", "Point"]
    assert [shape.geom_type for shape in shapes] == kinds
    for shape, expected in zip(shapes, (POINTS, POINTS[:1], FENCE, WRECK, BUOY), strict=True):
        places = metres(shapely.get_coordinates(shape)[:, ::-1])
        if shape.geom_type == "Polygon":  # by RFC 7946 counter-clockwise, whatever it was
            assert shape.exterior.is_ccw
            assert len(places) == len(expected) + 1
            off = shapely.hausdorff_distance(
                shapely.LinearRing(places), shapely.LinearRing(expected)
            )
            assert off < MILLIMETRE
        else:
            np.testing.assert_allclose(places, expected, atol=MILLIMETRE)


def test_a_line_over_180_degrees_goes_on_past_it(tmp_path):
    line = Track(points=np.array([(-17.0, 179.999), (-17.0, -179.999)]))
    write_geojson(tmp_path / "a.geojson", Mission(tracks={"a": line}, geographic=True))
    _, _, geometry, _ = pyogrio.raw.read(tmp_path / "a.geojson")
    np.testing.assert_allclose(
        shapely.get_coordinates(shapely.from_wkb(geometry[0])), [(179.999, -17), (180.001, -17)]
    )


def test_a_speed_not_known_is_null_in_geojson(tmp_path):
    track = Track(points=degrees(POINTS), speed=np.array([np.nan, 2.0, np.nan, 2.0]))
    write_geojson(tmp_path / "a.geojson", full_mission(tracks={"cna": track}))
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert features[0]["properties"]["speed_mps"] == [None, 2.0, None, 2.0]


# --- CSV and MOOS ------------------------------------------------------------------------------


def test_table_has_places_in_degrees_and_metres_with_times_and_speeds(tmp_path):
    write_csv(tmp_path / "a.csv", full_mission(), origin=ORIGIN)
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["name", "time_s", "lat", "lon", "x_m", "y_m", "speed_mps"]
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    assert set(columns["name"]) == {"cna"}
    number = {key: np.array(columns[key], dtype=float) for key in columns if key != "name"}
    np.testing.assert_allclose(number["time_s"], STAMPED)
    np.testing.assert_allclose(number["speed_mps"], SPEED[[0, 0, 1, 1, 2, 3]])
    latlon = np.stack([number["lat"], number["lon"]], axis=-1)
    np.testing.assert_allclose(metres(latlon), STAMPED_PLACES, atol=MILLIMETRE)
    xy = np.stack([number["x_m"], number["y_m"]], axis=-1)
    np.testing.assert_allclose(xy, STAMPED_PLACES, atol=MILLIMETRE)


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@sum(a1)", '=cmd|"/c calc"!a1'])
def test_no_name_is_a_formula(tmp_path, name):
    write_csv(tmp_path / "a.csv", full_mission(tracks={name: Track(points=degrees(POINTS))}))
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as file:
        cells = {row["name"] for row in csv.DictReader(file)}
    assert cells == {f"'{name}"}


def test_moos_behaviours_hold_the_path_its_speed_and_a_convex_fence(tmp_path):
    write_moos(tmp_path / "a.bhv", full_mission(), origin=ORIGIN, capture=3.0)
    text = (tmp_path / "a.bhv").read_text()
    path, region = moos_behaviours(text)
    assert (path["Behavior"], region["Behavior"]) == ("BHV_Waypoint", "BHV_OpRegion")
    np.testing.assert_allclose(moos_points(path["points"]), POINTS, atol=6e-3)
    np.testing.assert_allclose(moos_points(region["polygon"]), FENCE, atol=6e-3)
    assert float(path["capture_radius"]) == 3.0
    length = 100.0 + 60.0 + 120.0 + 54.5
    assert float(path["speed"]) == pytest.approx(length / 249.6, rel=1e-3)
    assert "LatOrigin = 47.62900000, LongOrigin = -122.33700000" in text
    off = max(abs(along * 249.6 / length - t) for along, t in ((100, 50), (160, 80), (280, 206)))
    assert f"ahead or behind by up to {off:.1f} s" in text
    assert "not kept by a behaviour: keep-out-1, polygon" in text
    assert "keep-out-2, circle 75.00,30.00 of 12.5 m" in text


def test_a_fence_that_is_not_convex_is_no_operation_region(tmp_path):
    dented = np.array([(-60.0, -40.0), (150.0, -40.0), (150.0, 90.0), (50.0, 0.0), (-60.0, 90.0)])
    write_moos(tmp_path / "a.bhv", full_mission(geofences=(Area(points=degrees(dented)),)))
    text = (tmp_path / "a.bhv").read_text()
    assert "BHV_OpRegion" not in text
    assert "not kept by a behaviour: geofence, polygon" in text


def test_a_local_mission_needs_no_origin_in_moos(tmp_path):
    write_moos(tmp_path / "a.bhv", to_local(full_mission(), ORIGIN))
    (path, _) = moos_behaviours((tmp_path / "a.bhv").read_text())
    np.testing.assert_allclose(moos_points(path["points"]), POINTS, atol=6e-3)


# --- all of them -------------------------------------------------------------------------------


@every_writer
def test_the_same_mission_gives_the_same_bytes(tmp_path, suffix):
    WRITERS[suffix](tmp_path / "a", full_mission())
    WRITERS[suffix](tmp_path / "b", full_mission())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert b"\r" not in (tmp_path / "a").read_bytes()


@every_writer
def test_writers_refuse_what_their_format_cannot_hold(tmp_path, suffix):
    local = to_local(full_mission(), ORIGIN)
    if suffix != ".bhv":
        with pytest.raises(ValueError, match="got local tracks: convert them"):
            WRITERS[suffix](tmp_path / "a", local)
    if suffix in (".waypoints", ".plan", ".bhv"):
        two = full_mission(tracks=dict.fromkeys("ab", full_mission().tracks["cna"]))
        with pytest.raises(ValueError, match="holds one track, got 2: write one at a time"):
            WRITERS[suffix](tmp_path / "a", two)
    assert not list(tmp_path.iterdir())


def test_to_geographic_undoes_to_local():
    mission = full_mission()
    back = to_geographic(to_local(mission, ORIGIN), ORIGIN)
    parts = [mission.tracks["cna"], *mission.geofences, *mission.keep_outs]
    again = [back.tracks["cna"], *back.geofences, *back.keep_outs]
    for part, other in zip(parts, again, strict=True):
        np.testing.assert_allclose(part.points, other.points, rtol=0, atol=1e-11)
    assert back.geographic
    assert to_geographic(mission, (0.0, 0.0)) is mission


# --- files -------------------------------------------------------------------------------------


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.txt"
    write_atomically(path, "one\r\n")
    with (
        open(path, "rb") as earlier
    ):  # a reader who came before keeps what it opened: the file was replaced, not overwritten
        write_atomically(path, b"two\n")
        assert earlier.read() == b"one\r\n"
    assert path.read_bytes() == b"two\n"

    def full():
        yield "th"
        assert len(list(tmp_path.iterdir())) == 2  # the file, and the part of the new one
        raise OSError(28, os.strerror(28))

    with pytest.raises(
        ObsplanError,
        match=r"a.txt cannot be written \(No space left on device\): choose another folder",
    ):
        write_atomically(path, full())
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_bytes() == b"two\n"


def test_a_folder_that_is_not_there_or_is_a_file_is_our_error(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in ("nowhere", "file"):
        with pytest.raises(ObsplanError, match="cannot be written"):
            write_atomically(tmp_path / folder / "a.txt", "x")
