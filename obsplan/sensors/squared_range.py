"""Squared range to the aid vehicle, the thesis's measurement."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import casadi as ca

from formulations.model.ranging import Ranging
from obsplan.quantities import SQUARED_RANGE_SIGMA


@dataclass(frozen=True, slots=True, kw_only=True)
class SquaredRange:
    """Squared horizontal distance [m^2] to a beacon of known position (thesis 4.1).

    Its error is Gaussian, of constant standard deviation.
    """

    periodic: ClassVar[bool] = False

    sigma: Annotated[float, "standard deviation of the square [m^2]", SQUARED_RANGE_SIGMA] = 1.0

    @property
    def ranging(self) -> Ranging:
        """What planners count on."""
        return Ranging(self.sigma, squared=True)

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Squared range [m^2] from state x to the beacon (east, north)."""
        return (x[0] - beacon[0]) ** 2 + (x[1] - beacon[1]) ** 2

    def deviation(self, x: ca.SX, beacon: ca.SX) -> float:  # noqa: ARG002 - the same everywhere
        """Standard deviation [m^2] of the squared range."""
        return self.sigma
