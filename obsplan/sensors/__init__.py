"""Sensors, one file each: ``measure(x, beacon)`` as a CasADi expression, the standard deviation ``sigma`` of its error."""

from obsplan.sensors.heading import Heading
from obsplan.sensors.range import Range
from obsplan.sensors.squared_range import SquaredRange

SENSORS = {"range": Range, "squared-range": SquaredRange, "heading": Heading}

__all__ = ["SENSORS", "Heading", "Range", "SquaredRange"]
