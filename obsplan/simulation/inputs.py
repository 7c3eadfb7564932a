"""What a mission is given from outside: first estimates, schedules, survey and noise."""

from typing import NamedTuple

import numpy as np

from formulations.model.covariance import pack_array
from obsplan.scenario import Scenario
from obsplan.scenario.states import first_covariance, first_mean, first_truth, noise
from obsplan.simulation.step import Carry, Inputs
from obsplan.types import Pose


class Streams(NamedTuple):
    """Random streams of their own, so that planners meet the same noise (thesis 5.3)."""

    process: np.random.Generator
    measurement: np.random.Generator
    planner: np.random.Generator


def streams(seed: int) -> Streams:
    """Independent streams of a mission."""
    return Streams(*(np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)))


def mission_inputs(scenario: Scenario, start: Pose, seed: int) -> tuple[Carry, Inputs]:
    """The state at time 0, the aid vehicle being at ``start``, and the inputs of every step."""
    process, measurement, _ = streams(seed)
    # samples, AUVs, basic states
    survey = np.stack(
        [np.column_stack([m.position, m.heading, m.speed]) for m in scenario.motions], axis=1
    )
    steps, auvs = len(survey) - 1, survey.shape[1]
    truth = first_truth(scenario, survey[0])
    carry = first_carry(scenario, start, truth, measurement.standard_normal(truth.shape))
    index = np.arange(steps)
    heading_error, range_error = (measurement.standard_normal((steps, auvs, 1)) for _ in range(2))
    inputs = Inputs(
        time=scenario.time[:-1, None, None],
        decide=(index % scenario.decide_every == 0)[:, None, None],
        given=np.zeros((steps, 1, 2)),
        ping=((index + 1) % scenario.ping_every == 0)[:, None, None],
        survey=survey[:-1],
        steer=survey[1:, :, 2:],
        disturbance=process.standard_normal((steps, *truth.shape))
        * noise(scenario, scenario.truth_states)
        * np.sqrt(scenario.table.time_step),
        heading_error=heading_error * scenario.heading_sensor.sigma,
        range_error=range_error,
    )
    return carry, Inputs(*(np.asarray(a, dtype=float) for a in inputs))


def first_carry(scenario: Scenario, start: Pose, truth: np.ndarray, error: np.ndarray) -> Carry:
    """Truth, first estimates and the aid vehicle's pose at time 0."""
    mean = first_mean(scenario, truth, error)
    lower = pack_array(first_covariance(scenario, scenario.filter_states))
    cna = np.array([[start.x, start.y, start.heading]])
    command = np.array([[0.0, scenario.cna.speed]])
    return Carry(cna, command, truth, mean, lower, mean, lower)
