"""Claims about mission files that are read."""

import json
from functools import partial

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mission_files import LONLAT, ORIGIN, TRACK, check_one_sentence, collection, line, write

from obsplan.missions import READERS, Mission, read_mission, to_local
from obsplan.types import ObsplanError


@pytest.fixture
def save(tmp_path):
    """Write text, bytes or JSON under a name; give the path."""

    return partial(write, tmp_path)


GPX = "<gpx><rte>{}</rte></gpx>".format(
    "".join(f'<rtept lat="{lat}" lon="{lon}"/>' for lat, lon in TRACK)
)
KML = "<kml><Placemark><LineString><coordinates>{}</coordinates></LineString></Placemark></kml>".format(
    " ".join(f"{lon},{lat}" for lat, lon in TRACK)
)


# --- what is read ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.geojson", line()["geometry"]),
        ("a.json", line()),
        ("a.GEOJSON", collection(line())),
        ("a.geojson", {"type": "GeometryCollection", "geometries": [line()["geometry"]]}),
        ("a.geojson", collection(line([[*p, -5.0] for p in LONLAT]))),
        ("a.gpx", GPX),
        ("a.kml", KML),
        ("a.KML", KML),
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


def test_an_origin_in_another_country_is_refused(save):
    with pytest.raises(
        ObsplanError,
        match=r'track "a" lies \d+ km from the origin at latitude 60.0, longitude 5.0 degrees: move the origin',
    ):
        to_local(read_mission(save("a.geojson", line())), (60.0, 5.0))


# --- what is refused --------------------------------------------------------------------------------------------------------------

BAD = {
    "unknown suffix": (
        "a.shp",
        "x",
        r'unknown suffix ".shp": .*mission files end in .bhv, .csv, .geojson, .gpx, .json, .kml, .kmz, .moos, .plan, ',
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
    "truncated plan": (
        "a.plan",
        '{"fileType": "Plan", "mission": {"items": [',
        r"not valid JSON \(line 1, column \d+: .*may be cut short",
    ),
    "text as geojson": ("a.geojson", "lat,lon\n1,2\n", r"not valid JSON \(line 1, column 1"),
    "huge number": ("a.geojson", "1" * 5000, "is not JSON that can be read"),
    "deep nesting": ("a.json", "[" * 100_000, "nested too deeply"),
    "array": ("a.plan", "[]", "holds a JSON list where an object is expected"),
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
    save("Survey.plan", {"fileType": "Plan"})
    with pytest.raises(ObsplanError, match=r'does not exist: did you mean "Survey.plan"\?'):
        read_mission(tmp_path / "survay.plan")
    with pytest.raises(ObsplanError, match="does not exist: check the name and the folder"):
        read_mission(tmp_path / "nowhere" / "x.plan")
    (tmp_path / "b.plan").mkdir()
    with pytest.raises(ObsplanError, match=r"b\.plan is a folder: give a mission file inside it"):
        read_mission(tmp_path / "b.plan")
    with pytest.raises(ObsplanError, match=r"cannot be read \(.*null"):
        read_mission(tmp_path / "a\0.plan")


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("suffix", WHOLE)
def test_a_file_cut_anywhere_gives_our_error(save, suffix):
    whole = json.dumps(WHOLE[suffix])
    for end in range(len(whole)):
        with pytest.raises(ObsplanError, match=r"cut short|is empty"):
            read_mission(save(f"a{suffix}", whole[:end]))
