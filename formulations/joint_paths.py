"""The joint bound: what no paths of a few aid vehicles can beat, for all AUVs together."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .fleet import AidVehicle, Fleet, RangedAuv
from .frank_wolfe import CertifiedBound, Progress, frank_wolfe
from .model.ranging import Ranging
from .sight import Boxes, along, cheapest, distances, gap, sight_of

RELATIVE_GAP = 0.002  # of the mean square
MAX_ITERATIONS = 100
CELLS = 20  # along the longer side of where the AUVs and the aid vehicle start and are
MIXED = 20  # paths to begin from
GROWTH = 1.5  # of cells beyond, each by the one before
MAX_LINKS = 5_000_000  # of cells that can follow one another, some 60 MB


@dataclass(frozen=True, slots=True, kw_only=True)
class JointBound(CertifiedBound):
    """What no paths of the aid vehicles can beat, weighted over AUVs and time.

    ``value`` is the least mean square [m²] of mixtures of paths that was found, and ``gap`` its
    duality gap: every path lies above ``bound`` = value − gap.
    """

    cells: int  # of the plane, of the aid vehicle with most


def joint_bound(
    auvs: Sequence[RangedAuv],
    aids: Sequence[AidVehicle],
    *,
    ranging: Ranging,
    time: Float[np.ndarray, " samples"],
    weights: Float[np.ndarray, " _samples"] | None = None,
    cells: int = CELLS,
    relative_gap: float = RELATIVE_GAP,
    max_iterations: int = MAX_ITERATIONS,
    progress: Progress = lambda _share: None,
) -> JointBound:
    r"""Bound the AUVs' weighted mean square position error from below, over all paths of the aids.

    A path of an aid vehicle gives each range to it a matrix w u uᵀ. The error is convex in all of
    them, so over the hull of all paths `frank_wolfe` bounds it. Its linear step is the path of the
    least sum of :math:`w \, u^\top G_j u`: dynamic programming over cells of the plane in time.

    - In a cell a range is worth as much as anywhere in it, and each AUV has the best line of sight
      to it, its own.
    - One cell can follow another where their nearest points are within reach meanwhile, and a cell
      can be held at a time if its nearest point is within reach of the start.

    So the hull is a larger one, and its bound holds for all paths whose speed over ground does not
    exceed the aid vehicle's. Limits on turns or areas make paths worse, and are not counted. A
    bound finer in cells is tighter and takes longer.

    Parameters
    ----------
    auvs, aids
        Models, ranges and starts; see `RangedAuv` and `AidVehicle`. No aid vehicles, or no ranges,
        leave what the AUVs know by themselves.
    ranging
        Law of all ranges. It counts those that come; losses are in which ranges are given.
    time
        Of the samples [s].
    weights
        Of the samples in the mean over time; equal unless given.
    cells
        Along the longer side of the area in which the AUVs and the aid vehicle's start lie; beyond
        it they grow.
    relative_gap
        Of the value, at which to stop.
    progress
        Called with the share done, from 0 to 1, at each iteration.

    Raises
    ------
    ValueError
        There are no AUVs; numbers are not finite; pings lie outside the steps or aid vehicles, or
        lack places; weights are negative or all zero; speeds are negative; or cells, gap or
        iterations are not positive.
    """
    if not (cells >= 1 and relative_gap > 0 and max_iterations >= 1):
        raise ValueError(
            "cells, relative_gap and max_iterations must be positive, "
            f"got {cells}, {relative_gap} and {max_iterations}"
        )
    fleet = Fleet(auvs, aids, time, weights)
    ways = [_Ways(fleet, aid, ranging, cells) for aid in range(len(aids))]

    def vertex(gradient: np.ndarray) -> np.ndarray:
        told = np.zeros_like(gradient)
        for way in ways:
            told[way.ranges] = way.best(gradient[way.ranges])
        return told

    start = _beginning(fleet, vertex, ways)
    found = frank_wolfe(
        fleet,
        start,
        vertex,
        relative_gap=relative_gap,
        max_iterations=max_iterations,
        progress=progress,
    )
    return JointBound(
        value=found.value,
        gap=found.gap,
        iterations=found.iterations,
        cells=max((len(way.boxes.low) for way in ways), default=0),
    )


def _beginning(
    fleet: Fleet, vertex: Callable[[np.ndarray], np.ndarray], ways: Sequence["_Ways"]
) -> np.ndarray:
    """A mixture of a few paths, each the best beside those before; at first beside all bearings.

    A path by itself leaves errors so large that slopes there say little.
    """
    mixture = np.zeros((len(fleet.aid), 2, 2))
    for way in ways:
        mixture[way.ranges] = np.eye(2) / 2 * way.sight.most.max(axis=1)[:, None, None]
    for k in range(MIXED):
        _, J, P = fleet.evaluate(mixture)
        step = 2 / (k + 2)  # the first takes the place of what no path can tell
        mixture = (1 - step) * mixture + step * vertex(fleet.gradient(J, P))
    return mixture


class _Ways:
    """All ways of one aid vehicle from cell to cell, and what its ranges tell in each."""

    def __init__(self, fleet: Fleet, aid: int, ranging: Ranging, cells: int) -> None:
        vehicle = fleet.aids[aid]
        times, self.ranges, self.stage = fleet.stages(aid)
        self.stages = len(times)
        places = fleet.places[self.ranges]
        reach = vehicle.reach(times)
        self.boxes = _grid(vehicle.start, places, float(reach.max(initial=0.0)), cells)
        nearest, _ = distances(vehicle.start, self.boxes)
        self.too_far = nearest > reach[:, None]
        heights = fleet.heights[self.ranges]
        self.sight = sight_of(places[:, None], self.boxes, ranging, heights[:, None])
        between = vehicle.reach(np.diff(times))
        self.links = {float(r): _links(self.boxes, float(r)) for r in np.unique(between)}
        self.between = between

    def best(self, gradient: np.ndarray) -> np.ndarray:
        """What the ranges tell along the way of least cost, by the gradient of each."""
        costs, doubled = cheapest(gradient[:, None], self.sight)
        of_stage = np.zeros(self.too_far.shape)
        np.add.at(of_stage, self.stage, costs)
        of_stage[self.too_far] = np.inf
        cell = self._way(of_stage)[self.stage]
        ranges = np.arange(len(self.ranges))
        return along(self.sight.most[ranges, cell], doubled[ranges, cell])

    def _way(self, costs: np.ndarray) -> np.ndarray:
        """Cell at each stage of the way with the least sum, by the least that follows each."""
        way = np.zeros(self.stages, dtype=int)
        if not self.stages:
            return way
        left = np.empty_like(costs)
        left[-1] = costs[-1]
        for k in range(self.stages - 2, -1, -1):
            follow, first = self.links[float(self.between[k])]
            left[k] = costs[k] + np.minimum.reduceat(left[k + 1][follow], first[:-1])
        way[0] = np.argmin(left[0])
        for k in range(self.stages - 1):
            follow, first = self.links[float(self.between[k])]
            near = follow[first[way[k]] : first[way[k] + 1]]
            way[k + 1] = near[np.argmin(left[k + 1][near])]
        return way


def _grid(start: np.ndarray, places: np.ndarray, reach: float, cells: int) -> Boxes:
    """Cells that cover all that is within reach of the start."""
    middle = np.vstack([places, start])
    low, high = middle.min(axis=0), middle.max(axis=0)
    low, high = np.maximum(low, start - reach), np.minimum(high, start + reach)
    high = np.maximum(high, low)
    size = max(float(np.max(high - low)), reach / cells, 1e-9) / cells
    edges = [_edges(low[i], high[i], start[i] - reach, start[i] + reach, size) for i in range(2)]
    corners_low = np.meshgrid(edges[0][:-1], edges[1][:-1], indexing="ij")
    corners_high = np.meshgrid(edges[0][1:], edges[1][1:], indexing="ij")
    return Boxes(
        np.stack(corners_low, axis=-1).reshape(-1, 2),
        np.stack(corners_high, axis=-1).reshape(-1, 2),
    )


def _edges(low: float, high: float, first: float, last: float, size: float) -> np.ndarray:
    """Edges of cells from first to last, of one size about low to high, growing beyond."""
    count = max(1, int(np.ceil((high - low) / size)))
    margin = (count * size - (high - low)) / 2
    edges = [*np.linspace(low - margin, high + margin, count + 1)]
    step = size
    while edges[-1] < last:
        step *= GROWTH
        edges.append(edges[-1] + step)
    step = size
    while edges[0] > first:
        step *= GROWTH
        edges.insert(0, edges[0] - step)
    return np.array(edges)


def _links(boxes: Boxes, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Cells that can follow each cell, one after the other, and where those of each begin."""
    follow, first = [], [0]
    for i in range(len(boxes.low)):
        apart = gap(Boxes(boxes.low[i], boxes.high[i]), boxes)
        near = np.flatnonzero(np.hypot(apart[:, 0], apart[:, 1]) <= reach)
        follow.append(near)
        first.append(first[-1] + len(near))
    if first[-1] > MAX_LINKS:
        raise ValueError(
            f"{len(boxes.low)} cells can follow one another in {first[-1]} ways, more than "
            f"{MAX_LINKS}: give fewer cells"
        )
    return np.concatenate(follow), np.array(first)
