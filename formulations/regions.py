"""Regions of paths: boxes that an aid vehicle passes through, and bearings at which it is seen."""

import math
from typing import NamedTuple

import numpy as np

from .fleet import Fleet
from .sight import Boxes, Sight, wrapped

SLACK = 1e-9  # of lengths, also in metres: a region is never tightened by rounding
TINY = 1e-9  # way [m] of a vehicle that stays
SWEEPS = 2  # forwards and backwards through a path


class Region(NamedTuple):
    """A box for each stage, and for each range an interval of the doubled bearing [rad]."""

    boxes: Boxes  # stages
    middle: np.ndarray  # ranges
    half: np.ndarray  # to either side; pi: all


class Stages:
    """When each aid vehicle has ranges: its stages in order, one vehicle after the other."""

    def __init__(self, fleet: Fleet) -> None:
        self.of_range = np.zeros(len(fleet.aid), dtype=int)
        starts, reaches, links = [], [], []
        for aid, vehicle in enumerate(fleet.aids):
            times, own, stage = fleet.stages(aid)
            self.of_range[own] = len(starts) + stage
            between = [np.inf, *vehicle.reach(np.diff(times))]  # nothing before the first
            links += between[: len(times)]
            reaches += [*vehicle.reach(times)]
            starts += [vehicle.start] * len(times)
        self.count = len(starts)
        self.start = np.array(starts).reshape(-1, 2)
        self.reach = np.array(reaches)
        self.before = np.array(links)  # how far from the stage before, by index
        self.places = fleet.places
        # from the stage before, or from the start [m]
        self.way = np.maximum(np.minimum(self.before, self.reach), TINY)

    def whole(self) -> Region:
        """All that can be reached."""
        reach = self.reach[:, None]
        boxes = Boxes(self.start - reach, self.start + reach)
        ranges = len(self.of_range)
        return Region(boxes, np.zeros(ranges), np.full(ranges, np.pi))

    def tightened(self, region: Region) -> Region | None:
        """Boxes around what can be reached within them; None where nothing can.

        From the start, from the stage before, from the one after, and within the bearings.
        """
        low, high = region.boxes.low.tolist(), region.boxes.high.tolist()
        order = [*range(1, self.count)]
        self._within_bearings(region, low, high)
        for k in range(self.count):
            start = self.start[k].tolist()
            _near(low[k], high[k], start, start, float(self.reach[k]))
        for _ in range(SWEEPS):
            for k in order:
                _near(low[k], high[k], low[k - 1], high[k - 1], float(self.before[k]))
            for k in reversed(order):
                _near(low[k - 1], high[k - 1], low[k], high[k], float(self.before[k]))
        boxes = Boxes(np.array(low).reshape(-1, 2), np.array(high).reshape(-1, 2))
        if np.any(boxes.low > boxes.high) or np.isnan(boxes.low).any():
            return None
        return region._replace(boxes=boxes)

    def _within_bearings(self, region: Region, low: list, high: list) -> None:
        """Shrink boxes to what lies within the bearings from an AUV beside them."""
        for j in np.flatnonzero(region.half < np.pi / 2):
            k = self.of_range[j]
            place = self.places[j].tolist()
            if all(low[k][i] <= place[i] <= high[k][i] for i in range(2)):
                continue  # both wedges lie about the place, and their box is the whole
            corners = _corners(low[k], high[k], place)
            wedge = _wedge(corners, float(region.middle[j]), float(region.half[j]))
            if wedge is None:
                continue
            for edge, side in zip(wedge, (1, -1), strict=True):
                corners = _clipped(corners, -side * math.sin(edge), side * math.cos(edge))
            if not corners:
                low[k][0] = math.inf
                continue
            for i in range(2):
                values = [corner[i] + place[i] for corner in corners]
                margin = SLACK * (1 + abs(place[i]) + high[k][i] - low[k][i])
                low[k][i] = max(low[k][i], min(values) - margin)
                high[k][i] = min(high[k][i], max(values) + margin)


def _corners(low: list, high: list, place: list) -> list[tuple[float, float]]:
    """Corners round a box, from a place."""
    west, south = low[0] - place[0], low[1] - place[1]
    east, north = high[0] - place[0], high[1] - place[1]
    return [(west, south), (east, south), (east, north), (west, north)]


def _wedge(corners: list, middle: float, half: float) -> tuple[float, float] | None:
    """Directions between which a doubled bearing has a box; None where on both sides of the place.

    A doubled bearing stands for two opposite directions.
    """
    east = sum(corner[0] for corner in corners)
    north = sum(corner[1] for corner in corners)
    toward = math.atan2(north, east)
    turns = [math.remainder(math.atan2(y, x) - toward, 2 * math.pi) for x, y in corners]
    away = math.remainder(middle - 2 * toward, 2 * math.pi) / 2
    clear = math.pi - half / 2 - SLACK
    if away + clear <= max(turns) or away - clear >= min(turns):
        return None
    return toward + away - half / 2, toward + away + half / 2


def _near(low: list, high: list, other_low: list, other_high: list, reach: float) -> None:
    """Shrink a box to around what is within reach of another; low is infinite where nothing is."""
    if reach == math.inf:
        return
    apart = [max(low[i] - other_high[i], other_low[i] - high[i], 0.0) for i in range(2)]
    most = reach * (1 + SLACK) + SLACK
    for i in range(2):
        left = most**2 - apart[1 - i] ** 2
        if left < 0:
            low[0] = math.inf
            return
        wide = math.sqrt(left) + SLACK
        low[i] = max(low[i], other_low[i] - wide)
        high[i] = min(high[i], other_high[i] + wide)


def _clipped(polygon: list, a: float, b: float) -> list:
    """The part of a convex polygon where a x + b y >= 0, up to rounding."""
    kept = []
    for (x, y), (u, v) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        here, there = a * x + b * y, a * u + b * v
        if here >= -SLACK:
            kept.append((x, y))
        if (here >= -SLACK) != (there >= -SLACK):
            share = here / (here - there)
            kept.append((x + share * (u - x), y + share * (v - y)))
    return kept


def within(sight: Sight, middle: np.ndarray, half: np.ndarray) -> Sight | None:
    """What of a sight lies within intervals of doubled bearings; None where nothing of one does."""
    ahead = wrapped(sight.middle - middle)
    first, last = np.full_like(half, np.inf), np.full_like(half, -np.inf)
    for turn in (-2 * np.pi, 0.0, 2 * np.pi):  # an interval may end where another begins
        low = np.maximum(-half, ahead + turn - sight.half)
        high = np.minimum(half, ahead + turn + sight.half)
        some = low <= high + SLACK
        first = np.where(some, np.minimum(first, low), first)
        last = np.where(some, np.maximum(last, high), last)
    if np.any(first > last + SLACK):
        return None
    free = half >= np.pi  # all bearings: the sight as it is
    middles = np.where(free, sight.middle, middle + (first + last) / 2)
    halves = np.where(free, sight.half, np.maximum(last - first, 0.0) / 2)
    return Sight(middles, halves, sight.most)
