"""What of the sea a scenario has: what it has not costs a mission nothing."""

from typing import NamedTuple

from obsplan.scenario import Scenario
from obsplan.scenario.tables import aids_of


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
    unheard: bool  # reports may be lost whose ranges came
    doubted: bool  # covariances are believed as far as innovations bear them out

    @classmethod
    def of(cls, scenario: Scenario) -> "Features":
        """Those of a scenario."""
        ranging, communication = scenario.table.ranging, scenario.communication
        clocks = ranging.clock_offset or ranging.clock_drift
        return cls(
            lossy=scenario.ranges_may_be_lost,
            false=bool(ranging.outliers or ranging.scale_sigma or clocks),
            repeated=ranging.duplicates > 0,
            deep=scenario.depths_count,
            bearing=ranging.bearing_sigma_deg is not None,
            varying=not scenario.water.is_uniform,
            carried=any(aid.carried for aid in aids_of(scenario.table)),
            logged=max(len(components) for components in scenario.true_logs),
            unheard=communication.loss > 0 or communication.half_distance is not None,
            doubted=scenario.table.planner.doubt == "innovations",
        )
