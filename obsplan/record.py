"""What was recorded of a mission, flown or replayed, and its geometry."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from obsplan.announced import announcements
from obsplan.constraints import LimitHistory
from obsplan.heard import Heard
from obsplan.planned import Planned
from obsplan.ranged import Ranged
from obsplan.scenario import Scenario
from obsplan.scenario.beacons import aid_names
from obsplan.types import ObsplanError

NO_TRUTH = "no truth was given"
SIMULATION, REPLAY = "simulation", "replay"  # where a run comes from


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long it took; never part of a result."""

    seconds: float  # of the whole mission [s]
    decision_seconds: list[float]  # of each decision that was not folded into the step [s]


class AidTrack(NamedTuple):
    """What one aid vehicle did; as in `Run`."""

    pose: Float[np.ndarray, "samples 3"]
    turn_rate: Float[np.ndarray, " samples"]  # [rad/s]
    speed: Float[np.ndarray, " samples"]  # [m/s]
    score: Float[np.ndarray, " samples"]
    status: Float[np.ndarray, " samples"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """One mission as recorded; what is `None` was not recorded.

    Frames: local east/north [m], heading [rad] counter-clockwise from east. Axes: AUV, time sample
    (from 0), state: east, north, heading, speed through the water [m/s], and what more
    `Scenario.truth_states` and `Scenario.filter_states` name. Commands, scores and conditions hold
    from their sample on; they are nan where no decision was due.
    """

    scenario: Scenario
    planner: str
    condition_label: str  # κ(J), κ(W) or empty
    seed: int
    time: Float[np.ndarray, " samples"]  # [s]
    cna: Float[np.ndarray, "samples 3"]  # pose
    turn_rate: Float[np.ndarray, " samples"]  # [rad/s]
    speed: Float[np.ndarray, " samples"]  # of the aid vehicle [m/s]
    # nan where a recording does not say; None where it has no truth at all
    truth: Float[np.ndarray, "auvs samples n"] | None
    mean: Float[np.ndarray, "auvs samples m"]
    covariance: Float[np.ndarray, "auvs samples m m"]
    # as measured [m or m^2]; nan where none came
    ranges: Float[np.ndarray, "beacons auvs samples"]
    bearings: Float[np.ndarray, "beacons_or_none auvs samples"]  # that came with them [rad]
    # made then, and heard by an aid vehicle, be it later
    reports: Bool[np.ndarray, "auvs samples"]
    condition: Float[np.ndarray, "auvs samples"]  # predicted condition number at each decision
    score: Float[np.ndarray, " samples"]  # the planner's own objective
    status: Float[np.ndarray, " samples"]  # code of a Status; nan without a decision
    timing: Timing = field(repr=False)
    others: tuple[AidTrack, ...] = ()  # aid vehicles besides the first, which ``cna`` is of
    # of each aid vehicle, the paths that its planner had in mind; None where it decides turns that
    # are held until the next decision; empty where none were kept
    planned: tuple[Planned | None, ...] = ()
    # by status, what was wrong with the planner's first answer of that kind, and when; by `PATH`,
    # what was wrong with a path that it predicted
    faults: Mapping[str, str] = field(default_factory=dict)
    bounded: bool = True  # whether the certified bound is asked for, where figures are

    source: str = SIMULATION
    began: datetime | None = None  # when time was 0, where a recording says so
    # what became of each range (codes of `Fate`) and how it differed from what was expected
    fates: Float[np.ndarray, "beacons auvs samples"] | None = None
    innovations: Float[np.ndarray, "beacons auvs samples"] | None = None
    innovation_variances: Float[np.ndarray, "beacons auvs samples"] | None = None
    log: Ranged | None = None  # the same of a recording, where several may come within a sample
    # whether a heading came with a sample; None: with each
    compass: Bool[np.ndarray, "auvs samples"] | None = None
    hypotheses: Float[np.ndarray, "auvs samples"] | None = None  # how many positions fit
    smoothed: Float[np.ndarray, "auvs samples 2"] | None = None  # of all ranges: places [m]
    smoothed_covariance: Float[np.ndarray, "auvs samples 2 2"] | None = None

    @property
    def names(self) -> list[str]:
        """Names of the AUVs."""
        return [auv.name for auv in self.scenario.table.auv]

    @property
    def range(self) -> Float[np.ndarray, "auvs samples"]:
        """Ranges to the first beacon as measured [m or m^2]; nan where none came."""
        return self.ranges[0]

    @property
    def aids(self) -> tuple[AidTrack, ...]:
        """All aid vehicles."""
        first = AidTrack(self.cna, self.turn_rate, self.speed, self.score, self.status)
        return first, *self.others

    @property
    def aid_names(self) -> tuple[str, ...]:
        """Names of the aid vehicles."""
        return aid_names(len(self.others) + 1)

    @cached_property
    def beacon_places(self) -> Float[np.ndarray, "beacons samples 2"]:
        """Where each of the scenario's beacons is, east and north [m]."""
        found = []
        for beacon in self.scenario.beacons:
            if beacon.carrier is None:
                found.append(np.broadcast_to(beacon.place, (self.time.size, 2)))
                continue
            east, north, heading = self.aids[beacon.carrier].pose.T
            ahead, left = beacon.place
            cos, sin = np.cos(heading), np.sin(heading)
            x, y = east + ahead * cos - left * sin, north + ahead * sin + left * cos
            found.append(np.column_stack([x, y]))
        return np.stack(found)

    @cached_property
    def heard(self) -> Heard:
        """Reach, age of the newest report, and throughput."""
        return Heard.of(self.scenario, self.true, self.beacon_places, self.reports)

    @property
    def is_replay(self) -> bool:
        """Whether this was recorded at sea, and not simulated."""
        return self.source == REPLAY

    @property
    def has_aid(self) -> bool:
        """Whether there is an aid vehicle: the scenario of a recording may have none."""
        carried = any(beacon.carrier is not None for beacon in self.scenario.beacons)
        return carried or not self.is_replay

    @property
    def true(self) -> Float[np.ndarray, "auvs samples n"]:
        """The truth.

        Raises
        ------
        ObsplanError
            None was given.
        """
        if self.truth is None:
            raise ObsplanError(f"{NO_TRUTH}: errors are not known; give truth.csv")
        return self.truth

    @cached_property
    def known(self) -> Bool[np.ndarray, "auvs samples"]:
        """Where the true position is known."""
        if self.truth is None:
            return np.zeros((len(self.mean), self.time.size), dtype=bool)
        finite = np.isfinite(self.truth[..., :2])
        return finite[..., 0] & finite[..., 1]

    @cached_property
    def places(self) -> Float[np.ndarray, "auvs samples 2"]:
        """Where AUVs were as far as is known [m].

        That is the truth, or where it is not known what all ranges say, or else the estimate.
        """
        other = self.mean[..., :2] if self.smoothed is None else self.smoothed
        if self.truth is None:
            return other
        return np.where(self.known[..., None], self.truth[..., :2], other)

    @cached_property
    def ranged(self) -> Ranged | None:
        """What became of each range; None where it was not recorded."""
        if self.log is not None or self.fates is None:
            return self.log
        sample, beacon, auv = np.nonzero(np.moveaxis(np.isfinite(self.fates), -1, 0))
        at = beacon, auv, sample
        nothing = np.full(self.fates.shape, np.nan)
        nu = nothing if self.innovations is None else self.innovations
        S = nothing if self.innovation_variances is None else self.innovation_variances
        return Ranged(
            auvs=tuple(self.names),
            beacons=tuple(one.name for one in self.scenario.beacons),
            unit="m^2" if self.scenario.ranging_kind == "squared-range" else "m",
            sent=np.full(sample.size, np.nan),
            received=self.time[sample],
            auv=auv,
            beacon=beacon,
            value=self.ranges[at],
            innovation=nu[at],
            variance=S[at],
            fate=self.fates[at].astype(int),
        )

    @property
    def announcements(self) -> tuple[str, ...]:
        """When several positions fitted, and when one was left, a sentence an AUV."""
        if self.hypotheses is None:
            return ()
        return announcements(self.names, self.time, self.hypotheses)

    @cached_property
    def error(self) -> Float[np.ndarray, "auvs samples"]:
        """Distance between true and estimated position [m]; nan where the truth is not known.

        Raises
        ------
        ObsplanError
            No truth was given; so do all that follow from it.
        """
        return distance(self.mean, self.true)

    @property
    def rms_error(self) -> float:
        """Root mean square of the position error over time and AUVs [m].

        The first estimate is included, as in the thesis's tables.
        """
        return rms(self.error[self.known])

    @property
    def max_error(self) -> float:
        """Greatest position error [m], the first estimate's included."""
        return float(self.error[self.known].max())

    @cached_property
    def nees(self) -> Float[np.ndarray, "auvs samples"]:
        """Normalised squared position error, nan where P is singular.

        It is chi-square with 2 degrees of freedom if the filter is consistent.
        """
        d = self.mean[..., :2] - self.true[..., :2]
        P = self.covariance[..., :2, :2]
        determinant = P[..., 0, 0] * P[..., 1, 1] - P[..., 0, 1] ** 2
        weighed = (
            P[..., 1, 1] * d[..., 0] ** 2
            - 2 * P[..., 0, 1] * d[..., 0] * d[..., 1]
            + P[..., 0, 0] * d[..., 1] ** 2
        )
        regular = determinant > 0
        return np.where(regular, weighed / np.where(regular, determinant, 1.0), np.nan)

    @cached_property
    def separation(self) -> Float[np.ndarray, "auvs samples"]:
        """True horizontal distance between the aid vehicle and each AUV [m]."""
        return distance(self.true, self.cna)

    @cached_property
    def limits(self) -> tuple[LimitHistory, ...]:
        """How each of the scenario's limits was kept, at the sample instants.

        Without an aid vehicle, or where the truth is not known throughout, there are none.
        """
        limits, found = self.scenario.constraints, []
        if self.truth is None or not (self.known.all() and self.has_aid):
            return ()
        paths = [np.ascontiguousarray(aid.pose[:, :2]) for aid in self.aids]
        for k, path in enumerate(paths):
            own = limits.histories(path, distance(self.truth, path), self.names)
            whose = f" of {self.aid_names[k]}" if self.others else ""
            found += [replace(one, name=one.name + whose, aid=k) for one in own]
        return (*found, *limits.between(paths, self.aid_names))

    @cached_property
    def violation(self) -> Float[np.ndarray, "auvs samples"]:
        """How far [m] the aid vehicle breaks limits for each AUV; at most 0 if it keeps them."""
        worst = np.full(self.separation.shape, -np.inf)
        for limit in self.limits:
            rows = slice(None) if limit.auv is None else limit.auv
            worst[rows] = np.maximum(worst[rows], limit.violation)
        return worst

    @cached_property
    def came(self) -> Bool[np.ndarray, "beacons auvs samples"]:
        """Which ranges came."""
        return np.isfinite(self.ranges)


def distance(
    a: Float[np.ndarray, "*#batch n"], b: Float[np.ndarray, "*#batch m"]
) -> Float[np.ndarray, "*batch"]:
    """Horizontal distance between states [m]."""
    return np.hypot(*np.moveaxis(a[..., :2] - b[..., :2], -1, 0))


def rms(values: Float[np.ndarray, "..."]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
