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
from obsplan.simulation.features import Features
from obsplan.simulation.inputs import (
    depth_errors,
    faults,
    log_errors,
    logged,
    mission_inputs,
    stream,
    streams,
)
from obsplan.tape import Measurements, Tape
from obsplan.types import Pose

UNITS = {"range": "m", "squared-range": "m^2", "bearing": "rad"}
SPEED_UNIT = "m/s"  # of all others


def to_tape(run: Run) -> Tape:
    """Say what the vehicles of a run moved, measured and heard, as a recording would.

    Turns and changes of speed are those that the filter predicts with: as measured, or with
    ``estimator.motion = "commanded"`` as the survey commands them.
    Ranges that were delivered twice are there twice; lost ones are not.
    """
    scenario = run.scenario
    starts = [Pose(*aid.pose[0].tolist()) for aid in run.aids]
    _, inputs = mission_inputs(scenario, starts, run.seed)
    truth = run.true[..., :BASIC]
    # the autopilot brings heading and speed back to the survey's at the end of each step
    before = truth[:, :-1, 2:]
    if scenario.table.estimator.motion == "commanded":
        before = inputs.survey[..., 2:BASIC].swapaxes(0, 1)
    steered = inputs.steer.swapaxes(0, 1) - before
    drawn, beacons = Drawn.of(run), scenario.beacons
    return Tape(
        time=run.time,
        auvs=tuple(run.names),
        beacons=tuple(beacon.name for beacon in beacons),
        turn=steered[..., 0],
        change_of_speed=steered[..., 1],
        sway=np.zeros(steered.shape[:2]),
        heading=truth[:, 1:, 2] + inputs.heading_error[..., 0].T,
        depth=drawn.depth,
        pose=drawn.motion[..., :3],
        beacon_depth=np.array([beacon.depth for beacon in beacons]),
        sensors=sensors_of(scenario),
        measurements=measurements(run, drawn),
        truth=run.truth,
    )


def beacon_motion(run: Run) -> Float[np.ndarray, "beacons samples 7"]:
    """Each beacon at each sample as AUVs take it: the first seven of `BEACON`."""
    found = np.zeros((len(run.scenario.beacons), run.time.size, 7))
    found[..., :2] = run.beacon_places
    streams_of_aids = stream(run.scenario).swapaxes(0, 1)
    for motion, beacon in zip(found, run.scenario.beacons, strict=True):
        motion[:, 6] = beacon.depth
        if beacon.carrier is None:
            continue
        aid = run.aids[beacon.carrier]
        motion[:, 2] = aid.pose[:, 2]
        # the command of the step that ends at a sample
        speed, turn_rate = aid.speed[:-1], aid.turn_rate[:-1]
        ahead = np.column_stack([np.cos(motion[1:, 2]), np.sin(motion[1:, 2])])
        motion[1:, 3:5] = speed[:, None] * ahead + streams_of_aids[beacon.carrier]
        motion[1:, 5] = turn_rate
    return found


class Drawn(NamedTuple):
    """What measurements hold besides what a run records: its seed says it again."""

    twice: Float[np.ndarray, "steps auvs some"] | Bool[np.ndarray, "steps auvs some"]
    logged: Bool[np.ndarray, "steps auvs 1"]
    log_error: Float[np.ndarray, "steps auvs components"]  # in standard deviations
    depth: Float[np.ndarray, "auvs samples"]  # as measured [m]
    motion: Float[np.ndarray, "beacons samples 7"]  # of beacons: the first of `BEACON`

    @classmethod
    def of(cls, run: Run) -> "Drawn":
        """What was drawn in a run that was flown."""
        random = streams(run.seed)
        _, twice = faults(run.scenario, random.faults)
        depth = run.scenario.depths.T.copy()
        if Features.of(run.scenario).deep:
            depth[:, 1:] += depth_errors(run.scenario, random.depth)[..., 0].T
        logs = log_errors(run.scenario, random.log)
        return cls(twice, logged(run.scenario), logs, depth, beacon_motion(run))


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
    current = np.array(run.scenario.assumed_currents)[auv]
    told = [drawn.motion[beacon.clip(0), sample], drawn.depth[auv, sample, None], current]
    return Measurements(
        sent=received - away,
        received=received,
        auv=auv,
        beacon=beacon,
        sensor=sensor,
        value=value,
        sigma=np.full(value.size, np.nan),
        told=np.concatenate(told, axis=1),
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
    x, beacon, error = symbol("x", run.true.shape[2]), symbol("beacon", len(BEACON)), symbol("e")
    z = sensor.measure(x, beacon) + sensor.deviation(x, beacon) * error
    at = np.full((len(BEACON), samples.size), np.nan)
    at[BEACON.index("auv_depth")] = run.scenario.depths[samples, auv]
    east = BEACON.index("east_current")
    at[east : east + 2] = run.scenario.currents[samples, auv].T
    measured = ca.Function("measured", [x, beacon, error], [z])
    return measured(run.true[auv, samples].T, at, errors[None]).full().ravel()


def flight(sensor: Sensor, ranged: Float[np.ndarray, " n"]) -> np.ndarray:
    """How long before a range came its message, or the question for it, was sent [s]."""
    if not isinstance(sensor, Range) or sensor.timing == "instant":
        return np.zeros_like(ranged)
    one_way = ranged / sensor.usual_sound_speed
    if sensor.timing == "one-way":
        return one_way
    return 2 * one_way + sensor.turn_around
