"""The AUV's compass."""

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca


@dataclass(frozen=True, slots=True, kw_only=True)
class Heading:
    """Heading [rad] counter-clockwise from east, with Gaussian error; innovations are wrapped."""

    periodic: ClassVar[bool] = True

    sigma: float  # [rad]

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:  # noqa: ARG002
        """Heading [rad] of state x; the beacon plays no part."""
        return x[2]

    def deviation(self, x: ca.SX, beacon: ca.SX) -> float:  # noqa: ARG002 - as `measure`
        """Standard deviation [rad], the same everywhere."""
        return self.sigma
