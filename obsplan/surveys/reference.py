"""Motion of an AUV that follows a polyline over ground at a constant speed through the water."""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

SHORTEST_LEG = (
    1e-3  # [m]; below it two waypoints are one: a mission file resolves about 1 cm (1e-7 degrees)
)


def check_polyline(polyline: Float[np.ndarray, "n 2"]) -> None:
    """Refuse a polyline that nothing can follow.

    Raises
    ------
    ValueError
        No vertex, a vertex that is not finite, or two consecutive ones closer than `SHORTEST_LEG`; names their indices, from 0.
    """
    if len(polyline) == 0:
        raise ValueError("the survey is empty: give it at least one point")
    bad = np.flatnonzero(~np.isfinite(polyline).all(axis=1))
    if bad.size:
        x, y = polyline[bad[0]]
        raise ValueError(f"waypoint {bad[0]} must be two finite numbers [m], got ({x}, {y})")
    short = np.flatnonzero(np.hypot(*np.diff(polyline, axis=0).T) < SHORTEST_LEG)
    if short.size:
        i = short[0]
        x, y = polyline[i]
        raise ValueError(
            f"waypoints {i} and {i + 1} are identical, at ({x:.3f}, {y:.3f}) m: remove one of them"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Sampled motion: p[k+1] = p[k] + (t[k+1] - t[k]) (V[k] (cos ψ[k], sin ψ[k]) + c), exactly.

    Heading and speed are those of the interval that begins at the sample; the last sample repeats the last interval.
    """

    time: Float[np.ndarray, " steps"]  # t [s]
    position: Float[np.ndarray, "steps 2"]  # p, east and north [m]
    heading: Float[
        np.ndarray, " steps"
    ]  # ψ [rad], counter-clockwise from east, continuous (not wrapped)
    speed: Float[np.ndarray, " steps"]  # V, through the water [m/s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    r"""Track held over ground in a uniform current, with sharp corners.

    On a leg of direction e, with n normal to it, the vehicle crabs so that its velocity over ground lies along e:

    .. math:: v_g = e \cdot c + \sqrt{V^2 - (n \cdot c)^2}

    Before time 0 it waits at the first vertex, and after `duration` it keeps station at the last (heading into the current, at the
    current's speed; whether it could is not asked). A single vertex is a station kept throughout.

    Raises
    ------
    ValueError
        Speed not positive on a survey that moves, a polyline `check_polyline` refuses, or a current too strong for a leg.
    """

    polyline: Float[np.ndarray, "n 2"]  # vertices, east and north [m]
    speed: float  # V, through the water [m/s]
    current: Float[np.ndarray, " 2"] = field(
        default_factory=lambda: np.zeros(2)
    )  # c, east and north [m/s]
    initial_heading: float = 0.0  # [rad]; used until the vehicle first moves through the water

    def __post_init__(self):
        check_polyline(self.polyline)
        if not np.isfinite(self.current).all():
            raise ValueError(
                f"current must be two finite numbers [m/s], got {self.current.tolist()}"
            )
        if not math.isfinite(self.initial_heading):
            raise ValueError(f"initial_heading must be finite [rad], got {self.initial_heading}")
        if len(self.polyline) > 1:
            if not 0 < self.speed < math.inf:
                raise ValueError(
                    f"speed of a survey that moves must be positive and finite [m/s], got {self.speed}"
                )
            self._check_current()

    def _check_current(self) -> None:
        along, across = self._current_on_legs()
        stuck = np.flatnonzero(~((np.abs(across) < self.speed) & (self.ground_speed > 0)))
        if stuck.size:
            i = stuck[0]
            heading = math.degrees(math.atan2(*self._legs()[i, ::-1]))
            raise ValueError(
                f"current {self.current.tolist()} m/s is too strong for leg {i}, heading {heading:.1f} degrees (from east), "
                f"at {self.speed} m/s through the water (it sets {abs(across[i]):.3g} m/s across and {along[i]:+.3g} m/s along): "
                "give a higher speed, a weaker current, or legs along the current"
            )

    def _legs(self) -> Float[np.ndarray, "legs 2"]:
        return np.diff(self.polyline, axis=0)

    def _current_on_legs(self) -> tuple[Float[np.ndarray, " legs"], Float[np.ndarray, " legs"]]:
        """Components of the current along each leg and to its left [m/s]."""
        legs = self._legs()
        e = legs / np.hypot(legs[:, 0], legs[:, 1])[:, None]
        return e @ self.current, e[:, 0] * self.current[1] - e[:, 1] * self.current[0]

    @property
    def ground_speed(self) -> Float[np.ndarray, " legs"]:
        """Speed over ground on each leg [m/s]; not above 0 where the current prevails."""
        along, across = self._current_on_legs()
        return along + np.sqrt(np.maximum(self.speed**2 - across**2, 0.0))

    @property
    def arrival(self) -> Float[np.ndarray, " n"]:
        """Instants at which the vertices are reached [s], the first one at 0."""
        legs = self._legs()
        return np.concatenate(
            [[0.0], np.cumsum(np.hypot(legs[:, 0], legs[:, 1]) / self.ground_speed)]
        )

    @property
    def duration(self) -> float:
        """Time from the first vertex to the last [s]; 0 for a station."""
        return float(self.arrival[-1])

    def position(self, time: Float[np.ndarray, "*t"] | float) -> Float[np.ndarray, "*t 2"]:
        """Position [m] at any instants [s]: the first vertex before 0, the last one after `duration`."""
        arrival = self.arrival
        return np.stack(
            [
                np.interp(time, arrival, self.polyline[:, 0]),
                np.interp(time, arrival, self.polyline[:, 1]),
            ],
            axis=-1,
        )

    def sample(self, time: Float[np.ndarray, " steps"]) -> Motion:
        """Sample the motion at increasing instants [s], as what a vehicle steering piecewise constant would do.

        In an interval that holds a corner the vehicle takes the chord: it meets the track again at the next sample.
        Where it does not move through the water it keeps its last heading.

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
        water = np.diff(position, axis=0) / dt[:, None] - self.current
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
