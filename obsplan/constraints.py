"""Where the aid vehicle may be: keep-outs, a geofence, and its distance from the AUVs."""

import math
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, compress
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from formulations.model.arcs import arcs
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
MOVE_POINTS = 16  # at which the way to the next decision is held against the limits
LOITER_POINTS = 9  # at which a loiter in a current is held against the limits


class Stream(NamedTuple):
    """Water that carries the vehicle."""

    current: tuple[float, float] = (0.0, 0.0)  # east, north [m/s]
    turn: float = 0.0  # time [s] in which the vehicle sails its smallest circle

    def __bool__(self) -> bool:
        """Whether it flows."""
        return any(self.current)

    def drift(self, times: Float[np.ndarray, "*t"]) -> Float[np.ndarray, "*t 2"]:
        """How far [m] it has gone after times [s]."""
        return times[..., None] * np.array(self.current)

    def over_ground(
        self, places: Float[np.ndarray, "*batch T n"], times: Float[np.ndarray, " T"]
    ) -> Float[np.ndarray, "*batch T n"]:
        """Where places or poses in this water [m] are over ground at times from now [s]."""
        if not self:
            return places
        moved = places.copy()
        moved[..., :2] += self.drift(times)
        return moved


STILL = Stream()


def first_move_violation(
    constraints: Constraints,
    pose: Float[np.ndarray, "3"],
    turn_rates: Float[np.ndarray, " K"],
    *,
    speed: float,
    radius: float,
    interval: float,
    auvs: Callable[[Float[np.ndarray, " points"]], Float[np.ndarray, "points M 2"]],
    margin: Float[np.ndarray, " M"] | float = 0.0,
    stream: Stream = STILL,
    aids: int = 0,
) -> Float[np.ndarray, " K"]:
    """How far [m] each turn breaks a limit before the next decision, or without fail after it.

    A vehicle that cannot stop is safe for ever as long as one of its two smallest circles, with
    what it encloses, is within the fixed limits: turning on the free one keeps it free. These
    circles are the terminal safe set. So if the limiting turns are among the candidates and one
    circle is free now, some candidate always keeps within the fixed limits. In a current the
    circles are loiters (`loiter_violation`), which take finer steering than a candidate held until
    the next decision: there the last is not promised.

    It is preferred where no separation can be kept: whatever breaks a fixed limit counts as worse
    than the worst that does not. Distances change by no more than the vehicles move. Half of that
    between the points looked at is added, so that nothing between them is missed.

    Parameters
    ----------
    pose, turn_rates, speed, radius, interval
        Pose now (east, north [m], heading [rad]); candidates [rad/s]; speed [m/s]; smallest turning
        radius [m]; time until the next decision [s].
    auvs
        Positions of the AUVs [m] at times from now [s], over ground.
    margin
        By which separations are kept more than the limits say, per AUV [m].
    stream
        What carries the vehicle.
    aids
        How many of the last of ``auvs`` are other aid vehicles.
    """
    times = interval * np.arange(1, MOVE_POINTS + 1) / MOVE_POINTS
    poses = stream.over_ground(arcs(pose, turn_rates, speed, times), times)
    positions = poses[..., :2]
    half_step = 0.5 * (speed + math.hypot(*stream.current)) * interval / MOVE_POINTS
    centers, reach = _loiters(poses[:, -1], radius, stream)
    places = [positions, centers.reshape(len(centers), -1, 2)]
    away = constraints.fixed_violation(np.concatenate(places, axis=1))
    fixed = away[:, :MOVE_POINTS].max(axis=-1)
    if speed > 0 or stream:  # a vehicle at rest needs no circle
        loiters = away[:, MOVE_POINTS:].reshape(centers.shape[:-1]).max(axis=-1)
        fixed = np.maximum(fixed, (loiters + reach).min(axis=-1))
    known = auvs(np.append(0.0, times))
    strides = 0.5 * np.max(np.linalg.norm(np.diff(known, axis=0), axis=-1), axis=-1, initial=0.0)
    broken = constraints.separation_violation(positions, known[1:], margin, aids=aids)
    apart = np.max(broken + strides, axis=-1)
    worst = np.maximum(fixed, apart) + half_step
    return np.where(
        fixed + half_step > 0, worst + max(0.0, float(np.max(apart)) + half_step), worst
    )


def loiter_violation(
    constraints: Constraints,
    poses: Float[np.ndarray, "*batch 3"],
    radius: float,
    stream: Stream = STILL,
) -> Float[np.ndarray, "*batch 2"]:
    r"""How far the smallest circles left and right of poses are outside the fixed limits [m].

    A circle counts with what it encloses. In a current c it is carried, and the vehicle stays by
    heading upstream once a turn: it completes its turn until it heads upstream, in a time τ, goes
    straight on until it has made good the way :math:`c T` of a whole turn, which it then begins.
    All the while it is within the radius of the line

    .. math:: \text{centre} + s c, \quad τ - T \le s \le τ,

    which is what counts there.
    """
    centers, reach = _loiters(poses, radius, stream)
    return constraints.fixed_violation(centers).max(axis=-1) + reach


def _loiters(
    poses: Float[np.ndarray, "*batch 3"], radius: float, stream: Stream
) -> tuple[Float[np.ndarray, "*batch 2 points 2"], float]:
    """Points [m] about which the vehicle loiters left and right of poses, and within what."""
    left = radius * np.stack([-np.sin(poses[..., 2]), np.cos(poses[..., 2])], axis=-1)
    centers = poses[..., None, :2] + np.array([[1.0], [-1.0]]) * left[..., None, :]
    if not stream:
        return centers[..., None, :], radius
    current = np.array(stream.current)
    upstream = math.atan2(-current[1], -current[0])
    turns = np.stack([upstream - poses[..., 2], poses[..., 2] - upstream], axis=-1)
    until = np.remainder(turns / (2 * np.pi), 1.0) * stream.turn
    back = stream.turn * np.linspace(0.0, 1.0, LOITER_POINTS)
    since = until[..., None] - back
    between = 0.5 * math.hypot(*current) * stream.turn / (LOITER_POINTS - 1)
    return centers[..., None, :] + since[..., None] * current, radius + between
