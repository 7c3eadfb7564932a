"""Sensors, one file each: ``measure`` and ``deviation`` of its error as CasADi expressions.

`SENSORS` are those that may stand in ``[ranging]``; every AUV has a compass, `Heading`, besides.
"""

from obsplan.sensors.bearing import Bearing
from obsplan.sensors.heading import Heading
from obsplan.sensors.range import Range
from obsplan.sensors.sensor import BEACON, Sensor
from obsplan.sensors.squared_range import SquaredRange

SENSORS = {"range": Range, "squared-range": SquaredRange}

__all__ = ["BEACON", "SENSORS", "Bearing", "Heading", "Range", "Sensor", "SquaredRange"]
