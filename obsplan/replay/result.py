"""The run that a replayed recording is, on the uniform grid of its scenario."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Integer

from obsplan.ranged import Ranged
from obsplan.record import REPLAY
from obsplan.replay.estimates import Estimates
from obsplan.replay.log import Discarded
from obsplan.run import AidTrack, Run, Timing
from obsplan.scenario import Scenario
from obsplan.sensors import Range, SquaredRange
from obsplan.tape import Measurements, Tape
from obsplan.types import ObsplanError

NEAR = 1e-6  # [s] between a time of the grid and that of the tape that is it
UNKNOWN = "unknown"  # name of a beacon that no table has


@runtime_checkable
class Track(Protocol):
    """Where AUVs were by all that was measured, at the times of a tape."""

    @property
    def mean(self) -> Float[np.ndarray, "auvs samples n"]:
        """States, east and north first [m]."""
        ...

    @property
    def covariance(self) -> Float[np.ndarray, "auvs samples 2 2"]:
        """Of their places [m^2]."""
        ...


def run_of(
    tape: Tape,
    scenario: Scenario,
    estimates: Estimates,
    *,
    smoothed: Track | None = None,
    discarded: Sequence[Discarded] = (),
    began: datetime | None = None,
    seconds: float = np.nan,
) -> Run:
    """Make a run of a recording and of what filters made of it.

    Parameters
    ----------
    smoothed
        Where AUVs were by all of their ranges.
    discarded
        Ranges that are not on the tape, which no filter could take.
    began
        When the tape's time was 0.
    seconds
        How long estimation took.

    Raises
    ------
    ObsplanError
        The tape lacks a time of the scenario's grid.
    """
    at = grid(tape.time, scenario.time)
    auvs, samples = len(tape.auvs), at.size
    ranged = ranges_of(tape, estimates, discarded)
    beacons = _numbers(ranged.beacons, scenario)
    aids = [_aid(tape, scenario, number, at) for number in range(len(scenario.aids))]
    first = aids[0]
    truth = None if tape.truth is None else completed(tape.truth[:, at], scenario.time)
    nothing = np.full((auvs, samples), np.nan)
    value, fate, innovation, variance = _on_grid(scenario, ranged, beacons)
    run = Run(
        scenario=scenario,
        source=REPLAY,
        planner=REPLAY,
        condition_label="",
        seed=scenario.table.seed,
        time=scenario.time,
        cna=first.pose,
        turn_rate=first.turn_rate,
        speed=first.speed,
        score=first.score,
        status=first.status,
        others=tuple(aids[1:]),
        truth=truth,
        mean=estimates.mean[:, at],
        covariance=estimates.covariance[:, at],
        ranges=value,
        bearings=np.empty((0, auvs, samples)),
        reports=nothing > 0,
        condition=nothing,
        timing=Timing(seconds=seconds, decision_seconds=[]),
    )
    return replace(
        run,
        began=began,
        fates=fate,
        innovations=innovation,
        innovation_variances=variance,
        log=ranged,
        compass=_compass(tape, at),
        hypotheses=estimates.hypotheses[:, at].astype(float),
        smoothed=None if smoothed is None else smoothed.mean[:, at, :2],
        smoothed_covariance=None if smoothed is None else smoothed.covariance[:, at],
    )


def grid(
    time: Float[np.ndarray, " samples"], wanted: Float[np.ndarray, " some"]
) -> Integer[np.ndarray, " some"]:
    """Indices of the wanted times among a tape's.

    Raises
    ------
    ObsplanError
        One is not there.
    """
    after = np.searchsorted(time, wanted).clip(1, time.size - 1)
    at = after - (wanted - time[after - 1] < time[after] - wanted)
    off = np.abs(time[at] - wanted)
    if (off > NEAR).any():
        first = wanted[np.argmax(off > NEAR)]
        raise ObsplanError(
            f"the recording has no sample at {first:g} s, which its scenario's duration and "
            "time_step ask for: correct them in recording.toml"
        )
    return at


def ranges_of(tape: Tape, estimates: Estimates, discarded: Sequence[Discarded] = ()) -> Ranged:
    """What became of each range; those between AUVs have an AUV's name for a beacon.

    Those that are not on the tape are at the end.
    """
    kinds = [isinstance(one, Range | SquaredRange) for one in tape.sensors.values()]
    squared = any(isinstance(one, SquaredRange) for one in tape.sensors.values())
    rows = np.flatnonzero(np.array(kinds, dtype=bool)[tape.measurements.sensor])
    m = Measurements(*(column[rows] for column in tape.measurements))
    known = (*tape.beacons, *tape.auvs)
    names = tuple(dict.fromkeys((*known, UNKNOWN, *(one.sender for one in discarded))))
    lost = [one for one in discarded if one.vehicle in tape.auvs]
    to = [tape.auvs.index(one.vehicle) for one in lost]
    sender = [names.index(one.sender) for one in lost]
    why = [int(one.fate) for one in lost]
    nothing = np.full(len(lost), np.nan)
    return Ranged(
        auvs=tape.auvs,
        beacons=names,
        unit="m^2" if squared else "m",
        sent=np.append(m.sent, nothing),
        received=np.append(m.received, [one.received for one in lost]),
        auv=_joined(m.auv, to),
        beacon=_joined(np.where(m.beacon < 0, names.index(UNKNOWN), m.beacon), sender),
        value=np.append(m.value, [one.value for one in lost]),
        innovation=np.append(estimates.innovation[rows], nothing),
        variance=np.append(estimates.innovation_variance[rows], nothing),
        fate=_joined(estimates.fate[rows], why),
    )


def _joined(numbers: Integer[np.ndarray, " n"], more: list[int]) -> Integer[np.ndarray, " all"]:
    """Whole numbers, and more of them."""
    return np.concatenate([numbers, np.array(more, dtype=int)])


def _numbers(names: Sequence[str], scenario: Scenario) -> Integer[np.ndarray, " names"]:
    """The scenario's number of each beacon by its name; -1 of those that it has not."""
    known = [beacon.name for beacon in scenario.beacons]
    return np.array([known.index(name) if name in known else -1 for name in names])


def _on_grid(
    scenario: Scenario, ranged: Ranged, beacons: Integer[np.ndarray, " names"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Ranges, fates, innovations and variances by beacon, AUV and the first sample not before.

    Of several within a sample there is the last that was taken, or else the last.
    """
    shape = len(scenario.beacons), len(ranged.auvs), scenario.time.size
    found = np.full((4, *shape), np.nan)
    sample = np.searchsorted(scenario.time, ranged.received - NEAR)
    beacon = beacons[ranged.beacon]
    rows = np.argsort(ranged.taken, kind="stable")
    rows = rows[(beacon[rows] >= 0) & (sample[rows] < scenario.time.size)]
    values = np.stack([ranged.value, ranged.fate, ranged.innovation, ranged.variance])
    # numpy keeps the last of several values for one place
    found[:, beacon[rows], ranged.auv[rows], sample[rows]] = values[:, rows]
    value, fate, innovation, variance = found
    return value, fate, innovation, variance


def _compass(tape: Tape, at: Integer[np.ndarray, " some"]) -> Bool[np.ndarray, "auvs some"]:
    """Whether a heading was measured since the sample of the grid before."""
    measured = np.isfinite(tape.heading)
    count = np.cumsum(np.pad(measured, ((0, 0), (1, 0))), axis=1)[:, at]
    return np.diff(count, axis=1, prepend=count[:, :1]) > 0


def _aid(tape: Tape, scenario: Scenario, number: int, at: Integer[np.ndarray, " some"]) -> AidTrack:
    """Where an aid vehicle was by the track of its transducer; at its start without one."""
    time, nothing = scenario.time, np.full(at.size, np.nan)
    start = scenario.starts[number]
    pose = np.tile([start.x, start.y, start.heading], (at.size, 1))
    for beacon in scenario.beacons:
        if beacon.carrier == number and beacon.name in tape.beacons:
            pose = tape.pose[tape.beacons.index(beacon.name), at]
            break
    states = np.column_stack([pose, nothing])
    east, north, heading, _ = completed(states[None], time)[0].T
    turn_rate = np.diff(np.unwrap(heading)) / np.diff(time)
    speed = np.hypot(np.diff(east), np.diff(north)) / np.diff(time)
    pose = np.column_stack([east, north, heading])
    return AidTrack(pose, np.append(turn_rate, 0.0), np.append(speed, 0.0), nothing, nothing)


def completed(
    states: Float[np.ndarray, "auvs samples n"], time: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, "auvs samples n"]:
    """The same states, with courses for headings and speeds over ground where these are missing.

    A place that is not known stays so.
    """
    found = states.copy()
    for one in found:
        known = np.isfinite(one[:, :2]).all(axis=1)
        if np.count_nonzero(known) < 2:
            continue
        rate = np.gradient(one[known, :2], time[known], axis=0)
        course, speed = np.arctan2(rate[:, 1], rate[:, 0]), np.hypot(*rate.T)
        for column, values in ((2, np.unwrap(course)), (3, speed)):
            missing = known & ~np.isfinite(one[:, column])
            one[missing, column] = values[missing[known]]
    return found
