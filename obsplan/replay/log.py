"""What a recording holds as it was read, whatever its format: each kind of row by itself.

Times [s] are on the recording's own clock. Headings [rad] are counter-clockwise from east.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from obsplan.fates import Fate
from obsplan.replay.settings import Settings
from obsplan.types import ObsplanError

RESOLUTION = 1e-6  # [s]; nearer times are one
EPOCH = 5e8  # [s]; times beyond it count from 1970


class Motion(NamedTuple):
    """How a vehicle moved: increments since the row before; the first row is where it begins.

    The displacement is along the heading at the interval's begin and ``share`` of its turn.
    """

    time: Float[np.ndarray, " n"]
    forward: Float[np.ndarray, " n"]  # [m]
    left: Float[np.ndarray, " n"]  # [m]
    turn: Float[np.ndarray, " n"]  # [rad], counter-clockwise
    share: float = 0.5


class Readings(NamedTuple):
    """What an instrument said at times: a heading [rad] or a depth [m]."""

    time: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]


class Fixes(NamedTuple):
    """Where something was: local east and north [m], or latitude and longitude [degrees]."""

    time: Float[np.ndarray, " n"]  # nan, of a single fix: always
    place: Float[np.ndarray, "n 2"]
    depth: Float[np.ndarray, " n"]  # [m]
    heading: Float[np.ndarray, " n"]  # [rad]; nan where not told
    geographic: bool

    @property
    def fixed(self) -> bool:
        """Whether it is always at one place."""
        return bool(np.isnan(self.time).all())


class Ranges(NamedTuple):
    """Distances that were measured, a row each, in the order of the file."""

    received: Float[np.ndarray, " n"]
    sent: Float[np.ndarray, " n"]  # nan: not told, a travel time before it was received
    vehicle: list[str]  # that measured; empty: the only one
    sender: list[str]
    value: Float[np.ndarray, " n"]  # [m]
    sigma: Float[np.ndarray, " n"]  # [m]; nan: not told


class Discarded(NamedTuple):
    """A range that no filter can take, and why."""

    received: float  # from time 0 [s]
    vehicle: str
    sender: str
    value: float  # [m]
    fate: Fate
    reason: str


@dataclass(kw_only=True)
class Log:
    """All that was read, by the names of vehicles and beacons; ``notes`` say what was done."""

    path: Path
    settings: Settings
    motions: dict[str, Motion] = field(default_factory=dict)
    ranges: list[Ranges] = field(default_factory=list)
    beacons: dict[str, Fixes] = field(default_factory=dict)
    headings: dict[str, Readings] = field(default_factory=dict)
    depths: dict[str, Readings] = field(default_factory=dict)
    truths: dict[str, Fixes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def note(self, sentence: str) -> None:
        """Say something once."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def check_clocks(self) -> None:
        """Refuse files of which some count from 1970 and some do not.

        Raises
        ------
        ObsplanError
            Names one of each.
        """
        timed = {
            "motion": [motion.time for motion in self.motions.values()],
            "ranges": [ranges.received for ranges in self.ranges],
            "beacons": [fixes.time for fixes in self.beacons.values() if not fixes.fixed],
            "headings": [readings.time for readings in self.headings.values()],
            "depths": [readings.time for readings in self.depths.values()],
            "truth": [fixes.time for fixes in self.truths.values()],
        }
        firsts = {
            kind: float(np.nanmin(np.concatenate(times)))
            for kind, times in timed.items()
            if times and np.isfinite(np.concatenate(times)).any()
        }
        absolute = [kind for kind, first in firsts.items() if first > EPOCH]
        others = [kind for kind, first in firsts.items() if first <= EPOCH]
        if absolute and others:
            raise ObsplanError(
                f"{self.path}: times of {absolute[0]} count from 1970 and those of {others[0]} do "
                f"not, which begin at {firsts[others[0]]:g} s: give all on one clock"
            )


def counted(count: int, what: str) -> str:
    """`1 row`, `3 rows`: a number of things, of a word whose plural has an s."""
    return f"{count} {what}{'' if count == 1 else 's'}"
