"""Readings of compasses, carried to the samples of a tape by the odometry between."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from obsplan.replay.log import Log, Readings
from obsplan.replay.merge import Course
from obsplan.tape import Tape


def with_headings(
    log: Log,
    tape: Tape,
    auvs: Sequence[Course],
    held: Float[np.ndarray, "auvs samples"],
    start: float,
) -> Tape:
    """The tape with what compasses said.

    Each reading is taken once, at the nearest sample but the first; of several at one their mean.
    A model holds the heading of a sample's displacement, a vehicle turns on: a reading is taken as
    far off as these two are, by the odometry.
    """
    found = tape.heading.copy()
    for j, course in enumerate(auvs):
        readings = log.headings.get(course.name)
        if readings is None:
            continue
        at, value = _known(readings, start)
        sample = _nearest(tape.time, at)
        carried = value + held[j, sample] - course.reckoned.heading_at(at)
        inside = (sample > 0) & (at <= tape.time[-1])
        total = np.zeros(tape.time.size, dtype=complex)
        np.add.at(total, sample[inside], np.exp(1j * carried[inside]))
        read = np.abs(total[1:]) > 0
        found[j, read] = np.angle(total[1:])[read]
    return replace(tape, heading=found)


def first_heading(log: Log, course: Course, start: float) -> float | None:
    """Heading at a vehicle's first row by its first reading [rad]; None without one."""
    readings = log.headings.get(course.name)
    if readings is None:
        return None
    at, value = _known(readings, start)
    if not at.size:
        return None
    return float(value[0] - course.reckoned.heading_at(at[:1])[0])


def _known(
    readings: Readings, start: float
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Times from time 0 and values of the readings that are numbers."""
    known = np.isfinite(readings.value)
    return readings.time[known] - start, readings.value[known]


def _nearest(time: Float[np.ndarray, " samples"], at: Float[np.ndarray, " n"]) -> np.ndarray:
    """Numbers of the nearest samples."""
    after = np.searchsorted(time, at).clip(1, time.size - 1)
    earlier = at - time[after - 1] < time[after] - at
    return np.where(earlier, after - 1, after)
