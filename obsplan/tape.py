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


@dataclass(frozen=True, kw_only=True, eq=False)
class Tape:
    """Motions, measurements and beacon tracks; the truth where there is one.

    Frames as in `obsplan.Run`. Turns and changes of speed are what an AUV measured of itself in the
    step that ends at a sample, headings what its compass said then; both begin at the second
    sample.
    """

    time: Float[np.ndarray, " samples"]  # [s]
    auvs: tuple[str, ...]  # names
    beacons: tuple[str, ...]
    turn: Float[np.ndarray, "auvs steps"]  # [rad]
    change_of_speed: Float[np.ndarray, "auvs steps"]  # through the water [m/s]
    heading: Float[np.ndarray, "auvs steps"]  # measured [rad]
    depth: Float[np.ndarray, "auvs samples"]  # of the transducer, as measured [m]
    pose: Float[np.ndarray, "beacons samples 3"]  # east, north [m], heading [rad]
    beacon_depth: Float[np.ndarray, " beacons"]  # [m]
    # by name: the model that truth was measured by, where it is known
    sensors: Mapping[str, Sensor]
    measurements: Measurements
    truth: Float[np.ndarray, "auvs samples n"] | None = None
