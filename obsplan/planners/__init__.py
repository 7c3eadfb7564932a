"""Planners, one file each, and the table that names them in files and on the command line.

The classes load on first use: a scenario that needs one does not pay for the others' solvers.
"""

from typing import Any

from obsplan.plugins import is_own, loaded

PLANNERS = {
    "path-inertia": "obsplan.planners.path_inertia:PathInertia",
    "gramian": "obsplan.planners.gramian:GramianHorizon",
    "information": "obsplan.planners.information:InformationHorizon",
    "trajectory": "obsplan.planners.trajectory:Trajectory",
    "error-ellipse": "obsplan.planners.error_ellipse:ErrorEllipse",
    "centroid-orbit": "obsplan.planners.centroid_orbit:CentroidOrbit",
    "trail": "obsplan.planners.trail:Trail",
    "random": "obsplan.planners.random_turns:RandomTurns",
    "circle": "obsplan.planners.circle:Circle",
    "whole-mission": "obsplan.planners.whole_mission:WholeMission",
    "rolling": "obsplan.planners.rolling:Rolling",
    "stationary": "obsplan.planners.stationary:Stationary",
}
# tens of seconds a mission: compared only where they are named
SLOW = (
    "trajectory",
    "whole-mission",
    "rolling",
)
DEFAULT_PLANNER = "information"  # what the name "default" stands for


def planner_class(name: str) -> type[Any]:
    """Class of a planner by its name in files, or by its own as ``"package.module:Class"``."""
    if is_own(name):
        return loaded(name)
    return loaded(PLANNERS[DEFAULT_PLANNER if name == "default" else name])


def name_of(planner: object) -> str:
    """Name of a planner in files; its class's name where it is not one of ours."""
    cls = type(planner)
    return next(
        (name for name, home in PLANNERS.items() if home == f"{cls.__module__}:{cls.__qualname__}"),
        cls.__name__,
    )
