r"""Signed distance from the closed line of a polygon, negative inside.

.. math:: d(p) = \pm \min_k \min_{0 \le t \le 1} |p - a_k - t (a_{k+1} - a_k)|

The least is at a corner, or where an edge is met at a right angle. A point is inside if a ray to
the east crosses the line an odd number of times (Shimrat 1962, ACM Algorithm 112); an edge counts
with its lower end and without its upper one.

Of a long line only the stretches near the points are looked at. Others are replaced by the straight
way from their first corner to the next stretch's: with it they stay within a box that no point is
in, so as many rays cross it, but for an even number.

In numpy, over points and edges at once: twice as fast as CasADi's virtual machine, and no slower
than the C it generates.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

ELEMENTS = 8192  # points times edges looked at together: what comes of them stays in the cache
STRETCH = 16  # edges of a long line that are replaced together
LONG = 4 * STRETCH  # edges from which on it is worth it
POINTS = 128  # looked at together where a line is long: fewer are nearer to each other
CLEAR = 1.0 + 1e-9  # by so much farther than the nearest place is farther without doubt


class Outline(NamedTuple):
    """The closed line of a polygon."""

    corners: Float[np.ndarray, "n 2"]
    edges: Float[np.ndarray, "7 E 1"]
    low: Float[np.ndarray, "s 2"]  # south-western corners of boxes around stretches [m]
    high: Float[np.ndarray, "s 2"]  # north-eastern ones


def outline_of(corners: Float[np.ndarray, "n 2"]) -> Outline:
    """The line through corners [m], back to the first."""
    firsts = np.arange(0, len(corners), STRETCH)
    lasts = np.roll(corners[firsts], -1, axis=0)  # of a stretch: where the next one begins
    low = np.minimum(np.minimum.reduceat(corners, firsts), lasts)
    high = np.maximum(np.maximum.reduceat(corners, firsts), lasts)
    return Outline(corners, _edges_of(corners), low, high)


def _edges_of(corners: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "7 E 1"]:
    """Edges between corners; none between corners in the same place.

    Where each begins; how far north it ends; where it leads from its beginning; its length squared;
    its length.
    """
    ends = np.roll(corners, -1, axis=0)
    way = ends - corners
    squared = (way**2).sum(axis=1)
    rows = np.vstack([corners.T, ends[:, 1], way.T, squared, np.sqrt(squared)])
    return rows[:, squared > 0, None]


def signed_distance(
    points: Float[np.ndarray, "*batch 2"], outline: Outline
) -> Float[np.ndarray, "*batch"]:
    """Distance [m] of points from the line of a polygon, negative inside.

    Not a number where a coordinate is none.
    """
    flat = points.reshape(-1, 2)
    found = np.empty(len(flat))
    long = len(outline.corners) > LONG
    together = POINTS if long else 4 * POINTS
    for first in range(0, len(flat), together):
        these = flat[first : first + together]
        edges = _edges_near(outline, these) if long else outline.edges
        found[first : first + together] = _distances(these, edges)
    return found.reshape(points.shape[:-1])


def _edges_near(outline: Outline, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "7 E 1"]:
    """Edges of a long line of which no point can tell that they are not all."""
    south_west, north_east = points.min(axis=0), points.max(axis=0)
    middle = (south_west + north_east) / 2
    reach = np.linalg.norm(north_east - middle)
    nearest = np.linalg.norm(outline.corners - middle, axis=1).min()
    beside = np.maximum(outline.low - middle, middle - outline.high)
    gap = np.linalg.norm(np.maximum(beside, 0.0), axis=1)
    far = gap > CLEAR * (nearest + 2 * reach)
    kept = ~np.repeat(far, STRETCH)[: len(outline.corners)]
    kept[::STRETCH] = True
    return _edges_of(outline.corners[kept])


def _distances(
    points: Float[np.ndarray, "n 2"], edges: Float[np.ndarray, "7 E 1"]
) -> Float[np.ndarray, " n"]:
    x, y = np.ascontiguousarray(points.T)
    nearest = np.full(len(points), np.inf)
    inside = np.zeros(len(points), dtype=bool)
    together = ELEMENTS // len(points)
    for first in range(0, edges.shape[1], together):
        begin_x, begin_y, end_y, east, north, squared, length = edges[:, first : first + together]
        dx, dy = x - begin_x, y - begin_y
        along = dx * east + dy * north
        left = dy * east - dx * north
        abeam = (along > 0) & (along < squared)
        off = np.where(abeam, np.abs(left) / squared * length, np.inf).min(axis=0)
        corner = np.sqrt((dx * dx + dy * dy).min(axis=0))
        nearest = np.minimum(nearest, np.minimum(corner, off))
        crossed = ((begin_y > y) != (end_y > y)) & ((left > 0) == (north > 0))
        inside ^= np.logical_xor.reduce(crossed, axis=0)
    return np.where(inside, -1.0, 1.0) * nearest
