"""Acoustic range to the aid vehicle."""

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Horizontal distance [m] to a beacon of known position, with Gaussian error of constant standard deviation.

    A slant range is taken to be reduced to the horizontal with the AUV's depth, which it measures well (thesis 2.2).
    """

    sigma: float  # [m]
    periodic: bool = False

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Range [m] from state x to the beacon (east, north)."""
        squared = (x[0] - beacon[0]) ** 2 + (x[1] - beacon[1]) ** 2
        apart = squared > 0
        # the root of a safe argument: at coincidence the derivative is 0 (no direction, no information), not nan
        return ca.if_else(apart, ca.sqrt(ca.if_else(apart, squared, 1.0)), 0.0)
