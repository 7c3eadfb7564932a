"""How a scenario's AUVs move, measure and estimate."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.estimators import ESTIMATORS, Estimator
from obsplan.plugins import class_of, is_own
from obsplan.scenario.choice import options
from obsplan.scenario.tables import ScenarioTable
from obsplan.scenario.trial import try_estimator, try_sensor, try_vehicle
from obsplan.sensors import SENSORS, Heading, Sensor, SquaredRange
from obsplan.types import ObsplanError
from obsplan.vehicles import VEHICLES, States, Vehicle


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
        told = {"current": self.table.environment.current}
        found: list[Vehicle] = []
        for i, auv in enumerate(self.table.auv):
            key = f"auv.{i}.vehicle"
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
    def filter_states(self) -> States:
        """Components of the states that the AUVs' filters estimate."""
        return self.estimator.states(self.vehicles[0])

    @cached_property
    def range_sensor(self) -> Sensor:
        """What measures the range, or squared range."""
        n = len(self.truth_states)
        return self._built(
            "ranging", self.table.ranging, SENSORS, {}, lambda sensor: try_sensor(sensor, n)
        )

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
    def heading_sensor(self) -> Heading:
        """The compass."""
        return Heading(sigma=float(np.deg2rad(self.table.ranging.heading_sigma_deg)))

    def process_noise(self, *, assumed: bool = False) -> Float[np.ndarray, "auvs 4"]:
        """Standard deviations per square root of a second of (east, north, heading, speed).

        They are the truth's, or those that the filter assumes.
        """
        override = self.table.estimator.process_noise if assumed else None
        noises = [override or auv.process_noise for auv in self.table.auv]
        return np.array(
            [[n.position, n.position, np.deg2rad(n.heading_deg), n.speed] for n in noises]
        )

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
