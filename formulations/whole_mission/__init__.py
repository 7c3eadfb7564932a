"""Paths for a whole mission, planned before it begins: turns by multi-start descent."""

from .again import again
from .path import Turns
from .problem import AidVehicle, Beacon, Problem
from .team import optimise

__all__ = ["AidVehicle", "Beacon", "Problem", "Turns", "again", "optimise"]
