"""Paths for a whole mission, planned before it begins: turns by multi-start descent."""

from .problem import AidVehicle, Beacon, Problem
from .team import optimise

__all__ = ["AidVehicle", "Beacon", "Problem", "optimise"]
