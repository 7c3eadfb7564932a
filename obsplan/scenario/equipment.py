"""How a scenario's AUVs move, measure and estimate."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float
from pydantic import TypeAdapter, ValidationError

from obsplan.estimators import ESTIMATORS, Estimator, Process
from obsplan.estimators.filtering import Filtering
from obsplan.estimators.hidden import CLOCK, DEPTH, SCALE, DepthGauge, Extended, believed
from obsplan.plugins import class_of, is_own
from obsplan.scenario.beacons import Beacon, beacons_of
from obsplan.scenario.choice import options
from obsplan.scenario.communication import CommunicationTable
from obsplan.scenario.environment import water_of
from obsplan.scenario.messages import as_error
from obsplan.scenario.ranging import RANGING, RangingTable
from obsplan.scenario.tables import ScenarioTable, aids_of
from obsplan.scenario.trial import try_estimator, try_sensor, try_vehicle
from obsplan.sensors import (
    SENSORS,
    SPEED_SENSORS,
    Bearing,
    Heading,
    Range,
    Sensor,
    SpeedSensor,
    SquaredRange,
)
from obsplan.types import ObsplanError
from obsplan.vehicles import STATES, VEHICLES, States, Vehicle
from obsplan.water import Water


@dataclass(frozen=True, kw_only=True)
class Equipment:
    """What the AUVs of a `Scenario` bring: vehicles, sensors, filter, first estimates."""

    table: ScenarioTable
    source: str = "scenario"

    def error(self, key: str, what: object) -> ObsplanError:
        """An error at a key of this scenario."""
        return ObsplanError(f"{self.source}: {key}: {what}")

    @cached_property
    def vehicles(self) -> tuple[Vehicle, ...]:
        """The AUVs' motion, of the truth and, unless it has its own, of the filter."""
        found: list[Vehicle] = []
        for i, auv in enumerate(self.table.auv):
            key = f"auv.{i}.vehicle"
            told = {"current": self.assumed_currents[i]}
            vehicle = self._built(key, auv.vehicle, VEHICLES, told, try_vehicle)
            if found and [*vehicle.states.items()] != [*found[0].states.items()]:
                raise self.error(
                    key,
                    (
                        f"has the states {', '.join(vehicle.states)}, auv.0.vehicle "
                        f"{', '.join(found[0].states)}; give every AUV a vehicle with the same "
                        "states"
                    ),
                )
            found.append(vehicle)
        return tuple(found)

    @property
    def truth_states(self) -> States:
        """Components of the AUVs' true states."""
        return self.vehicles[0].states

    @cached_property
    def filter_vehicles(self) -> tuple[Vehicle, ...]:
        """The AUVs' motion as their filters take it, with what they estimate besides."""
        hidden = self.table.estimator.states.states(len(self.beacons))
        if not hidden:
            return self.vehicles
        return tuple(Extended(vehicle=one, hidden=(*hidden.items(),)) for one in self.vehicles)

    @cached_property
    def filter_states(self) -> States:
        """Components of the states that the AUVs' filters estimate."""
        return self.estimator.states(self.filter_vehicles[0])

    def check_hidden(self) -> None:
        """Refuse hidden states that the filter has no place for, or that are of no such ranges.

        Raises
        ------
        ObsplanError
            One sentence with the place and the remedy.
        """
        table, known = self.table.estimator.states, self.filter_states
        hidden = table.states(len(self.beacons))
        if not {*hidden} <= {*known}:
            raise self.error(
                "estimator.states",
                f"the filter {self.table.estimator.kind} has states of its own: leave them out",
            )
        in_metres = [key for key in (SCALE, "bias", CLOCK) if getattr(table, key) is not None]
        if in_metres and self.ranging_kind == "squared-range":
            raise self.error(
                f"estimator.states.{in_metres[0]}",
                'is of ranges in metres, and the kind is "squared-range": give kind "range"',
            )
        if table.depth is not None and not self.depths_count:
            raise self.error(
                "estimator.states.depth",
                'no range tells of a depth: give [ranging] geometry "slant", or leave it out',
            )

    def filter_process(self, auv: int, dt: float | ca.SX) -> Process:
        """What the filter of an AUV assumes of it between samples dt [s] apart."""
        own = [*self.filter_states.values()][len(STATES) :]
        noise = self.table.estimator.process_noise or self.table.auv[auv].process_noise
        heading, per_meter = (
            float(np.deg2rad(angle)) for angle in (noise.heading_deg, noise.heading_deg_per_meter)
        )
        by_time = (noise.position, noise.position, heading, noise.speed)
        by_way = (noise.position_per_meter, noise.position_per_meter, per_meter, 0.0)
        return Process(
            model=self.filter_vehicles[auv],
            noise=(*by_time, *(state.walk for state in own)),
            dt=dt,
            walk_per_meter=(*by_way, *(state.walk_per_meter for state in own)),
        )

    def filtering(self, hypotheses: int = 1) -> Filtering:
        """The AUVs' filter with its gate, and room for so many hypotheses."""
        sensor = self.filter_sensor
        plain = isinstance(sensor, Range)
        return Filtering(
            estimator=self.estimator,
            count=len(self.filter_states),
            gate=self.table.estimator.gate,
            patience=self.table.estimator.patience,
            hypotheses=hypotheses,
            beacons=len(self.beacons),
            reach=(self.filter_ranging.reach or np.inf) if plain else np.inf,
            slant=isinstance(sensor, Range) and sensor.geometry == "slant",
        )

    def as_filtered(self, sensor: Sensor, beacon: int = -1) -> Sensor:
        """A sensor as the filter takes it, of a beacon if it concerns one."""
        return believed(sensor, [*self.filter_states], beacon, self.assumed_sound_speed)

    @property
    def depth_gauge(self) -> Sensor | None:
        """What measures the depth, where the filter estimates it."""
        names = [*self.filter_states]
        if self.table.estimator.states.depth is None:
            return None
        return DepthGauge(sigma=max(self.depth_sigma, 0.01), at=names.index(DEPTH))

    @cached_property
    def water(self) -> Water:
        """How the water moves."""
        try:
            return water_of(self.table.environment)
        except ValueError as error:
            raise self.error("environment", error) from None

    @cached_property
    def assumed_currents(self) -> tuple[tuple[float, float], ...]:
        """Currents that AUVs' filters and autopilots count on, east and north [m/s].

        Where none is told they are the true ones, on average over tides and an AUV's depths.
        """
        told, auvs = self.table.estimator.current, self.table.auv
        if told is not None or self.water.is_uniform:
            return (self.water.current if told is None else told,) * len(auvs)
        means = [self.water.mean(np.atleast_1d(auv.depth)).mean(axis=0) for auv in auvs]
        return tuple((east, north) for east, north in np.array(means).tolist())

    @cached_property
    def carrying(self) -> tuple[tuple[float, float], ...]:
        """Currents at the surface that planners count on, of each aid vehicle [m/s].

        Those of vehicles that steer over ground are 0.
        """
        east, north = self.water.mean(0.0).tolist()
        return tuple((east, north) if aid.carried else (0.0, 0.0) for aid in aids_of(self.table))

    @cached_property
    def speed_sensors(self) -> tuple[SpeedSensor | None, ...]:
        """What measures each AUV's speed, if anything does."""
        return tuple(
            None
            if auv.speed_sensor is None
            else self._built(
                f"auv.{i}.speed_sensor", auv.speed_sensor, SPEED_SENSORS, {}, self._try_speed
            )
            for i, auv in enumerate(self.table.auv)
        )

    @property
    def true_logs(self) -> tuple[tuple[Sensor, ...], ...]:
        """What of each AUV's speed is measured at once, of its true state."""
        return self._logs(self.truth_states)

    @property
    def filter_logs(self) -> tuple[tuple[Sensor, ...], ...]:
        """The same of the filter's state.

        An unknown current is added to the one told, not taken for it.
        """
        hidden = self.table.estimator.states.states(len(self.beacons))
        own = {name: one for name, one in self.filter_states.items() if name not in hidden}
        logs = self._logs(own)
        return tuple(tuple(self.as_filtered(one) for one in components) for components in logs)

    def _logs(self, states: States) -> tuple[tuple[Sensor, ...], ...]:
        return tuple(
            () if sensor is None else sensor.components([*states]) for sensor in self.speed_sensors
        )

    def _try_speed(self, sensor: SpeedSensor) -> None:
        """Raise ValueError unless what it measures at once are scalars of the state."""
        for states in (self.truth_states, self.filter_states):
            for component in sensor.components([*states]):
                try_sensor(component, len(states))

    @cached_property
    def range_sensor(self) -> Sensor:
        """What measures the range, or squared range."""
        return self._sensor("ranging", self.table.ranging)

    @cached_property
    def filter_ranging(self) -> RangingTable:
        """What the filter is told of ranges."""
        return self._told("estimator.ranging", self.table.ranging, self.table.estimator.ranging)

    @cached_property
    def filter_sensor(self) -> Sensor:
        """What the filter takes a range for."""
        if self.filter_ranging is self.table.ranging:
            return self.range_sensor
        return self._sensor("estimator.ranging", self.filter_ranging)

    @cached_property
    def planner_ranging(self) -> RangingTable:
        """What planners are told of ranges."""
        return self._told("planner.ranging", self.filter_ranging, self.table.planner.ranging)

    @cached_property
    def planner_sensor(self) -> Sensor:
        """What planners take a range for."""
        if self.planner_ranging is self.filter_ranging:
            return self.filter_sensor
        return self._sensor("planner.ranging", self.planner_ranging)

    def _sensor(self, key: str, table: RangingTable) -> Sensor:
        """The sensor a table stands for."""
        n = len(self.truth_states)
        return self._built(key, table, SENSORS, {}, lambda sensor: try_sensor(sensor, n))

    def _told(self, key: str, truth: RangingTable, given: dict[str, Any] | None) -> RangingTable:
        """The truth's table of ranging with other values for some keys."""
        if given is None:
            return truth
        same_kind = given.get("kind", truth.kind) == truth.kind
        kept = truth.model_dump(exclude_unset=True) if same_kind else {}
        try:
            return TypeAdapter(RANGING.annotation()).validate_python(
                {"kind": truth.kind, **kept, **given}
            )
        except ValidationError as error:
            raise as_error(self.source, error, told=key) from None

    @property
    def ranges_may_be_lost(self) -> bool:
        """Whether ranges that are due may not come."""
        ranging = self.table.ranging
        far = ranging.half_distance is not None or ranging.reach is not None
        return far or ranging.loss > 0

    @property
    def depths_count(self) -> bool:
        """Whether the range measured, or what filter or planner take it for, depends on depths."""
        known = (self.range_sensor, self.filter_sensor, self.planner_sensor)
        sensors = [sensor for sensor in known if isinstance(sensor, Range)]
        return any(sensor.geometry == "slant" or sensor.profile for sensor in sensors)

    @property
    def communication(self) -> CommunicationTable:
        """What aid vehicles hear."""
        return self.table.communication or CommunicationTable()

    @property
    def hearing_matters(self) -> bool:
        """Whether reports are anything but one with each range, on time."""
        return self.table.communication is not None or self.ranges_may_be_lost

    @cached_property
    def beacons(self) -> tuple[Beacon, ...]:
        """What AUVs range to, the aid vehicles' own transducers first."""
        try:
            return beacons_of(self.table)
        except ValueError as error:
            raise self.error("beacon", error) from None

    @property
    def ranging_kind(self) -> str:
        """Whether ranges [m] or squared ranges [m^2] are measured, which planners plan for."""
        return "squared-range" if isinstance(self.range_sensor, SquaredRange) else "range"

    @cached_property
    def estimator(self) -> Estimator:
        """The AUVs' filter."""
        vehicle, sensor = self.vehicles[0], self.range_sensor
        return self._built(
            "estimator",
            self.table.estimator,
            ESTIMATORS,
            {},
            lambda estimator: try_estimator(estimator, vehicle, sensor),
        )

    def _built(
        self,
        key: str,
        table: Any,
        known: Mapping[str, type[Any]],
        told: dict[str, Any],
        trial: Callable[[Any], None],
    ) -> Any:
        """The object a table stands for, tried once where its class is a user's own."""
        cls = class_of(table.kind, known)
        asked = {f.name: told[f.name] for f in fields(cls) if f.name in told}
        try:
            built = cls(**options(cls, table), **asked)
            if is_own(table.kind):
                trial(built)
        except ValueError as error:
            raise self.error(key, error) from error
        return built

    @property
    def depth_sigma(self) -> float:
        """Standard deviation of the AUVs' measured depths [m]."""
        sensor = self.range_sensor
        return sensor.depth_sigma if isinstance(sensor, Range) else 0.0

    @property
    def assumed_sound_speed(self) -> float:
        """Speed of sound by which instruments make distances of times [m/s]."""
        sensor = self.range_sensor
        if not isinstance(sensor, Range):
            return Range().usual_sound_speed
        return sensor.usual_sound_speed

    @property
    def bearing_sensor(self) -> Bearing | None:
        """What measures a bearing with each range, if anything does."""
        sigma = self.table.ranging.bearing_sigma_deg
        if sigma is None:
            return None
        from_auv = self.table.ranging.bearing_from == "auv"
        return Bearing(sigma=float(np.deg2rad(sigma)), from_auv=from_auv)

    @property
    def heading_sensor(self) -> Heading:
        """The compass."""
        return Heading(sigma=float(np.deg2rad(self.table.ranging.heading_sigma_deg)))

    def first_estimates(
        self, truth: Float[np.ndarray, "auvs 4"], error: Float[np.ndarray, "auvs 4"]
    ) -> tuple[Float[np.ndarray, "auvs 4"], Float[np.ndarray, "auvs 4 4"]]:
        """The filters' first means and covariances.

        What is not given is the truth plus a standard normal error times its sigma.
        """
        firsts = [auv.first_estimate for auv in self.table.auv]
        heading = [None if f.heading_deg is None else np.deg2rad(f.heading_deg) for f in firsts]
        # None becomes nan
        given = np.array(
            [[f.x, f.y, h, f.speed] for f, h in zip(firsts, heading, strict=True)], dtype=float
        )
        sigma = np.array(
            [
                [f.sigma_position, f.sigma_position, np.deg2rad(f.sigma_heading_deg), f.sigma_speed]
                for f in firsts
            ]
        )
        mean = np.where(np.isnan(given), truth + sigma * error, given)
        return mean, np.stack([np.diag(row**2) for row in sigma])
