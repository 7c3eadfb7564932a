"""Acoustic range to the aid vehicle."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import casadi as ca

from formulations.model.covariance import deviation
from obsplan.quantities import RANGE_SIGMA


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Horizontal distance [m] to a beacon of known position, with Gaussian error.

    Its standard deviation is constant. A slant range is taken to be reduced to the horizontal with
    the AUV's depth, which it measures well (thesis 2.2).
    """

    periodic: ClassVar[bool] = False

    sigma: Annotated[float, "standard deviation [m]", RANGE_SIGMA] = 1.0

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Range [m] from state x to the beacon (east, north)."""
        squared = (x[0] - beacon[0]) ** 2 + (x[1] - beacon[1]) ** 2
        apart = squared > 0
        # the root of a safe argument: at coincidence the derivative is 0 (no direction, no
        # information), not nan
        return ca.if_else(apart, ca.sqrt(ca.if_else(apart, squared, 1.0)), 0.0)

    def deviation(self, x: ca.SX, beacon: ca.SX) -> ca.SX | float:
        """Standard deviation [m] of the range from state x to the beacon."""
        return deviation(self.sigma, beacon[:2] - x[:2])
