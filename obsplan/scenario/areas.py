"""Areas of scenario tables and of mission files, as the discs and polygons that limit the aid vehicle."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from obsplan.constraints import Disc, Polygon
from obsplan.missions import Area, read_mission
from obsplan.scenario.places import LatLon, to_metres

Shape = Disc | Polygon


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


def shapes_of(table: Any, *, folder: Path, origin: LatLon) -> list[Shape]:
    """What an `AreaTable` stands for: one disc, one polygon, or all areas of its file.

    Raises
    ------
    ValueError
        An area that encloses nothing, or a file without any.
    ObsplanError
        A file that cannot be read.
    """
    if table.file is not None:
        return _read_shapes(folder / table.file, origin)
    if table.points is not None:
        return [Polygon(points=table.points)]
    return [Disc(x=table.x, y=table.y, radius=table.radius)]


def _read_shapes(path: Path, origin: LatLon) -> list[Shape]:
    mission = read_mission(path)
    areas = (*mission.keep_outs, *mission.geofences)
    if not areas:
        raise ValueError(f"{path.name} holds no area: draw it as a polygon or a circle")
    if not mission.geographic:
        return [shape_of(area) for area in areas]
    return [
        shape_of(Area(points=to_metres(area.points, origin), radius=area.radius)) for area in areas
    ]


def common(fences: Sequence[Shape]) -> Shape:
    """The area within all fences, as an autopilot keeps them; a disc among several is taken as the polygon within it.

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
    corners = shapely.get_coordinates(shape.normalize().exterior)[:-1]
    return Polygon(points=tuple((x, y) for x, y in corners.tolist()))


def as_entry(shape: Shape) -> dict[str, Any]:
    """Keys of the `AreaTable` that stands for a shape."""
    if isinstance(shape, Disc):
        return {"x": shape.x, "y": shape.y, "radius": shape.radius}
    return {"points": as_corners(shape)}


def as_corners(polygon: Polygon) -> list[list[float]]:
    """Corners as a list in a file, east and north [m]."""
    return np.array(polygon.points, dtype=float).tolist()
