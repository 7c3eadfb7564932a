"""GPX, KML and KMZ files for tests."""

import io
import zipfile

from mission_files import LAWN_LATLON

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


TRACK = "<gx:Track>{}</gx:Track>"
COORDS = [f"<gx:coord>{lon} {lat} -5</gx:coord>" for lat, lon in LAWN_LATLON]
WHENS = [f"<when>2024-05-01T12:0{i}:00Z</when>" for i in range(6)]
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
