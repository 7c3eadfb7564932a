"""Mission files in and out: one format a file, and one line in `READERS` or `WRITERS`."""

import difflib
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from obsplan import geo
from obsplan.missions.geojson import read_geojson
from obsplan.missions.gpx import read_gpx
from obsplan.missions.kml import read_kml, read_kmz
from obsplan.missions.mission import REPEATED, Area, Mission, Track, to_geographic, to_local
from obsplan.missions.moos import read_moos
from obsplan.missions.plan import read_plan
from obsplan.missions.table import read_csv
from obsplan.missions.wpl import read_wpl
from obsplan.missions.writers import (
    write_csv,
    write_geojson,
    write_gpx,
    write_kml,
    write_moos,
    write_plan,
    write_waypoints,
)
from obsplan.types import ObsplanError

READERS: dict[str, Callable[[Path | str], Mission]] = {
    ".bhv": read_moos,
    ".csv": read_csv,
    ".geojson": read_geojson,
    ".gpx": read_gpx,
    ".json": read_geojson,
    ".kml": read_kml,
    ".kmz": read_kmz,
    ".moos": read_moos,
    ".plan": read_plan,
    ".tsv": read_csv,
    ".txt": read_wpl,
    ".waypoints": read_wpl,
}
WRITERS: dict[str, Callable[..., None]] = {  # of a path and a mission; options by name
    ".waypoints": write_waypoints,
    ".plan": write_plan,
    ".gpx": write_gpx,
    ".kml": write_kml,
    ".geojson": write_geojson,
    ".csv": write_csv,
    ".bhv": write_moos,
}

__all__ = [
    "READERS",
    "WRITERS",
    "Area",
    "Mission",
    "Track",
    "read_areas",
    "read_mission",
    "to_geographic",
    "to_local",
    "write_csv",
    "write_geojson",
    "write_gpx",
    "write_kml",
    "write_moos",
    "write_plan",
    "write_waypoints",
]


def read_mission(path: Path | str) -> Mission:
    """Read a mission file by its suffix, whatever its case.

    Raises
    ------
    ObsplanError
        An unknown suffix, no line to follow, or a file its reader refuses; one sentence with file,
        place, value and remedy.
    """
    mission = _read(Path(path))
    if not mission.tracks:
        why = f" ({'; '.join(mission.remarks)})" if mission.remarks else ""
        raise ObsplanError(f"{path} holds no line to follow{why}: draw the survey as a line")
    return mission


def read_areas(path: Path | str, role: Literal["keep-out", "geofence"]) -> tuple[list[Area], bool]:
    """Read the areas of a mission file that are asked for as keep-outs, or as a geofence.

    Keep-outs are all polygons and circles but those that the file calls a geofence. A geofence is
    what the file calls so, or else all that it calls neither. In a file without such areas, lines
    that end where they start are taken for polygons.

    Returns
    -------
    The areas, and whether they are in latitude and longitude [degrees] and not in local metres.

    Raises
    ------
    ObsplanError
        As `read_mission`, but for no such area instead of no line.
    """
    mission = _read(Path(path))
    keep_out = role == "keep-out"
    named = mission.keep_outs if keep_out else mission.geofences
    areas = [*named, *(mission.areas if keep_out or not named else ())]
    if not areas:
        areas = [
            Area(points=track.points[:-1])
            for track in mission.tracks.values()
            if len(track.points) > 3 and _is_closed(track, geographic=mission.geographic)
        ]
    if not areas:
        raise ObsplanError(
            f"{path} holds no polygon, no circle and no closed line for a {role}: draw the area "
            "as a polygon"
        )
    return areas, mission.geographic


def _is_closed(track: Track, *, geographic: bool) -> bool:
    """Whether a track ends where it starts."""
    start, end = track.points[:1], track.points[-1:]
    apart = geo.distance(start, end) if geographic else np.hypot(*(end - start).T)
    return bool(apart.max() <= REPEATED)


def _read(path: Path) -> Mission:
    """Read a mission file by its suffix, whatever it holds."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        near = difflib.get_close_matches(path.suffix.lower(), READERS, n=1)
        hint = f'did you mean "{near[0]}"? ' if near else ""
        raise ObsplanError(
            f'{path} has the unknown suffix "{path.suffix}": '
            f"{hint}mission files end in {', '.join(sorted(READERS))}: export the survey as one"
        )
    try:
        return reader(path)
    except RecursionError as error:
        raise ObsplanError(
            f"{path} is nested too deeply to be a mission: export it again"
        ) from error
