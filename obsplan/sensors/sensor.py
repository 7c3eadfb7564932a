"""What a sensor is."""

from typing import ClassVar, Protocol, runtime_checkable

import casadi as ca


@runtime_checkable
class Sensor(Protocol):
    """A scalar measurement with Gaussian error.

    It is a dataclass whose fields are keys of ``[ranging]``.
    """

    periodic: ClassVar[bool]  # whether the measurement is an angle [rad]

    @property
    def sigma(self) -> float:
        """Standard deviation that planners count on everywhere, in the unit of the measurement."""
        ...

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Measurement of state x (`STATES`, ...), the beacon at (east, north, heading)."""
        ...

    def deviation(self, x: ca.SX, beacon: ca.SX) -> ca.SX | float:
        """Standard deviation of its error there; positive."""
        ...
