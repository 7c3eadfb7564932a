"""What a planner is told of the mission, once."""

import math
from dataclasses import KW_ONLY, dataclass, fields
from functools import cached_property

from formulations.beam_search.limits import Areas
from formulations.model.ranging import Ranging
from formulations.model.schedule import Schedule
from obsplan.constraints import UNLIMITED, Constraints, Disc
from obsplan.next_move import Stream
from obsplan.planning.checks import check_positive
from obsplan.planning.companion import Companion
from obsplan.planning.filed import Filed
from obsplan.quantities import CURRENT
from obsplan.vehicles import Unicycle

METRE = Ranging(sigma=1.0, squared=False)


@dataclass(frozen=True)
class Situation:
    """Vehicle, ranging, schedule, limits and surveys to plan for; a scenario builds it.

    Written by hand it needs the vehicle alone. The other values are then those that a scenario has
    where it does not say, without limits and surveys.

    A vehicle that a ``current`` carries is planned for in the water that carries it, where it moves
    on arcs. So the AUVs that its planner is told of are as `obsplan.planning.water.in_the_water`
    has them, and paths that it predicts are in that water. Limits and surveys are over ground.

    Raises
    ------
    ValueError
        A time or a standard deviation that is not positive and finite, or a current out of range.
    """

    cna: Unicycle
    _: KW_ONLY
    ranging: Ranging = METRE
    ping_interval: float = 15.0  # [s] between ranges to each AUV, counted from time 0
    slots: tuple[float, ...] = ()  # [s] after each interval's beginning, of each AUV; none: 0
    silent: tuple[tuple[float, float], ...] = ()  # from when to when [s] there are no ranges
    transducer_depth: float = 0.0  # of the aid vehicle [m]
    ranged: bool = True  # whether AUVs range to the aid vehicle at all
    companions: tuple[Companion, ...] = ()  # moored beacons that AUVs range to as well
    heading_sigma: float = math.radians(1.0)  # of a measured heading [rad]
    # of the water that carries the aid vehicle, east and north [m/s]; 0: it steers over ground
    current: tuple[float, float] = (0.0, 0.0)
    throughput_half_distance: float = math.inf  # at which half of the throughput is left [m]
    decision_interval: float = 1.0  # [s] between decisions
    constraints: Constraints = UNLIMITED
    survey_circle: Disc | None = None  # the smallest about every survey that the vehicle can follow
    filed: Filed | None = None  # the surveys as filed

    def __post_init__(self) -> None:
        check_positive(self, ping_interval="s", heading_sigma="rad", decision_interval="s")
        if not self.throughput_half_distance > 0:
            raise ValueError(
                "throughput_half_distance must be positive [m], "
                f"got {self.throughput_half_distance}: correct it"
            )
        if not 0 < self.ranging.sigma < math.inf:
            unit = "m^2" if self.ranging.squared else "m"
            raise ValueError(
                f"sigma must be positive and finite [{unit}], got {self.ranging.sigma}"
            )
        for part in self.current:
            if part not in CURRENT:
                raise ValueError(f"current must be {CURRENT}, got {self.current}: correct it")

    @cached_property
    def schedule(self) -> Schedule:
        """When ranges are expected."""
        return Schedule(interval=self.ping_interval, offsets=self.slots, silent=self.silent)

    @cached_property
    def stream(self) -> Stream:
        """What carries the vehicle."""
        return Stream(self.current, 2 * math.pi / self.cna.max_turn_rate)

    @cached_property
    def areas(self) -> Areas:
        """Keep-outs and geofence as machine code reads them."""
        return Areas(
            [
                ((area.x, area.y, area.radius) if isinstance(area, Disc) else area.outline, sign)
                for area, sign in self.constraints.areas
            ]
        )

    @cached_property
    def _hash(self) -> int:
        return hash(tuple(getattr(self, field.name) for field in fields(self)))

    def __hash__(self) -> int:
        return self._hash  # planners with it are keys of what is built for them
