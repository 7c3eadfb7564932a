"""Squared range to the aid vehicle, the thesis's measurement."""

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, slots=True, kw_only=True)
class SquaredRange:
    """Squared horizontal distance [m^2] to a beacon of known position, Gaussian error of constant standard deviation (thesis 4.1)."""

    sigma: float  # [m^2]
    periodic: bool = False

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Squared range [m^2] from state x to the beacon (east, north)."""
        return (x[0] - beacon[0]) ** 2 + (x[1] - beacon[1]) ** 2
