"""Claims about GPX, KML and KMZ files that are read."""

import numpy as np
import pyogrio.raw
import pytest
import shapely
from mission_files import (
    LAWN_LATLON,
    check_lawn,
    read,
    write,
)
from pymap3d.vincenty import vdist
from xml_files import (
    COORDS,
    GPX,
    KML,
    LINE,
    POLYGON,
    RING,
    SQUARE,
    TRACK,
    WHENS,
    WHOLE_GPX,
    WHOLE_KML,
    archive,
    coordinates,
    placemark,
    points,
    route,
    without_namespaces,
)

from obsplan.missions import read_mission

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


# --- against GDAL -----------------------------------------------------------------------------------


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
