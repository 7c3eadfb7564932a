"""What of the sea a scenario has: what it has not costs a mission nothing."""

from typing import NamedTuple

from obsplan.scenario import Scenario
from obsplan.scenario.tables import aids_of
from obsplan.sensors import Range


class Features(NamedTuple):
    """Which inputs a step reads besides those that every mission has."""

    lossy: bool  # ranges may be lost
    false: bool  # or longer than they are
    repeated: bool  # or delivered twice
    deep: bool  # depths count
    bearing: bool  # a bearing comes with each range
    varying: bool  # currents differ by depth or time
    carried: bool  # some aid vehicle is carried by the current
    logged: int  # most numbers that an AUV's speed is measured by at once

    @classmethod
    def of(cls, scenario: Scenario) -> "Features":
        """Those of a scenario."""
        ranging, sensor = scenario.table.ranging, scenario.range_sensor
        told = (sensor, scenario.filter_sensor, scenario.planner_sensor)
        slant = [isinstance(s, Range) and s.geometry == "slant" for s in told]
        profiles = [isinstance(s, Range) and bool(s.profile) for s in told]
        far = ranging.half_distance is not None or ranging.reach is not None
        clocks = ranging.clock_offset or ranging.clock_drift
        return cls(
            lossy=far or ranging.loss > 0,
            false=bool(ranging.outliers or ranging.scale_sigma or clocks),
            repeated=ranging.duplicates > 0,
            deep=any(slant) or any(profiles),
            bearing=ranging.bearing_sigma_deg is not None,
            varying=not scenario.water.is_uniform,
            carried=any(aid.carried for aid in aids_of(scenario.table)),
            logged=max(len(components) for components in scenario.true_logs),
        )
