"""Claims about GPX, KML and KMZ files that are read."""

import io
import zipfile

import numpy as np
import pyogrio.raw
import pytest
import shapely
from mission_files import (
    LAWN_LATLON,
    check_lawn,
    check_one_sentence,
    check_refused,
    check_survives_damage,
    read,
    write,
)
from pymap3d.vincenty import vdist

from obsplan.missions import findings, markup, read_mission
from obsplan.types import ObsplanError

GPX = '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">{}</gpx>'
KML = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
    'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>{}</Document></kml>'
)


def points(tag, places=LAWN_LATLON, inside=""):
    """GPX points at places, with the same content each, or one of its own."""
    contents = [inside] * len(places) if isinstance(inside, str) else inside
    return "".join(
        f'<{tag} lat="{lat}" lon="{lon}">{content}</{tag}>'
        for (lat, lon), content in zip(places, contents, strict=True)
    )


def route(name="survey", **options):
    """A GPX route."""
    return f"<rte><name>{name}</name>{points('rtept', **options)}</rte>"


def placemark(geometry, name="survey", inside=""):
    """A KML placemark."""
    return f"<Placemark><name>{name}</name>{inside}{geometry}</Placemark>"


def coordinates(places=LAWN_LATLON, end=""):
    """KML coordinates of places."""
    listed = " ".join(f"{lon},{lat}{end}" for lat, lon in places)
    return f"<coordinates>{listed}</coordinates>"


LINE = f"<LineString>{coordinates()}</LineString>"
SQUARE = [(63.44, 10.4), (63.44, 10.402), (63.441, 10.402), (63.441, 10.4), (63.44, 10.4)]
RING = f"<LinearRing>{coordinates(SQUARE)}</LinearRing>"
POLYGON = f"<Polygon><outerBoundaryIs>{RING}</outerBoundaryIs></Polygon>"


def archive(*files):
    """A zip archive of (name, content)."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as written:
        for name, text in files:
            written.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)
    return content.getvalue()


def without_namespaces(text):
    """XML as scripts write it: no namespaces at all."""
    return text.split(" xmlns")[0] + text[text.index(">", text.index(" xmlns")) :].replace(
        "gx:", ""
    )


# --- GPX ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [
        "\n  " + GPX.format(route()),
        GPX.format(route(inside="<name>WP</name><ele/><sym>flag</sym>")),
        without_namespaces(GPX.format(route())),
        GPX.format(route()).replace("GPX/1/1", "GPX/1/0").replace('"1.1"', '"1.0"'),
        GPX.format(route()).replace("UTF-8", "UTF-16").encode("utf-16"),
        GPX.format(route()).replace("UTF-8", "windows-1252").encode("cp1252"),
        GPX.format(f"<trk><name> survey\n</name><trkseg>{points('trkpt')}</trkseg></trk>"),
        GPX.format(
            f"<trk><name>survey</name><trkseg>{points('trkpt', LAWN_LATLON[:3])}</trkseg><trkseg/>"
            f"<trkseg>{points('trkpt', LAWN_LATLON[3:])}</trkseg></trk>"
        ),
        GPX.format(route())
        .replace("<", "<g:")
        .replace("<g:/", "</g:")
        .replace("<g:?", "<?")
        .replace("xmlns=", "xmlns:g="),
    ],
)
def test_routes_and_tracks_of_gpx_are_tracks(tmp_path, content):
    check_lawn(read(tmp_path, "a.gpx", content), "survey")


def test_segments_are_joined_and_waypoints_beside_a_route_passed_over_and_both_are_said(tmp_path):
    segments = "".join(
        f"<trkseg>{points('trkpt', LAWN_LATLON[i : i + 3])}</trkseg>" for i in (0, 3)
    )
    track = f"<trk><name>t</name>{segments}</trk>"
    waypoints = points("wpt", LAWN_LATLON[:2], "<name>mark</name>")
    mission = read(tmp_path, "a.gpx", GPX.format(waypoints + track))
    check_lawn(mission, "t")
    assert mission.remarks == (
        '1 track ("t") of several segments: joined in order by straight legs',
        '2 waypoints ("mark" and "mark") passed over: routes and tracks are lines',
    )


def test_waypoints_alone_are_a_track_in_their_order_and_that_is_said(tmp_path):
    mission = read(tmp_path, "a.gpx", GPX.format(points("wpt")))
    check_lawn(mission, "a")
    assert mission.remarks == (
        "no route and no track: the 6 waypoints are joined in the order of the file",
    )


def test_elevations_and_times_of_gpx_give_altitudes_speeds_and_holds(tmp_path):
    places = [LAWN_LATLON[0], LAWN_LATLON[1], LAWN_LATLON[1], LAWN_LATLON[2]]
    times = ["12:00:00Z", "12:02:00Z", "12:02:30.5Z", "14:03:10.5+02:00"]
    inside = [f"<ele>-7.5</ele><time>2024-05-01T{time}</time>" for time in times]
    content = GPX.format(f"<trk><trkseg>{points('trkpt', places, inside)}</trkseg></trk>")
    track = read(tmp_path, "a.gpx", content).tracks["a"]
    np.testing.assert_array_equal(track.altitude, [-7.5] * 3)
    np.testing.assert_allclose(track.time, [0, 120, 190.5])
    np.testing.assert_allclose(track.hold, [0, 30.5, 0])
    lengths = [vdist(*LAWN_LATLON[i], *LAWN_LATLON[i + 1])[0] for i in (0, 1)]
    np.testing.assert_allclose(track.speed, [lengths[0] / 120, lengths[1] / 40], rtol=1e-6)


@pytest.mark.parametrize(
    ("time", "remark"),
    [
        ("yesterday", '1 track ("survey") with times that are not ISO 8601: times passed over'),
        (
            "2024-05-01T12:00:00Z",
            '1 track ("survey") with legs along which the times do not run on: no speed there',
        ),
    ],
)
def test_times_that_tell_no_speed_are_said(tmp_path, time, remark):
    mission = read(tmp_path, "a.gpx", GPX.format(route(inside=f"<time>{time}</time>")))
    check_lawn(mission, "survey")
    assert mission.tracks["survey"].speed is None
    assert mission.remarks == (remark,)


def test_times_and_speed_of_an_opencpn_route_are_not_taken_for_a_plan(tmp_path):
    speed = "<extensions><o:planned_speed>6.00</o:planned_speed></extensions>"
    inside = [f"<time>2024-05-01T12:0{i}:00Z</time>" for i in range(6)]
    content = GPX.format(route(inside=inside).replace("<rtept", f"{speed}<rtept", 1))
    content = content.replace(" xmlns=", ' xmlns:o="http://www.opencpn.org" xmlns=')
    mission = read(tmp_path, "a.gpx", content)
    check_lawn(mission, "survey")
    assert mission.tracks["survey"].speed is None
    assert mission.remarks == (
        '1 route ("survey") drawn in OpenCPN, whose times tell when its points were drawn: times passed over',
        '1 route ("survey") with a planned speed of OpenCPN, often its default of 6 knots: speed passed over',
    )


# --- KML and KMZ ------------------------------------------------------------------------------------

TRACK = "<gx:Track>{}</gx:Track>"
COORDS = [f"<gx:coord>{lon} {lat} -5</gx:coord>" for lat, lon in LAWN_LATLON]
WHENS = [f"<when>2024-05-01T12:0{i}:00Z</when>" for i in range(6)]


@pytest.mark.parametrize(
    "content",
    [
        KML.format(placemark(LINE)),
        KML.format(f"<Folder><name>f</name><Folder>{placemark(LINE)}</Folder></Folder>"),
        KML.format(placemark(f"<MultiGeometry>{LINE}</MultiGeometry>")),
        KML.format(placemark(TRACK.format("".join(COORDS)))),
        KML.format(
            placemark(
                f"<gx:MultiTrack>{TRACK.format(''.join(COORDS[:3]))}{TRACK.format(''.join(COORDS[3:]))}</gx:MultiTrack>"
            )
        ),
        KML.format(
            placemark(f"<LineString>{coordinates(end=', 0')}</LineString>".replace(",", " , "))
        ),
        without_namespaces(KML.format(placemark(LINE))),
        without_namespaces(KML.format(placemark(TRACK.format("".join(COORDS))))),
        KML.format(placemark(LINE)).replace("www.opengis.net", "earth.google.com"),
        placemark(LINE),
    ],
)
def test_lines_and_tracks_of_kml_are_tracks_whatever_their_folders_and_namespaces(
    tmp_path, content
):
    check_lawn(read(tmp_path, "a.kml", content), "survey")
    packed = archive(("files/icon.png", b"\x89PNG"), ("doc.kml", content))
    check_lawn(read(tmp_path, "a.kmz", packed), "survey")


def test_lines_of_a_multigeometry_are_tracks_each_and_parts_of_a_multitrack_one(tmp_path):
    lines = placemark(f"<MultiGeometry>{LINE}<MultiGeometry>{LINE}</MultiGeometry></MultiGeometry>")
    assert list(read(tmp_path, "a.kml", KML.format(lines)).tracks) == ["survey", "survey-2"]
    parts = TRACK.format("".join(COORDS[:3])) + TRACK.format("".join(COORDS[3:]))
    mission = read(
        tmp_path, "a.kml", KML.format(placemark(f"<gx:MultiTrack>{parts}</gx:MultiTrack>"))
    )
    assert mission.remarks == (
        '1 track ("survey") of several parts: joined in order by straight legs',
    )


def test_times_of_a_gx_track_give_speeds_and_its_heights_altitudes(tmp_path):
    content = KML.format(placemark(TRACK.format("".join(WHENS + COORDS))))
    track = read(tmp_path, "a.kml", content).tracks["survey"]
    np.testing.assert_array_equal(track.altitude, [-5] * 6)
    np.testing.assert_array_equal(track.time, np.arange(6) * 60.0)
    length = vdist(*LAWN_LATLON[0], *LAWN_LATLON[1])[0]
    np.testing.assert_allclose(track.speed[0], length / 60, rtol=1e-6)


@pytest.mark.parametrize(
    ("mode", "end", "altitude", "remarks"),
    [
        ("", ",0", None, ()),
        ("<altitudeMode>absolute</altitudeMode>", ",-12.5", [-12.5] * 6, ()),
        (
            "<gx:altitudeMode>relativeToSeaFloor</gx:altitudeMode>",
            ",3",
            None,
            ('1 track ("survey") with heights above the sea floor: heights passed over',),
        ),
    ],
)
def test_heights_of_kml_are_altitudes_unless_none_was_drawn_or_the_sea_floor_is_below(
    tmp_path, mode, end, altitude, remarks
):
    content = KML.format(placemark(f"<LineString>{mode}{coordinates(end=end)}</LineString>"))
    mission = read(tmp_path, "a.kml", content)
    np.testing.assert_array_equal(mission.tracks["survey"].altitude, altitude)
    assert mission.remarks == remarks


def test_polygons_of_kml_are_limits_by_name_data_description_or_folder(tmp_path):
    data = '<ExtendedData><Data name="kind"><value>geofence</value></Data></ExtendedData>'
    simple = '<ExtendedData><SchemaData><SimpleData name="Type">obstacle</SimpleData></SchemaData></ExtendedData>'
    hole = f"<innerBoundaryIs>{RING}</innerBoundaryIs></Polygon>"
    content = KML.format(
        placemark(LINE)
        + placemark(POLYGON, "Wreck")
        + placemark(POLYGON.replace("</Polygon>", hole), "a", data)
        + placemark(POLYGON, "b", simple)
        + placemark(POLYGON, "c", "<description>no-go</description>")
        + f"<Folder><name>Keep-outs</name>{placemark(POLYGON, 'd')}</Folder>"
        + placemark(POLYGON, "meadow")
        + placemark("<Point><coordinates>10.4,63.44</coordinates></Point>", "pier")
        + placemark("", "empty")
        + "<NetworkLink><name>chart</name></NetworkLink>"
    )
    mission = read(tmp_path, "a.kml", content)
    assert (len(mission.keep_outs), len(mission.geofences), len(mission.areas)) == (5, 1, 1)
    for area in (*mission.keep_outs, *mission.geofences):
        np.testing.assert_array_equal(area.points, SQUARE[:-1])
    assert mission.remarks == (
        '1 point ("pier") passed over: only lines are tracks',
        '1 placemark ("empty") without geometry passed over',
        '1 link ("chart") passed over: only what the file itself draws is read',
        '1 geofence ("a") with holes: the holes are keep-outs',
        '1 polygon ("meadow") passed over: name it "keep-out ..." or "geofence ..." to make it a limit',
    )


def test_kmz_reads_doc_kml_else_the_first_and_says_which_others_it_holds(tmp_path):
    other = KML.format(placemark(LINE, "other"))
    doc = KML.format(placemark(LINE))
    mission = read(tmp_path, "a.kmz", archive(("b/other.kml", other), ("doc.kml", doc)))
    check_lawn(mission, "survey")
    assert mission.remarks == (
        "1 file (\"b/other.kml\") of the archive passed over beside 'doc.kml'",
    )
    check_lawn(read(tmp_path, "a.kmz", archive(("b/other.kml", other))), "other")


# --- what is refused, and what survives ---------------------------------------------------------------

ENTITY = '<!DOCTYPE gpx [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
EXTERNAL = '<!DOCTYPE gpx [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
DEEP = "<a>" * 100_000


def bad_line(text):
    """A KML file with a line of these coordinates."""
    return KML.format(placemark(f"<LineString><coordinates>{text}</coordinates></LineString>"))


BAD = {
    "cut gpx": ("a.gpx", GPX.format(route())[:-40], r"is not valid XML \(.*line 2.*cut short"),
    "text as gpx": ("a.gpx", "lat,lon\n1,2\n", r"is not valid XML \(syntax error: line 1, column 0"),
    "kml as gpx": ("a.gpx", KML.format(placemark(LINE)), r"not GPX \(its root is <kml>\): rename it to .kml"),
    "gpx as kml": ("a.kml", GPX.format(route()), r"not KML \(its root is <gpx>\): rename it to .gpx"),
    "html as kml": ("a.kml", "<html/>", r"not KML \(its root is <html>\): export it as KML"),
    "entities": ("a.gpx", ENTITY + GPX.format(route("&b;"))[39:], "document type or entities, which are not read"),
    "external entity": ("a.kml", EXTERNAL + "<kml>&a;</kml>", "document type or entities"),
    "unknown entity": ("a.kml", "<kml>&a;</kml>", r"is not valid XML \(undefined entity"),
    "deep": ("a.kml", DEEP, "nested too deeply"),
    "unknown encoding": ("a.gpx", GPX.format(route()).replace("UTF-8", "klingon"), r"not valid XML \(unknown encoding"),
    "no latitude": ("a.gpx", GPX.format(route()).replace(' lat="63.44"', "", 1), r"route 'survey', point 1, attribute lat must .* got ''"),
    "comma": ("a.gpx", GPX.format(route()).replace("63.44\"", "63,44\"", 1), "attribute lat must be a number, got '63,44'"),
    "nan": ("a.gpx", GPX.format(route()).replace("63.44\"", "nan\"", 1), "attribute lat must be a finite number, got nan"),
    "swapped gpx": ("a.gpx", GPX.format('<rte><rtept lat="-122" lon="47"/></rte>'), "point 1, has latitude -122.0 .*look swapped: GPX has"),
    "bad elevation": ("a.gpx", GPX.format(route(inside="<ele>deep</ele>")), "point 1, ele must be a number, got 'deep'"),
    "no line in gpx": ("a.gpx", GPX.format(""), "holds no line to follow: draw"),
    "one waypoint": ("a.gpx", GPX.format(points("wpt", LAWN_LATLON[:1])), "holds no line to follow .*has a single place"),
    "no line in kml": ("a.kml", KML.format(placemark(POLYGON)), r"holds no line to follow \(1 polygon"),
    "text in kml": ("a.kml", bad_line("1,x 3,4"), r"placemark 'survey': coordinates\[0\] must be a number, got 'x'"),
    "one number in kml": ("a.kml", bad_line("1,2 3"), r"coordinates\[1\] must be longitude,latitude or .*, got '3'"),
    "swapped kml": ("a.kml", bad_line("47,-122"), "look swapped: KML has longitude,latitude"),
    "bad coord": ("a.kml", KML.format(placemark(TRACK.format("<gx:coord>1</gx:coord>"))), "gx:coord 1 must be longitude,latitude"),
    "no archive": ("a.kmz", KML.format(placemark(LINE)), r"not a KMZ archive that can be read \(File is not a zip file\)"),
    "no kml": ("a.kmz", archive(("readme.txt", "x")), "holds no .kml file"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_xml_is_refused_in_one_sentence_that_says_where_what_and_how_to_mend(tmp_path, case):
    check_refused(tmp_path, *BAD[case])


def test_more_elements_or_vertices_than_a_mission_has_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(markup, "_MOST", 8)
    check_refused(
        tmp_path, "a.gpx", GPX.format(route()), "has more than 8 elements: export the mission"
    )
    monkeypatch.setattr(markup, "_MOST", 1000)
    monkeypatch.setattr(findings, "MOST_VERTICES", 5)
    check_refused(
        tmp_path, "a.gpx", GPX.format(route()), "route 'survey' has 6 vertices, more than 5"
    )
    check_refused(
        tmp_path, "a.kml", KML.format(placemark(LINE)), "placemark 'survey' has 6 vertices"
    )
    half = points("rtept", LAWN_LATLON[:3])
    check_refused(
        tmp_path, "a.gpx", GPX.format(f"<rte>{half}</rte><rte>{half}</rte>"), "a.gpx has 6 vertices"
    )


def test_files_that_are_or_unpack_too_large_are_refused(tmp_path):
    blank = " " * 51_000_000
    with pytest.raises(ObsplanError, match=r"a.gpx is larger than 50 MB: export the mission alone"):
        read_mission(write(tmp_path, "a.gpx", blank))
    bomb = archive(("doc.kml", blank))
    assert len(bomb) < 100_000
    with pytest.raises(ObsplanError, match=r"a.kmz unpacks to more than 50 MB") as caught:
        read_mission(write(tmp_path, "a.kmz", bomb))
    check_one_sentence(str(caught.value).replace(str(tmp_path), "FOLDER"))


def test_an_encrypted_or_oddly_packed_archive_is_refused(tmp_path):
    packed = bytearray(archive(("doc.kml", KML.format(placemark(LINE)))))
    central = packed.index(b"PK\x01\x02")
    encrypted = packed.copy()
    encrypted[6] |= 1
    encrypted[central + 8] |= 1
    check_refused(
        tmp_path, "a.kmz", bytes(encrypted), "not a KMZ archive that can be read .*encrypted"
    )
    packed[8] = packed[central + 10] = 12  # bzip2
    check_refused(tmp_path, "a.kmz", bytes(packed), "compressed in an uncommon way")


WHOLE_GPX = GPX.format(
    points("wpt", LAWN_LATLON[:2])
    + route("first", inside="<ele>-3</ele>")
    + "<trk><name>second</name><trkseg>"
    + points("trkpt", inside=[f"<time>2024-05-01T12:0{i}:00Z</time>" for i in range(6)])
    + "</trkseg></trk>"
)
WHOLE_KML = KML.format(
    placemark(LINE.replace("63.44,", "63.44,-2"), "first")
    + placemark(f"<MultiGeometry>{LINE}{POLYGON}</MultiGeometry>", "second")
    + placemark(TRACK.format("".join(WHENS + COORDS)), "third")
    + placemark(POLYGON, "Wreck")
)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.gpx", WHOLE_GPX.encode()),
        ("a.kml", WHOLE_KML.encode()),
        ("a.kmz", archive(("doc.kml", WHOLE_KML))),
    ],
)
def test_damaged_xml_gives_a_mission_or_our_error(tmp_path, name, content):
    check_survives_damage(tmp_path, name, content)


def layers(path):
    """Vertices (latitude, longitude) of the lines that GDAL reads, layer by layer."""
    lines = []
    for layer, _ in pyogrio.list_layers(path):
        _, _, shapes, _ = pyogrio.raw.read(path, layer=layer)
        for part in shapely.get_parts(shapely.from_wkb([shape for shape in shapes if shape])):
            lines += [
                shapely.get_coordinates(line)[:, ::-1]
                for line in shapely.get_parts(part)
                if line.geom_type == "LineString"
            ]
    return lines


@pytest.mark.parametrize(("name", "content"), [("a.gpx", WHOLE_GPX), ("a.kml", WHOLE_KML)])
def test_lines_are_those_that_gdal_reads(tmp_path, name, content):
    path = write(tmp_path, name, content)
    expected = layers(path)
    tracks = read_mission(path).tracks
    assert len(expected) == len(tracks)
    for track, line in zip(tracks.values(), expected, strict=True):
        np.testing.assert_array_equal(track.points, line)
