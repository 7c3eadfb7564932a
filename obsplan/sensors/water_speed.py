"""A log: speed through the water."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import casadi as ca

from obsplan.quantities import LOG_SIGMA
from obsplan.sensors.sensor import Sensor


@dataclass(frozen=True, slots=True, kw_only=True)
class WaterSpeed:
    """Speed [m/s] through the water along the heading, with Gaussian error."""

    periodic: ClassVar[bool] = False

    sigma: Annotated[float, "standard deviation [m/s]", LOG_SIGMA] = 0.05

    def components(self, states: Sequence[str]) -> tuple[Sensor, ...]:  # noqa: ARG002
        """What is measured at once: one number, whatever the state holds besides."""
        return (self,)

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:  # noqa: ARG002
        """Speed [m/s] of state x; the beacon plays no part."""
        return x[3]

    def deviation(self, x: ca.SX, beacon: ca.SX) -> float:  # noqa: ARG002 - the same everywhere
        """Standard deviation [m/s]."""
        return self.sigma
