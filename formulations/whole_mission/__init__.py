"""A path for a whole mission, planned before it begins: turns by gradients from many starts (see `optimise`)."""

from .mission import Mission
from .search import Plan, optimise

__all__ = ["Mission", "Plan", "optimise"]
