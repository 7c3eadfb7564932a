"""The table [ranging]: when ranges come, which are lost, what is false, what is known of them."""

from typing import Annotated, Literal

from pydantic import Field

from obsplan.quantities import (
    CLOCK_DRIFT,
    CLOCK_OFFSET,
    COMPASS_BIAS,
    COMPASS_SIGMA,
    INSTANT,
    INTERVAL,
    LENGTH,
    SHARE,
    SLOT,
)
from obsplan.scenario.base import Table
from obsplan.scenario.choice import Choice
from obsplan.sensors import SENSORS


class RangingTable(Table):
    """Acoustic ranging and the compass: when ranges come, which are lost, and what is false."""

    kind: str = Field(description="what is measured with Gaussian error")
    interval: Annotated[float, INTERVAL] = Field(
        default=15.0, description="time between ranges to each AUV [s]"
    )
    heading_sigma_deg: Annotated[float, COMPASS_SIGMA] = Field(
        default=1.0, description="standard deviation of the measured heading [deg]"
    )
    access: Literal["polling", "broadcast"] = Field(
        default="polling", description="AUVs one by one, or all that hear a beacon at once"
    )
    slot: Annotated[float, SLOT] = Field(
        default=0.0,
        description="time from one range of a round to the next [s]; 0: all at the same time",
    )
    jitter: Annotated[float, SLOT] = Field(
        default=0.0, description="greatest delay of a range, at random [s]"
    )
    silent: tuple[tuple[Annotated[float, INSTANT], Annotated[float, INSTANT]], ...] = Field(
        default=(), description="from when to when nothing is ranged, each [from, to] [s]"
    )
    loss: Annotated[float, SHARE] = Field(
        default=0.0, description="probability that a range is lost, at any distance"
    )
    half_distance: Annotated[float | None, LENGTH] = Field(
        default=None, description="at which half of the others are lost [m]; default: none are"
    )
    reach: Annotated[float | None, LENGTH] = Field(
        default=None, description="greatest range [m]; default: none"
    )
    outliers: Annotated[float, SHARE] = Field(
        default=0.0, description="probability that a range took a longer way; not told"
    )
    outlier_mean: Annotated[float, LENGTH] = Field(
        default=30.0, description="mean of the longer way, of an exponential distribution [m]"
    )
    duplicates: Annotated[float, SHARE] = Field(
        default=0.0, description="probability that a range is delivered twice; not told"
    )
    scale_sigma: Annotated[float, SHARE] = Field(
        default=0.0, description="standard deviation of a mission's relative error; not told"
    )
    clock_offset: Annotated[float, CLOCK_OFFSET] = Field(
        default=0.0, description="of clocks at time 0, which lengthens ranges [s]; not told"
    )
    clock_drift: Annotated[float, CLOCK_DRIFT] = Field(
        default=0.0, description="by which the offset grows [s/s]; not told"
    )
    compass_bias_deg: Annotated[float, COMPASS_BIAS] = Field(
        default=0.0, description="added to every measured heading [deg]; not told"
    )
    bearing_sigma_deg: Annotated[float | None, COMPASS_SIGMA] = Field(
        default=None,
        description="standard deviation of a bearing that comes with each range [deg]; default: "
        "none comes",
    )
    bearing_from: Literal["beacon", "auv"] = Field(
        default="beacon",
        description="who measures bearings: the beacon, to the AUV, its own heading known; or the "
        "AUV, relative to its bow",
    )


RANGING = Choice(
    what="ranging",
    known=SENSORS,
    needs=("sigma", "periodic", "measure", "deviation"),
    base=RangingTable,
    default="range",
)
TOLD = "keys of [ranging] that differ from the truth's"
