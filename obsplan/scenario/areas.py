"""Areas of scenario tables and mission files: the discs and polygons that limit the aid vehicle."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from obsplan.constraints import Disc, Polygon
from obsplan.missions import Area, read_areas
from obsplan.scenario.places import LatLon, to_metres

Shape = Disc | Polygon
Role = Literal["keep-out", "geofence"]


def shape_of(area: Area) -> Shape:
    """Disc or polygon of an area in metres.

    Raises
    ------
    ValueError
        A radius that is not positive, or corners that enclose no area.
    """
    if area.radius is not None:
        x, y = area.points[0].tolist()
        return Disc(x=x, y=y, radius=area.radius)
    return Polygon(points=tuple((x, y) for x, y in area.points.tolist()))


def shapes_of(table: Any, role: Role, *, folder: Path, origin: LatLon) -> list[Shape]:
    """What an `AreaTable` stands for: a disc, a polygon, or the areas of its file with this role.

    Raises
    ------
    ValueError
        An area that encloses nothing, or one farther from the origin than the map reaches.
    ObsplanError
        A file that cannot be read, or has no such area.
    """
    if table.file is not None:
        return _read_shapes(folder / table.file, role, origin)
    if table.points is not None:
        return [Polygon(points=table.points)]
    return [Disc(x=table.x, y=table.y, radius=table.radius)]


def _read_shapes(path: Path, role: Role, origin: LatLon) -> list[Shape]:
    areas, geographic = read_areas(path, role)
    shapes: list[Shape] = []
    for number, area in enumerate(areas, start=1):
        try:
            points = to_metres(area.points, origin) if geographic else area.points
            shapes.append(shape_of(Area(points=points, radius=area.radius)))
        except ValueError as error:
            raise ValueError(f"{path.name}, area {number}: {error}") from None
    return shapes


def common(fences: Sequence[Shape]) -> Shape:
    """The area within all fences; a disc among several is taken as the polygon within it.

    Autopilots keep the same.

    Raises
    ------
    ValueError
        They have no one polygon in common: none, several apart, or one with a hole.
    """
    import shapely

    if len(fences) == 1:
        return fences[0]
    polygons = [f.inscribed() if isinstance(f, Disc) else f for f in fences]
    shape = shapely.intersection_all([shapely.Polygon(p.points) for p in polygons])
    if not isinstance(shape, shapely.Polygon) or shape.is_empty or shape.interiors:
        raise ValueError(
            f"the {len(fences)} geofences, all of which hold, have no one area in common: draw one"
        )
    corners = shapely.get_coordinates(shape.normalize())[:-1]  # the last is the first
    return Polygon(points=tuple((x, y) for x, y in corners.tolist()))


def as_entry(shape: Shape) -> dict[str, Any]:
    """Keys of the `AreaTable` that stands for a shape."""
    if isinstance(shape, Disc):
        return {"x": shape.x, "y": shape.y, "radius": shape.radius}
    return {"points": np.array(shape.points, dtype=float).tolist()}


def as_fence(shape: Shape) -> dict[str, Any] | list[list[float]]:
    """A geofence as the file has it: corners [east, north] [m], or the keys of a round one."""
    entry = as_entry(shape)
    return entry.get("points", entry)
