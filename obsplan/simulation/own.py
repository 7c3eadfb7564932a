"""What the step of one AUV is told."""

from typing import NamedTuple

from formulations.model.casadi import SX
from obsplan.estimators import Process
from obsplan.sensors import Sensor
from obsplan.vehicles import Vehicle


class Own(NamedTuple):
    """What an AUV's step is told; see `Carry` and `Inputs`."""

    truth: SX
    mean: SX
    covariance: SX
    reported: SX
    reported_covariance: SX
    in_flight: SX
    excess: SX
    reported_excess: SX
    bank: SX
    misses: SX
    survey: SX
    steer: SX
    disturbance: SX
    ping: SX
    heading_error: SX
    range_error: SX
    chance: SX
    false: SX
    repeated: SX
    depth: SX
    depth_error: SX
    bearing_error: SX
    log: SX
    log_error: SX
    water: SX
    report_chance: SX


class Kind(NamedTuple):
    """What AUVs may have in common."""

    vehicle: Vehicle  # how they move
    process: Process  # what their filters assume
    current: tuple[float, float]  # they count on [m/s]
    logs: tuple[tuple[Sensor, Sensor], ...]  # that measure speed: of the true state, the filter's
