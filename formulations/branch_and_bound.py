"""Branch and bound over paths: how low any path can get, tight also in time, on short missions."""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .fleet import AidVehicle, Fleet, RangedAuv
from .frank_wolfe import Progress, frank_wolfe
from .model.ranging import Ranging
from .regions import Region, Stages, within
from .sight import Boxes, Sight, along, cheapest, sight_of

RELATIVE_GAP = 0.02  # of the mean square: 1 % of the error
MAX_NODES = 20_000
NODE_GAP = 0.002  # of the mean square, at which a node's own search stops
NODE_ITERATIONS = 4
SHARE_OF_WIDTH = 0.3  # what a wide region counts as, beside a range that is mixed


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimalBound:
    """What no path of the aid vehicles can beat, to within a gap of a path that is known.

    Mean squares [m²] are weighted over AUVs and time. ``achieved`` is that of the path that was
    given; the best of all paths lies between ``bound`` and it. ``closed`` says whether they are as
    near as was asked for, or the ``nodes`` had run out before.
    """

    bound: float
    achieved: float
    nodes: int
    closed: bool

    @property
    def bound_rms_m(self) -> float:
        """Certified lower bound on the root mean square position error [m]."""
        return float(np.sqrt(self.bound))

    @property
    def excess(self) -> float:
        """How far the given path's RMS error is above that of the best path, at most; relative."""
        return float(np.sqrt(self.achieved / self.bound)) - 1 if self.bound > 0 else np.inf


class _Node(NamedTuple):
    """Paths that pass through regions, and the least error of mixtures of them."""

    bound: float
    region: Region
    sight: Sight
    value: float
    told: np.ndarray
    gradient: np.ndarray


def optimal_bound(
    auvs: Sequence[RangedAuv],
    aids: Sequence[AidVehicle],
    *,
    ranging: Ranging,
    time: Float[np.ndarray, " samples"],
    achieved: float,
    weights: Float[np.ndarray, " _samples"] | None = None,
    relative_gap: float = RELATIVE_GAP,
    max_nodes: int = MAX_NODES,
    progress: Progress = lambda _share: None,
) -> OptimalBound:
    r"""Bound the mean square error of every path from below, to near that of a given one.

    The bound over the hull of all paths is loose because a hull mixes paths: a mixture sees each
    AUV from two sides at every ping, a path from one. Here the set of all paths is divided into
    those that pass through smaller and smaller regions at each ping, until within none of them
    mixing helps. A node of the search is, for each aid vehicle and ping, a box of the plane, and
    for each range an interval of bearings; boxes are tightened by what the speed allows between
    pings, forwards and backwards, and by the bearings. Over the hull of what such regions can tell
    `frank_wolfe` gives a certified bound. The node with the lowest is split, until it lies within
    ``relative_gap`` of the given path, or ``max_nodes`` are done: the least bound that is left
    holds for every path whatever.

    The work grows with the number of pings by a power that no bound helps against. Some ten pings
    are practical.

    Parameters
    ----------
    auvs, aids, ranging, time, weights
        As for `joint_bound`.
    achieved
        Mean square error [m²] of a path that the aid vehicles can take, in the same weights.
    relative_gap
        Of ``achieved``, below which the bound may stay.
    max_nodes
        To examine. The bound is as certain if they run out, and less tight.
    progress
        Called with the share done, from 0 to 1, at each node.

    Raises
    ------
    ValueError
        As `joint_bound`, or ``achieved`` is not positive and finite.
    """
    if not (relative_gap > 0 and max_nodes >= 1 and 0 < achieved < np.inf):
        raise ValueError(
            "achieved must be finite, and it, relative_gap and max_nodes positive, "
            f"got {achieved}, {relative_gap} and {max_nodes}"
        )
    search = _Search(Fleet(auvs, aids, time, weights), ranging, (1 - relative_gap) * achieved)
    bound = search.run(max_nodes, progress)
    closed = bool(bound >= search.target)
    return OptimalBound(
        bound=float(bound), achieved=float(achieved), nodes=search.examined, closed=closed
    )


class _Search:
    """Best-first branch and bound, to a target."""

    def __init__(self, fleet: Fleet, ranging: Ranging, target: float) -> None:
        self.fleet, self.ranging, self.target = fleet, ranging, target
        self.stages = Stages(fleet)
        self.open: list[tuple[float, int, _Node]] = []  # a heap
        self.examined = 0

    def run(self, max_nodes: int, progress: Progress) -> float:
        """Least bound of all paths, or the target."""
        self._examine(self.stages.whole(), None)
        while self.open and self.open[0][0] < self.target and self.examined < max_nodes:
            _, _, node = heapq.heappop(self.open)
            halves = self._halves(node)
            if not halves:
                return node.bound
            for region in halves:
                self._examine(region, node)
            progress(min(1.0, self.examined / max_nodes))
        return min(self.open[0][0] if self.open else np.inf, self.target)

    def _examine(self, region: Region, parent: _Node | None) -> None:
        """Keep a region, unless no path of it is below the target."""
        self.examined += 1
        tight = self.stages.tightened(region)
        sight = None if tight is None else self._sight(tight)
        if tight is None or sight is None:
            return
        told = sight.most[:, None, None] * np.eye(2) / 2  # from all sides, to begin with
        at_least = 0.0
        if parent is not None:
            at_least = max(parent.bound, _linear_bound(parent, sight))
            if at_least >= self.target:
                return
            told = parent.told
        found = frank_wolfe(
            self.fleet,
            _moved(told, sight),
            lambda gradient: along(sight.most, cheapest(gradient, sight)[1]),
            relative_gap=NODE_GAP,
            max_iterations=NODE_ITERATIONS,
            enough=self.target,
        )
        bound = max(found.bound, at_least)
        if bound < self.target:
            node = _Node(bound, tight, sight, found.value, found.point, found.gradient)
            heapq.heappush(self.open, (bound, self.examined, node))

    def _sight(self, region: Region) -> Sight | None:
        """What ranges can tell in a region; None where no path passes through it."""
        return within(self._box_sight(region.boxes), region.middle, region.half)

    def _box_sight(self, boxes: Boxes) -> Sight:
        """What ranges can tell in boxes."""
        of_range = self.stages.of_range
        own = Boxes(boxes.low[of_range], boxes.high[of_range])
        return sight_of(self.fleet.places, own, self.ranging, self.fleet.heights)

    def _width(self, region: Region) -> np.ndarray:
        """How much each range's box leaves open, from 0 to 2.

        That is how wide it is seen; a box that is small beside the ways between pings
        leaves little.
        """
        seen = 1 - np.cos(self._box_sight(region.boxes).half)
        size = np.max(region.boxes.high - region.boxes.low, axis=-1)
        share = np.minimum(1.0, size / self.stages.way)
        return seen * share[self.stages.of_range]

    def _halves(self, node: _Node) -> list[Region]:
        """Two regions that make up a node's: where mixing helps it most, or where it is wide.

        None where ranges tell nothing, and all paths are alike.
        """
        sight = node.sight
        if not sight.most.any():
            return []  # nothing to choose
        worth = -np.trace(node.gradient, axis1=-2, axis2=-1) * sight.most
        most = np.where(sight.most > 0, sight.most, 1.0)
        east, north = _doubled(node.told / most[:, None, None])
        mixed = worth * (1 - np.hypot(east, north))
        wide = worth * self._width(node.region) * SHARE_OF_WIDTH
        if mixed.max() >= wide.max():
            j = int(np.argmax(mixed))
            return _halves_of_bearings(node.region, sight, j)
        k = int(self.stages.of_range[np.argmax(wide)])
        return self._halves_of_box(node.region, k)

    def _halves_of_box(self, region: Region, k: int) -> list[Region]:
        """Split a box where that narrows lines of sight most."""
        choices = []
        low, high = region.boxes
        for axis in range(2):
            middle = (low[k, axis] + high[k, axis]) / 2
            lower, upper = high.copy(), low.copy()
            lower[k, axis] = upper[k, axis] = middle
            choices.append([Boxes(low, lower), Boxes(upper, high)])
        widths = []
        for boxes in choices:
            widths.append(sum(float(np.sum(1 - np.cos(self._box_sight(b).half))) for b in boxes))
        best = choices[int(np.argmin(widths))]
        return [region._replace(boxes=box) for box in best]


def _halves_of_bearings(region: Region, sight: Sight, j: int) -> list[Region]:
    """Split the bearings of a range in the middle of those that are seen."""
    halves = []
    for side in (-1, 1):
        middle, half = region.middle.copy(), region.half.copy()
        half[j] = sight.half[j] / 2
        middle[j] = sight.middle[j] + side * half[j]
        halves.append(region._replace(middle=middle, half=half))
    return halves


def _linear_bound(node: _Node, sight: Sight) -> float:
    """What the slope at a node's minimum says of a part of it."""
    least, _ = cheapest(node.gradient, sight)
    return node.value + float(np.sum(least) - np.sum(node.gradient * node.told))


def _doubled(unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of the doubled bearing, of matrices of trace one; mixtures are shorter."""
    return unit[..., 0, 0] - unit[..., 1, 1], unit[..., 0, 1] + unit[..., 1, 0]


def _moved(told: np.ndarray, sight: Sight) -> np.ndarray:
    """The matrices of the hull of a sight near given ones."""
    size = np.trace(told, axis1=-2, axis2=-1)
    east, north = _doubled(told / np.where(size > 0, size, 1.0)[:, None, None])
    cos, sin = np.cos(sight.middle), np.sin(sight.middle)
    forth, aside = cos * east + sin * north, cos * north - sin * east
    forth = np.clip(forth, np.cos(sight.half), 1.0)
    room = np.sqrt(1 - forth**2)
    aside = np.clip(aside, -room, room)
    east, north = cos * forth - sin * aside, sin * forth + cos * aside
    unit = np.stack([1 + east, north, north, 1 - east], axis=-1).reshape(-1, 2, 2) / 2
    return sight.most[:, None, None] * unit
