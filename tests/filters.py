"""Filters for tests, and what they are told: AUVs that dead reckon among beacons."""

from contextlib import contextmanager

import numpy as np
from jaxtyping import config

from obsplan.estimators import ESTIMATORS, Process
from obsplan.estimators.filter import Filter
from obsplan.estimators.filtering import Filtering
from obsplan.sensors import BEACON, Range
from obsplan.vehicles import DeadReckoning

# of a scenario: steps, and an aid vehicle that heads east to the north of AUVs at the origin
AID = {
    "time_step": 0.5,
    "origin": {"lat": 47.6, "lon": -122.3},
    "cna": {
        "speed": 2.0,
        "min_turn_radius": 10.0,
        "start": {"x": -40.0, "y": 50.0, "heading_deg": 0.0},
    },
}
NOISE = (0.05, 0.05, 0.005, 0.01)


def filter_of(mean, deviations, *, noise=NOISE, kind="ekf", **gated):
    """A filter of (east, north, heading, speed) by its first mean and standard deviations."""
    return Filter(
        filtering=Filtering(estimator=ESTIMATORS[kind](), count=4, **gated),
        process=lambda dt: Process(model=DeadReckoning(), noise=noise, dt=dt),
        mean=np.array(mean, dtype=float),
        covariance=np.diag(np.array(deviations, dtype=float) ** 2),
    )


def beacon_at(east, north, *, depth=0.0, auv_depth=0.0):
    """What a filter is told of a beacon."""
    told = np.zeros(len(BEACON))
    told[:2] = east, north
    told[BEACON.index("depth")], told[BEACON.index("auv_depth")] = depth, auv_depth
    return told


def course(steps, *, turn=0.0, speed=1.0, start=(0.0, 0.0, 0.0), dt=1.0):
    """True places of an AUV that holds its heading over each step and turns at its end."""
    east, north, heading = start
    places = [(east, north)]
    for _ in range(steps):
        east += speed * dt * np.cos(heading)
        north += speed * dt * np.sin(heading)
        heading += turn
        places.append((east, north))
    return np.array(places)


def ranges_of(places, beacons, rng, sigma=1.0):
    """Ranges to a beacon at each place, with errors."""
    return np.hypot(*(places - beacons).T) + sigma * rng.standard_normal(len(places))


def flown(one, ranges, beacons, *, turn=0.0, sigma=1.0, dt=1.0):
    """Let a filter take a range a step; its means, covariances and fates."""
    sensor, means, covariances, fates = Range(sigma=sigma), [], [], []
    for k, (z, place) in enumerate(zip(ranges, beacons, strict=True)):
        if k:
            one.predict(np.array([turn, 0.0, 0.0]), dt)
        if np.isfinite(z):
            fates.append(one.range(float(z), sensor, beacon_at(*place), 0).fate)
        means.append(one.mean)
        covariances.append(one.covariance)
    return np.array(means), np.array(covariances), fates


@contextmanager
def unchecked():
    """No shapes checked at each of ten thousand events, which takes ten times as long."""
    config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        config.update("jaxtyping_disable", False)
