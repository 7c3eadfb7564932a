"""The tape of a mission that was flown."""

import numpy as np
from jaxtyping import Float

from obsplan.run import Run
from obsplan.scenario.states import BASIC
from obsplan.sensors import Range, Sensor
from obsplan.simulation.inputs import mission_inputs
from obsplan.tape import Measurements, Tape
from obsplan.types import Pose


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
    sensors: dict[str, Sensor] = {scenario.ranging_kind: scenario.range_sensor}
    if scenario.bearing_sensor is not None:
        sensors["bearing"] = scenario.bearing_sensor
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
        sensors=sensors,
        measurements=measurements(run, inputs.repeated),
        truth=run.truth,
    )


def measurements(run: Run, repeated: Float[np.ndarray, "steps auvs some"]) -> Measurements:
    """What came, in order: by time, beacon and AUV, the range before its bearing."""
    came = np.moveaxis(run.came, -1, 0)  # samples, beacons, AUVs
    sample, beacon, auv = np.nonzero(came)
    value = run.ranges[beacon, auv, sample]
    times = np.ones(sample.size, dtype=int)
    if repeated.size:
        times += repeated[sample - 1, auv, beacon].astype(int)
    columns = [sample, beacon, auv, np.zeros_like(sample), value]
    rows = [np.repeat(column, times) for column in columns]
    if len(run.bearings):
        bearing = [sample, beacon, auv, np.ones_like(sample), run.bearings[beacon, auv, sample]]
        rows = [np.concatenate(pair) for pair in zip(rows, bearing, strict=True)]
    order = np.lexsort((rows[3], rows[2], rows[1], rows[0]))
    sample, beacon, auv, sensor, value = (row[order] for row in rows)
    received = run.time[sample]
    ranged = run.ranges[beacon, auv, sample]
    return Measurements(
        sent=received - flight(run.scenario.range_sensor, ranged),
        received=received,
        auv=auv,
        beacon=beacon,
        sensor=sensor,
        value=value,
    )


def flight(sensor: Sensor, ranged: Float[np.ndarray, " n"]) -> np.ndarray:
    """How long before a range came its message, or the question for it, was sent [s]."""
    if not isinstance(sensor, Range) or sensor.timing == "instant":
        return np.zeros_like(ranged)
    one_way = ranged / (sensor.assumed_sound_speed or sensor.sound_speed)
    if sensor.timing == "one-way":
        return one_way
    return 2 * one_way + sensor.turn_around
