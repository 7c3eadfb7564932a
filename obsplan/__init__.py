"""Plan the path of an aid vehicle so that AUVs that measure only range to it can localize.

Names below load on first use, so that importing the package costs nothing. They are listed twice:
for Python, and for editors and type checkers, which do not run it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_TYPES = {
    "Belief": "types",
    "CentroidOrbit": "planners.centroid_orbit",
    "Circle": "planners.circle",
    "ClosedLoop": "simulation",
    "Constraints": "constraints",
    "DeadReckoning": "vehicles",
    "Decision": "types",
    "Disc": "constraints",
    "Ekf": "estimators",
    "ErrorEllipse": "planners.error_ellipse",
    "Estimator": "estimators",
    "Filed": "planning.filed",
    "Formation": "surveys",
    "GramianHorizon": "planners.gramian",
    "InformationHorizon": "planners.information",
    "IteratedEkf": "estimators",
    "Lawnmower": "surveys",
    "ObsplanError": "types",
    "PathInertia": "planners.path_inertia",
    "Planner": "planning.interface",
    "Polygon": "constraints",
    "Pose": "types",
    "Process": "estimators",
    "RandomTurns": "planners.random_turns",
    "Range": "sensors",
    "Reference": "surveys",
    "Run": "run",
    "Rolling": "planners.rolling",
    "STATES": "vehicles",
    "Scenario": "scenario",
    "SecondOrderEkf": "estimators",
    "Sensor": "sensors",
    "SigmaPoint": "estimators",
    "Situation": "planning.situation",
    "SquaredRange": "sensors",
    "State": "vehicles",
    "Static": "surveys",
    "Stationary": "planners.stationary",
    "Status": "types",
    "Tape": "tape",
    "Trail": "planners.trail",
    "Trajectory": "planners.trajectory",
    "Unicycle": "vehicles",
    "Vehicle": "vehicles",
    "Waypoints": "surveys",
    "WholeMission": "planners.whole_mission",
}
_FUNCTIONS = {
    "calibrate": "smoothing",
    "from_dict": "scenario",
    "load": "scenario",
    "load_campaign": "campaign",
    "simulate": "simulation",
    "smooth": "smoothing",
    "to_dataset": "recording",
    "to_tape": "simulation",
    "write_netcdf": "recording",
    "write_run": "report.files",
}
_HOME = {**_TYPES, **_FUNCTIONS}

if TYPE_CHECKING:
    from obsplan.campaign import load_campaign as load_campaign
    from obsplan.constraints import Constraints as Constraints
    from obsplan.constraints import Disc as Disc
    from obsplan.constraints import Polygon as Polygon
    from obsplan.estimators import Ekf as Ekf
    from obsplan.estimators import Estimator as Estimator
    from obsplan.estimators import IteratedEkf as IteratedEkf
    from obsplan.estimators import Process as Process
    from obsplan.estimators import SecondOrderEkf as SecondOrderEkf
    from obsplan.estimators import SigmaPoint as SigmaPoint
    from obsplan.planners.centroid_orbit import CentroidOrbit as CentroidOrbit
    from obsplan.planners.circle import Circle as Circle
    from obsplan.planners.error_ellipse import ErrorEllipse as ErrorEllipse
    from obsplan.planners.gramian import GramianHorizon as GramianHorizon
    from obsplan.planners.information import InformationHorizon as InformationHorizon
    from obsplan.planners.path_inertia import PathInertia as PathInertia
    from obsplan.planners.random_turns import RandomTurns as RandomTurns
    from obsplan.planners.rolling import Rolling as Rolling
    from obsplan.planners.stationary import Stationary as Stationary
    from obsplan.planners.trail import Trail as Trail
    from obsplan.planners.trajectory import Trajectory as Trajectory
    from obsplan.planners.whole_mission import WholeMission as WholeMission
    from obsplan.planning.filed import Filed as Filed
    from obsplan.planning.interface import Planner as Planner
    from obsplan.planning.situation import Situation as Situation
    from obsplan.recording import to_dataset as to_dataset
    from obsplan.recording import write_netcdf as write_netcdf
    from obsplan.report.files import write_run as write_run
    from obsplan.run import Run as Run
    from obsplan.scenario import Scenario as Scenario
    from obsplan.scenario import from_dict as from_dict
    from obsplan.scenario import load as load
    from obsplan.sensors import Range as Range
    from obsplan.sensors import Sensor as Sensor
    from obsplan.sensors import SquaredRange as SquaredRange
    from obsplan.simulation import ClosedLoop as ClosedLoop
    from obsplan.simulation import simulate as simulate
    from obsplan.simulation import to_tape as to_tape
    from obsplan.smoothing import calibrate as calibrate
    from obsplan.smoothing import smooth as smooth
    from obsplan.surveys import Formation as Formation
    from obsplan.surveys import Lawnmower as Lawnmower
    from obsplan.surveys import Reference as Reference
    from obsplan.surveys import Static as Static
    from obsplan.surveys import Waypoints as Waypoints
    from obsplan.tape import Tape as Tape
    from obsplan.types import Belief as Belief
    from obsplan.types import Decision as Decision
    from obsplan.types import ObsplanError as ObsplanError
    from obsplan.types import Pose as Pose
    from obsplan.types import Status as Status
    from obsplan.vehicles import STATES as STATES
    from obsplan.vehicles import DeadReckoning as DeadReckoning
    from obsplan.vehicles import State as State
    from obsplan.vehicles import Unicycle as Unicycle
    from obsplan.vehicles import Vehicle as Vehicle
else:  # hidden from type checkers, which would take any misspelt name for one that loads
    __all__ = ["__version__", *_HOME]

    def __getattr__(name: str) -> Any:
        """Load a public name from the module that defines it."""
        if name not in _HOME:
            raise AttributeError(f"module 'obsplan' has no public name {name!r}")
        return getattr(import_module(f"obsplan.{_HOME[name]}"), name)

    def __dir__() -> list[str]:
        return [*__all__]
