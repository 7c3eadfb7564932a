"""Every key a scenario file may have: its type, limits and default, its unit in the description."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from obsplan.estimators import ESTIMATORS
from obsplan.missions import READERS
from obsplan.planners import PLANNERS, planner_class
from obsplan.quantities import (
    ANGLE_SIGMA,
    AUV_SPEED,
    AUV_SURGE,
    BEARING,
    CARRIER,
    DEPTH,
    DISTANCE,
    DURATION,
    INTERVAL,
    LENGTH,
    POSITION,
    SEED,
    SPEED_SIGMA,
    TIME_STEP,
    TURN_RADIUS,
    VESSEL_SPEED,
    WEIGHT,
)
from obsplan.scenario.base import Table
from obsplan.scenario.choice import Choice
from obsplan.scenario.communication import CommunicationTable
from obsplan.scenario.environment import SPEED_SENSOR, Environment
from obsplan.scenario.export import ExportTable
from obsplan.scenario.filters import EstimatorTable, ProcessNoise
from obsplan.scenario.places import Corners, Degrees, Place
from obsplan.scenario.ranging import RANGING, TOLD
from obsplan.surveys import SURVEYS
from obsplan.vehicles import VEHICLES

LONGEST_NAME = 120  # letters: files and folders are called so, of 255 bytes at most
MISSION_FILE = f"mission file ({', '.join(READERS)}), relative to the scenario file"


class Origin(Degrees):
    """Where local east/north is zero."""


class Start(Place):
    """Where the aid vehicle starts."""

    x: Annotated[float, POSITION] = Field(default=0.0, description="east [m]")
    y: Annotated[float, POSITION] = Field(default=0.0, description="north [m]")
    heading_deg: Annotated[float, BEARING] = Field(
        default=90.0, description="heading [deg], counter-clockwise from east"
    )


class Cna(Table):
    """An aid vehicle (communication and navigation aid)."""

    speed: Annotated[float, VESSEL_SPEED] = Field(description="cruising speed [m/s]")
    min_turn_radius: Annotated[float, TURN_RADIUS] = Field(
        description="smallest turning radius [m]"
    )
    start: Start = Field(default=Start(), description="pose at time 0")
    transducer_depth: Annotated[float, DEPTH] = Field(
        default=0.0, description="of its transducer, where ranges are slant [m]"
    )
    ranged: bool = Field(default=True, description="whether AUVs range to it")
    carried: bool = Field(
        default=False,
        description="whether the current at the surface carries it: its speed is then through the "
        "water; otherwise it steers over ground",
    )


class BeaconTable(Place):
    """A transponder that AUVs range to besides: moored, or carried by an aid vehicle."""

    name: str = Field(
        default="",
        max_length=LONGEST_NAME,
        description="name in tables; default: beacon-1, beacon-2, ...",
    )
    x: Annotated[float, POSITION] = Field(
        default=0.0, description="east [m]; of a carried one ahead of the vehicle's reference point"
    )
    y: Annotated[float, POSITION] = Field(
        default=0.0, description="north [m]; of a carried one to the left"
    )
    depth: Annotated[float, DEPTH] = Field(default=0.0, description="of its transducer [m]")
    on: Annotated[int | None, CARRIER] = Field(
        default=None,
        description="number of the aid vehicle that carries it, from 0; default: moored",
    )


class MissionSurvey(Table):
    """A survey read from a mission file."""

    kind: Literal["mission"] = Field(default="mission", description="which one")
    file: str = Field(description=f"{MISSION_FILE}; its speeds and holds are kept")
    track: str | None = Field(
        default=None,
        description="name of the track, where the file has several; default: the first",
    )


class FirstEstimate(Place):
    """The filter's first mean and standard deviations.

    What is left out of the mean is drawn about the truth with its sigma.
    """

    x: Annotated[float | None, POSITION] = Field(default=None, description="east [m]")
    y: Annotated[float | None, POSITION] = Field(default=None, description="north [m]")
    heading_deg: Annotated[float | None, BEARING] = Field(
        default=None, description="heading [deg], counter-clockwise from east"
    )
    speed: Annotated[float | None, AUV_SURGE] = Field(
        default=None, description="speed through the water [m/s], negative astern"
    )
    sigma_position: Annotated[float, DISTANCE] = Field(
        default=5.0, description="standard deviation of each coordinate [m]"
    )
    sigma_heading_deg: Annotated[float, ANGLE_SIGMA] = Field(
        default=2.0, description="standard deviation of the heading [deg]"
    )
    sigma_speed: Annotated[float, SPEED_SIGMA] = Field(
        default=0.5, description="standard deviation of the speed [m/s]"
    )


class VehicleTable(Table):
    """How an AUV moves."""

    kind: str = Field(description="model of the AUV's motion")


class PlannerTable(Table):
    """Keys that every planner has."""

    kind: str = Field(description="which one")
    interval: Annotated[float | None, INTERVAL] = Field(
        default=None, description="time between decisions [s]; default: about 1 s"
    )
    knowledge: Literal["estimate", "estimate-and-survey", "survey", "truth"] = Field(
        default="estimate", description="what the planner is given of the AUVs"
    )
    ranging: dict[str, Any] | None = Field(
        default=None, description=f"what it is told of ranges: {TOLD}; default: as the filter"
    )
    doubt: Literal["none", "innovations"] = Field(
        default="none",
        description="whether reported positions are believed as their covariances say, or doubted "
        "as far as the AUVs' ranges have differed from what their filters expected: then "
        "information, trail and centroid-orbit keep a distance that still tells",
    )
    team: Literal["joint", "alone"] = Field(
        default="joint",
        description="whether several aid vehicles plan given the others' plans, or as if alone",
    )


SURVEY = Choice(
    what="survey",
    known=SURVEYS,
    needs=("reference",),
    besides=(MissionSurvey,),
)
VEHICLE = Choice(
    what="vehicle",
    known=VEHICLES,
    needs=("states", "step"),
    base=VehicleTable,
    told=("current",),
    default="dead-reckoning",
)
ESTIMATOR = Choice(
    what="estimator",
    known=ESTIMATORS,
    needs=("states", "predict", "innovation", "update"),
    base=EstimatorTable,
    default="ekf",
)
PLANNER = Choice(
    what="planner",
    known={name: planner_class(name) for name in (*PLANNERS, "default")},
    needs=("plan",),
    base=PlannerTable,
    told=("situation",),
)
CHOICES = (SURVEY, VEHICLE, RANGING, ESTIMATOR, PLANNER, SPEED_SENSOR)
if TYPE_CHECKING:  # these are unions of tables built at run time
    Survey = Vehicle = Ranging = Estimator = Planner = SpeedSensor = Any
else:
    Survey, Vehicle = SURVEY.annotation(), VEHICLE.annotation()
    Ranging, Estimator = RANGING.annotation(), ESTIMATOR.annotation()
    Planner, SpeedSensor = PLANNER.annotation(), SPEED_SENSOR.annotation()


ONE_DEPTH, DEPTHS = "{ depth }", "[ depth ]"  # pydantic's names for the two forms of a depth


class Auv(Table):
    """One survey vehicle."""

    name: str = Field(
        default="",
        max_length=LONGEST_NAME,
        description="name in tables and figures; default: auv-1, auv-2, ...",
    )
    speed: Annotated[float | None, AUV_SPEED] = Field(
        default=None,
        description=(
            "speed through the water on every leg [m/s]; default: the speeds of the survey or its "
            "file, where a leg without one takes that before it, or else after it"
        ),
    )
    weight: Annotated[float, WEIGHT] = Field(
        default=1.0, description="weight in the planner's objective"
    )
    depth: Annotated[
        Annotated[float, DEPTH, Tag(ONE_DEPTH)]
        | Annotated[tuple[Annotated[float, DEPTH], ...], Field(min_length=1), Tag(DEPTHS)],
        Discriminator(lambda value: DEPTHS if isinstance(value, tuple) else ONE_DEPTH),
    ] = Field(
        default=0.0,
        description="of its transducer, where ranges are slant [m]; a list has one for each point "
        "of its survey",
    )
    survey: Survey = Field(  # pyright: ignore[reportInvalidTypeForm]
        description="what it follows over ground"
    )
    vehicle: Vehicle = Field(  # pyright: ignore[reportInvalidTypeForm]
        default=VEHICLE.default_table(), description="how it moves"
    )
    speed_sensor: SpeedSensor | None = Field(  # pyright: ignore[reportInvalidTypeForm]
        default=None, description="what it measures of its speed; default: nothing"
    )
    first_estimate: FirstEstimate = FirstEstimate()
    process_noise: ProcessNoise = ProcessNoise()


class AreaTable(Place):
    """An area: a disc by its centre and radius, a polygon by its corners, or those of a file."""

    x: Annotated[float | None, POSITION] = Field(
        default=None, description="centre of a disc, east [m]"
    )
    y: Annotated[float | None, POSITION] = Field(
        default=None, description="centre of a disc, north [m]"
    )
    radius: Annotated[float | None, LENGTH] = Field(
        default=None, description="radius of a disc [m]"
    )
    points: Corners | None = Field(
        default=None, description="corners of a polygon, each [east, north] [m]"
    )
    file: str | None = Field(
        default=None, description=f"{MISSION_FILE}: the polygons, circles or closed lines in it"
    )

    @model_validator(mode="after")
    def _one_of_them(self) -> "AreaTable":
        disc = [value is not None for value in (self.x, self.y, self.radius)]
        whole = all(disc) or not any(disc)
        if (
            not whole
            or [all(disc), self.points is not None, self.file is not None].count(True) != 1
        ):
            raise ValueError(
                "give either x, y and radius, or points, or file; lat and lon may stand for x and y"
            )
        return self


ONE, SEVERAL = "{ cna }", "[ cna ]"  # pydantic's names for the two forms of an aid vehicle
CORNERS, AREA = "[ corners ]", "{ area }"  # pydantic's names for the two forms of a geofence


class ConstraintsTable(Table):
    """Where the aid vehicle may be: some planners plan within it, the others are kept within it."""

    keep_out: tuple[AreaTable, ...] = Field(default=(), description="areas not to enter")
    geofence: (
        Annotated[
            Annotated[Corners, Tag(CORNERS)] | Annotated[AreaTable, Tag(AREA)],
            Discriminator(lambda value: AREA if isinstance(value, dict | AreaTable) else CORNERS),
        ]
        | None
    ) = Field(default=None, description="corners of the area not to leave, each [east, north] [m]")
    min_separation: Annotated[float, DISTANCE] = Field(
        default=0.0, description="least distance to any AUV [m]"
    )
    max_separation: Annotated[float | None, LENGTH] = Field(
        default=None, description="greatest distance to any AUV [m]; default: none"
    )
    min_separation_cna: Annotated[float, DISTANCE] = Field(
        default=0.0, description="least distance between aid vehicles [m]"
    )


class ScenarioTable(Table):
    """A whole scenario file."""

    name: str = Field(
        default="scenario",
        max_length=LONGEST_NAME,
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        description="letters, digits, dots and hyphens",
    )
    description: str = Field(default="", description="one line for lists")
    seed: Annotated[int, SEED] = Field(default=1, description="of all random numbers")
    time_step: Annotated[float, TIME_STEP] = Field(
        default=0.5, description="of simulation, heading measurements and records [s]"
    )
    duration: Annotated[float | None, DURATION] = Field(
        default=None, description="of the mission [s]; default: until the last survey is done"
    )
    origin: Origin = Field(description="geographic place of local (0, 0)")
    cna: Annotated[
        Annotated[Cna, Tag(ONE)] | Annotated[tuple[Cna, ...], Tag(SEVERAL), Field(min_length=1)],
        Discriminator(lambda value: SEVERAL if isinstance(value, tuple) else ONE),
    ] = Field(description="the aid vehicle, or several as [[cna]]")
    beacon: tuple[BeaconTable, ...] = Field(default=(), description="other transponders")
    auv: tuple[Auv, ...] = Field(min_length=1, description="the survey vehicles")
    environment: Environment = Environment()
    ranging: Ranging = Field(default=RANGING.default_table(), description="ranges and compass")
    communication: CommunicationTable | None = Field(
        default=None, description="what aid vehicles hear; default: an estimate with every range"
    )
    constraints: ConstraintsTable = ConstraintsTable()
    estimator: Estimator = Field(default=ESTIMATOR.default_table(), description="the AUVs' filter")
    planner: Planner = Field(
        default=PLANNER.table("default")(), description="who steers the aid vehicle"
    )
    export: ExportTable = ExportTable()

    @model_validator(mode="before")
    @classmethod
    def _name_the_nameless(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        for key in ("auv", "beacon"):
            listed = data.get(key)
            if isinstance(listed, tuple):
                data = {**data, key: tuple(_named(key, i, one) for i, one in enumerate(listed))}
        return data


def aids_of(table: ScenarioTable) -> tuple[Cna, ...]:
    """The aid vehicles."""
    return table.cna if isinstance(table.cna, tuple) else (table.cna,)


def _named(key: str, i: int, one: Any) -> Any:
    """An entry of a list with the name it has where it says none."""
    return {"name": f"{key}-{i + 1}", **one} if isinstance(one, dict) else one
