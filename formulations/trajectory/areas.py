"""Fixed limits as a smooth program can take them: discs, and convex polygons by their edges.

A keep-out polygon is replaced by its convex hull; a geofence by its hull less the hull of each
pocket between hull and fence. Both err on the safe side. What is inside the one or outside the
other although the true area permits it, is lost to the program, not to the manoeuvres it starts
from, which are held against the true area.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.frames import Frame

FLAT = 1e-9  # of a fence: a corner this near to its hull is on it


class Areas(NamedTuple):
    """Limits on a position p.

    A line is (n, b), n of length 1: n·p - b is the distance to the edge, positive outside.
    """

    discs: Float[np.ndarray, "D 3"]  # centre, radius [m]; stay outside
    keep_outs: tuple[Float[np.ndarray, "J 3"], ...]  # lines; stay outside at least one of each
    fence: Float[np.ndarray, "J 3"]  # lines; stay inside all

    def __bool__(self) -> bool:
        """Whether anything is limited."""
        return len(self.discs) + len(self.keep_outs) + len(self.fence) > 0


def convex_areas(
    discs: Float[np.ndarray, "D 3"],
    polygons: Sequence[Float[np.ndarray, "_ 2"]],
    geofence: Float[np.ndarray, "_ 2"] | None,
) -> Areas:
    """Convex areas of discs, and of the corners of keep-out polygons and of a geofence."""
    keep_outs = list(polygons)
    fence = np.empty((0, 3))
    if geofence is not None:
        keep_outs += _pockets(geofence)
        fence = hull_lines(geofence)
    return Areas(discs, tuple(hull_lines(points) for points in keep_outs), fence)


def hull_lines(points: Float[np.ndarray, "_ 2"]) -> Float[np.ndarray, "J 3"]:
    """Lines through the edges of the convex hull."""
    from scipy.spatial import ConvexHull  # takes long to import, and few have polygons

    lines = ConvexHull(points).equations * [1.0, 1.0, -1.0]
    return lines[np.lexsort(np.round(lines, 9).T)]


def _pockets(corners: Float[np.ndarray, "n 2"]) -> list[Float[np.ndarray, "_ 2"]]:
    """Corners of each part of the hull that a simple polygon leaves out.

    Each is from one corner on the hull to the next, where others lie between.
    """
    lines = hull_lines(corners)
    depth = np.min(lines[:, 2] - corners @ lines[:, :2].T, axis=1)
    on_hull = np.flatnonzero(depth < FLAT * np.ptp(corners, axis=0).max())
    ends = np.append(on_hull[1:], on_hull[0] + len(corners))
    pockets = []
    for first, last in zip(on_hull, ends, strict=True):
        if last - first > 1:
            pockets.append(corners[np.arange(first, last + 1) % len(corners)])
    return pockets


def in_frame(areas: Areas, frame: Frame) -> Areas:
    """The same areas in a frame."""

    def moved(lines: np.ndarray) -> np.ndarray:
        normals, offsets = lines[:, :2], lines[:, 2]
        seen = (offsets - normals @ frame.origin) / frame.length
        return np.column_stack([frame.directions(normals), seen])

    centers, radii = areas.discs[:, :2], areas.discs[:, 2]
    discs = np.column_stack([frame.positions(centers), radii / frame.length])
    return Areas(discs, tuple(moved(lines) for lines in areas.keep_outs), moved(areas.fence))
