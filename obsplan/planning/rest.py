"""What is left of a mission, as a problem of `formulations.whole_mission`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from formulations.model.frames import Frame
from formulations.model.schedule import Schedule
from formulations.whole_mission import AidVehicle, Beacon, Problem
from obsplan.planning.filed import Filed
from obsplan.planning.limits import SURE, margins
from obsplan.planning.situation import Situation
from obsplan.types import Belief, Pose

# Decimals [m], [m/s]: the same world seen from other axes is the same problem to the last bit.
PLACES = 9
# Kept from limits, in smallest turning radii: what a penalty leaves of a violation is less.
MARGIN = 0.05


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of the AUVs at a sample of their filed surveys, which they go on with.

    ``margin`` is kept from each for not knowing where it is then, three standard deviations
    (`SURE`).
    """

    filed: Filed
    first: int  # the sample
    offset: Float[np.ndarray, "auvs 2"]  # from where they filed to be [m]
    covariance: Float[np.ndarray, "auvs 4 4"]
    margin: Float[np.ndarray, " auvs"]  # [m]

    @classmethod
    def as_filed(cls, filed: Filed, first: int) -> "Known":
        """Where they filed to be, or strayed from there, and known as well as at the beginning."""
        nowhere = np.zeros(filed.position.shape[1:])
        return cls(filed, first, nowhere, filed.covariance, SURE * filed.straying[first])

    @classmethod
    def as_believed(cls, filed: Filed, first: int, auvs: Sequence[Belief]) -> "Known":
        """Where they are believed to be; of a depth that is estimated nothing is told."""
        offset = np.array([auv.mean[:2] for auv in auvs]) - filed.position[first]
        covariance = np.array([auv.horizontal_covariance for auv in auvs])
        return cls(filed, first, offset, covariance, margins(auvs))

    @cached_property
    def margins(self) -> Float[np.ndarray, "auvs samples"]:
        """Kept from each AUV at all samples [m]: it strays, and moves between two samples."""
        filed = self.filed
        since = filed.straying**2 - filed.straying[self.first] ** 2
        strayed = np.hypot(self.margin, SURE * np.sqrt(np.maximum(since, 0.0)))
        return (strayed + 0.5 * filed.strides).T


def sample_at(filed: Filed, time: float) -> int:
    """The sample of a time [s], at most the last but one."""
    return min(round(time / filed.time_step), filed.time.size - 2)


def problem_of(
    situation: Situation, known: Known, frame: Frame, vehicles: tuple[AidVehicle, ...]
) -> Problem:
    """What is known from a sample on, as seen in a frame, in the water about the vehicles."""
    filed = known.filed
    after = slice(known.first, None)
    since = filed.time[after] - filed.time[known.first]
    drift = situation.stream.drift(since)
    beacons = [
        Beacon(
            position=frame.positions(one.route(since) - drift),
            ranging=one.ranging,
            schedule=sampled(one.schedule, filed),
            depth=one.depth,
        )
        for one in situation.companions
        if one.ranging is not None
    ]
    courses = np.stack([np.cos(filed.heading[after]), np.sin(filed.heading[after])], axis=-1)
    total = filed.weights.sum()
    alike = np.full(filed.weights.size, 1 / filed.weights.size)
    weights = filed.weights / total if total > 0 else alike
    position = frame.positions(filed.position[after] + known.offset - drift[:, None])
    heading = frame.directions(courses)
    return Problem(
        time_step=filed.time_step,
        begin=known.first * filed.time_step,
        position=np.round(position, PLACES),
        heading=np.round(heading, PLACES),
        speed=np.round(filed.speed[after], PLACES),
        depth=filed.depth[after],
        covariance=seen_covariances(frame, known.covariance),
        process_noise=filed.process_noise,
        weights=weights,
        compass=situation.heading_sigma,
        vehicles=vehicles,
        beacons=tuple(beacons),
        separation=(situation.constraints.min_separation_cna, np.inf),
    )


def vehicle_of(situation: Situation, known: Known, frame: Frame, pose: Pose) -> AidVehicle:
    """The vehicle at a pose and its ranges, as seen in a frame."""
    place = frame.positions(np.array([pose.x, pose.y]))
    turned = frame.mirror * (pose.heading - frame.heading)
    return AidVehicle(
        start=np.round([*place, turned], PLACES) + 0.0,  # no -0.0
        speed=situation.cna.speed,
        max_turn_rate=situation.cna.max_turn_rate,
        ranging=situation.ranging,
        schedule=sampled(situation.schedule, known.filed),
        depth=situation.transducer_depth,
        violation=Limits(situation, known, frame) if situation.constraints else None,
        margin=MARGIN * situation.cna.min_turn_radius,
    )


def sampled(schedule: Schedule, filed: Filed) -> Schedule:
    """A schedule whose interval is a whole number of samples."""
    steps = schedule.interval / filed.time_step
    every = round(min(steps, filed.time.size))  # at most: none in the mission
    return replace(schedule, interval=every * filed.time_step)


def frame_at(pose: Pose, filed: Filed) -> Frame:
    """The vehicle's frame, abeam counted to the side where the AUVs are.

    Worlds that are each other's mirror images look the same in it.
    """
    frame = Frame(np.array([pose.x, pose.y]), pose.heading)
    to_the_left = frame.positions(filed.position.mean(axis=0))[:, 1] @ filed.weights
    return frame._replace(mirror=-1.0 if to_the_left < -(10.0**-PLACES) else 1.0)


def seen_covariances(frame: Frame, P: Float[np.ndarray, "M 4 4"]) -> Float[np.ndarray, "M 4 4"]:
    """Covariances in a frame, of which `PLACES` are kept of what is in [m]."""
    exact = frame.covariances(P)
    turned = np.round(exact, PLACES)
    turned[:, 2:, 2:] = exact[:, 2:, 2:]  # at most their signs have changed
    return turned


@dataclass(frozen=True, eq=False)
class Limits:
    """How far positions in a frame break the limits at times since a sample.

    The AUVs are near where they would be on their filed surveys. Separations have a margin of three
    standard deviations (`SURE`) of how far an AUV may be from there by then (`Filed.straying`).
    """

    situation: Situation
    known: Known
    frame: Frame

    def __call__(
        self, positions: Float[np.ndarray, "*batch 2"], time: Float[np.ndarray, " *samples"]
    ) -> Float[np.ndarray, "*batch"]:
        """Violation [m]; half of each vehicle's way between two samples is added.

        So nothing between the samples is missed.
        """
        limits, stream = self.situation.constraints, self.situation.stream
        filed, offset = self.known.filed, self.known.offset
        world = np.ascontiguousarray(self.frame.world(positions)) + stream.drift(time)
        speed = self.situation.cna.speed + math.hypot(*stream.current)
        since = (time / filed.time_step).round().astype(int)
        at = (since + self.known.first).clip(max=filed.time.size - 1)
        broken = [limits.fixed_violation(world)]
        if limits.separates:  # one after the other: each needs a margin of its own at each time
            auvs = np.moveaxis(filed.position, 1, 0)[:, at, None] + offset[:, None, None]
            broken += [
                limits.separation_violation(world, auv) + margin
                for auv, margin in zip(auvs, self.known.margins[:, at], strict=True)
            ]
        return np.max(broken, axis=0) + 0.5 * speed * filed.time_step
