"""KML, and KMZ, its zip archive: every line is a track, and every polygon that is named so a limit.

Read over defusedxml: fastkml loses files of older or no namespace, and lines whose heights are
not all there, in silence.
"""

import io
import math
import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from obsplan.missions.findings import Findings, Outline, Vertex, check_count, join_at_180, ring_area
from obsplan.missions.markup import parse_xml, text_of
from obsplan.missions.mission import Area, Mission, check_latlon, read_number
from obsplan.missions.source import MOST_BYTES, read_bytes
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_ORDER = "exchange them, KML has longitude,latitude"
_CONTAINERS = ("kml", "Document", "Folder")
_GEOMETRIES = (
    "LineString",
    "LinearRing",
    "Track",
    "MultiTrack",
    "Polygon",
    "Point",
    "Model",
    "MultiGeometry",
)
_NOT_LINES = {
    "NetworkLink": "link",
    "GroundOverlay": "overlay",
    "PhotoOverlay": "overlay",
    "ScreenOverlay": "overlay",
    "Tour": "tour",
}
_FROM_SEA_FLOOR = ("relativeToSeaFloor", "clampToSeaFloor")
_NOT_AN_ARCHIVE = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    NotImplementedError,  # a compression or a version that zipfile does not know
    RuntimeError,  # encrypted
    ValueError,  # offsets that cannot be
)


def read_kml(path: Path | str) -> Mission:
    """Read the lines and tracks of a KML file, named by their placemarks, and its limits.

    Limits are the polygons that are named so.

    A gx:MultiTrack is one track, its parts joined in order; a MultiGeometry has a track for each
    line. What a polygon is for may stand in its name, its data `kind` or `type`, its description
    or its folder's name.

    Raises
    ------
    ObsplanError
        Not KML, or a coordinate that is not one; names the place.
    """
    path = Path(path)
    return _read(read_bytes(path), Findings(path=path))


def read_kmz(path: Path | str) -> Mission:
    """Read the main file of a KMZ archive as `read_kml` does: doc.kml, else the first KML file.

    Raises
    ------
    ObsplanError
        As `read_kml`; no zip archive, no KML inside, or one too large.
    """
    found = Findings(path=Path(path))
    archive = io.BytesIO(read_bytes(found.path))
    try:
        content = _main_file(archive, found)
    except _NOT_AN_ARCHIVE as error:
        raise ObsplanError(
            f"{path} is not a KMZ archive that can be read ({error}): export it again"
        ) from error
    return _read(content, found)


def _main_file(file: io.BytesIO, found: Findings) -> bytes:
    """Content of the main file of an archive, read within bounds."""
    with zipfile.ZipFile(file) as archive:
        names = [info.filename for info in archive.infolist()]
        inside = [name for name in names if name.lower().endswith(".kml")]
        if not inside:
            raise ObsplanError(f"{found.path} holds no .kml file: export it again")
        main = "doc.kml" if "doc.kml" in inside else inside[0]
        if archive.getinfo(main).compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ObsplanError(f"{found.path} is compressed in an uncommon way: export it again")
        with archive.open(main) as opened:
            content = opened.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ObsplanError(
            f"{found.path} unpacks to more than {MOST_BYTES / 1e6:.0f} MB: export the mission alone"
        )
    for name in inside:
        if name != main:
            found.passed_over("file", f"of the archive passed over beside {main!r}", name)
    return content


def _read(content: bytes, found: Findings) -> Mission:
    """Read the content of a KML file."""
    root = parse_xml(content, found.path)
    if root.tag not in (*_CONTAINERS, "Placemark"):
        hint = "rename it to .gpx" if root.tag == "gpx" else "export it as KML"
        raise ObsplanError(f"{found.path} is not KML (its root is <{root.tag[:40]}>): {hint}")
    for placemark, folder in _placemarks(root, "", found):
        _read_placemark(placemark, folder, found)
    return found.mission()


def _placemarks(node: "Element", folder: str, found: Findings) -> Iterator[tuple["Element", str]]:
    """Walk documents and folders down to the placemarks, each with the name of its folder."""
    if node.tag == "Placemark":
        yield node, folder
    elif node.tag in _CONTAINERS:
        if node.tag == "Folder":
            folder = text_of(node, "name") or folder
        for child in node:
            yield from _placemarks(child, folder, found)
    elif node.tag in _NOT_LINES:
        why = "passed over: only what the file itself draws is read"
        found.passed_over(_NOT_LINES[node.tag], why, text_of(node, "name"))


def _read_placemark(placemark: "Element", folder: str, found: Findings) -> None:
    """Add the lines and the polygons of a placemark."""
    name = text_of(placemark, "name")
    where = f"{found.path}: placemark {name!r}" if name else f"{found.path}: placemark"
    lines: list[list[Vertex]] = []
    geometries = list(_geometries(placemark))
    if not geometries:
        found.passed_over("placemark", "without geometry passed over", name)
    for geometry in geometries:
        match geometry.tag:
            case "LineString" | "LinearRing":
                line = _coordinates(geometry, where)
                lines.append(_above_sea(line, geometry, name, found))
            case "Track":
                _read_tracks([geometry], name, where, found)
            case "MultiTrack":
                _read_tracks(geometry.findall("Track"), name, where, found)
            case "Polygon":
                texts = [*_data(placemark), name, text_of(placemark, "description"), folder]
                parts = _rings(geometry, "outerBoundaryIs", where)
                outline = Outline(
                    name=name or "",
                    texts=[text for text in texts if text],
                    parts=parts or [ring_area([])],
                    holes=_rings(geometry, "innerBoundaryIs", where),
                )
                found.outlines.append(outline)
            case kind:
                found.passed_over(kind.lower(), "passed over: only lines are tracks", name)
    for line in join_at_180(lines):
        found.line(name, line)


def _geometries(node: "Element") -> Iterator["Element"]:
    """Walk multiple geometries down to the single ones."""
    for child in node:
        if child.tag == "MultiGeometry":
            yield from _geometries(child)
        elif child.tag in _GEOMETRIES:
            yield child


def _data(placemark: "Element") -> Iterator[str | None]:
    """What the extended data of a placemark call its kind or type."""
    for tag in ("Data", "SimpleData"):
        for datum in placemark.iterfind(f"ExtendedData//{tag}"):
            if datum.get("name", "").lower() in ("kind", "type"):
                yield text_of(datum, "value") or (datum.text or "").strip()


def _rings(polygon: "Element", boundary: str, where: str) -> list[Area]:
    """Areas within the rings of a polygon's boundaries of one side."""
    rings = polygon.iterfind(f"{boundary}/LinearRing")
    return [ring_area(_coordinates(ring, where)) for ring in rings]


def _read_tracks(tracks: list["Element"], name: str | None, where: str, found: Findings) -> None:
    """Add the track that the parts of a gx:MultiTrack make, or a single gx:Track."""
    vertices: list[Vertex] = []
    whens: list[str | None] = []
    for track in tracks:
        coords = [(coord.text or "").split() for coord in track.findall("coord")]
        part = [_vertex(coord, f"{where}: gx:coord {i}") for i, coord in enumerate(coords, start=1)]
        vertices += _above_sea(part, track, name, found)
        times = [(when.text or "").strip() for when in track.findall("when")]
        whens += times if len(times) == len(part) else [None] * len(part)
        if times and len(times) != len(part):
            why = "with more or fewer times than places: times passed over"
            found.passed_over("track", why, name)
    if len(tracks) > 1:
        found.passed_over("track", "of several parts: joined in order by straight legs", name)
    found.line(name, vertices, time=found.times(name, whens))


def _coordinates(geometry: "Element", where: str) -> list[Vertex]:
    """Vertices of a line or a ring."""
    triples = re.sub(r"\s*,\s*", ",", geometry.findtext("coordinates") or "").split()
    check_count(len(triples), where)
    return [
        _vertex(triple.rstrip(",").split(","), f"{where}: coordinates[{i}]")
        for i, triple in enumerate(triples)
    ]


def _vertex(triple: list[str], where: str) -> Vertex:
    """Latitude and longitude [degrees] and height [m] of longitude, latitude and perhaps height."""
    if not 2 <= len(triple) <= 3:
        text = ",".join(triple)[:40]
        raise ObsplanError(
            f"{where} must be longitude,latitude or longitude,latitude,height, got {text!r}: "
            "correct it"
        )
    lon, lat, *height = (read_number(text, where) for text in triple)
    return (*check_latlon(lat, lon, where, _ORDER), height[0] if height else math.nan)


def _above_sea(
    vertices: list[Vertex], geometry: "Element", name: str | None, found: Findings
) -> list[Vertex]:
    """Vertices with their heights, if those are heights above the sea or the ground.

    Heights that are all 0 are dropped, too: none was drawn.
    """
    heights = [vertex[2] for vertex in vertices if not math.isnan(vertex[2])]
    if text_of(geometry, "altitudeMode") in _FROM_SEA_FLOOR:
        if heights:
            why = "with heights above the sea floor: heights passed over"
            found.passed_over("track", why, name)
    elif any(heights):
        return vertices
    return [(lat, lon, math.nan) for lat, lon, _ in vertices]
