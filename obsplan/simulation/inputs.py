"""What a mission is given from outside: first estimates, schedules, survey and noise."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from formulations.model.covariance import pack_array
from obsplan.estimators.filtering import GONE
from obsplan.scenario import Scenario
from obsplan.scenario.states import first_covariance, first_mean, first_truth, noise
from obsplan.scenario.tables import aids_of
from obsplan.simulation.features import Features
from obsplan.simulation.step import Carry, Inputs
from obsplan.types import Pose


class Streams(NamedTuple):
    """Random streams of their own, so that planners meet the same noise (thesis 5.3)."""

    process: np.random.Generator
    measurement: np.random.Generator
    planner: np.random.Generator
    schedule: np.random.Generator
    arrival: np.random.Generator
    faults: np.random.Generator
    depth: np.random.Generator
    bearing: np.random.Generator
    log: np.random.Generator
    report: np.random.Generator


def streams(seed: int) -> Streams:
    """Independent streams of a mission."""
    children = np.random.SeedSequence(seed).spawn(len(Streams._fields))
    return Streams(*(np.random.default_rng(child) for child in children))


def mission_inputs(scenario: Scenario, starts: Sequence[Pose], seed: int) -> tuple[Carry, Inputs]:
    """The state at time 0, the aid vehicles being at ``starts``, and the inputs of every step."""
    random = streams(seed)
    # samples, AUVs, basic states
    survey = np.stack(
        [np.column_stack([m.position, m.heading, m.speed]) for m in scenario.motions], axis=1
    )
    steps, auvs = len(survey) - 1, survey.shape[1]
    truth = first_truth(scenario, survey[0])
    carry = first_carry(scenario, starts, truth, random.measurement.standard_normal(truth.shape))
    heading_error = random.measurement.standard_normal((steps, auvs, 1))
    range_error = random.measurement.standard_normal((steps, auvs, len(scenario.beacons)))
    bias = np.deg2rad(scenario.table.ranging.compass_bias_deg)
    nothing = Inputs(*[np.empty((steps, auvs, 0))] * len(Inputs._fields))
    inputs = nothing._replace(
        time=scenario.time[:-1, None, None],
        decide=(np.arange(steps) % scenario.decide_every == 0)[:, None, None],
        given=np.zeros((steps, len(starts), 2)),
        ping=due(scenario, random.schedule).swapaxes(1, 2),
        survey=survey[:-1],
        steer=survey[1:, :, 2:],
        disturbance=disturbance(scenario, random.process.standard_normal((steps, *truth.shape))),
        heading_error=heading_error * scenario.heading_sensor.sigma + bias,
        range_error=range_error,
        stream=np.empty((steps, len(starts), 0)),
    )
    inputs = at_sea(inputs, scenario, random)
    return carry, Inputs(*(np.asarray(a, dtype=float) for a in inputs))


def at_sea(inputs: Inputs, scenario: Scenario, random: Streams) -> Inputs:
    """The inputs with what a scenario has besides those that every mission has."""
    has, of_each = Features.of(scenario), inputs.range_error.shape
    if has.lossy:
        inputs = inputs._replace(chance=random.arrival.random(of_each))
    false, twice = faults(scenario, random.faults)
    inputs = inputs._replace(false=false, repeated=twice)
    if has.deep:
        depth = scenario.depths[..., None]
        inputs = inputs._replace(
            survey=np.concatenate([inputs.survey, depth[:-1]], axis=-1),
            depth=depth[1:],
            depth_error=depth_errors(scenario, random.depth),
        )
    if has.bearing:
        inputs = inputs._replace(bearing_error=random.bearing.standard_normal(of_each))
    if has.logged:
        log_error = log_errors(scenario, random.log)
        inputs = inputs._replace(log=logged(scenario), log_error=log_error)
    if has.varying:
        inputs = inputs._replace(water=scenario.currents[1:])
    if has.carried:
        inputs = inputs._replace(stream=stream(scenario))
    if has.unheard:
        inputs = inputs._replace(report_chance=random.report.random(of_each))
    return inputs


def due(scenario: Scenario, random: Any) -> Bool[np.ndarray, "steps beacons auvs"]:
    """At the end of which steps ranges are due; ``random`` is the stream of schedules."""
    return scenario.ranged(random if scenario.table.ranging.jitter else None)


def faults(scenario: Scenario, random: Any) -> tuple[np.ndarray, np.ndarray]:
    """What is false of each range, and which are delivered twice; ``random`` is the stream."""
    features, steps = Features.of(scenario), scenario.time.size - 1
    shape = (steps, len(scenario.table.auv), len(scenario.beacons))
    nothing = np.empty((*shape[:2], 0))
    false = false_ranges(scenario, random, shape) if features.false else nothing
    twice = repeated(scenario, random, shape) if features.repeated else nothing
    return false, twice


def log_errors(
    scenario: Scenario, random: np.random.Generator
) -> Float[np.ndarray, "steps auvs some"]:
    """Errors of measured speeds in standard deviations; ``random`` is the stream of logs."""
    features = Features.of(scenario)
    shape = (scenario.time.size - 1, len(scenario.table.auv), features.logged)
    return random.standard_normal(shape)


def depth_errors(
    scenario: Scenario, random: np.random.Generator
) -> Float[np.ndarray, "steps auvs 1"]:
    """Errors of measured depths [m]; ``random`` is the stream of depths."""
    shape = (scenario.time.size - 1, len(scenario.table.auv), 1)
    return random.standard_normal(shape) * scenario.depth_sigma


def logged(scenario: Scenario) -> Bool[np.ndarray, "steps auvs 1"]:
    """At the end of which steps each AUV's speed is measured."""
    number = np.arange(1, scenario.time.size)[:, None]
    every = np.array(scenario.log_every)
    due = (number % np.maximum(every, 1) == 0) & (every > 0)
    return due[..., None]


def stream(scenario: Scenario) -> Float[np.ndarray, "steps aids 2"]:
    """Current at the surface over each step [m/s]; 0 for aid vehicles that steer over ground."""
    surface = scenario.water.at(scenario.time[:-1], 0.0)
    carried = np.array([aid.carried for aid in aids_of(scenario.table)])
    return surface[:, None] * carried[:, None]


def disturbance(
    scenario: Scenario, drawn: Float[np.ndarray, "steps auvs n"]
) -> Float[np.ndarray, "steps auvs n"]:
    """What moves the true states besides their models: process noise, and water unknown to them."""
    dt = scenario.table.time_step
    moved = drawn * noise(scenario, scenario.truth_states) * np.sqrt(dt)
    unknown = scenario.unknown_currents
    if unknown is not None:
        moved[..., :2] += unknown[:-1] * dt
    return moved


def false_ranges(
    scenario: Scenario, random: np.random.Generator, shape: tuple[int, int, int]
) -> Float[np.ndarray, "steps auvs two_per_beacon"]:
    """Of each range, how much [m] it is longer whatever the distance, and its relative error.

    A way by multipath is longer by an exponential distribution; a clock that is late lengthens all;
    a relative error holds for the mission.
    """
    ranging = scenario.table.ranging
    # always drawn, so that one fault does not change another
    strays, longer = random.random(shape), random.exponential(size=shape)
    scale = random.standard_normal() * ranging.scale_sigma
    late = ranging.clock_offset + ranging.clock_drift * scenario.time[1:, None, None]
    excess = np.where(strays < ranging.outliers, longer * ranging.outlier_mean, 0.0)
    excess = excess + late * scenario.assumed_sound_speed
    return np.concatenate([excess, np.full(shape, scale)], axis=-1)


def repeated(
    scenario: Scenario, random: np.random.Generator, shape: tuple[int, int, int]
) -> np.ndarray:
    """Which ranges are delivered twice."""
    return random.random(shape) < scenario.table.ranging.duplicates


def first_carry(
    scenario: Scenario, starts: Sequence[Pose], truth: np.ndarray, error: np.ndarray
) -> Carry:
    """Truth, first estimates and the aid vehicles' poses at time 0."""
    mean = first_mean(scenario, truth, error)
    lower = pack_array(first_covariance(scenario, scenario.filter_states))
    cna = np.array([[start.x, start.y, start.heading] for start in starts])
    command = np.array([[0.0, aid.speed] for aid in scenario.aids])
    excess = np.zeros((len(mean), int(Features.of(scenario).doubted)))
    # nothing is on its way yet: what waits for no step never arrives
    report = np.concatenate([mean, lower, excess, np.zeros((len(mean), 1))], axis=1)
    in_flight = np.tile(report, scenario.in_flight)
    counted = scenario.filtering().counted
    return Carry(
        cna=cna,
        command=command,
        truth=truth,
        mean=mean,
        covariance=lower,
        reported=mean,
        reported_covariance=lower,
        in_flight=in_flight,
        excess=excess,
        reported_excess=excess,
        bank=first_bank(scenario, mean, lower),
        misses=np.zeros((len(mean), counted)),
    )


def first_bank(
    scenario: Scenario, mean: np.ndarray, lower: np.ndarray
) -> Float[np.ndarray, "auvs rows"]:
    """The first estimates as the only hypotheses, with room for those of the first ranges."""
    count = scenario.hypotheses
    if count == 1:
        return np.empty((len(mean), 0))
    whole = np.ones((len(mean), 1))
    there = np.concatenate([mean, lower, np.zeros((len(mean), 1))], axis=1)
    empty = np.concatenate([mean, lower, np.full((len(mean), 1), GONE)], axis=1)
    return np.concatenate([whole, there, np.tile(empty, count - 1)], axis=1)
