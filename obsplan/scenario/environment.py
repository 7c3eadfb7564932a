"""Keys of the water, and of what AUVs measure of their speed in it."""

from typing import Annotated

import numpy as np
from pydantic import Field

from obsplan.quantities import BEARING, CURRENT, DEPTH, INTERVAL, TIDE_PERIOD
from obsplan.scenario.base import Table
from obsplan.scenario.choice import Choice
from obsplan.sensors import SPEED_SENSORS
from obsplan.water import SEMIDIURNAL, Tide, Water

Velocity = tuple[Annotated[float, CURRENT], Annotated[float, CURRENT]]


class TideTable(Table):
    """A current that goes to and fro, the same at all depths."""

    amplitude: Velocity = Field(description="greatest velocity, east and north [m/s]")
    period: Annotated[float, TIDE_PERIOD] = Field(
        default=SEMIDIURNAL, description="time from one flood to the next [s]"
    )
    phase_deg: Annotated[float, BEARING] = Field(
        default=0.0, description="by which it lags: at 0 the amplitude is reached at time 0 [deg]"
    )


class Environment(Table):
    """The water: its currents add up."""

    current: Velocity = Field(
        default=(0.0, 0.0), description="uniform current, east and north [m/s]"
    )
    current_profile: tuple[
        tuple[Annotated[float, DEPTH], Annotated[float, CURRENT], Annotated[float, CURRENT]], ...
    ] = Field(
        default=(),
        description="current by depth, each [depth m, east m/s, north m/s]: linear between, "
        "constant above and below",
    )
    tide: TideTable | None = Field(default=None, description="what varies in time; default: none")


class SpeedSensorTable(Table):
    """What an AUV measures of its speed."""

    kind: str = Field(description="through the water, or over ground by Doppler from the seabed")
    interval: Annotated[float, INTERVAL] = Field(
        default=1.0, description="time between measurements [s]"
    )


SPEED_SENSOR = Choice(
    what="speed_sensor",
    known=SPEED_SENSORS,
    needs=("sigma", "components"),
    base=SpeedSensorTable,
)


def water_of(environment: Environment) -> Water:
    """The water that a table stands for.

    Raises
    ------
    ValueError
        Depths of the profile that do not increase.
    """
    told, tide = environment.tide, None
    if told is not None:
        phase = float(np.deg2rad(told.phase_deg))
        tide = Tide(amplitude=told.amplitude, period=told.period, phase=phase)
    return Water(current=environment.current, profile=environment.current_profile, tide=tide)
