"""A chart under the map of a page: lines of a GeoJSON file, as far as they are near."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from obsplan import geo
from obsplan.missions.geojson import read_lines
from obsplan.report.map import extent
from obsplan.report.page.pack import Packed, track
from obsplan.run import Run
from obsplan.types import ObsplanError

AROUND = 2.0  # times the longer side of the map, beyond its edges
FARTHEST = 50e3  # [m] from the origin: beyond that a plane is no map


class Chart(NamedTuple):
    """Lines that are drawn, and what is to be said of them."""

    lines: Sequence[dict[str, Packed]] = ()
    notes: Sequence[str] = ()


NO_CHART = Chart()


def chart_of(path: Path, run: Run) -> Chart:
    """Read a chart, and keep what is near the mission.

    Raises
    ------
    ObsplanError
        The file cannot be read as GeoJSON, or the scenario does not say where on Earth it is.
    """
    origin = run.scenario.table.origin
    if (origin.lat, origin.lon) == (0.0, 0.0):
        raise ObsplanError(
            f"{path}: the scenario has no origin, so a chart has no place on its map: "
            "give it origin = { lat = ..., lon = ... } and run it again"
        )
    low, high = extent(run)
    side = float((high - low).max())
    low, high = low - AROUND * side, high + AROUND * side
    given = read_lines(path)
    near = [part for line in given for part in _near(line, (origin.lat, origin.lon))]
    drawn = [piece for line in near for piece in _within(line, low, high)]
    if not drawn:
        return Chart(notes=[f"Nothing of {path.name} is near the mission: no chart is drawn."])
    said = (
        f"The chart is {path.name}, cut {AROUND * side:.0f} m beyond the map. Planners know "
        "nothing of it."
    )
    return Chart([track(piece, side) for piece in drawn], [said])


def _near(line: np.ndarray, origin: tuple[float, float]) -> list[np.ndarray]:
    """The parts [m] of a line [degrees] that are not too far away to be on a plane."""
    near = geo.distance(np.array(origin), line) <= FARTHEST
    ends = np.flatnonzero(near[1:] != near[:-1]) + 1
    parts = zip(np.split(line, ends), np.split(near, ends), strict=True)
    return [geo.to_local(part, origin) for part, kept in parts if kept.any()]


def _within(line: np.ndarray, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """The pieces [m] of a line within a rectangle."""
    import shapely

    if len(line) < 2:
        return []
    cut = shapely.clip_by_rect(shapely.LineString(line), *low, *high)
    pieces = [shapely.get_coordinates(piece) for piece in shapely.get_parts(cut)]
    return [piece for piece in pieces if len(piece) > 1]
