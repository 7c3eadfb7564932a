"""GPX (1.0 and 1.1): every route and every track is a track.

Read over defusedxml: gpxpy loses prefixed files and unreadable times in silence, and registers a
file's namespaces for the whole process.
"""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from obsplan.missions.findings import Findings, Vertex, check_count
from obsplan.missions.markup import parse_xml, text_of
from obsplan.missions.mission import Mission, check_latlon, read_number
from obsplan.missions.source import read_bytes
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_ORDER = "exchange them, GPX has attributes lat and lon"
_OPENCPN = b"http://www.opencpn.org"  # its namespace


def read_gpx(path: Path | str) -> Mission:
    """Read the routes and the tracks of a GPX file, with elevations as altitudes, and times.

    The segments of a track are joined in order, by straight legs: they are one vehicle's. The
    waypoints of a file that has nothing else are one track, in the order of the file; beside a
    route or a track they are passed over. Remarks say so.

    Raises
    ------
    ObsplanError
        Not GPX, or a coordinate that is not one; names the place.
    """
    path = Path(path)
    content = read_bytes(path)
    root = parse_xml(content, path)
    if root.tag != "gpx":
        hint = "rename it to .kml" if root.tag == "kml" else "export it as GPX"
        raise ObsplanError(f"{path} is not GPX (its root is <{root.tag[:40]}>): {hint}")
    found = Findings(path=path)
    for line in root:
        if line.tag == "rte":
            _read_route(found, line, drawn_in_opencpn=_OPENCPN in content)
        elif line.tag == "trk":
            _read_track(found, line)
    _read_waypoints(found, root)
    return found.mission()


def _read_route(found: Findings, route: "Element", *, drawn_in_opencpn: bool) -> None:
    """Add a route."""
    name = text_of(route, "name")
    points = route.findall("rtept")
    vertices = _vertices(points, _place(found, "route", name))
    times = found.times(name, [text_of(point, "time") for point in points])
    if drawn_in_opencpn and times is not None:
        times = None
        why = "drawn in OpenCPN, whose times tell when its points were drawn: times passed over"
        found.passed_over("route", why, name)
    if route.find(".//planned_speed") is not None:
        why = "with a planned speed of OpenCPN, often its default of 6 knots: speed passed over"
        found.passed_over("route", why, name)
    found.line(name, vertices, time=times)


def _read_track(found: Findings, track: "Element") -> None:
    """Add a track, its segments joined."""
    name = text_of(track, "name")
    segments = [segment.findall("trkpt") for segment in track.findall("trkseg")]
    segments = [segment for segment in segments if segment]
    points = [point for segment in segments for point in segment]
    if len(segments) > 1:
        why = "of several segments: joined in order by straight legs"
        found.passed_over("track", why, name)
    vertices = _vertices(points, _place(found, "track", name))
    times = found.times(name, [text_of(point, "time") for point in points])
    found.line(name, vertices, time=times)


def _read_waypoints(found: Findings, root: "Element") -> None:
    """Take waypoints for a track where there is nothing else; pass them over where there is."""
    waypoints = root.findall("wpt")
    if found.drafts or not waypoints:
        for waypoint in waypoints:
            why = "passed over: routes and tracks are lines"
            found.passed_over("waypoint", why, text_of(waypoint, "name"))
        return
    found.line(None, _vertices(waypoints, _place(found, "waypoints", None)))
    found.remarks.append(
        f"no route and no track: the {len(waypoints)} waypoints are joined in the order of the file"
    )


def _place(found: Findings, kind: str, name: str | None) -> str:
    """Where a line stands in the file."""
    return f"{found.path}: {kind} {name!r}" if name else f"{found.path}: {kind}"


def _vertices(points: list["Element"], place: str) -> list[Vertex]:
    """Latitude and longitude [degrees] and elevation [m] of points."""
    check_count(len(points), place)
    vertices: list[Vertex] = []
    for i, point in enumerate(points, start=1):
        where = f"{place}, point {i},"
        lat = read_number(point.get("lat", ""), f"{where} attribute lat")
        lon = read_number(point.get("lon", ""), f"{where} attribute lon")
        elevation = text_of(point, "ele")
        altitude = math.nan if elevation is None else read_number(elevation, f"{where} ele")
        vertices.append((*check_latlon(lat, lon, where, _ORDER), altitude))
    return vertices
