"""Fences: corners and circles, from the items of a mission or from the file's own list of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import takewhile

import numpy as np

from obsplan.missions.mavlink.commands import CIRCLES, INCLUSIONS, POLYGONS
from obsplan.missions.mavlink.items import Item
from obsplan.missions.mission import Area, Point
from obsplan.types import ObsplanError

LARGEST_RADIUS = 100e3  # [m]
_MOST_CORNERS = 65535.0  # a count of items is 16 bits wide


@dataclass(slots=True)
class Fences:
    """Areas not to be left and areas not to be entered, as they are found."""

    inclusions: list[Area] = field(default_factory=list)
    exclusions: list[Area] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def add_polygon(self, corners: Sequence[Point], where: str, *, inclusion: bool) -> None:
        """Take a polygon by its corners, the first repeated or not.

        Raises
        ------
        ObsplanError
            Fewer than three corners: what a fence was meant to be is not left out.
        """
        open_ring = list(corners[:-1] if corners and corners[0] == corners[-1] else corners)
        if len(set(open_ring)) < 3:
            raise ObsplanError(
                f"{where} is a fence of fewer than three corners: draw it again, or delete it"
            )
        self._add(Area(points=np.array(open_ring, dtype=float)), inclusion)

    def add_circle(self, centre: Point, radius: float, where: str, *, inclusion: bool) -> None:
        """Take a circle by its centre and radius [m].

        Raises
        ------
        ObsplanError
            A radius that is not positive, or beyond `LARGEST_RADIUS`.
        """
        if not 0 < radius <= LARGEST_RADIUS:
            raise ObsplanError(
                f"{where}, radius, must be positive and at most {LARGEST_RADIUS:g} m, "
                f"got {radius:g}: correct it"
            )
        self._add(Area(points=np.array([centre], dtype=float), radius=radius), inclusion)

    def _add(self, area: Area, inclusion: bool) -> None:
        (self.inclusions if inclusion else self.exclusions).append(area)


def find_fences(items: Sequence[Item]) -> Fences:
    """Collect the fences among mission items.

    Raises
    ------
    ObsplanError
        A polygon with a corner missing, a corner or a centre without a place, or a bad radius.
    """
    fences = Fences()
    i = 0
    while i < len(items):
        item = items[i]
        inclusion = item.command in INCLUSIONS
        length = 1
        if item.command in POLYGONS:
            ring = _ring(items, i)
            corners = [_corner(corner) for corner in ring]
            fences.add_polygon(corners, item.where, inclusion=inclusion)
            length = len(ring)
        elif item.command in CIRCLES:
            radius = item.value(1, "radius", 0.0, LARGEST_RADIUS)
            fences.add_circle(_corner(item), radius, item.where, inclusion=inclusion)
        i += length
    return fences


def _ring(items: Sequence[Item], start: int) -> Sequence[Item]:
    """Corners of the polygon that starts here: as many as the first says, all if it says none."""
    first = items[start]
    count = int(first.value(1, "number of corners", 0.0, _MOST_CORNERS))
    end = start + count if count else len(items)
    ring = list(takewhile(lambda item: item.command == first.command, items[start:end]))
    if len(ring) < count:
        raise ObsplanError(
            f"{first.where} begins a fence of {count} corners, of which {len(ring)} follow: "
            "save the fence again, or correct the number of corners (parameter 1)"
        )
    return ring


def _corner(item: Item) -> Point:
    """Place of a corner or a centre, which a fence must have."""
    position = item.position
    if position is None:
        raise ObsplanError(f"{item.where} is a part of a fence without a place: save it again")
    return position
