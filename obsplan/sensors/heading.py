"""The AUV's compass."""

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, slots=True, kw_only=True)
class Heading:
    """Heading [rad] counter-clockwise from east, with Gaussian error; innovations are wrapped to half a turn."""

    sigma: float  # [rad]
    periodic: bool = True

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:  # noqa: ARG002 - every sensor has the same signature
        """Heading [rad] of state x; the beacon plays no part."""
        return x[2]
