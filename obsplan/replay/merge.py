"""The tape of a log: everything on one clock, in one frame, at the samples of one grid."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Integer

from obsplan import geo
from obsplan.fates import Fate
from obsplan.quantities import RANGE_SIGMA
from obsplan.replay.log import RESOLUTION, Discarded, Fixes, Log, Ranges, counted
from obsplan.replay.motion import GAP, DeadReckoned
from obsplan.sensors import BEACON
from obsplan.tape import Measurements, Tape
from obsplan.types import ObsplanError

SHORTEST_COVER = 2.0  # [s]; fixes nearer than that are joined by a line whatever their rate


class Frame(NamedTuple):
    """Which time is 0, and which place."""

    start: float  # on the recording's clock [s]
    origin: tuple[float, float]  # latitude and longitude [degrees]

    def local(self, fixes: Fixes) -> Fixes:
        """Fixes in this frame: from time 0, east and north [m]."""
        place = geo.to_local(fixes.place, self.origin) if fixes.geographic else fixes.place
        return fixes._replace(time=fixes.time - self.start, place=place, geographic=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """A vehicle's motion from its first row on, at time 0 of the frame."""

    name: str
    reckoned: DeadReckoned
    begin: float  # [s]
    end: float  # [s]


class Held(NamedTuple):
    """What models hold of a motion from each sample on."""

    heading: Float[np.ndarray, "auvs samples"]  # from 0 at each vehicle's first row [rad]
    speed: Float[np.ndarray, " auvs"]  # over the first sample [m/s]


class Candidates(NamedTuple):
    """Ranges that may be taken, in the order of reception; numbers as on a tape."""

    received: Float[np.ndarray, " n"]
    sent: Float[np.ndarray, " n"]
    auv: Integer[np.ndarray, " n"]
    beacon: Integer[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    sigma: Float[np.ndarray, " n"]

    def of(self, rows: np.ndarray) -> "Candidates":
        """Some of the rows."""
        return Candidates(*(column[rows] for column in self))


def courses(log: Log, frame: Frame) -> tuple[Course, ...]:
    """Each vehicle's motion."""
    found = []
    for name, motion in log.motions.items():
        time = motion.time - frame.start
        reckoned = DeadReckoned.of(motion._replace(time=time))
        found.append(Course(name=name, reckoned=reckoned, begin=time[0], end=time[-1]))
    return tuple(found)


def sort_ranges(
    log: Log, frame: Frame, auvs: Sequence[Course], beacons: dict[str, Fixes]
) -> tuple[Candidates, list[Discarded]]:
    """Ranges that a filter can take, and the others with their reasons."""
    parts = [_numbered(log, frame, ranges, auvs, [*beacons]) for ranges in log.ranges]
    rows = Candidates(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    labels = [
        (vehicle, sender)
        for ranges in log.ranges
        for vehicle, sender in zip(ranges.vehicle, ranges.sender, strict=True)
    ]
    fate, reason = _judge(rows, auvs, beacons)
    bad = fate != Fate.ACCEPTED
    discarded = [
        Discarded(
            received=float(rows.received[i]),
            vehicle=auvs[rows.auv[i]].name if rows.auv[i] >= 0 else labels[i][0],
            sender=labels[i][1],
            value=float(rows.value[i]),
            fate=Fate(fate[i]),
            reason=str(reason[i]),
        )
        for i in np.flatnonzero(bad)
    ]
    _tell_discarded(log, discarded, len(bad))
    _check_some(log, discarded, len(bad))
    good = rows.of(~bad)
    if (np.diff(good.received) < 0).any():
        log.note("ranges are not in the order of reception, which is taken")
    order = np.lexsort((good.value, good.beacon, good.auv, good.received))
    discarded.sort(key=lambda one: (np.nan_to_num(one.received, nan=-np.inf), one.sender))
    return _with_sigmas(log, good.of(order)), discarded


def _numbered(
    log: Log, frame: Frame, ranges: Ranges, auvs: Sequence[Course], beacons: list[str]
) -> Candidates:
    """Vehicles and senders by their numbers; -1 where unknown.

    A range that a beacon measured to a vehicle is one that the vehicle measured to it.
    """
    names = {course.name: j for j, course in enumerate(auvs)}
    if len(auvs) == 1:
        names.setdefault("", 0)
    senders = {name: len(beacons) + j for name, j in names.items()}
    senders |= {name: b for b, name in enumerate(beacons)}
    auv, beacon, turned = [], [], 0
    for vehicle, sender in zip(ranges.vehicle, ranges.sender, strict=True):
        if vehicle not in names and vehicle in senders and sender in names:
            vehicle, sender, turned = sender, vehicle, turned + 1
        auv.append(names.get(vehicle, -1))
        beacon.append(-1 if sender == vehicle else senders.get(sender, -1))
    if turned:
        log.note(f"{counted(turned, 'range')} received by beacons taken as received by the vehicle")
    return Candidates(
        received=ranges.received - frame.start,
        sent=ranges.sent - frame.start,
        auv=np.array(auv, dtype=int),
        beacon=np.array(beacon, dtype=int),
        value=ranges.value,
        sigma=ranges.sigma,
    )


def _judge(
    rows: Candidates, auvs: Sequence[Course], beacons: dict[str, Fixes]
) -> tuple[Integer[np.ndarray, " n"], np.ndarray]:
    """What becomes of each range before any filter, and why; the first reason counts."""
    tracks = [*beacons.values()]
    begin = np.array([course.begin for course in auvs])[rows.auv.clip(0)]
    end = np.array([course.end for course in auvs])[rows.auv.clip(0)]
    fate = np.full(rows.auv.size, int(Fate.ACCEPTED))
    reason = np.full(rows.auv.size, "", dtype=object)
    farthest = RANGE_SIGMA.greatest
    own = [b for b, fixes in enumerate(tracks) if not fixes.fixed]
    outside = np.zeros(rows.auv.size, dtype=bool)
    for b in own:
        time = tracks[b].time
        of_it = rows.beacon == b
        early, late = rows.sent < time[0] - RESOLUTION, rows.sent > time[-1] + RESOLUTION
        outside |= of_it & (early | late)
    tests = (
        (~np.isfinite(rows.received), Fate.OUT_OF_ORDER, "without a time"),
        (rows.auv < 0, Fate.NO_ESTIMATE, "of a vehicle whose motion is not recorded"),
        (rows.beacon < 0, Fate.UNKNOWN_BEACON, "from a sender whose place is not recorded"),
        (~(rows.value > 0), Fate.NO_DISTANCE, "no positive number"),
        (rows.value > farthest, Fate.NO_DISTANCE, f"more than {farthest / 1e3:g} km"),
        (rows.received < begin, Fate.NO_ESTIMATE, "before the vehicle's recorded motion"),
        (rows.received > end, Fate.NO_ESTIMATE, "after the vehicle's recorded motion"),
        (outside, Fate.UNKNOWN_BEACON, "sent outside the times of the beacon's track"),
    )
    for wrong, judged, why in tests:
        new = wrong & (fate == Fate.ACCEPTED)
        fate[new], reason[new] = int(judged), why
    return fate, reason


def _tell_discarded(log: Log, discarded: Sequence[Discarded], in_all: int) -> None:
    """Say how many ranges are left out, by reason and sender."""
    counts: dict[str, dict[str, int]] = {}
    for one in discarded:
        of = counts.setdefault(one.reason, {})
        of[one.sender] = of.get(one.sender, 0) + 1
    for reason, of in counts.items():
        listed = ", ".join(f'"{sender}" {count}' for sender, count in [*of.items()][:5])
        total = sum(of.values())
        log.note(f"{total} of {counted(in_all, 'range')} left out: {reason} ({listed})")


def _check_some(log: Log, discarded: Sequence[Discarded], in_all: int) -> None:
    """Refuse ranges of which none can be taken; say that there are none.

    Raises
    ------
    ObsplanError
        Names the first one, and why.
    """
    if not in_all:
        log.note("there are no ranges: the track is dead reckoning alone")
    if discarded and len(discarded) == in_all:
        first = discarded[0]
        raise ObsplanError(
            f"{log.path}: none of {counted(in_all, 'range')} can be taken; the first, of "
            f'{first.value:.6g} m from "{first.sender}", received {first.received:g} s after the '
            f"first motion, is {first.reason}: correct times, names or units"
        )


def _with_sigmas(log: Log, rows: Candidates) -> Candidates:
    """The same without standard deviations that no range can have."""
    known = np.isfinite(rows.sigma)
    odd = known & ((rows.sigma < RANGE_SIGMA.least) | (rows.sigma > RANGE_SIGMA.greatest))
    if odd.any():
        log.note(f"{counted(int(odd.sum()), 'standard deviation')} must be {RANGE_SIGMA}: clipped")
    return rows._replace(sigma=np.clip(rows.sigma, RANGE_SIGMA.least, RANGE_SIGMA.greatest))


def on_grid(
    received: Float[np.ndarray, " n"], grid: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, " n"]:
    """Times of reception, those within `RESOLUTION` of a grid's or each other's the same."""
    after = np.searchsorted(grid, received).clip(1, grid.size - 1)
    low, high = grid[after - 1], grid[after]
    nearest = np.where(received - low <= high - received, low, high)
    rounded = np.round(received / RESOLUTION) * RESOLUTION
    return np.where(np.abs(nearest - received) <= RESOLUTION, nearest, rounded)


def to_tape(
    log: Log,
    auvs: Sequence[Course],
    beacons: dict[str, Fixes],
    rows: Candidates,
    truths: dict[str, Fixes],
    grid: Float[np.ndarray, " samples"],
    start: float,
) -> tuple[Tape, Held]:
    """The tape but for its sensors and headings, and what models hold of the motions.

    ``start`` is time 0 on the log's clock, ``grid`` the samples of the run.
    """
    received = on_grid(rows.received, grid).clip(0.0, grid[-1])
    time = np.union1d(grid, received)
    steps = [course.reckoned.steps(time) for course in auvs]
    heading = np.stack([one.heading for one in steps])
    elapsed = np.diff(time)
    speed = np.stack([one.forward / elapsed for one in steps])
    # the last speed is held on, as if the motion went on
    change = np.diff(speed, axis=1, append=speed[:, -1:])
    depth = np.stack([_depths(log, course.name, time, start) for course in auvs])
    tracks = [*beacons.values()]
    measured = Measurements(
        sent=rows.sent,
        received=received,
        auv=rows.auv,
        beacon=rows.beacon,
        sensor=np.zeros_like(rows.auv),
        value=rows.value,
        sigma=rows.sigma,
        told=_told(rows, tracks, depth, np.searchsorted(time, received)),
    )
    tape = Tape(
        time=time,
        auvs=tuple(course.name for course in auvs),
        beacons=tuple(beacons),
        turn=np.diff(heading, axis=1),
        change_of_speed=change,
        sway=np.stack([one.left for one in steps]),
        heading=np.full((len(auvs), time.size - 1), np.nan),
        depth=depth,
        pose=np.stack([pose(fixes, time) for fixes in tracks]),
        beacon_depth=np.array([fixes.depth.mean() for fixes in tracks]),
        sensors={},
        measurements=measured,
        truth=truth_at(truths, auvs, time) if truths else None,
    )
    return tape, Held(heading, speed[:, 0])


def _depths(
    log: Log, name: str, time: Float[np.ndarray, " samples"], start: float
) -> Float[np.ndarray, " samples"]:
    """Depth of a vehicle's transducer [m]; 0 where none was measured."""
    readings = log.depths.get(name)
    if readings is None:
        return np.zeros_like(time)
    known = np.isfinite(readings.value)
    return np.interp(time, readings.time[known] - start, readings.value[known])


def _told(
    rows: Candidates,
    tracks: Sequence[Fixes],
    depth: Float[np.ndarray, "auvs samples"],
    sample: Integer[np.ndarray, " n"],
) -> Float[np.ndarray, "n 10"]:
    """Each sender where it was when it sent, at rest; nan of another AUV."""
    told = np.full((rows.auv.size, len(BEACON)), np.nan)
    for b, fixes in enumerate(tracks):
        of_it = np.flatnonzero(rows.beacon == b)
        told[of_it] = 0.0
        told[of_it, :3] = pose(fixes, rows.sent[of_it])
        told[of_it, BEACON.index("depth")] = interpolated(fixes, fixes.depth, rows.sent[of_it])
        told[of_it, BEACON.index("auv_depth")] = depth[rows.auv[of_it], sample[of_it]]
    return told


def interpolated(
    fixes: Fixes, values: Float[np.ndarray, " n"], time: Float[np.ndarray, " t"]
) -> Float[np.ndarray, " t"]:
    """Values between fixes; those of the ends before and after."""
    if fixes.fixed:
        return np.full(time.size, values[0])
    return np.interp(time, fixes.time, values)


def pose(fixes: Fixes, time: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 3"]:
    """East, north [m] and course [rad] at times; the course is that of the last motion."""
    place = [interpolated(fixes, axis, time) for axis in fixes.place.T]
    return np.column_stack([*place, interpolated(fixes, course(fixes), time)])


def course(fixes: Fixes) -> Float[np.ndarray, " n"]:
    """Direction of motion at fixes [rad], continuous; where nothing moves, that of before."""
    if fixes.time.size < 2:
        return np.zeros(fixes.time.size)
    ahead = np.diff(fixes.place[:, 0] + 1j * fixes.place[:, 1])
    moves = np.flatnonzero(np.abs(ahead) > 0)
    if not moves.size:
        return np.zeros(fixes.time.size)
    last = np.searchsorted(moves, np.arange(ahead.size), side="right") - 1
    direction = np.unwrap(np.angle(ahead[moves]))[last.clip(0)]
    return np.append(direction, direction[-1])


def truth_at(
    truths: dict[str, Fixes], auvs: Sequence[Course], time: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, "auvs samples 4"]:
    """East, north [m], heading [rad] and speed over ground [m/s]; nan where none is known."""
    found = np.full((len(auvs), time.size, 4), np.nan)
    for j, vehicle in enumerate(auvs):
        fixes = truths.get(vehicle.name)
        if fixes is None or fixes.time.size < 2:
            continue
        at = np.full((time.size, 4), np.nan)
        at[:, :2] = pose(fixes, time)[:, :2]
        told = np.isfinite(fixes.heading)
        heading = course(fixes)
        if told.any():
            heading = np.interp(fixes.time, fixes.time[told], np.unwrap(fixes.heading[told]))
        at[:, 2] = np.interp(time, fixes.time, heading)
        at[:, 3] = np.interp(time, fixes.time, speed_of(fixes))
        known = covered(fixes.time, time)
        found[j, known] = at[known]
    return found


def speed_of(fixes: Fixes) -> Float[np.ndarray, " n"]:
    """Speed over ground at fixes [m/s]."""
    return np.hypot(*np.gradient(fixes.place, fixes.time, axis=0).T)


def covered(
    known: Float[np.ndarray, " n"], time: Float[np.ndarray, " t"]
) -> Bool[np.ndarray, " t"]:
    """Which times lie between fixes near to each other, or just outside all of them."""
    usual = float(np.median(np.diff(known)))
    after = np.searchsorted(known, time).clip(1, known.size - 1)
    joined = known[after] - known[after - 1] <= max(GAP * usual, SHORTEST_COVER)
    inside = (time >= known[0] - usual) & (time <= known[-1] + usual)
    exact = np.isin(time, known)
    return inside & (joined | exact)
