"""Claims about tables of points that are read."""

import csv
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from mission_files import (
    LAWN,
    LAWN_LATLON,
    ORIGIN,
    TRACK,
    check_lawn,
    read,
    write,
)
from pymap3d.vincenty import vdist
from table_files import (
    BLANKED,
    EAST,
    LAWN_WKT,
    LETTERED,
    LONLAT,
    WITH_UNITS,
    comma,
    rows_with,
    table,
)

from obsplan.missions import read_areas, to_local
from obsplan.missions.tables.angles import read_angle
from obsplan.types import ObsplanError

# --- coordinates ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [
        table("lat,lon"),
        table("LATITUDE , Longitude"),
        table("Latitude [degrees_north],Longitude (decimal degrees)"),
        table(WITH_UNITS.strip(), end="\r\n"),
        table("lon;lat", LONLAT, ";"),
        table("nr;lat;lon", [(i, comma(a), comma(b)) for i, (a, b) in enumerate(LAWN_LATLON)], ";"),
        table("lat\tlng", delimiter="\t"),
        table("lat|lon", delimiter="|"),
        table("lat   lon", delimiter="    "),
        table("lat,lon", [(f'"{comma(a)}"', f'"{comma(b)}"') for a, b in LAWN_LATLON]),
        table("sep=;\nlat;lon", delimiter=";"),
        table("# survey of May\n// in WGS 84\nlat,lon"),
        table("# lat, lon"),
        table("Survey 7 of May\nvessel; Gunnerus\nlat,lon"),
        table("lat,lon,name", rows_with([f"WP{i}" for i in range(6)])),
        table("lat,lon", LETTERED),
        table("lat,lon", BLANKED),
        table("lat,ns,lon,ew", [(a, "N", b, "E") for a, b in LAWN_LATLON]),
        table("lat,N/S,lon,E/W", [(a, "n", b, "East") for a, b in LAWN_LATLON]),
        table(
            "lat_deg;lat_min;lon_deg;lon_min",
            [(63, comma((a - 63) * 60), 10, comma((b - 10) * 60)) for a, b in LAWN_LATLON],
            ";",
        ),
        table(None),
        table(None, LETTERED),
        table(None, [row[::-1] for row in LETTERED]),
        table(None, [(comma(a), comma(b)) for a, b in LAWN_LATLON], ";"),
        table(None, [(comma(a), comma(b)) for a, b in LAWN_LATLON], " "),
        table(None, [(i, f"WP{i}", a, b, -5) for i, (a, b) in enumerate(LAWN_LATLON)]),
        table("lat,lon").encode("utf-16"),
        table("WKT", [(f'"{LAWN_WKT}"',)]),
        table("id\tgeometry", [(1, f"SRID=4326;{LAWN_WKT}")], "\t"),
        table("wkt_geom\tname", [(f"Point ({b} {a})", f"WP{a} {b}") for a, b in LAWN_LATLON], "\t"),
    ],
)
def test_a_table_of_degrees_is_read_however_people_write_it(tmp_path, content):
    mission = read(tmp_path, "a.csv", content)
    assert mission.geographic
    check_lawn(mission, "a")


@pytest.mark.parametrize(
    "content",
    [
        table("x,y", LAWN),
        table("East,North", LAWN),
        table("x_m,y_m", LAWN),
        table("east [m],north [m]", LAWN),
        table("Northing,Easting", [(y, x) for x, y in LAWN]),
        table("E;N", [(comma(x), comma(y)) for x, y in LAWN], ";"),
        table("x (km),y (km)", [(x / 1000, y / 1000) for x, y in LAWN]),
        table("x (ft),y (ft)", [(x / 0.3048, y / 0.3048) for x, y in LAWN]),
        table(None, LAWN),
        table(None, LAWN, " "),
        table("wkt", [(f'"{shapely.LineString(LAWN).wkt}"',)]),
    ],
)
def test_a_table_of_metres_is_local(tmp_path, content):
    mission = read(tmp_path, "a.csv", content)
    assert not mission.geographic
    assert mission.origin is None
    np.testing.assert_allclose(to_local(mission, ORIGIN).tracks["a"].points, LAWN, atol=1e-9)


def test_a_tab_separated_file_is_a_table(tmp_path):
    check_lawn(read(tmp_path, "a.tsv", table("lat\tlon", delimiter="\t")), "a")


def test_degrees_win_over_metres_in_one_table(tmp_path):
    content = table("x,y,lat,lon", [(1, 2, *place) for place in LAWN_LATLON])
    check_lawn(read(tmp_path, "a.csv", content), "a")


@pytest.mark.parametrize(
    ("first", "rows", "said"),
    [
        ("lat", LAWN_LATLON, "columns 1 and 2 are read as lat and lon [degrees]"),
        (
            "lon",
            [(lon, lat) for lat, lon in EAST],
            "columns 1 and 2 are read as lon and lat [degrees]",
        ),
        ("east", LAWN, "columns 1 and 2 are read as east and north [m]"),
    ],
)
def test_how_a_table_without_a_heading_is_read_is_said(tmp_path, first, rows, said):
    mission = read(tmp_path, "a.csv", table(None, rows))
    assert mission.remarks == (f"no heading: {said}",)
    expected = {"lat": LAWN_LATLON, "lon": EAST, "east": LAWN}[first]
    np.testing.assert_allclose(mission.tracks["a"].points, expected)


def test_further_columns_of_a_table_without_a_heading_are_said(tmp_path):
    rows = [(i, *place, -5) for i, place in enumerate(LAWN_LATLON)]
    mission = read(tmp_path, "a.csv", table(None, rows))
    check_lawn(mission, "a")
    assert mission.remarks == (
        "no heading: columns 2 and 3 are read as lat and lon [degrees]",
        '2 columns ("column 1" and "column 4") passed over',
    )


@given(
    angle=st.floats(0, 89.99),
    letter=st.sampled_from("NS"),
    form=st.sampled_from(
        [
            "{d}°{m}'{s:.4f}\"{h}",
            "{h} {d} {m} {s:.4f}",
            "{d}:{m}:{s:.4f}{h}",
            "{d}d{m}m{s:.4f}s{h}",
            "{d}º {m}′ {s:.4f}″ {h}",
        ]
    ),
)
def test_degrees_minutes_and_seconds_are_what_they_were_written_from(angle, letter, form):
    d, rest = divmod(angle, 1)
    m, s = divmod(rest * 60, 1)
    text = form.format(d=int(d), m=int(m), s=min(s * 60, 59.9999), h=letter)
    value, read_letter = read_angle(text, "here")
    assert read_letter == letter
    expected = angle if letter == "N" else -angle
    np.testing.assert_allclose(value, expected, rtol=0, atol=2e-4 / 3600)


@pytest.mark.parametrize(
    "text",
    [
        "63 70 N",
        "63.5 26.4",
        "63 26.5 10",
        "-63 26 S",
        "N 63 26 N",
        "6326.4N",
        "63 26 24 10",
        "5W3",
        "10 20 E E",
        "°",
        "1_0°",
    ],
)
def test_what_is_no_angle_is_refused(text):
    with pytest.raises(
        ObsplanError, match=r"^here (is no angle that can be|must be a number or degrees)"
    ):
        read_angle(text, "here")


def test_seconds_marked_by_s_are_not_south():
    assert read_angle("63d26m24s", "here") == (pytest.approx(63.44), "")


# --- names, depths, speeds, times ---------------------------------------------------------------------


def test_a_table_tells_tracks_apart_by_name_though_their_rows_mingle(tmp_path):
    mission = read(
        tmp_path,
        "a.csv",
        'name,x,y\nalpha,0,0\n"beta, second",5,5\nalpha,9,0\n"beta, second",6,5\n',
    )
    assert list(mission.tracks) == ["alpha", "beta, second"]
    np.testing.assert_array_equal(mission.tracks["alpha"].points, [[0, 0], [9, 0]])
    np.testing.assert_array_equal(mission.tracks["beta, second"].points, [[5, 5], [6, 5]])


@pytest.mark.parametrize("heading", ["track", "Line", "leg", "vehicle", "Route"])
def test_names_are_the_waypoints_beside_a_column_of_tracks_or_where_most_are_alone(
    tmp_path, heading
):
    names = [f"WP{i}" for i in range(6)]
    lines = ["a", "a", "a", "b", "b", "b"]
    mission = read(tmp_path, "c.csv", table(f"lat,lon,name,{heading}", rows_with(names, lines)))
    assert [len(track.points) for track in mission.tracks.values()] == [3, 3]
    assert mission.remarks == ('1 column ("name") passed over',)
    legs = table(f"lat,lon,{heading}", rows_with(range(6)))
    assert list(read(tmp_path, "c.csv", legs).tracks) == ["c"]
    loop = table("lat,lon,name", [*rows_with(names), (*LAWN_LATLON[0], "WP0")])
    assert list(read(tmp_path, "c.csv", loop).tracks) == ["c"]


def test_depths_speeds_holds_and_times_are_read_in_their_units(tmp_path):
    heading = "lat,lon,depth (ft),speed_kn,hold_min,time_s,crew"
    columns = [[10] * 6, [2] * 6, [0, 1, 0, 0, 0, 0], range(0, 3000, 500), ["x"] * 6]
    mission = read(tmp_path, "a.csv", table(heading, rows_with(*columns)))
    track = mission.tracks["a"]
    np.testing.assert_allclose(track.altitude, [-3.048] * 6)
    np.testing.assert_allclose(track.speed, [2 * 1852 / 3600] * 5)
    np.testing.assert_allclose(track.hold, [0, 60, 0, 0, 0, 0])
    np.testing.assert_allclose(track.time, np.arange(6) * 500.0)
    assert mission.remarks == ('1 column ("crew") passed over',)


@pytest.mark.parametrize(
    ("heading", "start"), [("time (s)", 100.0), ("timestamp", 1.7e9), ("Time (UTC)", "iso")]
)
def test_times_of_a_table_give_the_speed_on_each_leg(tmp_path, heading, start):
    seconds = [60 * i for i in range(6)]
    times = [
        f"2024-05-01 12:0{i}:00" if start == "iso" else start + s for i, s in enumerate(seconds)
    ]
    track = read(tmp_path, "a.csv", table(f"lat,lon,{heading}", rows_with(times))).tracks["a"]
    np.testing.assert_array_equal(track.time, seconds)
    lengths = [vdist(*a, *b)[0] for a, b in pairwise(LAWN_LATLON)]
    np.testing.assert_allclose(track.speed, np.array(lengths) / 60, rtol=1e-5)


def test_altitude_is_upwards_and_a_column_that_cannot_be_read_is_passed_over(tmp_path):
    columns = [[-4.5] * 6, ["slow"] * 6, [-1] * 6, [120000, 120500] * 3]
    mission = read(
        tmp_path, "a.csv", table("lat,lon,Altitude,speed,hold,time_utc", rows_with(*columns))
    )
    np.testing.assert_array_equal(mission.tracks["a"].altitude, [-4.5] * 6)
    assert mission.tracks["a"].speed is None
    assert mission.remarks == (
        '2 columns ("speed" and "hold") with values that cannot be read passed over',
        '1 column ("time_utc") with values that cannot be read passed over: write ISO 8601, or seconds under time_s',
    )


def test_rows_without_coordinates_and_lines_before_the_heading_are_counted(tmp_path):
    content = "Survey 7\nof May\n" + table(
        "name,lat,lon", [("end", "", ""), *[("a", *p) for p in LAWN_LATLON]]
    )
    mission = read(tmp_path, "a.csv", content)
    check_lawn(mission, "a")
    assert mission.remarks == (
        "lines before the heading, 2 of them, passed over",
        "1 row without coordinates passed over",
    )


def test_windows_letters_are_read_and_said(tmp_path):
    content = table(
        "name,lat,lon", [("Trondheimsfjorden, sør".replace(",", ""), *p) for p in LAWN_LATLON]
    )
    mission = read(tmp_path, "a.csv", content.encode("cp1252"))
    check_lawn(mission, "Trondheimsfjorden sør")
    assert mission.remarks == (
        "the file is not UTF-8: its letters are read as Windows text (cp1252)",
    )


@pytest.mark.slow
def test_geometries_in_wkt_are_tracks_and_limits_by_their_names(tmp_path):
    square = shapely.box(10.4, 63.44, 10.402, 63.441)
    holed = square.difference(shapely.box(10.4005, 63.4402, 10.401, 63.4405))
    long = shapely.LineString([(10.4 + i * 1e-7, 63.44, -3) for i in range(9000)])  # over 128 KiB
    rows = [
        ("a", shapely.MultiLineString([LONLAT[:3], LONLAT[3:]]).wkt),
        ("long", long.wkt),
        ("wreck", square.wkt),
        ("fence", holed.wkt),
        ("meadow", square.wkt),
        ("none", "LINESTRING EMPTY"),
        ("all", shapely.GeometryCollection([square, shapely.MultiPoint(LONLAT)]).wkt),
    ]
    mission = read(tmp_path, "a.csv", table("name;WKT", rows, ";"))
    assert list(mission.tracks) == ["a", "a-2", "long"]
    np.testing.assert_array_equal(mission.tracks["a-2"].points, LAWN_LATLON[3:])
    np.testing.assert_array_equal(mission.tracks["long"].altitude, [-3.0] * 9000)
    assert (len(mission.keep_outs), len(mission.geofences), len(mission.areas)) == (2, 1, 2)
    assert mission.remarks == (
        '1 empty shape ("none") passed over',
        '1 multipoint ("all") passed over: only lines are tracks',
        '1 geofence ("fence") with holes: the holes are keep-outs',
        '2 polygons ("meadow" and "all") passed over: name it "keep-out ..." or "geofence ..." to make it a limit',
    )
    counts = {
        role: len(read_areas(tmp_path / "a.csv", role)[0]) for role in ("keep-out", "geofence")
    }
    assert counts == {"keep-out": 4, "geofence": 1}


def test_places_are_those_that_a_plain_reader_of_csv_reads(tmp_path):
    path = write(tmp_path, "a.csv", table("lat,lon", TRACK))
    with path.open() as file:
        expected = [[float(row["lat"]), float(row["lon"])] for row in csv.DictReader(file)]
    np.testing.assert_array_equal(
        read(tmp_path, "a.csv", path.read_bytes()).tracks["a"].points, expected
    )
