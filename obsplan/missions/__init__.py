"""Mission files in and out: one format a file, and one line in `READERS` or `WRITERS`."""

import difflib
from collections.abc import Callable
from pathlib import Path

from obsplan.missions.geojson import read_geojson, write_geojson
from obsplan.missions.mission import Area, Mission, Track, to_local
from obsplan.missions.plan import read_plan
from obsplan.missions.table import read_csv
from obsplan.missions.waypoints import write_waypoints
from obsplan.missions.wpl import read_wpl
from obsplan.types import ObsplanError

READERS: dict[str, Callable[[Path | str], Mission]] = {
    ".geojson": read_geojson,
    ".json": read_geojson,
    ".plan": read_plan,
    ".csv": read_csv,
    ".waypoints": read_wpl,
    ".txt": read_wpl,
}
WRITERS: dict[str, Callable[[Path | str, Mission], object]] = {
    ".geojson": write_geojson,
    ".waypoints": write_waypoints,
}

__all__ = [
    "READERS",
    "WRITERS",
    "Area",
    "Mission",
    "Track",
    "read_mission",
    "to_local",
    "write_geojson",
    "write_waypoints",
]


def read_mission(path: Path | str) -> Mission:
    """Read a mission file by its suffix, whatever its case.

    Raises
    ------
    ObsplanError
        An unknown suffix, or a file its reader refuses; one sentence with file, place, value and remedy.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        near = difflib.get_close_matches(path.suffix.lower(), READERS, n=1)
        hint = f'did you mean "{near[0]}"? ' if near else ""
        raise ObsplanError(
            f'{path} has the unknown suffix "{path.suffix}": {hint}mission files end in {", ".join(sorted(READERS))}'
        )
    try:
        mission = reader(path)
    except RecursionError as error:
        raise ObsplanError(
            f"{path} is nested too deeply to be a mission: export it again"
        ) from error
    if not mission.tracks:
        why = f" ({mission.remarks[0]})" if mission.remarks else ""
        raise ObsplanError(f"{path} holds no line to follow{why}: draw the survey as a line")
    return mission
