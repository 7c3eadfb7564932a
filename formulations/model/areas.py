r"""Signed distance from the closed line of a polygon, negative inside.

.. math:: d(p) = \pm \min_k \min_{0 \le t \le 1} |p - a_k - t (a_{k+1} - a_k)|

The least is at a corner, or where an edge is met at a right angle. A point is inside if a ray to the east crosses the line an odd number of
times (Shimrat 1962, ACM Algorithm 112); an edge counts with its lower end and without its upper one.

In numpy: over points and edges at once it is two to four times as fast as CasADi's virtual machine, and no slower than its generated C.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

ELEMENTS = 8192  # points times edges looked at together: what comes of them stays in the cache


class Edges(NamedTuple):
    """Edges of a polygon, one after the other."""

    x: Float[np.ndarray, "E 1"]  # where they begin [m]
    y: Float[np.ndarray, "E 1"]
    end: Float[np.ndarray, "E 1"]  # how far north they end [m]
    east: Float[np.ndarray, "E 1"]  # where they lead from their beginning [m]
    north: Float[np.ndarray, "E 1"]
    squared: Float[np.ndarray, "E 1"]  # length [m^2]
    length: Float[np.ndarray, "E 1"]  # [m]


def edges_of(corners: Float[np.ndarray, "n 2"]) -> Edges:
    """Edges between the corners of a closed line; none between corners in the same place."""
    ends = np.roll(corners, -1, axis=0)
    way = ends - corners
    squared = (way**2).sum(axis=1)
    columns = [*corners.T, ends[:, 1], *way.T, squared, np.sqrt(squared)]
    return Edges(*(column[squared > 0, None] for column in columns))


def signed_distance(
    points: Float[np.ndarray, "*batch 2"], edges: Edges
) -> Float[np.ndarray, "*batch"]:
    """Distance [m] of points from the line of a polygon, negative inside; not a number where a coordinate is none."""
    x, y = np.ascontiguousarray(points.reshape(-1, 2).T)
    found = np.empty(x.size)
    together = max(1, ELEMENTS // len(edges.x))
    for first in range(0, x.size, together):
        these = slice(first, first + together)
        found[these] = _distances(x[these], y[these], edges)
    return found.reshape(points.shape[:-1])


def _distances(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], edges: Edges
) -> Float[np.ndarray, " n"]:
    dx, dy = x - edges.x, y - edges.y
    along = dx * edges.east + dy * edges.north
    left = dy * edges.east - dx * edges.north
    crossed = ((edges.y > y) != (edges.end > y)) & ((left > 0) == (edges.north > 0))
    abeam = (along > 0) & (along < edges.squared)
    off = np.where(abeam, np.abs(left) / edges.squared * edges.length, np.inf).min(axis=0)
    corner = np.sqrt((dx * dx + dy * dy).min(axis=0))
    inside = np.logical_xor.reduce(crossed, axis=0)
    return np.where(inside, -1.0, 1.0) * np.minimum(corner, off)
