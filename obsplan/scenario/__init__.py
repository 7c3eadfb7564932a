"""Scenario files: TOML in, checked objects out."""

from obsplan.scenario.files import SUITES, all_shipped, load, shipped, suite
from obsplan.scenario.scenario import Scenario, from_dict
from obsplan.scenario.tables import ScenarioTable

__all__ = [
    "SUITES",
    "Scenario",
    "ScenarioTable",
    "all_shipped",
    "from_dict",
    "load",
    "shipped",
    "suite",
]
