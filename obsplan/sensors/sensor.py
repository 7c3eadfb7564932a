"""What a sensor is."""

from collections.abc import Sequence
from typing import ClassVar, Protocol, runtime_checkable

import casadi as ca

from formulations.model.ranging import Ranging

# What a sensor is told of the vehicle that it ranges to, and of the water: position [m], heading
# [rad], velocity over ground [m/s], turn rate [rad/s], depths of both transducers [m], and the
# current at the AUV [m/s].
BEACON = (
    *("east", "north", "heading"),
    *("east_velocity", "north_velocity", "turn_rate"),
    *("depth", "auv_depth"),
    *("east_current", "north_current"),
)


@runtime_checkable
class Sensor(Protocol):
    """A scalar measurement with Gaussian error.

    It is a dataclass whose fields are keys of ``[ranging]``. One that has a property ``ranging``, a
    `formulations.model.ranging.Ranging`, says by it what planners count on; for others they count
    on ``sigma`` everywhere.
    """

    periodic: ClassVar[bool]  # whether the measurement is an angle [rad]

    @property
    def sigma(self) -> float:
        """Standard deviation that planners count on, in the unit of the measurement."""
        ...

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Measurement of state x (`STATES`, ...); of the other vehicle `BEACON` is given."""
        ...

    def deviation(self, x: ca.SX, beacon: ca.SX) -> ca.SX | float:
        """Standard deviation of its error there; positive."""
        ...


def residual(sensor: Sensor, z: ca.SX, expected: ca.SX) -> ca.SX:
    """Measured less expected; an angle's lies between -π and π."""
    difference = z - expected
    if sensor.periodic:
        return ca.atan2(ca.sin(difference), ca.cos(difference))
    return difference


@runtime_checkable
class KnowsLaw(Protocol):
    """A sensor that says what planners count on."""

    @property
    def ranging(self) -> Ranging:
        """Geometry and standard deviation by distance."""
        ...


@runtime_checkable
class SpeedSensor(Protocol):
    """What measures an AUV's speed: some scalars at once.

    It is a dataclass whose fields are keys of ``speed_sensor``.
    """

    @property
    def sigma(self) -> float:
        """Standard deviation of each [m/s]."""
        ...

    def components(self, states: Sequence[str]) -> tuple[Sensor, ...]:
        """The scalars, of a state whose components have these names; always as many."""
        ...
