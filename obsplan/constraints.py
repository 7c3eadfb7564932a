"""Where the aid vehicle may be: keep-outs, a geofence, and its distance from the AUVs."""

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, compress
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from formulations.model.areas import Outline, outline_of, signed_distance
from obsplan.types import Points, as_points

CORNERS = 32  # of the polygon that stands for a disc where only straight edges will do


@dataclass(frozen=True, slots=True, kw_only=True)
class Disc:
    """Round area.

    Raises
    ------
    ValueError
        A number that is not finite, or a radius that is not positive.
    """

    x: float  # east [m]
    y: float  # north [m]
    radius: float  # [m]

    def __post_init__(self) -> None:
        if not (np.isfinite([self.x, self.y]).all() and 0 < self.radius < np.inf):
            raise ValueError(
                f"a disc needs a finite centre and a positive radius [m], got ({self.x}, "
                f"{self.y}) and {self.radius}"
            )

    def signed_distance(
        self, positions: Float[np.ndarray, "*batch 2"]
    ) -> Float[np.ndarray, "*batch"]:
        """Distance [m] to the edge, negative inside."""
        return np.hypot(positions[..., 0] - self.x, positions[..., 1] - self.y) - self.radius

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Least and greatest coordinates [m]: west, south, east, north."""
        r = self.radius
        return self.x - r, self.y - r, self.x + r, self.y + r

    def inscribed(self) -> "Polygon":
        """The regular polygon with `CORNERS` corners on the edge.

        It lies within the disc, by at most 0.5 % of its radius.
        """
        angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
        corners = np.array([self.x, self.y]) + self.radius * np.column_stack(
            [np.cos(angles), np.sin(angles)]
        )
        return Polygon(points=tuple((x, y) for x, y in corners.tolist()))

    def misses(self, legs: Float[np.ndarray, "n 2 2"]) -> Bool[np.ndarray, " n"]:
        """Whether straight legs, from their first to their second place, stay outside."""
        import shapely

        centre = shapely.Point(self.x, self.y)
        return np.asarray(shapely.distance(centre, shapely.linestrings(legs)) >= self.radius)

    def holds(self, legs: Float[np.ndarray, "n 2 2"]) -> Bool[np.ndarray, " n"]:
        """Whether straight legs stay inside."""
        return np.asarray((self.signed_distance(legs) <= 0).all(axis=-1))


@dataclass(frozen=True, kw_only=True)
class Polygon:
    """Area within a closed line of corners (east, north [m]), convex or not.

    Raises
    ------
    ValueError
        Fewer than three corners, one that is not two numbers, or a line that crosses itself.
    """

    points: Points  # n x 2; kept as tuples

    def __post_init__(self) -> None:
        points = as_points(self.points)
        object.__setattr__(self, "points", points)
        if len(points) < 3:
            raise ValueError(f"a polygon needs at least three corners, got {len(points)}: add some")
        if not (np.isfinite(points).all() and self._shape.is_valid and self._shape.area > 0):
            raise ValueError(
                "the line of a polygon must be finite, enclose an area and not cross itself, got "
                f"{reprlib.repr(list(points))}: correct its corners"
            )

    @cached_property
    def _shape(self) -> Any:
        import shapely

        shape = shapely.Polygon(self.points)
        shapely.prepare(shape)
        return shape

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Least and greatest coordinates [m]: west, south, east, north."""
        east, north = zip(*self.points, strict=True)
        return min(east), min(north), max(east), max(north)

    @cached_property
    def outline(self) -> Outline:
        """Its closed line, with what is known of the edges."""
        return outline_of(np.array(self.points))

    def signed_distance(
        self, positions: Float[np.ndarray, "*batch 2"]
    ) -> Float[np.ndarray, "*batch"]:
        """Distance [m] to the edge, negative inside."""
        return signed_distance(positions, self.outline)

    def misses(self, legs: Float[np.ndarray, "n 2 2"]) -> Bool[np.ndarray, " n"]:
        """Whether straight legs, from their first to their second place, stay outside."""
        import shapely

        return ~shapely.intersects(self._shape, shapely.linestrings(legs))

    def holds(self, legs: Float[np.ndarray, "n 2 2"]) -> Bool[np.ndarray, " n"]:
        """Whether straight legs stay inside."""
        import shapely

        return shapely.covers(self._shape, shapely.linestrings(legs))


ROUNDING = 1e-3  # [m]: a limit overstepped by less is kept


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitHistory:
    """How one limit was kept, or broken, along a path."""

    name: str  # as people say it: keep-out 2, the geofence, least separation from auv-1
    aid: int = 0  # whose path it limits: the number of the aid vehicle
    violation: Float[np.ndarray, " samples"]  # how far [m] it is broken; at most 0 where it is kept
    auv: int | None = None  # whose separation it limits; None of a keep-out or the geofence
    distance: float | None = None  # the least or greatest separation [m]

    @property
    def worst(self) -> int:
        """Sample at which it is broken most, or comes nearest to being broken."""
        return int(np.argmax(self.violation))

    @property
    def broken(self) -> Bool[np.ndarray, " samples"]:
        """Where it is broken, by more than rounding."""
        return self.violation > ROUNDING


@dataclass(frozen=True, kw_only=True)
class Constraints:
    """Limits on an aid vehicle's position; all distances in metres.

    Raises
    ------
    ValueError
        A separation that is negative, or a least one above the greatest.
    """

    keep_out: tuple[Disc | Polygon, ...] = ()
    geofence: Disc | Polygon | None = None
    min_separation: float = 0.0
    max_separation: float = float("inf")
    min_separation_cna: float = 0.0  # from any other aid vehicle

    def __post_init__(self) -> None:
        if not 0 <= self.min_separation < self.max_separation:
            raise ValueError(
                f"separations must be 0 <= least < greatest [m], got {self.min_separation} and "
                f"{self.max_separation}: correct one of them"
            )
        if not 0 <= self.min_separation_cna < np.inf:
            raise ValueError(
                "the least separation of aid vehicles must be finite and at least 0 [m], got "
                f"{self.min_separation_cna}"
            )

    def __bool__(self) -> bool:
        """Whether anything is limited."""
        return self != UNLIMITED

    def fixed_violation(
        self, positions: Float[np.ndarray, "*batch 2"]
    ) -> Float[np.ndarray, "*batch"]:
        """How far [m] positions are inside a keep-out or outside the geofence.

        At most 0 where they are neither; -inf where there is no keep-out and no geofence.
        """
        worst = np.full(positions.shape[:-1], -np.inf)
        for area, sign in self.areas:
            worst = np.maximum(worst, sign * area.signed_distance(positions))
        return worst

    @property
    def areas(self) -> list[tuple[Disc | Polygon, float]]:
        """Each keep-out and, last, the geofence, with a sign.

        It turns the distance from the edge into a violation.
        """
        areas = [(area, -1.0) for area in self.keep_out]
        return areas if self.geofence is None else [*areas, (self.geofence, 1.0)]

    def histories(
        self,
        path: Float[np.ndarray, "samples 2"],
        separation: Float[np.ndarray, "auvs samples"],
        names: Sequence[str],
    ) -> tuple[LimitHistory, ...]:
        """How each limit by itself is kept along a path.

        Parameters
        ----------
        path
            Positions of the aid vehicle [m].
        separation
            Its distance from each AUV [m].
        names
            Of the AUVs.
        """
        labels = [f"keep-out {k}" for k in range(1, len(self.keep_out) + 1)]
        if self.geofence is not None:
            labels.append("the geofence")
        told = [
            LimitHistory(name=name, violation=sign * area.signed_distance(path))
            for name, (area, sign) in zip(labels, self.areas, strict=True)
        ]
        for i, name in enumerate(names):
            if self.min_separation > 0:
                least = LimitHistory(
                    name=f"least separation from {name}",
                    violation=self.min_separation - separation[i],
                    auv=i,
                    distance=self.min_separation,
                )
                told.append(least)
            if np.isfinite(self.max_separation):
                greatest = LimitHistory(
                    name=f"greatest separation from {name}",
                    violation=separation[i] - self.max_separation,
                    auv=i,
                    distance=self.max_separation,
                )
                told.append(greatest)
        return tuple(told)

    def between(
        self, paths: Sequence[Float[np.ndarray, "samples 2"]], names: Sequence[str]
    ) -> tuple[LimitHistory, ...]:
        """How the least distance between any two aid vehicles is kept along their paths [m]."""
        least, found = self.min_separation_cna, []
        for one, other in combinations(range(len(paths)) if least > 0 else (), 2):
            distance = np.hypot(*(paths[one] - paths[other]).T)
            history = LimitHistory(
                name=f"least separation of {names[other]} from {names[one]}",
                violation=least - distance,
                aid=other,
                distance=least,
            )
            found.append(history)
        return tuple(found)

    def keeps_legs(self, legs: Float[np.ndarray, "n 2 2"]) -> Bool[np.ndarray, " n"]:
        """Whether straight legs between two places keep out and within the geofence."""
        kept = (
            np.ones(len(legs), dtype=bool) if self.geofence is None else self.geofence.holds(legs)
        )
        for area in self.keep_out:
            kept &= area.misses(legs)
        return kept

    def separation_violation(
        self,
        positions: Float[np.ndarray, "*batch 2"],
        auvs: Float[np.ndarray, "*#batch M 2"],
        margin: Float[np.ndarray, " M"] | float = 0.0,
        *,
        aids: int = 0,
    ) -> Float[np.ndarray, "*batch"]:
        """How far [m] positions are from a permitted distance to every AUV; at most 0 if right.

        A margin [m] is kept from each AUV. The last so many of them, ``aids``, are other aid
        vehicles.
        """
        if not (aids or self.separates):
            return np.full(positions.shape[:-1], -np.inf)
        way = positions[..., None, :] - auvs
        distance = np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2)
        neighbours = distance.shape[-1]
        is_aid = np.arange(neighbours) >= neighbours - aids
        nearest = self.min_separation or -np.inf
        least = np.where(is_aid, self.min_separation_cna, nearest)
        broken = distance - np.where(is_aid, np.inf, self.max_separation)
        if (least > 0).any():
            broken = np.maximum(least - distance, broken)
        return np.max(broken + margin, axis=-1, initial=-np.inf)

    @property
    def separates(self) -> bool:
        """Whether distances to AUVs are limited."""
        return self.min_separation > 0 or self.max_separation < np.inf

    def violation(
        self,
        positions: Float[np.ndarray, "*batch 2"],
        auvs: Float[np.ndarray, "*#batch M 2"],
        margin: Float[np.ndarray, " M"] | float = 0.0,
        *,
        aids: int = 0,
    ) -> Float[np.ndarray, "*batch"]:
        """How far [m] positions break a limit, 0 where they keep all.

        It changes by no more than the vehicles move.

        The last axis of the batch is a path, of which the middle is looked at first.
        """
        apart = self.separation_violation(positions, auvs, margin, aids=aids)
        broken = np.maximum(apart, 0.0)
        if positions.ndim < 3:
            return np.maximum(broken, self.fixed_violation(positions))
        middle = positions[..., positions.shape[-2] // 2, :]
        way = positions - middle[..., None, :]
        reach = np.sqrt(np.max(way[..., 0] ** 2 + way[..., 1] ** 2, axis=-1)) + ROUNDING
        for area, sign in self._areas_near(positions):
            near = sign * area.signed_distance(middle) > -reach  # no other path can break it
            if near.any():
                there = sign * area.signed_distance(positions[near])
                broken[near] = np.maximum(broken[near], there)
        return broken

    def _areas_near(
        self, positions: Float[np.ndarray, "*batch 2"]
    ) -> list[tuple[Disc | Polygon, float]]:
        """Those of the areas that some position may break."""
        x, y = positions[..., 0], positions[..., 1]
        west, south, east, north = self._boxes
        meets_east = (west <= x.max(initial=-np.inf)) & (east >= x.min(initial=np.inf))
        meets_north = (south <= y.max(initial=-np.inf)) & (north >= y.min(initial=np.inf))
        return list(compress(self.areas, (meets_east & meets_north).tolist()))

    @cached_property
    def _boxes(self) -> Float[np.ndarray, "4 areas"]:
        """West, south, east and north ends of where each area can be broken.

        A keep-out can be broken only inside it, the geofence anywhere.
        """
        anywhere = (-np.inf, -np.inf, np.inf, np.inf)
        boxes = [area.box if sign < 0 else anywhere for area, sign in self.areas]
        return np.array(boxes).reshape(-1, 4).T


UNLIMITED = Constraints()
