"""Receding-horizon trajectory optimisation: an aid vehicle's turns over the next stages, under limits (see `optimise`)."""

from .areas import Areas, convex_areas
from .ladder import Limits, Outcome, optimise
from .program import Controls
from .task import OBJECTIVES, Task

__all__ = [
    "OBJECTIVES",
    "Areas",
    "Controls",
    "Limits",
    "Outcome",
    "Task",
    "convex_areas",
    "optimise",
]
