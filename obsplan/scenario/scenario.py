"""A checked scenario, and the objects it stands for."""

import reprlib
from dataclasses import dataclass
from functools import cached_property
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from obsplan.constraints import Constraints, Disc
from obsplan.planners import DEFAULT_PLANNER, planner_class
from obsplan.planning.filed import Filed
from obsplan.planning.interface import Planner, check_planner
from obsplan.planning.situation import Situation
from obsplan.planning.team import Team
from obsplan.plugins import in_words, is_own
from obsplan.scenario.areas import Role, Shape, as_entry, as_fence, common, shapes_of
from obsplan.scenario.base import tuples
from obsplan.scenario.beacons import (
    as_one,
    law_told,
    moored,
    schedule_of,
)
from obsplan.scenario.choice import options
from obsplan.scenario.communication import check_communication
from obsplan.scenario.contents import check_contents
from obsplan.scenario.course import Course
from obsplan.scenario.messages import as_error
from obsplan.scenario.settings import NESTED, as_given, replaced, with_planner
from obsplan.scenario.size import check_auvs, check_current, check_planner_size
from obsplan.scenario.surveys import as_waypoints
from obsplan.scenario.tables import AreaTable, MissionSurvey, Origin, ScenarioTable, aids_of
from obsplan.types import UNCOMPUTABLE, ObsplanError, uncomputable

IN_METRES = ("outliers", "scale_sigma", "clock_offset", "clock_drift")  # what is false of ranges


@dataclass(frozen=True, kw_only=True)
class Scenario(Course):
    """What a scenario file says, and what follows from it; built by `load` or `from_dict`.

    ``source`` is the file's name for messages, ``folder`` where its relative paths start.
    """

    def check(self) -> None:
        """Build everything once, so that whatever is wrong is said before anything runs.

        Raises
        ------
        ObsplanError
            One sentence with the place, the value and the remedy.
        """
        names = [auv.name for auv in self.table.auv]
        if len(set(names)) < len(names):
            given = reprlib.repr(names)
            raise self.error("auv", f"the names {given} are not all different; rename one")
        check_auvs(len(names), self.source)
        check_planner_size(self.table.planner, len(names), self.source)
        check_current(self.table, self.water, self.source)
        _ = self.motions, self.ping_every, self.decide_every, self.constraints
        _ = self.vehicles, self.range_sensor, self.estimator, self.speed_sensors, self.log_every
        self._check_false_ranges()
        self.check_hidden()
        _ = self.filter_sensor, self.planner_sensor, self.beacons, self.offsets, self.depths
        planner = self.table.planner
        wrong = check_communication(self.communication, planner.knowledge, planner.doubt)
        if wrong is not None:
            raise self.error(*wrong)
        _ = self.in_flight
        self.team()

    def _check_false_ranges(self) -> None:
        """Refuse errors in metres of squared ranges."""
        given = [key for key in IN_METRES if getattr(self.table.ranging, key)]
        if given and self.ranging_kind == "squared-range":
            raise self.error(
                f"ranging.{given[0]}",
                'is of ranges in metres, and the kind is "squared-range": give kind "range"',
            )

    def __repr__(self) -> str:
        table = self.table
        planner = DEFAULT_PLANNER if table.planner.kind == "default" else table.planner.kind
        known = vars(self).get("time")  # worked out by `check`; a repr reads no mission file
        parts = [
            f"{len(table.auv)} AUV{'s' * (len(table.auv) != 1)}",
            *([] if known is None else [f"{known[-1]:g} s"]),
            f"{table.ranging.kind} every {table.ranging.interval:g} s",
            *(f"aid vehicle at {aid.speed:g} m/s" for aid in aids_of(table)),
            f"planner {planner}",
        ]
        return f"<Scenario {table.name}: {', '.join(parts)}>"

    def replace(
        self, *, planner: str | dict[str, Any] | Planner | None = None, **settings: Any
    ) -> "Scenario":
        """The same scenario with other values for some keys, all of it checked again.

        Parameters
        ----------
        planner
            A planner by name, or as an object, at the same interval and knowledge and before any
            ``planner__...``; or its whole table.
        settings
            Values by key, in the units of `obsplan schema`: a key of a table after two underscores,
            ``cna__speed=2.0``; an entry of a list by its number, ``auv__0__speed=0.5``. None is the
            default. An object may stand for the table of a survey, vehicle, ranging or estimator,
            ``estimator=MyEkf(gain=2.0)``; keys that every kind has, such as the time between
            ranges, stay.

        Raises
        ------
        ObsplanError
            As `load`; keys are named as they are written here.
        """
        data = self.table.model_dump(exclude_unset=True, exclude_none=True)
        if isinstance(planner, str):
            data = with_planner(data, planner)
        elif planner is not None:
            settings = {"planner": planner, **settings}
        for key, value in settings.items():
            said = f"{key} = {reprlib.repr(value)}"
            data = replaced(data, key.split(NESTED), value, said)
        try:
            return from_dict(data, source=self.source, folder=self.folder)
        except ObsplanError as error:
            raise ObsplanError(as_given(str(error), settings)) from None

    def planner(self, aid: int = 0) -> Planner:
        """Build the planner of an aid vehicle, told of the situation where it has such a field.

        Raises
        ------
        ObsplanError
            An option out of its range, or whatever a user's class raises.
        """
        table = self.table.planner
        cls = planner_class(table.kind)
        given = options(cls, table)
        if "situation" in signature(cls).parameters:
            given["situation"] = self.situations[aid]
        try:
            planner = cls(**given)
            check_planner(planner)
        except (ValueError, ObsplanError) as error:
            raise self.error("planner", error) from None
        except (Exception, SystemExit) as error:
            if not is_own(table.kind):
                raise  # a fault of ours, to be mended
            fault = f"{table.kind} cannot be built: {in_words(error)}; correct the class"
            raise self.error("planner", fault) from error
        return planner

    def team(self) -> "Planner | Team":
        """The planner, or those of several aid vehicles."""
        planners = tuple(self.planner(aid) for aid in range(len(self.aids)))
        return planners[0] if len(planners) == 1 else Team(planners, joint=self.joint)

    @property
    def joint(self) -> bool:
        """Whether several aid vehicles plan given the others' plans."""
        return self.table.planner.team == "joint"

    @cached_property
    def situation(self) -> Situation:
        """What planners are told, once."""
        return self.situations[0]

    @cached_property
    def situations(self) -> tuple[Situation, ...]:
        """What the planner of each aid vehicle is told."""
        return tuple(self._situation(i) for i in range(len(self.aids)))

    def _situation(self, aid: int) -> Situation:
        ranging, law = self.planner_ranging, law_told(self.planner_sensor, self.planner_ranging)
        of_its_own = [k for k, beacon in enumerate(self.beacons) if beacon.carrier == aid]
        first = of_its_own[0] if of_its_own else 0
        schedule = schedule_of(ranging, self.offsets[first])
        return Situation(
            self.aids[aid],
            ranging=as_one(law, len(of_its_own)),
            ping_interval=schedule.interval,
            slots=schedule.offsets,
            silent=schedule.silent,
            transducer_depth=self.beacons[first].depth if of_its_own else 0.0,
            ranged=bool(of_its_own),
            companions=moored(self.beacons, law, ranging, self.offsets),
            heading_sigma=self.heading_sensor.sigma,
            throughput_half_distance=self.communication.throughput_half_distance or np.inf,
            decision_interval=self.decide_every * self.table.time_step,
            current=self.carrying[aid],
            constraints=self.constraints,
            survey_circle=self._survey_circle(aid),
            filed=self._filed,
        )

    @cached_property
    def constraints(self) -> Constraints:
        """Limits on the aid vehicle's position."""
        table = self.table.constraints
        keep_out = [
            self._shapes(f"constraints.keep_out.{i}", area, "keep-out")
            for i, area in enumerate(table.keep_out)
        ]
        try:
            return Constraints(
                keep_out=tuple(shape for shapes in keep_out for shape in shapes),
                geofence=self._geofence(),
                min_separation=table.min_separation,
                max_separation=np.inf if table.max_separation is None else table.max_separation,
                min_separation_cna=table.min_separation_cna if len(self.aids) > 1 else 0.0,
            )
        except ValueError as error:
            raise self.error("constraints", error) from None

    def _geofence(self) -> Shape | None:
        fence = self.table.constraints.geofence
        if fence is None:
            return None
        key = "constraints.geofence"
        table = fence if isinstance(fence, AreaTable) else AreaTable(points=fence)
        try:
            return common(self._shapes(key, table, "geofence"))
        except ValueError as error:
            raise self.error(key, error) from None

    def _shapes(self, key: str, table: AreaTable, role: Role) -> list[Shape]:
        """What an area of the file stands for."""
        try:
            return shapes_of(table, role, folder=self.folder, origin=self._origin)
        except ValueError as error:
            raise self.error(key, error) from None

    @cached_property
    def _filed(self) -> Filed:
        """What is known before the mission begins."""
        nothing = np.zeros((len(self.table.auv), 4))
        return Filed(
            time=self.time,
            position=np.stack([motion.position for motion in self.motions], axis=1),
            heading=np.stack([motion.heading for motion in self.motions], axis=1),
            speed=np.stack([motion.speed for motion in self.motions], axis=1),
            covariance=self.first_estimates(nothing, nothing)[1],
            process_noise=self.process_noise(assumed=True),
            weights=np.array([auv.weight for auv in self.table.auv], dtype=float),
            depth=self.depths,
        )

    def _survey_circle(self, aid: int) -> Disc:
        """Smallest circle about every survey, not smaller than the aid vehicle can turn."""
        import shapely

        points = shapely.MultiPoint(
            np.concatenate([reference.polyline for reference in self.references])
        )
        center = shapely.minimum_bounding_circle(points).centroid
        smallest = self.aids[aid].min_turn_radius
        radius = max(float(shapely.minimum_bounding_radius(points)), smallest)
        return Disc(x=center.x, y=center.y, radius=radius)

    def resolved(self) -> dict[str, Any]:
        """Contents of a file that gives this scenario again.

        Mission files are replaced by what they hold; nothing is left to a default.
        """
        data = self.table.model_dump(mode="json", exclude_none=True)
        for auv, reference, table in zip(data["auv"], self.references, self.table.auv, strict=True):
            if isinstance(table.survey, MissionSurvey):
                auv["survey"] = as_waypoints(reference)
        limits, shapes = data["constraints"], self.constraints
        limits["keep_out"] = [as_entry(shape) for shape in shapes.keep_out]
        if shapes.geofence is not None:
            limits["geofence"] = as_fence(shapes.geofence)
        return data


def from_dict(data: dict[str, Any], *, source: str = "scenario", folder: Path = Path()) -> Scenario:
    """Check the contents of a scenario file; relative paths in it start at ``folder``.

    Arrays may stand for lists.

    Raises
    ------
    ObsplanError
        As `load`.
    """
    try:
        check_contents(data, source)
        contents = tuples(data)
        table = ScenarioTable.model_validate(contents, context={"origin": origin_of(contents)})
    except ValidationError as error:
        raise as_error(source, error) from None
    scenario = Scenario(table=table, source=source, folder=folder)
    try:
        scenario.check()
    except UNCOMPUTABLE as error:
        raise ObsplanError(f"{source}: {uncomputable(error)}") from error
    return scenario


def origin_of(data: dict[str, Any]) -> tuple[float, float] | None:
    """Latitude and longitude of a scenario's origin [deg]; None where it is missing or wrong."""
    try:
        origin = Origin.model_validate(data.get("origin"))
    except ValidationError:  # said when all of the contents are checked
        return None
    return origin.lat, origin.lon
