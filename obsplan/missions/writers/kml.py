"""KML 2.2 with Google's tracks: a path with times to play, and limits as areas."""

import math
import xml.etree.ElementTree as ET
from datetime import datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float

from obsplan import geo
from obsplan.files import write_atomically
from obsplan.missions.mission import Area, Mission, Track
from obsplan.missions.writers.checks import check_geographic
from obsplan.missions.writers.names import limit_names
from obsplan.missions.writers.times import EPOCH, explain, instant, stamps

ROUND = 0.02  # [m] by which the polygon drawn for a circle may differ from it
CORNERS = (24, 720)  # of such a polygon, at least and at most


def write_kml(path: Path | str, mission: Mission, *, start: datetime = EPOCH) -> None:
    """Write geographic tracks and limits: tracks with times as ``gx:Track``, others as lines.

    Speeds follow from the times; a hold is a point repeated. Limits are polygons named ``geofence``
    or ``keep-out-1`` and so on. A circle is drawn as a polygon on its safe side.

    Raises
    ------
    ObsplanError
        The file cannot be written.
    ValueError
        Local tracks.
    """
    check_geographic(mission, "KML")
    root = ET.Element(
        "kml",
        {
            "xmlns": "http://www.opengis.net/kml/2.2",
            "xmlns:gx": "http://www.google.com/kml/ext/2.2",
        },
    )
    document = ET.SubElement(root, "Document")
    if any(track.time is not None for track in mission.tracks.values()):
        ET.SubElement(document, "description").text = explain(start)
    for name, track in mission.tracks.items():
        _add_track(document, name, track, start)
    for name, kind, area in limit_names(mission):
        _add_area(document, name, area, inside=kind == "geofence")
    ET.indent(root)
    write_atomically(path, ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")


def _placemark(document: ET.Element, name: str) -> ET.Element:
    placemark = ET.SubElement(document, "Placemark")
    ET.SubElement(placemark, "name").text = name
    return placemark


def _add_track(document: ET.Element, name: str, track: Track, start: datetime) -> None:
    placemark = _placemark(document, name)
    points, times = stamps(track)
    if times is None:
        kind = "LineString" if len(points) > 1 else "Point"
        line = ET.SubElement(placemark, kind)
        ET.SubElement(line, "coordinates").text = _coordinates(points)
        return
    line = ET.SubElement(placemark, "gx:Track")
    for time in times:
        ET.SubElement(line, "when").text = instant(start, time)
    for lat, lon in points.tolist():
        ET.SubElement(line, "gx:coord").text = f"{lon:.9f} {lat:.9f} 0"


def _add_area(document: ET.Element, name: str, area: Area, *, inside: bool) -> None:
    corners = area.points if area.radius is None else _corners(area.points, area.radius, inside)
    polygon = ET.SubElement(_placemark(document, name), "Polygon")
    ring = ET.SubElement(ET.SubElement(polygon, "outerBoundaryIs"), "LinearRing")
    ET.SubElement(ring, "coordinates").text = _coordinates(np.vstack([corners, corners[:1]]))


def _corners(
    centre: Float[np.ndarray, "1 2"], radius: float, inside: bool
) -> Float[np.ndarray, "n 2"]:
    """A polygon for a circle: within one to stay in, about one to stay out of."""
    few, many = CORNERS
    wanted = math.pi / math.sqrt(2 * min(ROUND / radius, 1.0))
    count = min(max(math.ceil(wanted), few), many)
    reach = radius if inside else radius / math.cos(math.pi / count)
    angles = 2 * math.pi * np.arange(count) / count
    corners = reach * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    lat, lon = centre[0].tolist()
    return geo.to_geographic(corners, (lat, lon))


def _coordinates(points: Float[np.ndarray, "n 2"]) -> str:
    """Longitude, latitude and altitude of each point."""
    return " ".join(f"{lon:.9f},{lat:.9f},0" for lat, lon in points.tolist())
