"""Charts under the map of a page: lines of GeoJSON, and rasters, as far as they are near."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from obsplan import geo
from obsplan.missions.geojson import read_lines
from obsplan.report.map import extent
from obsplan.report.page.geotiff import geotiff
from obsplan.report.page.mbtiles import mbtiles
from obsplan.report.page.pack import Packed, track
from obsplan.report.page.raster import Frame, Raster, picture_of
from obsplan.run import Run
from obsplan.types import ObsplanError

AROUND = 2.0  # times the longer side of the map, beyond its edges: lines
AROUND_PICTURE = 0.5  # the same of a raster, whose size has a limit
FARTHEST = 50e3  # [m] from the origin: beyond that a plane is no map
MOST_BYTES = 1_500_000  # of all pictures of a page
PLANNERS = "Planners know nothing of it."

# how a file begins, and what it is
BEGINNINGS = {b"II*\0": ".tif", b"MM\0*": ".tif", b"II+\0": ".tif", b"MM\0+": ".tif"}
BEGINNINGS |= {b"SQLite format 3\0": ".mbtiles"}
LINES = (".geojson", ".json")
RASTERS: dict[str, Callable[[Path], AbstractContextManager[Raster]]] = {
    ".tif": geotiff,
    ".tiff": geotiff,
    ".mbtiles": mbtiles,
}


class Chart(NamedTuple):
    """What is drawn, and what is to be said of it."""

    lines: Sequence[dict[str, Packed]] = ()
    pictures: Sequence[dict[str, Any]] = ()
    notes: Sequence[str] = ()


NO_CHART = Chart()


def surroundings(run: Run) -> Frame:
    """Where on Earth a run is, and where its map ends."""
    origin = run.scenario.table.origin
    return Frame((origin.lat, origin.lon), *extent(run))


def chart_of(paths: Sequence[Path], around: Sequence[Frame]) -> Chart:
    """Read charts, and keep what is near the missions of a page, in the order given.

    Raises
    ------
    ObsplanError
        A file cannot be read as a chart, or scenarios do not say where on Earth they are, or say
        different places.
    """
    if not paths:
        return NO_CHART
    there = _together(paths[0], around)
    charts = [_one(path, there, MOST_BYTES // len(paths)) for path in paths]
    return Chart(*([*chain(*of_all)] for of_all in zip(*charts, strict=True)))


def _together(path: Path, around: Sequence[Frame]) -> Frame:
    """The surroundings of all runs of a page."""
    origins = {one.origin for one in around}
    if (0.0, 0.0) in origins:
        raise ObsplanError(
            f"{path}: the scenario has no origin, so a chart has no place on its map: "
            "give it origin = { lat = ..., lon = ... } and run it again"
        )
    if len(origins) > 1:
        raise ObsplanError(
            f"{path}: the runs have different origins, so a chart has no one place on their maps: "
            "leave --chart out, or give runs with the same origin"
        )
    low = np.min([one.low for one in around], axis=0)
    return Frame(origins.pop(), low, np.max([one.high for one in around], axis=0))


def _one(path: Path, around: Frame, most: int) -> Chart:
    """A chart, in at most so many bytes if it is a picture."""
    kind = _kind(path)
    side = float((around.high - around.low).max())
    if kind in LINES:
        return _lines(path, around, AROUND * side)
    beyond = AROUND_PICTURE * side
    low = np.maximum(around.low - beyond, -FARTHEST)
    high = np.minimum(around.high + beyond, FARTHEST)
    if not (low < high).all():
        return _nothing(path)
    with RASTERS[kind](path) as raster:
        drawn, notes = picture_of(raster, Frame(around.origin, low, high), most)
    if drawn is None:
        return _nothing(path)
    return Chart(pictures=[drawn], notes=[_said(path, beyond, *notes)])


def _kind(path: Path) -> str:
    """The suffix that tells what a file is: by how it begins, else its own."""
    if not path.is_file():  # a pipe would be waited for
        what = "is no file" if path.exists() else "does not exist"
        raise ObsplanError(f"{path} {what}: check the name and the folder")
    try:
        with path.open("rb") as file:
            begins = file.read(16)
    except OSError as error:
        raise ObsplanError(
            f"{path} cannot be read ({error.strerror}): check its permissions"
        ) from error
    told = [kind for mark, kind in BEGINNINGS.items() if begins.startswith(mark)]
    kind = [*told, path.suffix.lower()][0]
    if kind not in RASTERS and kind not in LINES:
        raise ObsplanError(
            f"{path} is none of the charts that are drawn: GeoTIFF (.tif), MBTiles (.mbtiles), "
            "lines of GeoJSON (.geojson); export it as one of these"
        )
    return kind


def _nothing(path: Path) -> Chart:
    return Chart(notes=[f"Nothing of {path.name} is near the mission: no chart is drawn."])


def _said(path: Path, beyond: float, *more: str) -> str:
    """The sentences on a chart that is drawn."""
    return " ".join(
        [f"The chart is {path.name}, cut {beyond:.0f} m beyond the map.", *more, PLANNERS]
    )


def _lines(path: Path, around: Frame, beyond: float) -> Chart:
    """The lines of a GeoJSON file, cut so far [m] beyond the map."""
    low, high = around.low - beyond, around.high + beyond
    side = float((around.high - around.low).max())
    near = [part for line in read_lines(path) for part in _near(line, around.origin)]
    drawn = [piece for line in near for piece in _within(line, low, high)]
    if not drawn:
        return _nothing(path)
    return Chart(lines=[track(piece, side) for piece in drawn], notes=[_said(path, beyond)])


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
