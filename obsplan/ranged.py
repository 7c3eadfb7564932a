"""What became of each range: when it came, what was expected, whether a filter took it, and NIS."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Integer

from formulations.consistency import Runs, mean_interval, runs_of_signs
from obsplan.fates import Fate

ALARM = 0.2  # of the ranges: a filter that rejects more has something wrong
FEWEST = 10  # ranges of which a share is an alarm
MISSED = 9.0  # mean NIS, of innovations three times as large as expected: an alarm, too


class Nis(NamedTuple):
    """Mean normalised innovation squared, and what chance allows a consistent filter."""

    mean: float
    samples: int
    low: float
    high: float

    @property
    def is_inside(self) -> bool:
        """Whether the mean is within its 95 % band."""
        return self.low <= self.mean <= self.high


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranged:
    """The ranges that came to AUVs, a row each in the order in which filters had them.

    Of what a filter did not look at, innovation and variance are nan.
    """

    auvs: tuple[str, ...]  # names
    beacons: tuple[str, ...]  # names; ``beacon`` is a number in them
    unit: str  # of the value: m or m^2
    sent: Float[np.ndarray, " n"]  # [s]
    received: Float[np.ndarray, " n"]  # [s]
    auv: Integer[np.ndarray, " n"]
    beacon: Integer[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]  # as measured
    innovation: Float[np.ndarray, " n"]  # value less expected
    variance: Float[np.ndarray, " n"]  # of the innovation, as the filter says
    fate: Integer[np.ndarray, " n"]  # codes of `Fate`

    @property
    def expected(self) -> Float[np.ndarray, " n"]:
        """What the filter expected to be measured."""
        return self.value - self.innovation

    @property
    def normalised(self) -> Float[np.ndarray, " n"]:
        """Innovations in standard deviations."""
        return self.innovation / np.sqrt(self.variance)

    @property
    def taken(self) -> Bool[np.ndarray, " n"]:
        """Which of them filters used."""
        return np.isin(self.fate, [fate for fate in Fate if fate.taken])

    @property
    def heard(self) -> list[int]:
        """Numbers of the beacons that something came from."""
        return np.unique(self.beacon).tolist()

    def of(self, *, auv: int | None = None, beacon: int | None = None) -> "Ranged":
        """The rows of an AUV, of a beacon, or of both."""
        chosen = np.ones(self.value.size, dtype=bool)
        if auv is not None:
            chosen &= self.auv == auv
        if beacon is not None:
            chosen &= self.beacon == beacon
        columns = {name: getattr(self, name)[chosen] for name in COLUMNS}
        return Ranged(auvs=self.auvs, beacons=self.beacons, unit=self.unit, **columns)

    @property
    def nis(self) -> Nis | None:
        """Mean squared normalised innovation of the ranges taken; None without any.

        It is 1 for a consistent filter; its band is chi-square's for as many independent ones.
        """
        squares = self.normalised[self.taken] ** 2
        squares = squares[np.isfinite(squares)]
        if not squares.size:
            return None
        low, high = mean_interval(squares.size, degrees=1)
        return Nis(float(squares.mean()), squares.size, low, high)

    @property
    def runs(self) -> Runs:
        """Whether signs of innovations follow each other by chance, of the ranges taken."""
        return runs_of_signs(self.innovation[self.taken])

    @property
    def rejected(self) -> dict[Fate, int]:
        """How many were not taken, by reason, the most frequent first."""
        codes, counts = np.unique(self.fate[~self.taken], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return {Fate(int(codes[k])): int(counts[k]) for k in order}

    @property
    def share_rejected(self) -> float:
        """Of all that came; 0 where nothing came."""
        return float(np.mean(~self.taken)) if self.fate.size else 0.0

    @property
    def alarms(self) -> bool:
        """Whether so many were rejected, or missed by so much, that something must be wrong."""
        missed = self.nis is not None and self.nis.mean > MISSED
        return self.fate.size >= FEWEST and (self.share_rejected > ALARM or missed)

    def summary(self) -> dict[str, Any]:
        """Counts, reasons and NIS, of all beacons and of each that was heard."""
        per_beacon = {self.beacons[b]: self.of(beacon=b)._figures() for b in self.heard}
        return {**self._figures(), "beacon": per_beacon}

    def _figures(self) -> dict[str, Any]:
        found: dict[str, Any] = {
            "came": int(self.fate.size),
            "rejected": {fate.words: count for fate, count in self.rejected.items()},
            "share_rejected": self.share_rejected,
        }
        nis = self.nis
        if nis is not None:
            found["nis_mean"], found["nis_count"] = nis.mean, nis.samples
            found["nis_low"], found["nis_high"] = nis.low, nis.high
        if np.isfinite(self.runs.z):
            found["runs_z"], found["runs_p"] = self.runs.z, self.runs.p
        return found


COLUMNS = ("sent", "received", "auv", "beacon", "value", "innovation", "variance", "fate")
