"""Plan the path of an aid vehicle so that AUVs measuring only acoustic range to it can localize themselves.

Names below load on first use, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "Belief": "types",
    "Circle": "planners.circle",
    "Decision": "types",
    "GramianHorizon": "planners.gramian",
    "InformationHorizon": "planners.information",
    "ObsplanError": "types",
    "PathInertia": "planners.path_inertia",
    "Pose": "types",
    "Run": "run",
    "Scenario": "scenario",
    "Stationary": "planners.stationary",
    "Status": "types",
    "Trajectory": "planners.trajectory",
    "Unicycle": "vehicles",
    "load": "scenario",
    "load_campaign": "campaign",
    "simulate": "simulation",
}

__all__ = ["__version__", *_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module 'obsplan' has no public name {name!r}")
    return getattr(import_module(f"obsplan.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__]
