"""Motion of an AUV that follows a polyline over ground at a constant speed through the water."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from obsplan.quantities import AUV_SPEED, HOLD

SHORTEST_LEG = (
    1e-3  # [m]; below it two waypoints are one: a mission file resolves about 1 cm (1e-7 degrees)
)
SLOWEST, FASTEST = 1e-3, AUV_SPEED.greatest  # [m/s]; slower is a station


def check_polyline(polyline: Float[np.ndarray, "n 2"]) -> None:
    """Refuse a polyline that nothing can follow.

    Raises
    ------
    ValueError
        No vertex, a vertex that is not finite, or two consecutive ones closer than `SHORTEST_LEG`;
        names their indices, from 0.
    """
    if len(polyline) == 0:
        raise ValueError("the survey is empty: give it at least one point")
    bad = np.flatnonzero(~np.isfinite(polyline).all(axis=1))
    if bad.size:
        x, y = polyline[bad[0]]
        raise ValueError(
            f"waypoint {bad[0]} must be two finite numbers [m], got ({x}, {y}): correct it"
        )
    short = np.flatnonzero(np.hypot(*np.diff(polyline, axis=0).T) < SHORTEST_LEG)
    if short.size:
        i = short[0]
        x, y = polyline[i]
        raise ValueError(
            f"waypoints {i} and {i + 1} are identical, at ({x:.3f}, {y:.3f}) m: remove one of them"
        )


def check_speeds(speeds: Sequence[float] | np.ndarray, legs: int) -> None:
    """Refuse speeds through the water [m/s] other than one per leg, from `SLOWEST` to `FASTEST`.

    Raises
    ------
    ValueError
        Too few, too many, or one out of range; names its index, from 0.
    """
    if len(speeds) != legs:
        raise ValueError(
            f"speeds must be one for each of the {legs} legs, got {len(speeds)}: correct them"
        )
    for i, speed in enumerate(speeds):
        if not SLOWEST <= speed <= FASTEST:
            raise ValueError(
                f"speeds[{i}] must be from {SLOWEST} m/s, less being a station, to {FASTEST} m/s, "
                f"which no survey AUV exceeds, got {speed}: correct it, or give the AUV a speed, "
                "which then holds on every leg"
            )


def check_holds(holds: Sequence[float] | np.ndarray, vertices: int) -> None:
    """Refuse waiting times [s] that are not one for each vertex, in the range `HOLD`.

    Raises
    ------
    ValueError
        Too few, too many, or one out of range; names its index, from 0.
    """
    if len(holds) != vertices:
        raise ValueError(
            f"holds must be one for each of the {vertices} points, got {len(holds)}: correct them"
        )
    for i, hold in enumerate(holds):
        if hold not in HOLD:
            raise ValueError(
                f"holds[{i}] must be from 0 s to {HOLD.greatest:.0f} s, a day, got {hold}: "
                'correct it; to stay at a point for good use kind "static"'
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Sampled motion: p[k+1] = p[k] + (t[k+1] - t[k]) (V[k] (cos ψ[k], sin ψ[k]) + c), exactly.

    Heading and speed are those of the interval that begins at the sample. The last sample repeats
    those of the last interval.
    """

    time: Float[np.ndarray, " steps"]  # t [s]
    position: Float[np.ndarray, "steps 2"]  # p, east and north [m]
    # ψ [rad], counter-clockwise from east, continuous (not wrapped)
    heading: Float[np.ndarray, " steps"]
    speed: Float[np.ndarray, " steps"]  # V, through the water [m/s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    r"""Track held over ground in a uniform current, with sharp corners.

    On a leg of direction e, with n normal to it, the vehicle crabs so that its velocity over ground
    lies along e:

    .. math:: v_g = e \cdot c + \sqrt{V^2 - (n \cdot c)^2}

    It keeps station before time 0, while it holds at a vertex, and at the last one after
    `duration`: heading into the current, at the current's speed. Whether it could is not asked. A
    single vertex is a station kept throughout.

    Raises
    ------
    ValueError
        No speed on a survey that moves, or one that is not positive. Speeds or holds out of their
        bounds, or not one for each leg or vertex. A polyline that `check_polyline` refuses. A
        current too strong for a leg.
    """

    polyline: Float[np.ndarray, "n 2"]  # vertices, east and north [m]
    # V, through the water, of each leg or of all [m/s]; None only where nothing moves
    speed: Float[np.ndarray, " legs"] | float | None
    hold: Float[np.ndarray, " n"] | None = None  # time kept at each vertex [s]; None: none
    # c, east and north [m/s]
    current: Float[np.ndarray, " 2"] = field(default_factory=lambda: np.zeros(2))
    # in which it steers to keep to the track, where that is another than c [m/s]
    own_current: Float[np.ndarray, " 2"] | None = None
    initial_heading: float = 0.0  # [rad]; used until the vehicle first moves through the water

    def __post_init__(self):
        check_polyline(self.polyline)
        if not np.isfinite(self.current).all():
            raise ValueError(
                f"current must be two finite numbers [m/s], got {self.current.tolist()}"
            )
        if not math.isfinite(self.initial_heading):
            raise ValueError(f"initial_heading must be finite [rad], got {self.initial_heading}")
        if self.hold is not None:
            check_holds(self.hold, len(self.polyline))
        if len(self.polyline) > 1:
            self._check_speed()
            self._check_current()

    def _check_speed(self) -> None:
        if self.speed is None:
            raise ValueError("the survey moves and has no speed: give the AUV a speed [m/s]")
        if isinstance(self.speed, np.ndarray):
            check_speeds(self.speed, len(self.polyline) - 1)
        elif not SLOWEST <= self.speed <= FASTEST:
            raise ValueError(
                f"speed of a survey that moves must be from {SLOWEST} m/s, less being a station, "
                f"to {FASTEST} m/s, which no survey AUV exceeds, got {self.speed}: correct it"
            )

    def _check_current(self) -> None:
        along, across = self._current_on_legs()
        stuck = np.flatnonzero(~((np.abs(across) < self._speeds) & (self.ground_speed > 0)))
        if stuck.size:
            i = stuck[0]
            heading = math.degrees(math.atan2(*self._legs()[i, ::-1]))
            raise ValueError(
                f"current {self.current.tolist()} m/s is too strong for leg {i}, heading "
                f"{heading:.1f} degrees (from east), at {self._speeds[i]} m/s through the water "
                f"(it sets {abs(across[i]):.3g} m/s across and {along[i]:+.3g} m/s along): give a "
                "higher speed, a weaker current, or legs along the current"
            )

    def _legs(self) -> Float[np.ndarray, "legs 2"]:
        return np.diff(self.polyline, axis=0)

    @property
    def _speeds(self) -> Float[np.ndarray, " legs"]:
        """Speed through the water on each leg [m/s]."""
        return np.broadcast_to(np.asarray(self.speed, dtype=float), len(self.polyline) - 1)

    def _current_on_legs(self) -> tuple[Float[np.ndarray, " legs"], Float[np.ndarray, " legs"]]:
        """Components of the current along each leg and to its left [m/s]."""
        legs = self._legs()
        e = legs / np.hypot(legs[:, 0], legs[:, 1])[:, None]
        return e @ self.current, e[:, 0] * self.current[1] - e[:, 1] * self.current[0]

    @property
    def ground_speed(self) -> Float[np.ndarray, " legs"]:
        """Speed over ground on each leg [m/s]; not above 0 where the current prevails."""
        along, across = self._current_on_legs()
        return along + np.sqrt(np.maximum(self._speeds**2 - across**2, 0.0))

    @cached_property
    def _arrival_and_departure(self) -> Float[np.ndarray, "n 2"]:
        """Instants [s] at which each vertex is reached and left."""
        legs = self._legs()
        n = len(self.polyline)
        spent = np.zeros((n, 2))  # on the leg before each vertex, and at it
        spent[1:, 0] = np.hypot(legs[:, 0], legs[:, 1]) / self.ground_speed
        spent[:, 1] = 0.0 if self.hold is None else self.hold
        return np.cumsum(spent).reshape(n, 2)

    @property
    def arrival(self) -> Float[np.ndarray, " n"]:
        """Instants at which the vertices are reached [s], the first one at 0."""
        return self._arrival_and_departure[:, 0]

    @property
    def departure(self) -> Float[np.ndarray, " n"]:
        """Instants [s] at which the vertices are left; without holds those of `arrival`."""
        return self._arrival_and_departure[:, 1]

    @property
    def duration(self) -> float:
        """Time [s] from reaching the first vertex to leaving the last; 0 for an endless station."""
        return float(self.departure[-1])

    @cached_property
    def _knots(self) -> tuple[Float[np.ndarray, " knots"], Float[np.ndarray, "knots 2"]]:
        """Instants [s] between which the motion over ground is uniform, and positions [m] then."""
        distinct = np.ones((len(self.polyline), 2), dtype=bool)
        distinct[:, 1] = self.departure > self.arrival  # interpolation takes no instant twice
        return self._arrival_and_departure[distinct], np.repeat(
            self.polyline, distinct.sum(axis=1), axis=0
        )

    def position(self, time: Float[np.ndarray, "*t"] | float) -> Float[np.ndarray, "*t 2"]:
        """Position [m] at instants [s]: the first vertex before 0, the last after `duration`."""
        instants, positions = self._knots
        return np.stack(
            [
                np.interp(time, instants, positions[:, 0]),
                np.interp(time, instants, positions[:, 1]),
            ],
            axis=-1,
        )

    def depth(
        self, time: Float[np.ndarray, " t"], depths: float | Sequence[float]
    ) -> Float[np.ndarray, " t"]:
        """Depth [m] at instants [s]: one throughout, or one at each vertex and even between them.

        Raises
        ------
        ValueError
            Not as many depths as there are vertices.
        """
        if isinstance(depths, int | float):
            return np.full(time.shape, float(depths))
        if len(depths) != len(self.polyline):
            raise ValueError(
                f"must be one for each of the {len(self.polyline)} points of the survey, got "
                f"{len(depths)}: correct it, or give one number"
            )
        instants = self._arrival_and_departure.ravel()
        return np.interp(time, instants, np.repeat(np.asarray(depths, dtype=float), 2))

    def sample(self, time: Float[np.ndarray, " steps"]) -> Motion:
        """Sample the motion at increasing instants [s], as a vehicle steered piecewise constant.

        In an interval that holds a corner the vehicle takes the chord: it meets the track again at
        the next sample. Where it does not move through the water it keeps its last heading.

        Raises
        ------
        ValueError
            Fewer than two instants, or not increasing.
        """
        dt = np.diff(time)
        if not (dt.size and np.all(dt > 0)):
            raise ValueError(
                f"time must be at least two increasing instants [s], got {time.size} of them"
            )
        position = self.position(time)
        current = self.current if self.own_current is None else self.own_current
        water = np.diff(position, axis=0) / dt[:, None] - current
        speed = np.hypot(water[:, 0], water[:, 1])
        heading = self._continuous_heading(np.arctan2(water[:, 1], water[:, 0]), speed > 0)
        return Motion(
            time=time,
            position=position,
            heading=np.append(heading, heading[-1]),
            speed=np.append(speed, speed[-1]),
        )

    def _continuous_heading(
        self, heading: Float[np.ndarray, " k"], moving: np.ndarray
    ) -> Float[np.ndarray, " k"]:
        """Headings without jumps of a turn, each rest taking the heading before it."""
        last_moving = np.maximum.accumulate(np.where(moving, np.arange(heading.size), -1))
        held = np.where(last_moving < 0, self.initial_heading, heading[last_moving])
        return np.unwrap(held)
