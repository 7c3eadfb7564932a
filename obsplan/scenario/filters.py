"""The tables of AUVs' filters: [estimator] and process noise."""

from typing import Annotated, Any, Literal

from pydantic import Field

from obsplan.quantities import (
    ANGLE_SIGMA,
    GATE,
    HYPOTHESES,
    PATIENCE,
    POSITION_WALK,
    POSITION_WALK_PER_METER,
    SPEED_WALK,
)
from obsplan.scenario.base import Table
from obsplan.scenario.environment import Velocity
from obsplan.scenario.hidden import HiddenTable
from obsplan.scenario.ranging import TOLD


class ProcessNoise(Table):
    """Standard deviations of a random walk, per square root of a second."""

    position: Annotated[float, POSITION_WALK] = Field(
        default=0.0, description="of each coordinate [m/sqrt(s)]"
    )
    heading_deg: Annotated[float, ANGLE_SIGMA] = Field(
        default=0.0, description="of the heading [deg/sqrt(s)]"
    )
    speed: Annotated[float, SPEED_WALK] = Field(
        default=0.0, description="of the speed through the water [m/s/sqrt(s)]"
    )
    position_per_meter: Annotated[float, POSITION_WALK_PER_METER] = Field(
        default=0.0, description="of each coordinate besides, by distance travelled [m/sqrt(m)]"
    )
    heading_deg_per_meter: Annotated[float, ANGLE_SIGMA] = Field(
        default=0.0, description="of the heading besides, by distance travelled [deg/sqrt(m)]"
    )


class EstimatorTable(Table):
    """The AUVs' filter."""

    kind: str = Field(description="which filter")
    ranging: dict[str, Any] | None = Field(
        default=None, description=f"what it is told of ranges: {TOLD}"
    )
    current: Velocity | None = Field(
        default=None,
        description="that filter and autopilot count on, east and north [m/s]; default: the true "
        "one at the AUV's depth, without the tide",
    )
    process_noise: ProcessNoise | None = Field(
        default=None, description="what the filter assumes; default: the truth's"
    )
    motion: Literal["measured", "commanded"] = Field(
        default="measured",
        description="turns and changes of speed by which filters predict: as AUVs measure them, "
        "corrections of the autopilot included, or as surveys command them",
    )
    states: HiddenTable = HiddenTable()
    gate: Annotated[float, GATE] = Field(
        default=4.0,
        description="ranges are rejected that differ from what is expected by more standard "
        "deviations; 0: none is",
    )
    patience: Annotated[int, PATIENCE] = Field(
        default=2,
        description="ranges of a beacon rejected in a row after which the filter itself is doubted "
        "and the next is believed; more where false ranges are frequent",
    )
    hypotheses: Literal["auto"] | Annotated[int, HYPOTHESES] = Field(
        default="auto",
        description="positions that may be followed at once, until ranges leave one; auto: several "
        "where the first estimate is too wide for one Gaussian",
    )
