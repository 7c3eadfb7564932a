"""What a filter may estimate besides the vehicle's own state: currents, and errors of instruments.

They are added around a vehicle's model and around sensors, which know nothing of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, cast

import casadi as ca

from obsplan.sensors import BEACON, Bearing, Heading, Sensor
from obsplan.sensors.dvl import CURRENT_STATES, TOLD
from obsplan.vehicles import State, States, Vehicle

SCALE, CLOCK, COMPASS_BIAS, DEPTH = "scale", "clock", "compass_bias", "depth"


def bias_of(beacon: int) -> str:
    """Name of the state that is the bias of a beacon's ranges."""
    return f"bias_{beacon + 1}"


@dataclass(frozen=True, kw_only=True)
class Extended:
    """A vehicle's model with more states, which stay as they are but for their random walks.

    An unknown current, a difference from the one the vehicle counts on, carries it.
    """

    vehicle: Vehicle
    hidden: tuple[tuple[str, State], ...]

    @property
    def states(self) -> States:
        """The vehicle's, then the hidden ones."""
        return {**self.vehicle.states, **dict(self.hidden)}

    def step(self, x: ca.SX, u: ca.SX, dt: ca.SX | float) -> ca.SX:
        """State after dt seconds."""
        own = len(self.vehicle.states)
        moved, more = self.vehicle.step(x[:own], u, dt), x[own:]
        names = [name for name, _ in self.hidden]
        if CURRENT_STATES[0] in names:
            first = names.index(CURRENT_STATES[0])
            position = moved[:2] + more[first : first + 2] * dt
            moved = ca.vertcat(position, moved[2:])
        return ca.vertcat(moved, more)


@dataclass(frozen=True, kw_only=True)
class Around:
    """What a sensor around another has from that one."""

    sensor: Sensor

    @property
    def periodic(self) -> bool:
        """Whether it is an angle."""
        return self.sensor.periodic

    @property
    def sigma(self) -> float:
        """The sensor's."""
        return self.sensor.sigma


@dataclass(frozen=True, kw_only=True)
class Believed(Around):
    r"""A sensor as a filter with hidden states takes it.

    A range is expected to be :math:`(1 + s) r + b + c \tau`: s its scale, b the beacon's bias [m],
    τ how late the clock is [s] and c the speed of sound. A compass shows the heading and its bias.
    """

    states: tuple[str, ...]  # names of the filter's
    beacon: int  # number; -1 of what concerns none
    sound_speed: float  # [m/s]

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """What is expected in the filter's state x."""
        z = self.sensor.measure(x, self._told(x, beacon))
        if isinstance(self.sensor, Heading):
            return z + self._of(x, COMPASS_BIAS)
        if self.beacon < 0 or isinstance(self.sensor, Bearing):
            return z
        late = self.sound_speed * self._of(x, CLOCK)
        return z * (1 + self._of(x, SCALE)) + self._of(x, bias_of(self.beacon)) + late

    def deviation(self, x: ca.SX, beacon: ca.SX) -> ca.SX | float:
        """The sensor's, in the filter's state x."""
        return self.sensor.deviation(x, self._told(x, beacon))

    def _of(self, x: ca.SX, name: str) -> ca.SX:
        """A state by name; 0 where the filter has none."""
        return x[self.states.index(name)] if name in self.states else ca.SX(0.0)

    def _told(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """`BEACON` with the depth and the current as they are estimated."""
        rows = ca.vertsplit(beacon)
        if DEPTH in self.states:
            rows[BEACON.index("auv_depth")] = self._of(x, DEPTH)
        for row, name in zip(TOLD, CURRENT_STATES, strict=True):
            rows[row] = rows[row] + self._of(x, name)
        return ca.vertcat(*rows)


@dataclass(frozen=True, kw_only=True)
class DepthGauge:
    """The depth that is told (`BEACON`), where a filter estimates it."""

    periodic: ClassVar[bool] = False

    sigma: float  # [m]
    at: int  # index of the depth in the state

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:  # noqa: ARG002
        """Depth [m] in state x."""
        return x[self.at]

    def deviation(self, x: ca.SX, beacon: ca.SX) -> float:  # noqa: ARG002 - the same everywhere
        """Standard deviation [m]."""
        return self.sigma


def believed(
    sensor: Sensor, states: Sequence[str], beacon: int = -1, sound_speed: float = 0.0
) -> Sensor:
    """The sensor as a filter with these states takes it; itself where none of them is hidden."""
    hidden = {SCALE, CLOCK, COMPASS_BIAS, DEPTH, *CURRENT_STATES, bias_of(beacon)}
    if not hidden & {*states}:
        return sensor
    # whose `periodic` is no class's
    found = Believed(sensor=sensor, states=(*states,), beacon=beacon, sound_speed=sound_speed)
    return cast(Sensor, found)
