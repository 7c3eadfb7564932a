"""One vehicle's part of a mission that others aid as well."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..cramer_rao import ranging_information
from .limits import apart
from .problem import AidVehicle, Beacon, Problem, Violation


def beacon_of(vehicle: AidVehicle, position: Float[np.ndarray, "samples 2"]) -> Beacon:
    """What a vehicle is to others once it is known where it goes."""
    return Beacon(
        position=position,
        ranging=vehicle.ranging,
        schedule=vehicle.schedule,
        depth=vehicle.depth,
    )


def alone(problem: Problem, vehicle: AidVehicle, others: Iterable[Beacon]) -> Problem:
    """The problem of one vehicle, where other vehicles go being known."""
    others = tuple(others)
    return replace(
        problem,
        vehicles=(replace(vehicle, violation=with_others(problem, vehicle, others)),),
        beacons=(*problem.beacons, *others),
    )


def with_others(
    problem: Problem, vehicle: AidVehicle, others: tuple[Beacon, ...]
) -> Violation | None:
    """How far positions break a vehicle's own limits, or its distances to others."""
    own, (least, greatest) = vehicle.violation, problem.separation
    if not others or (least <= 0 and greatest == np.inf):
        return own

    own_way = vehicle.speed * problem.time_step
    ways = [own_way + np.linalg.norm(np.diff(o.position, axis=0), axis=-1).max() for o in others]

    def violation(positions: np.ndarray, time: np.ndarray) -> np.ndarray:
        samples = np.round(time / problem.time_step).astype(int).clip(max=problem.steps)
        worst = [] if own is None else [own(positions, time)]
        for other, way in zip(others, ways, strict=True):
            broken, _ = apart(positions - other.position[samples], least, greatest)
            worst.append(broken + 0.5 * way)
        return np.max(worst, axis=0)

    return violation


def information(problem: Problem) -> Float[np.ndarray, "samples M 2 2"]:
    """What ranges to beacons are expected to tell of the AUVs' positions at samples [1/m^2].

    Their second-order error is left out.
    """
    total = np.zeros((problem.steps + 1, len(problem.weights), 2, 2))
    pings = problem.pings[len(problem.vehicles) :]
    for beacon, of_each in zip(problem.beacons, pings, strict=True):
        height = problem.height(beacon)
        for auv, samples in enumerate(of_each):
            x = beacon.position[samples] - problem.position[samples, auv]
            above = height[samples, auv]
            told = ranging_information(x, beacon.ranging, above, expected=True)
            np.add.at(total[:, auv], samples, told)
    return total
