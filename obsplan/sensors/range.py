"""Acoustic range to the aid vehicle, or to a beacon."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import casadi as ca
import numpy as np

from formulations.model.ranging import (
    Ends,
    Ranging,
    mean_sound_speed,
    one_way_time,
    slant,
    travelled,
    two_way_time,
)
from obsplan.quantities import (
    DEPTH,
    DEPTH_SIGMA,
    GROWTH,
    RANGE_SIGMA,
    SOUND_SPEED,
    TIME_SIGMA,
    TURNAROUND,
    check_choices,
)
from obsplan.sensors.sensor import BEACON


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Distance [m] to a beacon of known position, with Gaussian error.

    By default it is horizontal and of one instant: a slant range is taken to be reduced to the
    horizontal with the AUV's depth, which it measures well (thesis 2.2). Otherwise it is what the
    sound travelled: between both depths, and while both vehicles moved. The instrument makes a
    distance of the time by the speed of sound it assumes (2.10, 2.11).

    Raises
    ------
    ValueError
        A sound-speed profile whose depths do not increase, or a speed out of range.
    """

    periodic: ClassVar[bool] = False

    sigma: Annotated[float, "standard deviation at no distance [m]", RANGE_SIGMA] = 1.0
    growth: Annotated[
        float, "of the standard deviation with distance [m/m]; variances add", GROWTH
    ] = 0.0
    geometry: Annotated[
        Literal["horizontal", "slant"], "whether depths are reduced before, or count"
    ] = "horizontal"
    timing: Annotated[
        Literal["instant", "one-way", "two-way"],
        "instant; from sending to receiving by synchronised clocks; or ping and reply",
    ] = "instant"
    sound_speed: Annotated[float, "true speed of sound [m/s]", SOUND_SPEED] = 1500.0
    profile: Annotated[
        tuple[tuple[Annotated[float, DEPTH], Annotated[float, SOUND_SPEED]], ...],
        "true speeds of sound by depth, each [depth m, speed m/s]; instead of sound_speed",
    ] = ()
    assumed_sound_speed: Annotated[
        float | None, "by which times are made distances [m/s]; default: the true one", SOUND_SPEED
    ] = None
    turn_around: Annotated[
        float, "from being asked to the reply, of two-way ranges [s]", TURNAROUND
    ] = 0.0
    turn_around_sigma: Annotated[float, "standard deviation of that [s]", TIME_SIGMA] = 0.0
    depth_sigma: Annotated[
        float, "standard deviation of the AUV's measured depth, of slant ranges [m]", DEPTH_SIGMA
    ] = 0.0

    def __post_init__(self) -> None:
        check_choices(self)
        depths = [depth for depth, _ in self.profile]
        for above, below in pairwise(depths):
            if not above < below:
                raise ValueError(
                    f"profile must have increasing depths, got {below} after {above}: order it"
                )
        for depth, speed in self.profile:
            if speed not in SOUND_SPEED or depth not in DEPTH:
                raise ValueError(
                    f"profile must have depths {DEPTH} and speeds {SOUND_SPEED}, "
                    f"got [{depth}, {speed}]: correct it"
                )

    @property
    def ranging(self) -> Ranging:
        """What planners count on."""
        return Ranging(self._at_once, growth=self.growth, slant=self.geometry == "slant")

    @property
    def _at_once(self) -> float:
        """Standard deviation at no distance, that of the reply's delay in it [m]."""
        if self.timing != "two-way" or not self.turn_around_sigma:
            return self.sigma
        return float(np.hypot(self.sigma, self.usual_sound_speed * self.turn_around_sigma / 2))

    @property
    def usual_sound_speed(self) -> float:
        """Speed by which the instrument makes distances of times [m/s]; a profile's mean."""
        if self.assumed_sound_speed is not None or not self.profile:
            return self.assumed_sound_speed or self.sound_speed
        return float(mean_sound_speed(self.profile, self.profile[0][0], self.profile[-1][0]))

    @property
    def at_rest(self) -> "Range":
        """The same as if nothing moved while the sound travels, at its true speed."""
        return Range(
            sigma=self._at_once,
            growth=self.growth,
            geometry=self.geometry,
            depth_sigma=self.depth_sigma,
        )

    @property
    def is_plain(self) -> bool:
        """Whether it is horizontal, of one instant, and of constant standard deviation."""
        return self._is_distance and not self.growth

    @property
    def _is_distance(self) -> bool:
        assumed = self.assumed_sound_speed in (None, self.sound_speed) and not self.profile
        return self.geometry == "horizontal" and self.timing == "instant" and assumed

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Range [m] from state x to the beacon (`BEACON`)."""
        if self._is_distance:
            squared = (x[0] - beacon[0]) ** 2 + (x[1] - beacon[1]) ** 2
            apart = squared > 0
            # the root of a safe argument: at coincidence the derivative is 0 (no direction, no
            # information), not nan
            return ca.if_else(apart, ca.sqrt(ca.if_else(apart, squared, 1.0)), 0.0)
        return travelled(self._assumed(beacon), self.travel_time(x, beacon))

    def travel_time(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """One-way travel time [s] of the sound that the AUV hears in state x."""
        ends, speed = self._ends(x, beacon), self._sound_speed(beacon)
        if self.timing == "one-way":
            return one_way_time(ends, speed)
        if self.timing == "two-way":
            return two_way_time(ends, speed, self.turn_around)
        apart = ends.receiver - ends.sender
        return slant(ca.sumsqr(apart), ends.receiver_depth - ends.sender_depth) / speed

    def _ends(self, x: ca.SX, beacon: ca.SX) -> Ends:
        """The AUV that hears the beacon."""
        at = dict(zip(BEACON, ca.vertsplit(beacon), strict=True))
        current = ca.vertcat(at["east_current"], at["north_current"])
        flat = self.geometry == "horizontal"
        return Ends(
            receiver=x[:2],
            receiver_velocity=x[3] * ca.vertcat(ca.cos(x[2]), ca.sin(x[2])) + current,
            receiver_depth=0.0 if flat else at["auv_depth"],
            sender=beacon[:2],
            sender_velocity=ca.vertcat(at["east_velocity"], at["north_velocity"]),
            sender_turn_rate=at["turn_rate"],
            sender_depth=0.0 if flat else at["depth"],
        )

    def _sound_speed(self, beacon: ca.SX) -> ca.SX | float:
        """True mean speed of sound on the way [m/s]."""
        if not self.profile:
            return self.sound_speed
        top, bottom = BEACON.index("depth"), BEACON.index("auv_depth")
        return mean_sound_speed(self.profile, beacon[top], beacon[bottom])

    def _assumed(self, beacon: ca.SX) -> ca.SX | float:
        """Speed of sound by which the instrument makes a distance of a time [m/s]."""
        return self.assumed_sound_speed or self._sound_speed(beacon)

    def deviation(self, x: ca.SX, beacon: ca.SX) -> ca.SX | float:
        """Standard deviation [m] of the range from state x to the beacon."""
        steep = self.geometry == "slant" and self.depth_sigma > 0
        if not self.growth and not steep:
            return self._at_once
        r = self.measure(x, beacon)
        variance = self._at_once**2 + (self.growth * r) ** 2
        if steep:
            height = beacon[BEACON.index("auv_depth")] - beacon[BEACON.index("depth")]
            variance += (self.depth_sigma * height / ca.fmax(r, 1.0)) ** 2
        return ca.sqrt(variance)
