"""The tape of a mission that was flown."""

from collections.abc import Iterator
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Integer

from formulations.model.casadi import symbol
from obsplan.run import Run
from obsplan.scenario import Scenario
from obsplan.scenario.states import BASIC
from obsplan.sensors import BEACON, Range, Sensor
from obsplan.simulation.inputs import faults, log_errors, logged, mission_inputs, streams
from obsplan.tape import Measurements, Tape
from obsplan.types import Pose

UNITS = {"range": "m", "squared-range": "m^2", "bearing": "rad"}
SPEED_UNIT = "m/s"  # of all others


def to_tape(run: Run) -> Tape:
    """Say what the vehicles of a run moved, measured and heard, as a recording would.

    Ranges that were delivered twice are there twice; lost ones are not.
    """
    scenario = run.scenario
    starts = [Pose(*aid.pose[0].tolist()) for aid in run.aids]
    _, inputs = mission_inputs(scenario, starts, run.seed)
    truth = run.truth[..., :BASIC]
    # the autopilot brings heading and speed back to the survey's at the end of each step
    steered = inputs.steer.swapaxes(0, 1) - truth[:, :-1, 2:]
    depth = scenario.depths.T.copy()
    if inputs.depth_error.size:
        depth[:, 1:] += inputs.depth_error[..., 0].T
    beacons = scenario.beacons
    heading = [
        np.zeros(run.time.size) if b.carrier is None else run.aids[b.carrier].pose[:, 2]
        for b in beacons
    ]
    pose = np.concatenate([run.beacon_places, np.stack(heading)[..., None]], axis=-1)
    return Tape(
        time=run.time,
        auvs=tuple(run.names),
        beacons=tuple(beacon.name for beacon in beacons),
        turn=steered[..., 0],
        change_of_speed=steered[..., 1],
        heading=truth[:, 1:, 2] + inputs.heading_error[..., 0].T,
        depth=depth,
        pose=pose,
        beacon_depth=np.array([beacon.depth for beacon in beacons]),
        sensors=sensors_of(scenario),
        measurements=measurements(run, Drawn.of(run)),
        truth=run.truth,
    )


class Drawn(NamedTuple):
    """What a run does not record of its measurements: its seed says it again."""

    twice: Float[np.ndarray, "steps auvs some"] | Bool[np.ndarray, "steps auvs some"]
    logged: Bool[np.ndarray, "steps auvs 1"]
    log_error: Float[np.ndarray, "steps auvs components"]  # in standard deviations

    @classmethod
    def of(cls, run: Run) -> "Drawn":
        """What was drawn in a run that was flown."""
        random = streams(run.seed)
        _, twice = faults(run.scenario, random.faults)
        return cls(twice, logged(run.scenario), log_errors(run.scenario, random.log))


def sensors_of(scenario: Scenario) -> dict[str, Sensor]:
    """Every sensor of a mission by a name: of the range, of its bearing, and of speeds."""
    found: dict[str, Sensor] = {scenario.ranging_kind: scenario.range_sensor}
    if scenario.bearing_sensor is not None:
        found["bearing"] = scenario.bearing_sensor
    for auv, components in zip(scenario.table.auv, scenario.true_logs, strict=True):
        kind = "" if auv.speed_sensor is None else auv.speed_sensor.kind
        for k, sensor in enumerate(components, start=1):
            if sensor in found.values():
                continue
            name = f"{kind}-{k}"
            found[f"{name} of {auv.name}" if name in found else name] = sensor
    return found


def measurements(run: Run, drawn: Drawn, some: slice = slice(None)) -> Measurements:
    """What came at some samples, in order: by time, speeds first, by beacon, AUV and sensor."""
    numbers = np.arange(run.time.size)[some]
    parts = [_ranges(run, drawn, numbers), _bearings(run, numbers), *_logs(run, drawn, numbers)]
    rows = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.lexsort((rows[3], rows[2], rows[1], rows[0]))
    sample, beacon, auv, sensor, value = (row[order] for row in rows)
    received = run.time[sample]
    # the range that a bearing came with; a speed comes from nowhere
    ranged = np.where(beacon < 0, 0.0, run.ranges[beacon, auv, sample])
    away = np.where(beacon < 0, 0.0, flight(run.scenario.range_sensor, ranged))
    return Measurements(
        sent=received - away,
        received=received,
        auv=auv,
        beacon=beacon,
        sensor=sensor,
        value=value,
    )


# columns of measurements before they are in order: sample, beacon, AUV, sensor, value
Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _came(run: Run, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample, beacon and AUV of the ranges that came at some samples."""
    sample, beacon, auv = np.nonzero(np.moveaxis(run.came[..., samples], -1, 0))
    return samples[sample], beacon, auv


def _ranges(run: Run, drawn: Drawn, samples: np.ndarray) -> Columns:
    """Ranges that came, those that came twice two times."""
    sample, beacon, auv = _came(run, samples)
    times = np.ones(sample.size, dtype=int)
    if drawn.twice.size:
        times += drawn.twice[sample - 1, auv, beacon].astype(int)
    sample, beacon, auv = (np.repeat(column, times) for column in (sample, beacon, auv))
    return sample, beacon, auv, np.zeros_like(sample), run.ranges[beacon, auv, sample]


def _bearings(run: Run, samples: np.ndarray) -> Columns:
    """Bearings that came with them."""
    sample, beacon, auv = _came(run, samples if len(run.bearings) else samples[:0])
    value = run.bearings[beacon, auv, sample] if len(run.bearings) else np.empty(0)
    return sample, beacon, auv, np.ones_like(sample), value


def _logs(run: Run, drawn: Drawn, samples: np.ndarray) -> Iterator[Columns]:
    """Speeds that AUVs measured."""
    scenario, known = run.scenario, [*sensors_of(run.scenario).values()]
    for i, components in enumerate(scenario.true_logs):
        after = samples[samples > 0]
        sample = after[drawn.logged[after - 1, i, 0]]
        for k, sensor in enumerate(components):
            whole = np.ones_like(sample)
            errors = drawn.log_error[sample - 1, i, k]
            value = _speeds(sensor, run, i, sample, errors)
            yield sample, -whole, i * whole, known.index(sensor) * whole, value


def _speeds(
    sensor: Sensor,
    run: Run,
    auv: int,
    samples: Integer[np.ndarray, " n"],
    errors: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """What a component of the AUV's speed measures at some samples, with errors [σ].

    Of `BEACON` there are only its depth and its water: the others are nan.
    """
    x, beacon, error = symbol("x", run.truth.shape[2]), symbol("beacon", len(BEACON)), symbol("e")
    z = sensor.measure(x, beacon) + sensor.deviation(x, beacon) * error
    at = np.full((len(BEACON), samples.size), np.nan)
    at[BEACON.index("auv_depth")] = run.scenario.depths[samples, auv]
    east = BEACON.index("east_current")
    at[east : east + 2] = run.scenario.currents[samples, auv].T
    measured = ca.Function("measured", [x, beacon, error], [z])
    return measured(run.truth[auv, samples].T, at, errors[None]).full().ravel()


def flight(sensor: Sensor, ranged: Float[np.ndarray, " n"]) -> np.ndarray:
    """How long before a range came its message, or the question for it, was sent [s]."""
    if not isinstance(sensor, Range) or sensor.timing == "instant":
        return np.zeros_like(ranged)
    one_way = ranged / sensor.usual_sound_speed
    if sensor.timing == "one-way":
        return one_way
    return 2 * one_way + sensor.turn_around
