"""How vehicles moved, of odometry or of speed and heading, and where that leads."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from obsplan.replay.log import RESOLUTION, Log, Motion, counted

GAP, SHORTEST_GAP = 10.0, 5.0  # times the usual interval, and [s]: a gap that is said


def increments(
    log: Log,
    where: str,
    time: Float[np.ndarray, " n"],
    steps: Float[np.ndarray, "n 3"],
    share: float,
) -> Motion | None:
    """Motion of increments (forward [m], left [m], turn [rad]) in any order; None of no rows.

    What is missing moves on as before and after; rows at one time are one.
    """
    time, steps = _in_order(log, where, time, steps)
    if not time.size:
        return None
    time, steps = _joined(log, where, time, steps)
    elapsed = np.diff(time, prepend=time[0])
    lost = np.isnan(steps).any(axis=1) & (np.arange(time.size) > 0)
    if lost.any():
        log.note(f"{where}: {counted(int(lost.sum()), 'row')} without numbers moves on as others")
        known = ~lost & (elapsed > RESOLUTION)
        for column in steps.T:
            rate = np.zeros_like(elapsed)
            rate[known] = column[known] / elapsed[known]
            column[lost] = _filled(time, np.where(known, rate, np.nan))[lost] * elapsed[lost]
    if np.nan_to_num(steps[0]).any():
        log.note(f"{where}: the first row has no row before it, its increments are passed over")
    steps[0] = 0.0
    _tell_gaps(log, where, time)
    forward, left, turn = steps.T
    return Motion(time, forward, left, turn, share)


def speeds(
    log: Log,
    where: str,
    time: Float[np.ndarray, " n"],
    rows: Float[np.ndarray, "n 2"],
    *,
    turning: bool,
) -> tuple[Motion, Float[np.ndarray, " n"]] | None:
    """Motion of speeds [m/s] with headings [rad] or, if ``turning``, turn rates [rad/s].

    Between rows both change evenly. Also the headings at the motion's times, nan where none was
    read; None of no rows.
    """
    time, rows = _in_order(log, where, time, rows)
    if not time.size:
        return None
    keep = np.append(np.diff(time) > RESOLUTION, True)  # of several at one time the last
    if not keep.all():
        log.note(
            f"{where}: of {counted(int((~keep).sum()), 'row')} at the time of another the last"
        )
        time, rows = time[keep], rows[keep]
    missing = int(np.isnan(rows).any(axis=1).sum())
    if missing:
        log.note(f"{where}: {counted(missing, 'row')} without numbers, taken as between others")
    speed = _filled(time, rows[:, 0])
    elapsed = np.diff(time)
    forward = np.append(0.0, elapsed * (speed[1:] + speed[:-1]) / 2)
    headings = np.full(time.size, np.nan)
    if turning:
        rate = _filled(time, rows[:, 1])
        turn = np.append(0.0, elapsed * (rate[1:] + rate[:-1]) / 2)
    else:
        headings = rows[:, 1]
        known = np.isfinite(headings)
        smooth = np.full(time.size, np.nan)
        smooth[known] = np.unwrap(headings[known])
        turn = np.diff(_filled(time, smooth), prepend=np.nan)
        turn[0] = 0.0
    _tell_gaps(log, where, time)
    return Motion(time, forward, np.zeros_like(forward), turn), headings


def _in_order(
    log: Log, where: str, time: Float[np.ndarray, " n"], rows: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m k"]]:
    """Rows that have a time, by their times, none twice."""
    timed = np.isfinite(time)
    if not timed.all():
        log.note(f"{where}: {counted(int((~timed).sum()), 'row')} without a time passed over")
    time, rows = time[timed], rows[timed]
    if (np.diff(time) < 0).any():
        log.note(f"{where}: rows are not in the order of their times, which is taken")
    order = np.argsort(time, kind="stable")
    time, rows = time[order], rows[order]
    table = np.column_stack([time, rows])
    again = np.zeros(time.size, dtype=bool)
    same = (table[1:] == table[:-1]) | (np.isnan(table[1:]) & np.isnan(table[:-1]))
    again[1:] = same.all(axis=1)
    if again.any():
        log.note(f"{where}: {counted(int(again.sum()), 'row')} that repeat another passed over")
    return time[~again], rows[~again].copy()


def _joined(
    log: Log, where: str, time: Float[np.ndarray, " n"], steps: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
    """The same with the increments of rows at one time added up."""
    first = np.flatnonzero(np.append(True, np.diff(time) > RESOLUTION))
    joined = time.size - first.size
    if joined:
        log.note(f"{where}: {counted(joined, 'row')} at the time of another, increments added up")
    return time[first], np.add.reduceat(steps, first, axis=0)


def _filled(time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]) -> np.ndarray:
    """The values, those that are nan from the ones before and after; 0 where there is none."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    return np.interp(time, time[known], values[known])


def _tell_gaps(log: Log, where: str, time: Float[np.ndarray, " n"]) -> None:
    """Say where rows are missing for long."""
    if time.size < 3:
        return
    gaps = np.diff(time)
    long = gaps > max(GAP * float(np.median(gaps)), SHORTEST_GAP)
    if long.any():
        longest = int(gaps.argmax())
        since = time[longest] - time[0]
        log.note(
            f"{where}: {counted(int(long.sum()), 'gap')}, the longest of {gaps[longest]:.0f} s, "
            f"{since:.0f} s after the first row; motion is taken to be even in it"
        )


def flat(places: Complex[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
    """East and north [m] of east + i north."""
    return np.column_stack([np.real(places), np.imag(places)])


class Steps(NamedTuple):
    """Motion between samples, as a tape has it, and what headings are at them."""

    heading: Float[np.ndarray, " samples"]  # held from each sample on, from 0 at first [rad]
    forward: Float[np.ndarray, " steps"]  # [m]
    left: Float[np.ndarray, " steps"]  # [m]


@dataclass(frozen=True, eq=False)
class DeadReckoned:
    """Where a motion leads from the origin, heading east at its first row."""

    time: Float[np.ndarray, " n"]
    heading: Float[np.ndarray, " n"]  # that the vehicle has then [rad], continuous
    place: Float[np.ndarray, "n 2"]  # [m]
    along: Float[np.ndarray, " steps"]  # heading of each interval's displacement [rad]

    @classmethod
    def of(cls, motion: Motion) -> "DeadReckoned":
        """Add the increments up."""
        heading = np.cumsum(motion.turn)
        along = heading[:-1] + motion.share * motion.turn[1:]
        ahead = motion.forward[1:] + 1j * motion.left[1:]
        place = np.append(0.0, np.cumsum(ahead * np.exp(1j * along)))
        return cls(motion.time, heading, flat(place), along)

    def heading_at(self, time: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Heading [rad] that the vehicle has, turning evenly between rows."""
        return np.interp(time, self.time, self.heading)

    def place_at(self, time: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 2"]:
        """Place [m], at rest before the first row and after the last."""
        return np.column_stack([np.interp(time, self.time, axis) for axis in self.place.T])

    def steps(self, time: Float[np.ndarray, " samples"]) -> Steps:
        """The motion between samples: along the mean heading of displacements, and to the left.

        At the samples it leads exactly to `place_at`.
        """
        moved = np.diff(self.place_at(time), axis=0)
        along = self._mean_along(time)
        cos, sin = np.cos(along), np.sin(along)
        forward = moved[:, 0] * cos + moved[:, 1] * sin
        left = moved[:, 1] * cos - moved[:, 0] * sin
        held = np.append(along, self.heading_at(time[-1:]))
        return Steps(held, forward, left)

    def _mean_along(self, time: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " steps"]:
        """Heading of the displacements between samples [rad], on average over time.

        Where they lie in one interval it is that interval's, to the last bit.
        """
        if not self.along.size:
            return np.full(time.size - 1, self.heading[0])
        known = np.concatenate([self.heading[:1], self.along, self.heading[-1:]])
        # 0: before the first row; at a row the interval that begins, or that ends
        first = np.searchsorted(self.time, time[:-1], side="right")
        last = np.searchsorted(self.time, time[1:], side="left")
        total = np.append(0.0, np.cumsum(np.diff(self.time) * self.along))
        integral = np.interp(time, self.time, total)
        integral += self.heading[0] * np.minimum(time - self.time[0], 0.0)
        integral += self.heading[-1] * np.maximum(time - self.time[-1], 0.0)
        mean = np.diff(integral) / np.diff(time)
        return np.where(first >= last, known[np.minimum(first, last)], mean)
