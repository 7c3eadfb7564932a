"""Claims about GPX, KML and KMZ files that are refused, and about damaged ones."""

import pytest
from mission_files import (
    LAWN_LATLON,
    check_one_sentence,
    check_refused,
    check_survives_damage,
    write,
)
from xml_files import (
    GPX,
    KML,
    LINE,
    POLYGON,
    TRACK,
    WHOLE_GPX,
    WHOLE_KML,
    archive,
    placemark,
    points,
    route,
)

from obsplan.missions import findings, markup, read_mission
from obsplan.types import ObsplanError

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
    "swapped gpx": ("a.gpx", GPX.format('<rte><rtept lat="-122" lon="47"/></rte>'), "point 1, has latitude -122.0 .*exchange them, GPX"),
    "bad elevation": ("a.gpx", GPX.format(route(inside="<ele>deep</ele>")), "point 1, ele must be a number, got 'deep'"),
    "no line in gpx": ("a.gpx", GPX.format(""), "holds no line to follow: draw"),
    "one waypoint": ("a.gpx", GPX.format(points("wpt", LAWN_LATLON[:1])), "holds no line to follow .*has a single place"),
    "no line in kml": ("a.kml", KML.format(placemark(POLYGON)), r"holds no line to follow \(1 polygon"),
    "text in kml": ("a.kml", bad_line("1,x 3,4"), r"placemark 'survey': coordinates\[0\] must be a number, got 'x'"),
    "one number in kml": ("a.kml", bad_line("1,2 3"), r"coordinates\[1\] must be longitude,latitude or .*, got '3'"),
    "swapped kml": ("a.kml", bad_line("47,-122"), "look swapped: exchange them, KML has longitude,latitude"),
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
