"""Claims about mission files that are read."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from obsplan.missions import READERS, Mission, read_mission, to_local
from obsplan.types import ObsplanError

ORIGIN = (47.629, -122.337)
TRACK = [(47.629, -122.337), (47.631, -122.337), (47.631, -122.336)]
LONLAT = [[lon, lat] for lat, lon in TRACK]


def line(coordinates=LONLAT, **properties):
    """A GeoJSON feature."""
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "LineString", "coordinates": coordinates},
    }


def collection(*features):
    """A GeoJSON feature collection."""
    return {"type": "FeatureCollection", "features": list(features)}


@pytest.fixture
def save(tmp_path):
    """Write text, bytes or JSON under a name; give the path."""

    def write(name, content):
        path = tmp_path / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            path.write_text(
                content if isinstance(content, str) else json.dumps(content),
                encoding="utf-8",
                newline="",
            )
        return path

    return write


def check_one_sentence(message):
    """A message is one line, without a full stop inside."""
    assert "\n" not in message
    assert ". " not in message


# --- what is read ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.geojson", line()["geometry"]),
        ("a.json", line()),
        ("a.GEOJSON", collection(line())),
        ("a.geojson", {"type": "GeometryCollection", "geometries": [line()["geometry"]]}),
        ("a.geojson", collection(line([[*p, -5.0] for p in LONLAT]))),
        ("a.csv", "lat,lon\n" + "".join(f"{lat},{lon}\n" for lat, lon in TRACK)),
        (
            "a.csv",
            "\ufeffLatitude_deg, Longitude (deg)\r\n\r\n , \r\n"
            + "".join(f"{lat}, {lon}\r\n" for lat, lon in TRACK),
        ),
        ("a.csv", "depth;LON;LAT\n" + "".join(f"5;{lon};{lat}\n" for lat, lon in TRACK)),
        ("a.csv", "x\tlat\tlng\n" + "".join(f"5\t{lat}\t{lon}\n" for lat, lon in TRACK)),
    ],
)
def test_every_format_gives_the_same_track_named_after_its_file(save, name, content):
    mission = read_mission(save(name, content))
    assert mission.geographic
    assert list(mission.tracks) == ["a"]
    np.testing.assert_array_equal(mission.tracks["a"].points, TRACK)
    assert mission.origin == ORIGIN


@pytest.mark.parametrize("heading", ["x,y", "East,North", "x_m,y_m", "east [m],north [m]"])
def test_a_table_in_metres_is_local_and_stays_as_it_is(save, heading):
    mission = read_mission(save("a.csv", f"{heading}\n0,0\n10.5,-20\n"))
    assert not mission.geographic
    assert mission.origin is None
    np.testing.assert_array_equal(
        to_local(mission, ORIGIN).tracks["a"].points, [[0, 0], [10.5, -20]]
    )


def test_a_table_tells_tracks_apart_by_name_though_their_rows_mingle(save):
    mission = read_mission(
        save("a.csv", 'name,x,y\nalpha,0,0\n"beta, second",5,5\nalpha,1,0\n"beta, second",6,5\n')
    )
    assert list(mission.tracks) == ["alpha", "beta, second"]
    np.testing.assert_array_equal(mission.tracks["alpha"].points, [[0, 0], [1, 0]])
    np.testing.assert_array_equal(mission.tracks["beta, second"].points, [[5, 5], [6, 5]])


def test_geojson_lines_keep_their_names_and_other_geometries_are_passed_over(save):
    multi = {
        "type": "Feature",
        "properties": {"name": "m"},
        "geometry": {"type": "MultiLineString", "coordinates": [LONLAT, LONLAT[1:]]},
    }
    area = {
        "type": "Feature",
        "properties": None,
        "geometry": {"type": "Polygon", "coordinates": [[*LONLAT, LONLAT[0]]]},
    }
    empty = {"type": "Feature", "properties": {}, "geometry": None}
    tracks = read_mission(
        save(
            "a.geojson",
            collection(area, line(name="alpha"), empty, line(name="alpha"), multi, line()),
        )
    ).tracks
    assert list(tracks) == ["alpha", "alpha-2", "m", "m-2", "a"]
    np.testing.assert_array_equal(tracks["m-2"].points, TRACK[1:])


def test_geojson_that_says_it_is_wgs84_is_read(save):
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    assert read_mission(save("a.geojson", {**collection(line()), "crs": crs})).geographic


def test_an_origin_in_another_country_is_refused(save):
    with pytest.raises(
        ObsplanError,
        match=r'track "a" lies \d+ km from the origin at latitude 60.0, longitude 5.0 degrees: move the origin',
    ):
        to_local(read_mission(save("a.geojson", line())), (60.0, 5.0))


# --- what is refused --------------------------------------------------------------------------------------------------------------

NAN_LINE = '{"type": "LineString", "coordinates": [[-122.3, 47.6], [NaN, 47.7]]}'
BAD = {
    "unknown suffix": (
        "a.kml",
        "x",
        r'unknown suffix ".kml": mission files end in .csv, .geojson, .json, .plan, .txt, .waypoints',
    ),
    "misspelt suffix": ("a.geojsn", "x", r'did you mean ".geojson"\?'),
    "no suffix": ("a", "x", 'unknown suffix ""'),
    "empty file": ("a.plan", "", "is empty"),
    "blank file": ("a.csv", " \r\n\n", "is empty"),
    "binary rubbish": (
        "a.plan",
        b"\x89PNG\r\n\x1a\n\x00\x01",
        r"not UTF-8 text \(byte 0x89 at position 0\): it is not what its extension says",
    ),
    "text as geojson": ("a.geojson", "lat,lon\n1,2\n", r"not valid JSON \(line 1, column 1"),
    "huge number": ("a.geojson", "1" * 5000, "is not JSON that can be read"),
    "deep nesting": ("a.json", "[" * 100_000, "nested too deeply"),
    "array": ("a.plan", "[]", "holds a JSON list where an object is expected"),
    # GeoJSON
    "plan as geojson": (
        "a.json",
        {"fileType": "Plan"},
        r'is not GeoJSON \("type" is None\): rename it to .plan',
    ),
    "other json": ("a.json", {"type": "Topology"}, "is not GeoJSON .*Topology"),
    "no features": (
        "a.geojson",
        {"type": "FeatureCollection"},
        'needs a list "features", got NoneType',
    ),
    "feature not an object": (
        "a.geojson",
        collection(3),
        r"features\[0\] must be a GeoJSON object, got int",
    ),
    "no line": (
        "a.geojson",
        {"type": "Point", "coordinates": [1, 2]},
        "holds no line to follow",
    ),
    "no features inside": ("a.geojson", collection(), "holds no line to follow"),
    "projected": (
        "a.geojson",
        {**line(), "crs": {"properties": {"name": "urn:ogc:def:crs:EPSG::32610"}}},
        r"crs .*32610.* is not WGS 84",
    ),
    "swapped": (
        "a.geojson",
        line([list(p) for p in TRACK]),
        r"coordinates\[0\] has latitude -122.337 .*look swapped: GeoJSON has \[long",
    ),
    "metres": (
        "a.geojson",
        line([[550000, 5275000], [0, 0]]),
        "latitude 5275000.0, beyond 90 degrees: give WGS 84",
    ),
    "nan": ("a.geojson", NAN_LINE, r"coordinates\[1\]\[0\] must be a finite number, got nan"),
    "infinite": (
        "a.geojson",
        line([[10**400, 1], [1, 2]]),
        r"coordinates\[0\]\[0\] must be a finite number, got inf",
    ),
    "text number": (
        "a.geojson",
        collection(line([["1", 2], [3, 4]])),
        r"features\[0\].geometry.coordinates\[0\]\[0\] must be a number, got '1'",
    ),
    "flag number": ("a.geojson", line([[True, 2], [3, 4]]), "must be a number, got True"),
    "flat coordinates": (
        "a.geojson",
        line([1, 2]),
        r"coordinates\[0\] must be \[longitude, latitude\], got 1",
    ),
    "one point": (
        "a.geojson",
        line(LONLAT[:1], name="q"),
        'holds no line to follow .track "q" has a single place',
    ),
    "unprintable name": (
        "a.geojson",
        line(name="a\x00b"),
        r"track name 'a\\x00b' cannot be printed",
    ),
    # CSV
    "no heading": (
        "a.csv",
        "47.6,-122.3\n47.7,-122.3\n",
        'line 1 must name the columns "lat,lon" or "x,y", got \'47.6,-122.3\'',
    ),
    "blank cells": ("a.csv", ",,\n,,\n", "line 1 must name the columns"),
    "half a pair": ("a.csv", "lat,y\n1,2\n", "must name the columns"),
    "heading only": ("a.csv", "lat,lon\n", "has a heading but no points"),
    "short row": ("a.csv", "lat,lon\n1,2\n3\n", "line 3 has too few columns, 1 of the heading's 2"),
    "row without its name": (
        "a.csv",
        "lat,lon,name\n1,2,a\n3,4\n",
        "line 3 has too few columns, 2 of the heading's 3",
    ),
    "not a number": (
        "a.csv",
        "x,y\n1,2\n\n3,north\n",
        "line 4, column 'y', must be a number, got 'north'",
    ),
    "nan in a table": (
        "a.csv",
        "x,y\n1,nan\n",
        "line 2, column 'y', must be a finite number, got nan",
    ),
    "swapped table": (
        "a.csv",
        "lat,lon\n-122.3,47.6\n",
        "line 2 has latitude -122.3 .*look swapped: exchange the headings",
    ),
    "utm": (
        "a.csv",
        "x,y\n550000,5275000\n",
        r"line 2 has \(550000.0, 5275000.0\) m, more than 100 km .*UTM",
    ),
    "identical rows": ("a.csv", "x,y\n1,2\n1,2\n", "holds no line to follow"),
    "overlong cell": (
        "a.csv",
        "x,y\n1," + "2" * 200_000,
        r"line 2 is not CSV \(field larger than field limit",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_in_one_sentence_that_says_where_what_and_how_to_mend(save, case):
    name, content, message = BAD[case]
    path = save(name, content)
    with pytest.raises(ObsplanError, match=message) as caught:
        read_mission(path)
    check_one_sentence(str(caught.value).replace(str(path), "FILE"))
    assert str(path) in str(caught.value)


def test_a_missing_file_a_folder_and_an_impossible_name_are_told_apart(save, tmp_path):
    save("Survey.plan", "{}")
    with pytest.raises(ObsplanError, match=r'does not exist: did you mean "Survey.plan"\?'):
        read_mission(tmp_path / "survay.plan")
    with pytest.raises(ObsplanError, match="does not exist: check the name and the folder"):
        read_mission(tmp_path / "nowhere" / "x.plan")
    (tmp_path / "b.plan").mkdir()
    with pytest.raises(ObsplanError, match=r"b\.plan is a folder: give a mission file inside it"):
        read_mission(tmp_path / "b.plan")
    with pytest.raises(ObsplanError, match=r"cannot be read \(.*null"):
        read_mission(tmp_path / "a\0.plan")


@pytest.mark.parametrize("suffix", READERS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    content=st.one_of(
        st.binary(max_size=200),
        st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")),
        st.text('0123456789.-+einfa,;\t\r\n" ', max_size=60).map(
            lambda text: b"name,lat,lon\n" + text.encode()
        ),
    )
)
def test_any_bytes_give_a_mission_or_our_error(tmp_path, suffix, content):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    try:
        assert isinstance(read_mission(path), Mission)
    except ObsplanError as error:
        check_one_sentence(str(error).replace(str(path), "FILE"))


rubbish = st.recursive(
    st.one_of(
        st.none(), st.booleans(), st.floats(), st.integers(-(10**30), 10**30), st.text(max_size=4)
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.sampled_from(["type", "coordinates", "items", "params"]), inner),
    ),
    max_leaves=8,
)


def replace_somewhere(node, value, draw):
    """Put a value in place of one random part of a JSON document."""
    if not isinstance(node, (dict, list)) or not node or draw(st.integers(0, 5)) == 0:
        return value
    if isinstance(node, dict):
        key = draw(st.sampled_from(sorted(node)))
        return {**node, key: replace_somewhere(node[key], value, draw)}
    i = draw(st.integers(0, len(node) - 1))
    return [*node[:i], replace_somewhere(node[i], value, draw), *node[i + 1 :]]


WHOLE = {
    ".geojson": {
        **collection(line(name="q"), line()),
        "crs": {"properties": {"name": "EPSG:4326"}},
    },
}


@pytest.mark.parametrize("suffix", WHOLE)
@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=300
)
@given(value=rubbish, data=st.data())
def test_a_file_damaged_anywhere_gives_a_mission_or_our_error(tmp_path, suffix, value, data):
    path = tmp_path / f"a{suffix}"
    path.write_text(json.dumps(replace_somewhere(WHOLE[suffix], value, data.draw)))
    try:
        assert isinstance(read_mission(path), Mission)
    except ObsplanError as error:
        check_one_sentence(str(error).replace(str(path), "FILE"))


@pytest.mark.parametrize("suffix", WHOLE)
def test_a_file_cut_anywhere_gives_our_error(save, suffix):
    whole = json.dumps(WHOLE[suffix])
    for end in range(len(whole)):
        with pytest.raises(ObsplanError, match=r"cut short|is empty"):
            read_mission(save(f"a{suffix}", whole[:end]))
