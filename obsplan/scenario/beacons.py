"""What AUVs range to, and when: aid vehicles' transducers and other beacons, rounds and slots."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from formulations.model.ranging import Ranging
from formulations.model.schedule import ROUNDING, Schedule, intervals, is_silent
from obsplan.planning.companion import Companion, Moored
from obsplan.scenario.ranging import RangingTable
from obsplan.scenario.tables import ScenarioTable, aids_of
from obsplan.sensors.sensor import KnowsLaw, Sensor


@dataclass(frozen=True, slots=True)
class Beacon:
    """A transducer that AUVs range to, moored or carried by an aid vehicle."""

    name: str
    carrier: int | None  # number of the aid vehicle; None: it is moored
    place: tuple[float, float]  # east, north; of a carried one ahead, to the left [m]
    depth: float  # [m]


def aid_names(aids: int) -> tuple[str, ...]:
    """Names of as many aid vehicles: cna, or cna-1, cna-2, ..."""
    return ("cna",) if aids == 1 else tuple(f"cna-{i + 1}" for i in range(aids))


def beacons_of(table: ScenarioTable) -> tuple[Beacon, ...]:
    """The aid vehicles' own transducers, then the other beacons.

    Raises
    ------
    ValueError
        No beacon at all, or one on a vehicle that is not there.
    """
    aids = aids_of(table)
    found = []
    for i, (aid, name) in enumerate(zip(aids, aid_names(len(aids)), strict=True)):
        if aid.ranged:
            found.append(Beacon(name, i, (0.0, 0.0), aid.transducer_depth))
    for beacon in table.beacon:
        if beacon.on is not None and beacon.on >= len(aids):
            raise ValueError(
                f'beacon "{beacon.name}" is on aid vehicle {beacon.on}, and the last is number '
                f"{len(aids) - 1}: correct the number"
            )
        found.append(Beacon(beacon.name, beacon.on, (beacon.x, beacon.y), beacon.depth))
    if not found:
        raise ValueError("AUVs range to nothing: set ranged = true, or add a [[beacon]]")
    return tuple(found)


def offsets(table: ScenarioTable, beacons: int, auvs: int) -> Float[np.ndarray, "beacons auvs"]:
    """When in a round each range comes [s]: beacon after beacon, and AUV after AUV if polled."""
    ranging = table.ranging
    number = np.arange(beacons)[:, None] * np.ones(auvs)
    if ranging.access == "polling":
        number = number * auvs + np.arange(auvs)
    return number * ranging.slot


def ranged_steps(
    table: ScenarioTable,
    steps: int,
    offset: Float[np.ndarray, "beacons auvs"],
    random: np.random.Generator | None,
) -> Bool[np.ndarray, "steps beacons auvs"]:
    """At the end of which steps each AUV ranges to each beacon; ``random`` delays by the jitter.

    Round k = 1, 2, ... begins at k intervals.
    """
    ranging, dt = table.ranging, table.time_step
    rounds = int(intervals(steps * dt, ranging.interval))
    begin = np.arange(1, rounds + 1)[:, None, None] * ranging.interval
    times = begin + offset
    if random is not None and ranging.jitter:
        times = times + random.uniform(0.0, ranging.jitter, times.shape)
    sample = np.ceil(times / dt - ROUNDING).astype(int)
    due = (sample <= steps) & ~is_silent(times, ranging.silent)
    mask = np.zeros((steps, *offset.shape), dtype=bool)
    _, beacon, auv = np.nonzero(due)
    mask[sample[due] - 1, beacon, auv] = True
    return mask


def law_told(sensor: Sensor, table: RangingTable) -> Ranging:
    """What planners count on, of a sensor and of what may be lost."""
    plain = Ranging(sensor.sigma)
    known = sensor.ranging if isinstance(sensor, KnowsLaw) else plain
    return known._replace(
        loss=table.loss,
        half_distance=np.inf if table.half_distance is None else table.half_distance,
        reach=np.inf if table.reach is None else table.reach,
    )


def as_one(law: Ranging, transducers: int) -> Ranging:
    """What planners count on of a vehicle with several transducers: all are at its place.

    That many ranges at once tell as much as one that is more precise by the root of their number.
    A vehicle that AUVs do not range to steers as if they did.
    """
    if transducers <= 1:
        return law
    root = np.sqrt(transducers)
    return law._replace(sigma=law.sigma / root, growth=law.growth / root)


def schedule_of(table: RangingTable, offset: Float[np.ndarray, " auvs"]) -> Schedule:
    """When AUVs range to a beacon, as it is planned."""
    slots = tuple(offset.tolist()) if table.slot else ()
    return Schedule(interval=table.interval, offsets=slots, silent=table.silent)


def moored(
    beacons: tuple[Beacon, ...],
    law: Ranging,
    table: RangingTable,
    offset: Float[np.ndarray, "beacons auvs"],
) -> tuple[Companion, ...]:
    """The moored beacons, as planners know them."""
    return tuple(
        Companion(
            route=Moored(*beacon.place),
            ranging=law,
            schedule=schedule_of(table, offset[b]),
            depth=beacon.depth,
        )
        for b, beacon in enumerate(beacons)
        if beacon.carrier is None
    )
