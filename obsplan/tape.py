"""A mission as what was moved, measured and heard: what a recording of real vehicles has, too."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Integer

from obsplan.sensors import Sensor


class Measurements(NamedTuple):
    """What came to an AUV from a beacon, or what it measured of its speed, a row each.

    They are in the order in which its filter takes them.
    """

    # by the beacon, or the question to it [s]; by the instrument's mean speed of sound
    sent: Float[np.ndarray, " n"]
    received: Float[np.ndarray, " n"]  # by the AUV [s]
    auv: Integer[np.ndarray, " n"]  # number
    beacon: Integer[np.ndarray, " n"]  # number; -1 of what concerns none
    sensor: Integer[np.ndarray, " n"]  # number in `Tape.sensors`
    value: Float[np.ndarray, " n"]  # in the sensor's unit: [m], [m^2], [rad] or [m/s]
    sigma: Float[np.ndarray, " n"]  # of this very one, in that unit; nan: the sensor's own
    # the other vehicle as the AUV takes it, rows of `BEACON`: where it is when the measurement
    # comes; a recording has it where it was when it sent, at rest
    told: Float[np.ndarray, "n 10"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Tape:
    """Motions, measurements and beacon tracks; the truth where there is one.

    Frames as in `obsplan.Run`. Turns, changes of speed and sway are what an AUV measured of itself
    in the step that ends at a sample (in a simulation with ``estimator.motion = "commanded"`` what
    its survey commanded), headings what its compass said then; all begin at the second
    sample. Samples may be unevenly apart; each measurement is received at one of them. Its beacon
    is a number in ``beacons``, or that many and the number of another AUV.
    """

    time: Float[np.ndarray, " samples"]  # [s], increasing
    auvs: tuple[str, ...]  # names
    beacons: tuple[str, ...]
    turn: Float[np.ndarray, "auvs steps"]  # [rad]
    change_of_speed: Float[np.ndarray, "auvs steps"]  # through the water [m/s]
    sway: Float[np.ndarray, "auvs steps"]  # moved to the left [m]
    heading: Float[np.ndarray, "auvs steps"]  # measured [rad]; nan where none was
    depth: Float[np.ndarray, "auvs samples"]  # of the transducer, as measured [m]
    pose: Float[np.ndarray, "beacons samples 3"]  # east, north [m], heading [rad]
    beacon_depth: Float[np.ndarray, " beacons"]  # [m]
    # by name: the model that truth was measured by, where it is known
    sensors: Mapping[str, Sensor]
    measurements: Measurements
    truth: Float[np.ndarray, "auvs samples n"] | None = None
