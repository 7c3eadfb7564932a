"""The table [estimator.states]: what filters estimate besides position, heading and speed."""

import math
from typing import Annotated

from pydantic import Field

from obsplan.estimators.hidden import CLOCK, COMPASS_BIAS, DEPTH, SCALE, bias_of
from obsplan.quantities import (
    ANGLE_SIGMA,
    DEPTH_SIGMA,
    DISTANCE,
    SHARE,
    SPEED_SIGMA,
    TIME_SIGMA,
)
from obsplan.scenario.base import Table
from obsplan.sensors.dvl import CURRENT_STATES
from obsplan.vehicles import State, States

SIGMA = "standard deviation at first"
WALK = "of its random walk"


class CurrentState(Table):
    """Current that differs from the one counted on, east and north."""

    sigma: Annotated[float, SPEED_SIGMA] = Field(default=0.2, description=f"{SIGMA} [m/s]")
    walk: Annotated[float, SPEED_SIGMA] = Field(default=0.001, description=f"{WALK} [m/s/sqrt(s)]")


class ScaleState(Table):
    """Relative error that all ranges have, by a wrong speed of sound say."""

    sigma: Annotated[float, SHARE] = Field(default=0.02, description=SIGMA)
    walk: Annotated[float, SHARE] = Field(default=0.0, description=f"{WALK} [1/sqrt(s)]")


class BiasState(Table):
    """By how much ranges of each beacon are too long."""

    sigma: Annotated[float, DISTANCE] = Field(default=2.0, description=f"{SIGMA} [m]")
    walk: Annotated[float, DISTANCE] = Field(default=0.0, description=f"{WALK} [m/sqrt(s)]")


class ClockState(Table):
    """By how much the AUV's clock is late, which lengthens one-way ranges."""

    sigma: Annotated[float, TIME_SIGMA] = Field(default=0.002, description=f"{SIGMA} [s]")
    walk: Annotated[float, TIME_SIGMA] = Field(default=0.0, description=f"{WALK} [s/sqrt(s)]")


class CompassState(Table):
    """By how much the compass shows too much, counter-clockwise."""

    sigma_deg: Annotated[float, ANGLE_SIGMA] = Field(default=2.0, description=f"{SIGMA} [deg]")
    walk_deg: Annotated[float, ANGLE_SIGMA] = Field(
        default=0.0, description=f"{WALK} [deg/sqrt(s)]"
    )


class DepthState(Table):
    """Depth of the transducer, where it is not measured well enough to be told."""

    sigma: Annotated[float, DEPTH_SIGMA] = Field(default=1.0, description=f"{SIGMA} [m]")
    walk: Annotated[float, DEPTH_SIGMA] = Field(default=0.1, description=f"{WALK} [m/sqrt(s)]")


class HiddenTable(Table):
    """What filters estimate besides position, heading and speed; each only where it is given."""

    current: CurrentState | None = Field(default=None, description="unknown current")
    scale: ScaleState | None = Field(default=None, description="relative error of ranges")
    bias: BiasState | None = Field(default=None, description="bias of each beacon's ranges")
    clock: ClockState | None = Field(default=None, description="error of the AUV's clock")
    compass_bias: CompassState | None = Field(default=None, description="bias of the compass")
    depth: DepthState | None = Field(default=None, description="depth")

    def states(self, beacons: int) -> States:
        """The components by name, of so many beacons: ``current_east``, ``bias_1``, ..."""
        found: dict[str, State] = {}
        if self.current is not None:
            one = _state(self.current, "m s-1")
            found |= dict.fromkeys(CURRENT_STATES, one)
        if self.scale is not None:
            found[SCALE] = _state(self.scale, "1")
        if self.bias is not None:
            one = _state(self.bias, "m")
            found |= {bias_of(beacon): one for beacon in range(beacons)}
        if self.clock is not None:
            found[CLOCK] = _state(self.clock, "s")
        if self.compass_bias is not None:
            degrees = (self.compass_bias.sigma_deg, self.compass_bias.walk_deg)
            sigma, walk = (math.radians(angle) for angle in degrees)
            found[COMPASS_BIAS] = State("rad", sigma=sigma, walk=walk)
        if self.depth is not None:
            found[DEPTH] = _state(self.depth, "m")
        return found


def _state(
    table: CurrentState | ScaleState | BiasState | ClockState | DepthState, unit: str
) -> State:
    return State(unit, sigma=table.sigma, walk=table.walk)
