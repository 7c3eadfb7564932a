"""Receding-horizon optimal control: an aid vehicle's turns over the next stages, under limits."""

from .areas import Areas, convex_areas
from .program import Controls
from .search import PathLimits, build, freer_side, optimise
from .task import OBJECTIVES, Task

__all__ = [
    "OBJECTIVES",
    "Areas",
    "Controls",
    "PathLimits",
    "Task",
    "build",
    "convex_areas",
    "freer_side",
    "optimise",
]
