"""GPX 1.1: tracks with times, for chart plotters and navigation programs."""

import xml.etree.ElementTree as ET
from datetime import datetime
from pathlib import Path

from obsplan.files import write_atomically
from obsplan.missions.mission import Mission, Track
from obsplan.missions.writers.checks import check_geographic
from obsplan.missions.writers.times import EPOCH, explain, instant, stamps

NO_LIMITS = "GPX holds no areas: the limits of the mission are not in this file."


def write_gpx(path: Path | str, mission: Mission, *, start: datetime = EPOCH) -> None:
    """Write geographic tracks, a point with its time for each vertex; a hold is a point repeated.

    Speeds follow from the times. The format holds no limits; where the mission has some, the file
    says that they are missing.

    Raises
    ------
    ObsplanError
        The file cannot be written.
    ValueError
        Local tracks.
    """
    check_geographic(mission, "GPX")
    root = ET.Element(
        "gpx", xmlns="http://www.topografix.com/GPX/1/1", version="1.1", creator="obsplan"
    )
    notes = [explain(start)] if any(t.time is not None for t in mission.tracks.values()) else []
    if mission.keep_outs or mission.geofences:
        notes.append(NO_LIMITS)
    if notes:
        ET.SubElement(ET.SubElement(root, "metadata"), "desc").text = " ".join(notes)
    for name, track in mission.tracks.items():
        _add_track(root, name, track, start)
    ET.indent(root)
    write_atomically(path, ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")


def _add_track(root: ET.Element, name: str, track: Track, start: datetime) -> None:
    element = ET.SubElement(root, "trk")
    ET.SubElement(element, "name").text = name
    segment = ET.SubElement(element, "trkseg")
    points, times = stamps(track)
    for i, (lat, lon) in enumerate(points.tolist()):
        point = ET.SubElement(segment, "trkpt", lat=f"{lat:.9f}", lon=f"{lon:.9f}")
        if times is not None:
            ET.SubElement(point, "time").text = instant(start, times[i])
