r"""A mission as known before it begins, and what becomes of the AUVs' covariances between ranges.

State of an AUV: (east, north [m], heading [rad], speed through the water [m/s]). Each sample of the
mission, its filter predicts,

.. math:: P \leftarrow F P F^\top + Q, \quad F = I + A \Delta t,

A having the columns (-V sin ψ, V cos ψ) and (cos ψ, sin ψ) of the heading and the speed, and
corrects by the compass. Any number of such samples amounts to one reading of the first heading of
information h, followed by one prediction:

.. math:: P \leftarrow \bar F \Bigl(P - \frac{h\, p_3 p_3^\top}{1 + h P_{33}}\Bigr) \bar F^\top
          + \bar Q,

p_3 being the heading's column of P. (F̄, Q̄) is the filter begun with a known state, and h what its
readings tell of the state it began with. None of it depends on where the aid vehicles are. (Linear
fractional form of the Riccati equation: Kailath, Sayed and Hassibi 2000, chapter 17.)
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Integer

from ..model.quadrature import simpson
from ..model.ranging import Ranging
from ..model.schedule import ROUNDING, Schedule

HEADING = 2  # index in the state
# Steps of the covariance recursion; ranges at more instants than that are taken together.
MOST_STAGES = 400
Violation = Callable[
    [Float[np.ndarray, "*batch 2"], Float[np.ndarray, " *samples"]], Float[np.ndarray, "*batch"]
]


class Maps(NamedTuple):
    """What intervals without ranges do to the covariances of M AUVs; see the module."""

    transition: Float[np.ndarray, "S M 4 4"]  # F̄
    noise: Float[np.ndarray, "S M 4 4"]  # Q̄
    heading: Float[np.ndarray, "S M"]  # h [1/rad^2]


class MissionStages(NamedTuple):
    """The mission cut at its ranges, which end each stage; the last stage perhaps has none.

    ``share`` is of the mission's time: of the beginning, middle and end of each stage, before its
    ranges.
    """

    end: Integer[np.ndarray, " S"]  # sample
    pings: Float[np.ndarray, "S K M"]  # number of ranges of each `Problem.ranged` to each AUV
    halves: tuple[Maps, Maps]
    share: Float[np.ndarray, "S 3"]


@dataclass(frozen=True, kw_only=True, eq=False)
class AidVehicle:
    """An aid vehicle to plan for, and its ranges to the AUVs.

    The schedule's interval is a whole number of time steps. Ranges between samples are measured at
    the later one.
    """

    start: Float[np.ndarray, "3"]  # east, north [m], heading [rad]
    speed: float  # [m/s]
    max_turn_rate: float  # [rad/s]
    ranging: Ranging
    schedule: Schedule
    depth: float = 0.0  # of its transducer [m]
    # How far [m] positions at times since the beginning [s] are on the wrong side of a limit, at
    # most 0 where they are right.
    violation: Violation | None = None
    margin: float = 0.0  # kept from its limits [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Beacon:
    """What AUVs range to as well and nobody plans for: it is fixed, or moves as is known."""

    position: Float[np.ndarray, "samples 2"]  # [m]
    ranging: Ranging
    schedule: Schedule
    depth: float = 0.0  # of its transducer [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """What is known before a mission begins, at K + 1 samples of M AUVs, and who aids them.

    ``process_noise`` has standard deviations per square root of a second; weights sum to one.
    """

    time_step: float  # [s]
    begin: float = 0.0  # time of the first sample [s]
    position: Float[np.ndarray, "samples M 2"]  # [m]
    heading: Float[np.ndarray, "samples M 2"]  # unit vectors, of the step that begins at the sample
    speed: Float[np.ndarray, "samples M"]  # through the water [m/s]
    depth: Float[np.ndarray, "samples M"] | float = 0.0  # [m]
    covariance: Float[np.ndarray, "M 4 4"]
    process_noise: Float[np.ndarray, "M 4"]
    weights: Float[np.ndarray, " M"]
    compass: float  # standard deviation [rad]
    vehicles: tuple[AidVehicle, ...]
    beacons: tuple[Beacon, ...] = ()
    # Least and greatest distance between any two of the aid vehicles [m].
    separation: tuple[float, float] = (0.0, np.inf)

    @property
    def steps(self) -> int:
        """Samples after the first."""
        return len(self.position) - 1

    @property
    def ranged(self) -> tuple[AidVehicle | Beacon, ...]:
        """All that AUVs range to: the aid vehicles, then the beacons."""
        return *self.vehicles, *self.beacons

    def height(self, other: AidVehicle | Beacon) -> Float[np.ndarray, "samples M"]:
        """How far [m] another transducer is above each AUV's."""
        return np.broadcast_to(self.depth - other.depth, self.speed.shape)

    @cached_property
    def pings(self) -> list[list[Integer[np.ndarray, " N"]]]:
        """Samples of the ranges of each `ranged` to each AUV; none is the first."""
        auvs = range(len(self.weights))
        return [[self._pings(other.schedule, auv) for auv in auvs] for other in self.ranged]

    def _pings(self, schedule: Schedule, auv: int) -> Integer[np.ndarray, " N"]:
        end = self.begin + self.steps * self.time_step
        since = schedule.times(auv, self.begin, end) - self.begin
        return np.ceil(since / self.time_step - ROUNDING).astype(int)

    @cached_property
    def stages(self) -> MissionStages:
        """The mission cut at its ranges.

        Where there are too many instants, an odd number of them counts as the middle one.
        """
        instants = np.unique(np.concatenate([one for each in self.pings for one in each]))
        size = group_size(instants.size)
        end = []
        for first in range(0, instants.size, size):
            group = instants[first : first + size]
            end.append(int(group[(len(group) - 1) // 2]))
        if not end or end[-1] < self.steps:
            end.append(self.steps)
        pings = np.zeros((len(end), len(self.ranged), len(self.weights)))
        for k, of_each in enumerate(self.pings):
            for auv, samples in enumerate(of_each):
                np.add.at(pings[:, k, auv], np.searchsorted(instants, samples) // size, 1.0)
        begin = np.array([0, *end[:-1]])
        stop = np.array(end)
        middle = begin + (stop - begin) // 2
        lasts = (stop - begin) / self.steps
        share = simpson(middle - begin, stop - middle) * lasts[:, None]
        halves = self.maps(begin, middle), self.maps(middle, stop)
        return MissionStages(stop, pings, halves, share)

    def maps(self, begin: Integer[np.ndarray, " S"], end: Integer[np.ndarray, " S"]) -> Maps:
        """What the intervals from samples ``begin`` to ``end`` do to the covariances."""
        shape = len(begin), len(self.weights)
        T = np.broadcast_to(np.eye(4), (*shape, 4, 4)).copy()
        Q = np.zeros((*shape, 4, 4))
        h = np.zeros(shape)
        random_walk = self.process_noise[..., None] ** 2 * np.eye(4) * self.time_step
        for step in range(int(np.max(end - begin, initial=0))):
            now = np.flatnonzero(begin + step < end)
            F = self._transitions[begin[now] + step]
            t = F @ T[now]
            q = F @ Q[now] @ F.swapaxes(-1, -2) + random_walk
            innovation = q[..., HEADING, HEADING] + self.compass**2
            gain = q[..., HEADING] / innovation[..., None]
            h[now] += t[..., HEADING, HEADING] ** 2 / innovation
            T[now] = t - gain[..., None] * t[..., HEADING, None, :]
            Q[now] = q - gain[..., None] * q[..., HEADING, None, :]
        return Maps(T, Q, h)

    @cached_property
    def _transitions(self) -> Float[np.ndarray, "steps M 4 4"]:
        """F of each step."""
        dt = self.time_step
        speed = self.speed[:-1]
        east, north = np.moveaxis(self.heading[:-1], -1, 0)
        F = np.broadcast_to(np.eye(4), (*east.shape, 4, 4)).copy()
        F[..., 0, 2] = -speed * north * dt
        F[..., 1, 2] = speed * east * dt
        F[..., 0, 3] = east * dt
        F[..., 1, 3] = north * dt
        return F


def group_size(instants: int) -> int:
    """How many instants are taken together, so that there are no more than `MOST_STAGES` stages."""
    if instants <= MOST_STAGES:
        return 1
    least = -(-instants // MOST_STAGES)
    return least // 2 * 2 + 1


def advance(P: Float[np.ndarray, "M 4 4"], maps: Maps, stage: int) -> Float[np.ndarray, "M 4 4"]:
    """Covariances after one of the intervals."""
    T, Q, h = (part[stage] for part in maps)
    column = P[..., HEADING]
    gain = h / (1 + h * column[..., HEADING])
    known = P - gain[:, None, None] * column[..., :, None] * column[..., None, :]
    return T @ known @ T.swapaxes(-1, -2) + Q
