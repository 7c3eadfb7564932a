"""Sensors, one file each: ``measure`` and ``deviation`` of its error as CasADi expressions.

`SENSORS` are those that may stand in ``[ranging]``, `SPEED_SENSORS` those that an AUV may have as
``speed_sensor``; every AUV has a compass, `Heading`, besides.
"""

from obsplan.sensors.bearing import Bearing
from obsplan.sensors.dvl import Dvl
from obsplan.sensors.heading import Heading
from obsplan.sensors.range import Range
from obsplan.sensors.sensor import BEACON, Sensor, SpeedSensor, residual
from obsplan.sensors.squared_range import SquaredRange
from obsplan.sensors.water_speed import WaterSpeed

SENSORS = {"range": Range, "squared-range": SquaredRange}
# whose `components` are the sensors that measure at once
SPEED_SENSORS = {"water-speed": WaterSpeed, "dvl": Dvl}

__all__ = [
    "BEACON",
    "SENSORS",
    "SPEED_SENSORS",
    "Bearing",
    "Dvl",
    "Heading",
    "Range",
    "Sensor",
    "SpeedSensor",
    "SquaredRange",
    "WaterSpeed",
    "residual",
]
