"""A Doppler velocity log on the seabed: velocity over ground."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import casadi as ca

from obsplan.quantities import LOG_SIGMA, check_choices
from obsplan.sensors.sensor import BEACON, Sensor

CURRENT_STATES = ("current_east", "current_north")  # [m/s], of filters that estimate it
TOLD = BEACON.index("east_current"), BEACON.index("north_current")


@dataclass(frozen=True, slots=True, kw_only=True)
class Dvl:
    """Velocity [m/s] over ground, forward and to the left, with independent Gaussian errors.

    So a filter that does not know the current can find it. One with the states ``current_east``
    and ``current_north`` does; others count on the current that they are told.
    """

    sigma: Annotated[float, "standard deviation of each component [m/s]", LOG_SIGMA] = 0.01

    def components(self, states: Sequence[str]) -> tuple[Sensor, ...]:
        """What is measured at once, of a state whose components have names."""
        own = all(name in states for name in CURRENT_STATES)
        at = tuple(states.index(name) for name in CURRENT_STATES) if own else None
        return (
            GroundSpeed(direction="forward", sigma=self.sigma, current_at=at),
            GroundSpeed(direction="left", sigma=self.sigma, current_at=at),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundSpeed:
    r"""A component of the velocity over ground in the vehicle's frame [m/s].

    .. math:: z_{forward} = V + c \cdot (\cos ψ, \sin ψ), \quad z_{left} = c \cdot (-\sin ψ, \cos ψ)
    """

    periodic: ClassVar[bool] = False

    direction: Literal["forward", "left"]
    sigma: float  # [m/s]
    # where the current, east and north, stands in the state; None: it is told
    current_at: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        check_choices(self)

    def measure(self, x: ca.SX, beacon: ca.SX) -> ca.SX:
        """Component [m/s] for state x; the current is the state's own, or as told (`BEACON`)."""
        if self.current_at is None:
            east, north = (beacon[i] for i in TOLD)
        else:
            east, north = (x[i] for i in self.current_at)
        cos, sin = ca.cos(x[2]), ca.sin(x[2])
        if self.direction == "forward":
            return x[3] + east * cos + north * sin
        return north * cos - east * sin

    def deviation(self, x: ca.SX, beacon: ca.SX) -> float:  # noqa: ARG002 - the same everywhere
        """Standard deviation [m/s]."""
        return self.sigma
