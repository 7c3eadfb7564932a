"""Keys of how a run's path is written for autopilots and maps."""

from datetime import datetime
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field

from obsplan.missions.writers.items import End
from obsplan.scenario.base import Table

Format = Literal["waypoints", "plan", "gpx", "kml", "geojson", "csv", "bhv"]
FORMATS: tuple[Format, ...] = get_args(Format)


def _instant(value: Any) -> Any:
    """An instant as text, as TOML has it or quoted; it needs an offset, or Z."""
    text = value.isoformat() if isinstance(value, datetime) else value
    if isinstance(text, str):
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            moment = None
        if moment is None or moment.tzinfo is None or not 1970 <= moment.year <= 2199:
            raise ValueError(
                "must be an instant of the years 1970 to 2199 with its offset, such as "
                "2026-05-01T08:00:00Z"
            )
    return text


class ExportTable(Table):
    """What a run's path is simplified to, so that an autopilot takes it, and how it is judged."""

    formats: tuple[Format, ...] = Field(
        default=FORMATS, description="files to write, path.waypoints and so on"
    )
    max_items: int = Field(
        default=500,
        ge=8,
        le=65535,
        description=(
            "most items of a mission, home and speeds included: PX4 holds 500, ordinary boards "
            "with ArduPilot about 700"
        ),
    )
    min_spacing: float = Field(
        default=2.0,
        ge=0,
        le=1000,
        description=(
            "least distance between waypoints [m]: autopilots pass over those within their "
            "acceptance radius (ArduRover: 2 m)"
        ),
    )
    tolerance: float = Field(
        default=0.5,
        gt=0,
        le=1000,
        description=(
            "greatest distance from the path flown [m]; a boat steers to about that; grows where "
            "the items are too many"
        ),
    )
    timing: float = Field(
        default=1.0,
        gt=0,
        le=3600,
        description=(
            "greatest time ahead of the path flown or behind it [s]; kept by commanding speeds"
        ),
    )
    min_turn_radius: float | None = Field(
        default=None,
        gt=0,
        le=10_000,
        description=(
            "least turning radius of the vehicle that sails the path [m]: a wider one moves it; "
            "default: cna.min_turn_radius"
        ),
    )
    end: End = Field(
        default="loiter",
        description=(
            "at the last waypoint: stay there, return to home, or what the autopilot is set to do"
        ),
    )
    start_time: Annotated[str, BeforeValidator(_instant)] = Field(
        default="1970-01-01T00:00:00Z",
        description=(
            "of the mission, for the times in GPX and KML; the default stands for a start not known"
        ),
    )
    replays: int = Field(
        default=4,
        ge=0,
        le=1000,
        description=(
            "seeds under whose noise the path as loaded is sailed, on time and late, to tell what "
            "it costs; 0: not told"
        ),
    )

    @property
    def start(self) -> datetime:
        """When the mission starts."""
        return datetime.fromisoformat(self.start_time)
