"""Everything measured on a tape, a row each, and what a trajectory says of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Integer

from formulations.model.casadi import of_each, symbol
from obsplan.scenario import Scenario
from obsplan.sensors import BEACON, Heading, Sensor
from obsplan.smoothing.constants import BIAS, CLOCK, COMPASS_BIAS, CURRENT, SCALE, Constants
from obsplan.smoothing.model import Model
from obsplan.tape import Tape
from obsplan.types import ObsplanError

EAST_CURRENT = BEACON.index("east_current")
VEHICLE = 6  # as many rows of `BEACON` say how another vehicle moves


class Rows(NamedTuple):
    """Measurements of ranges, bearings and speeds in the tape's order, then those of headings."""

    sample: Integer[np.ndarray, " rows"]
    auv: Integer[np.ndarray, " rows"]
    other: Integer[np.ndarray, " rows"]  # the AUV that it ranged to; itself where there is none
    sensor: Integer[np.ndarray, " rows"]  # number in `Problem.sensors`
    value: Float[np.ndarray, " rows"]
    sigma: Float[np.ndarray, " rows"]  # nan: the sensor's own
    told: Float[np.ndarray, "rows 10"]
    between: Float[np.ndarray, " rows"]  # 1 where it is of another AUV
    scaled: Float[np.ndarray, "rows constants"]  # 1 for the constants that are its scale
    biased: Float[np.ndarray, "rows constants"]  # its bias


class Seen(NamedTuple):
    """What rows are in a trajectory, and how they change with it."""

    residual: Float[np.ndarray, " rows"]  # measured less expected
    sigma: Float[np.ndarray, " rows"]
    # by the AUV's state, the other's and the constants
    jacobian: Float[np.ndarray, "rows columns"]


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Rows, the sensors they are of, and the model of all states."""

    model: Model
    sensors: tuple[Sensor, ...]
    rows: Rows
    samples: int

    @property
    def columns(self) -> Integer[np.ndarray, "rows columns"]:
        """Where in the state the columns of `Seen.jacobian` stand."""
        own, model = np.arange(self.model.own), self.model
        hidden = np.arange(model.of_auvs, model.size)
        parts = [
            self.rows.auv[:, None] * model.own + own,
            self.rows.other[:, None] * model.own + own,
            np.broadcast_to(hidden, (len(self.rows.auv), hidden.size)),
        ]
        return np.concatenate(parts, axis=1)

    def until(self, count: int) -> "Problem":
        """That of the first samples."""
        early = self.rows.sample < count
        rows = Rows(*(column[early] for column in self.rows))
        return Problem(model=self.model, sensors=self.sensors, rows=rows, samples=count)

    def seen(self, x: Float[np.ndarray, "samples n"]) -> Seen:
        """Residuals, deviations and Jacobians in a trajectory."""
        rows, count = self.rows, len(self.rows.auv)
        states = x[rows.sample[:, None], self.columns]
        given = [states, rows.told, rows.between[:, None], rows.scaled, rows.biased]
        given = np.concatenate(given, axis=1)
        residual, sigma = np.empty(count), np.empty(count)
        jacobian = np.empty((count, self.columns.shape[1]))
        for number, sensor in enumerate(self.sensors):
            mine = rows.sensor == number
            found = of_each(_expected(sensor, self.model), given[mine])[0]
            error = rows.value[mine] - found[:, 0]
            residual[mine] = np.angle(np.exp(1j * error)) if sensor.periodic else error
            sigma[mine], jacobian[mine] = found[:, 1], found[:, 2:]
        return Seen(residual, np.where(np.isnan(rows.sigma), sigma, rows.sigma), jacobian)

    def normal(
        self, seen: Seen, weights: Float[np.ndarray, " rows"]
    ) -> tuple[Float[np.ndarray, "samples n n"], Float[np.ndarray, "samples n"]]:
        """Hᵀ R⁻¹ H and Hᵀ R⁻¹ r of each sample, of weighted rows."""
        n, columns = self.model.size, self.columns
        sample = self.rows.sample[:, None]
        scaled = seen.jacobian * (weights / seen.sigma**2)[:, None]

        vector = np.zeros((self.samples, n))
        np.add.at(vector, (sample, columns), scaled * seen.residual[:, None])

        information = np.zeros((self.samples, n, n))
        row, column = columns[:, :, None], columns[:, None, :]
        products = scaled[:, :, None] * seen.jacobian[:, None, :]
        np.add.at(information, (sample[..., None], row, column), products)
        return information, vector


def problem_of(
    tape: Tape, scenario: Scenario, model: Model, usable: Bool[np.ndarray, " rows"]
) -> Problem:
    """Rows of a tape's usable measurements as the scenario's filter takes them."""
    sensors = (*_sensors(tape, scenario), scenario.heading_sensor)
    parts = [_measured(tape, scenario, model.constants, usable)]
    parts.append(_headings(tape, model.constants, len(sensors) - 1))
    rows = Rows(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    return Problem(model=model, sensors=sensors, rows=rows, samples=tape.time.size)


def _sensors(tape: Tape, scenario: Scenario) -> list[Sensor]:
    """The tape's sensors, the one of the range as the filter has it."""
    return [
        scenario.filter_sensor if name == scenario.ranging_kind else sensor
        for name, sensor in tape.sensors.items()
    ]


def _measured(
    tape: Tape, scenario: Scenario, constants: Constants, usable: Bool[np.ndarray, " rows"]
) -> Rows:
    """Ranges, bearings and speeds."""
    z = tape.measurements
    auv, beacon = z.auv[usable], z.beacon[usable]
    sample, told = np.searchsorted(tape.time, z.received[usable]), z.told[usable].copy()
    between = beacon >= len(tape.beacons)
    other = np.where(between, beacon - len(tape.beacons), auv)
    _tell(tape, told, (sample, auv, other), between)
    # constants are of distances alone
    names = np.array([*tape.sensors, ""])[z.sensor[usable]]
    distance = names == "range"
    late = scenario.assumed_sound_speed * constants.picked(CLOCK, auv)
    biased = constants.picked(BIAS, beacon) + late
    return Rows(
        sample=sample,
        auv=auv,
        other=other,
        sensor=z.sensor[usable],
        value=z.value[usable],
        sigma=z.sigma[usable],
        told=np.nan_to_num(told),
        between=between.astype(float),
        scaled=constants.picked(SCALE, beacon) * distance[:, None],
        biased=biased * distance[:, None],
    )


def _tell(
    tape: Tape,
    told: Float[np.ndarray, "rows 10"],
    who: tuple[np.ndarray, np.ndarray, np.ndarray],
    between: Bool[np.ndarray, " rows"],
) -> None:
    """Fill in what a tape cannot tell of another AUV: its motion is the trajectory's own."""
    sample, auv, other = who
    told[between, :VEHICLE] = 0.0
    told[between, BEACON.index("depth")] = tape.depth[other, sample][between]
    told[between, BEACON.index("auv_depth")] = tape.depth[auv, sample][between]


def _headings(tape: Tape, constants: Constants, sensor: int) -> Rows:
    """Headings by compass."""
    auv, step = np.nonzero(np.isfinite(tape.heading))
    count = auv.size
    return Rows(
        sample=step + 1,
        auv=auv,
        other=auv,
        sensor=np.full(count, sensor),
        value=tape.heading[auv, step],
        sigma=np.full(count, np.nan),
        told=np.zeros((count, len(BEACON))),
        between=np.zeros(count),
        scaled=np.zeros((count, len(constants))),
        biased=constants.picked(COMPASS_BIAS, auv),
    )


@lru_cache(maxsize=32)
def _expected(sensor: Sensor, model: Model) -> ca.Function:
    """States, what is told and which constants count -> value, deviation and Jacobian."""
    n, constants = model.own, len(model.constants)
    states = symbol("states", 2 * n + constants)
    x, other, hidden = states[:n], states[n : 2 * n], states[2 * n :]
    told, between = symbol("told", len(BEACON)), symbol("between")
    scaled, biased = symbol("scaled", constants), symbol("biased", constants)
    beacon = _beacon(model, other, hidden, told, between)
    scale, bias = ca.dot(scaled, hidden), ca.dot(biased, hidden)
    value = sensor.measure(x, beacon) * (1 + scale) + bias
    sigma = ca.SX(sensor.deviation(x, beacon))
    jacobian = ca.jacobian(value, states).T
    given = ca.vertcat(states, told, between, scaled, biased)
    found = ca.densify(ca.vertcat(value, sigma, jacobian))
    return ca.Function("expected", [given], [found])


def _beacon(model: Model, other: ca.SX, hidden: ca.SX, told: ca.SX, between: ca.SX) -> ca.SX:
    """`BEACON` as it is told, or as the other AUV's state and the unknown current say."""
    rows: Sequence[ca.SX] = ca.vertsplit(told)
    currents = model.constants.at(CURRENT)
    drift = [hidden[c] for c in currents] or [ca.SX(0.0), ca.SX(0.0)]
    east, north = (rows[EAST_CURRENT + k] + drift[k] for k in range(2))
    ahead = ca.vertcat(ca.cos(other[2]), ca.sin(other[2]))
    velocity = other[3] * ahead + ca.vertcat(east, north)
    moving = ca.vertcat(other[:3], velocity, 0.0)
    own = told[:VEHICLE] + between * moving
    return ca.vertcat(own, rows[VEHICLE], rows[VEHICLE + 1], east, north)


def usable(tape: Tape) -> tuple[Bool[np.ndarray, " rows"], list[str]]:
    """Which measurements can be used, and in words what the others lack.

    Raises
    ------
    ObsplanError
        A measurement that is received at none of the tape's samples.
    """
    z = tape.measurements
    place = np.searchsorted(tape.time, z.received).clip(0, tape.time.size - 1)
    late = tape.time[place] != z.received
    if late.any():
        raise ObsplanError(
            f"tape: measurement {int(late.argmax())} is received at {z.received[late][0]} s, which "
            "is no sample: give the tape a sample then"
        )
    between = z.beacon >= len(tape.beacons)
    known = (z.beacon >= -1) & (z.beacon < len(tape.beacons) + len(tape.auvs))
    # a speed concerns no other vehicle
    placed = between | (z.beacon < 0) | np.isfinite(z.told[:, :2]).all(axis=1)
    faults = {
        "no number": ~np.isfinite(z.value),
        "of an unknown beacon": ~known | ~placed,
        "delivered twice": _again(tape),
    }
    good, words = np.ones(z.value.size, dtype=bool), list[str]()
    for what, wrong in faults.items():
        count = int((wrong & good).sum())
        if count:
            words.append(f"{count} measurements are not used: {what}")
        good &= ~wrong
    return good, words


def _again(tape: Tape) -> Bool[np.ndarray, " rows"]:
    """Measurements that are the same as an earlier one."""
    z = tape.measurements
    keys = np.column_stack([z.sent, z.received, z.auv, z.beacon, z.sensor, z.value])
    first = np.unique(keys, axis=0, return_index=True)[1]
    again = np.ones(z.value.size, dtype=bool)
    again[first] = False
    return again


def heading_is(sensor: Sensor) -> bool:
    """Whether a sensor is the compass, whose errors are never gross."""
    return isinstance(sensor, Heading)
