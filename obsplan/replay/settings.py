"""The keys of ``recording.toml``: those of a recording, and those of the scenario beside it."""

from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, ValidationError

from obsplan.quantities import COMPASS_BIAS, SOUND_SPEED, TURNAROUND
from obsplan.scenario.base import Table, tuples
from obsplan.scenario.contents import check_contents
from obsplan.scenario.files import read as read_toml
from obsplan.scenario.messages import as_error
from obsplan.scenario.tables import ScenarioTable
from obsplan.spelling import nearest
from obsplan.types import ObsplanError

NAME = "recording.toml"


class Topics(Table):
    """Topics of a rosbag, by the names of vehicles or beacons."""

    odometry: dict[str, str] = Field(
        default_factory=dict, description="vehicle = topic of nav_msgs/Odometry"
    )
    beacons: dict[str, str] = Field(
        default_factory=dict, description="beacon = topic of sensor_msgs/NavSatFix"
    )
    ranges: dict[str, str] = Field(
        default_factory=dict,
        description='beacon = topic of sensor_msgs/Range; of several vehicles "vehicle/beacon"',
    )
    truth: dict[str, str] = Field(
        default_factory=dict, description="vehicle = topic of nav_msgs/Odometry or NavSatFix"
    )


class RecordingTable(Table):
    """Keys of a recording besides those of its scenario."""

    source: str = Field(default="", description="where the data are from")
    licence: str = Field(default="", description="of the data")
    attribution: str = Field(default="", description="whom the data are from")
    citation: str = Field(default="", description="what to cite for them")
    sound_speed: Annotated[float | None, SOUND_SPEED] = Field(
        default=None, description="by which times are made distances [m/s]; default: 1500"
    )
    turn_around: Annotated[float, TURNAROUND] = Field(
        default=0.0, description="from being asked to the reply, in two-way times [s]"
    )
    declination_deg: Annotated[float, COMPASS_BIAS] = Field(
        default=0.0, description="of magnetic north, to the east [deg]; added to compass_deg"
    )
    increments: Literal["middle", "start"] = Field(
        default="middle",
        description="the heading along which forward_m is: halfway through the turn, or before it",
    )
    first_estimate: Literal["truth"] | None = Field(
        default=None,
        description='"truth": the first estimate is the truth then; default: that of [[auv]]',
    )
    topics: Topics = Topics()


class Settings(NamedTuple):
    """What ``recording.toml`` says."""

    table: RecordingTable
    scenario: dict[str, Any]  # keys of the scenario, as in a scenario file
    source: str  # the file's name, for messages

    @property
    def sound_speed(self) -> float:
        """By which times are made distances [m/s]."""
        return self.table.sound_speed or 1500.0


def read_settings(folder: Path) -> Settings:
    """Read ``recording.toml`` in a folder, if it is there.

    Raises
    ------
    ObsplanError
        Not TOML, or a value that a key cannot have; one sentence with the key.
    """
    path = folder / NAME
    data = read_toml(path) if path.exists() else {}
    check_contents(data, NAME)
    known = [*RecordingTable.model_fields, *ScenarioTable.model_fields]
    unknown = next((key for key in data if key not in known), None)
    if unknown is not None:
        raise ObsplanError(f"{path}: unknown key {unknown}; {nearest(unknown, known)}")
    own = {key: data.pop(key) for key in [*data] if key in RecordingTable.model_fields}
    try:
        table = RecordingTable.model_validate(tuples(own))
    except ValidationError as error:
        raise as_error(NAME, error, root=RecordingTable) from None
    return Settings(table=table, scenario=data, source=str(path))
