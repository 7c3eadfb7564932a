"""Scenario files: TOML in, checked objects out."""

from obsplan.scenario.files import load, shipped, suite
from obsplan.scenario.scenario import Scenario, from_dict
from obsplan.scenario.tables import ScenarioTable

__all__ = ["Scenario", "ScenarioTable", "from_dict", "load", "shipped", "suite"]
