"""A path for a whole mission, planned before it begins: turns by multi-start descent."""

from .problem import Problem
from .search import optimise

__all__ = ["Problem", "optimise"]
