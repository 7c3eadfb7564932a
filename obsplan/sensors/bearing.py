"""Bearings that come with ranges: ultra-short baselines."""

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca


@dataclass(frozen=True, slots=True, kw_only=True)
class Bearing:
    """Direction [rad] between beacon and AUV, with Gaussian error (USBL; thesis, appendix A).

    A beacon measures it to the AUV, in the world's frame, since it knows its own heading well. An
    AUV with the array (inverted USBL) measures it to the beacon, relative to its own bow.
    """

    periodic: ClassVar[bool] = True

    sigma: float  # [rad]
    from_auv: bool = False

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Bearing [rad] counter-clockwise, from east or from the AUV's bow."""
        east, north = x[0] - beacon[0], x[1] - beacon[1]
        if self.from_auv:
            return ca.atan2(-north, -east) - x[2]
        return ca.atan2(north, east)

    def deviation(self, x: ca.SX, beacon: ca.SX) -> float:  # noqa: ARG002 - the same everywhere
        """Standard deviation [rad]."""
        return self.sigma
