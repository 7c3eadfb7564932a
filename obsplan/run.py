"""What was recorded of a mission, and what follows from it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Integer

from formulations.certified_bound import InformationBound
from formulations.consistency import effective_samples
from formulations.cramer_rao import (
    posterior_cramer_rao,
    range_information,
    squared_range_information,
)
from formulations.solution import Status
from obsplan.constraints import LimitHistory
from obsplan.estimators import Process
from obsplan.estimators.jacobian import informations, predictions, transitions
from obsplan.heard import Heard
from obsplan.kept_bounds import KEPT
from obsplan.scenario import Scenario
from obsplan.scenario.states import first_covariance, noise
from obsplan.scenario.tables import aids_of
from obsplan.sensors import BEACON, Range, SquaredRange
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[float, int], None]  # done, in all

GAINS = {Range: range_information, SquaredRange: squared_range_information}


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
class Run:
    """One mission as recorded; errors, consistency and bounds are derived.

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
    truth: Float[np.ndarray, "auvs samples n"]
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
    # by status, what was wrong with the planner's first answer of that kind, and when
    faults: Mapping[str, str] = field(default_factory=dict)
    bounded: bool = True  # whether the certified bound is asked for, where figures are

    def __repr__(self) -> str:
        auvs = len(self.truth)
        parts = [
            f"planner {self.planner}",
            f"seed {self.seed}",
            f"{auvs} AUV{'s' * (auvs != 1)}",
            f"{self.time[-1]:g} s",
            f"RMS error {self.rms_error:.2f} m",
            f"worst {self.max_error:.2f} m",
        ]
        return f"<Run of {self.scenario.table.name}: {', '.join(parts)}>"

    def _repr_html_(self) -> str:
        """Each AUV's figures of merit as a table, for notebooks."""
        from obsplan.report import run_html

        return run_html(self)

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
        return Heard.of(self.scenario, self.truth, self.beacon_places, self.reports)

    @cached_property
    def error(self) -> Float[np.ndarray, "auvs samples"]:
        """Distance between true and estimated position [m]."""
        return np.hypot(*np.moveaxis(self.mean[..., :2] - self.truth[..., :2], -1, 0))

    @property
    def rms_error(self) -> float:
        """Root mean square of the position error over time and AUVs [m].

        The first estimate is included, as in the thesis's tables.
        """
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def max_error(self) -> float:
        """Greatest position error [m], the first estimate's included."""
        return float(self.error.max())

    @cached_property
    def nees(self) -> Float[np.ndarray, "auvs samples"]:
        """Normalised squared position error, nan where P is singular.

        It is chi-square with 2 degrees of freedom if the filter is consistent.
        """
        d = self.mean[..., :2] - self.truth[..., :2]
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
    def independent_errors(self) -> Float[np.ndarray, " auvs"]:
        """How many independent errors each AUV's mean NEES is worth (see `effective_samples`)."""
        scenario, dt = self.scenario, self.scenario.table.time_step
        assumed = noise(scenario, scenario.filter_states, assumed=True)
        counts = []
        for vehicle, own, P, mean in zip(
            scenario.vehicles, assumed, self.covariance, self.mean, strict=True
        ):
            process = Process(model=vehicle, noise=tuple(own), dt=dt)
            F = predictions(scenario.estimator, process, mean[:-1])
            counts.append(effective_samples(P, F, np.diag(own**2 * dt)))
        return np.array(counts)

    @cached_property
    def separation(self) -> Float[np.ndarray, "auvs samples"]:
        """True horizontal distance between the aid vehicle and each AUV [m]."""
        return np.hypot(*np.moveaxis(self.truth[..., :2] - self.cna[:, :2], -1, 0))

    @cached_property
    def limits(self) -> tuple[LimitHistory, ...]:
        """How each of the scenario's limits was kept, at the sample instants."""
        path = np.ascontiguousarray(self.cna[:, :2])
        return self.scenario.constraints.histories(path, self.separation, self.names)

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

    @cached_property
    def cramer_rao(self) -> Float[np.ndarray, "auvs samples n n"]:
        """Posterior Cramér-Rao bound of the true states along the true path.

        It begins with their first covariance and counts the process noise that the filter assumes,
        and the ranges that came. A filter that has to find out more than these states cannot reach
        it.
        """
        return np.stack([*self._posterior()])

    @cached_property
    def cramer_rao_variance(self) -> Float[np.ndarray, "auvs samples"]:
        """Mean square position error by the `cramer_rao` bound [m^2]; a smaller array than that."""
        return np.stack([P[:, 0, 0] + P[:, 1, 1] for P in self._posterior()])

    @cached_property
    def unaided_variance(self) -> Float[np.ndarray, "auvs samples"]:
        """`cramer_rao_variance` as it would be without a single range: that of dead reckoning."""
        return np.stack([P[:, 0, 0] + P[:, 1, 1] for P in self._posterior(aided=False)])

    def _posterior(self, *, aided: bool = True) -> Iterator[Float[np.ndarray, "samples n n"]]:
        """Posterior Cramér-Rao bound of each AUV, of compass and, if aided, ranges."""
        for i, (P0, Q) in enumerate(zip(*self._covariances, strict=True)):
            J = self._own_information(i)
            if aided:
                for b in range(len(self.ranges)):
                    pings = np.flatnonzero(self.came[b, i])
                    J[pings - 1] += self._information(b, i, pings)
            yield posterior_cramer_rao(P0, self._transitions(i), Q, J)

    def _information(
        self, b: int, i: int, pings: Integer[np.ndarray, " pings"]
    ) -> Float[np.ndarray, "pings n n"]:
        """What an AUV's ranges to a beacon tell of its true state, and bearings with them."""
        sensor, truth = self.scenario.range_sensor, self.truth[i, pings]
        gain = GAINS.get(type(sensor))
        if isinstance(sensor, Range) and not sensor.is_plain:
            gain = None
        beacon = self._beacon(b, i, pings)
        if gain is None:
            J = informations(sensor, truth, beacon)
        else:
            J = np.zeros((*truth.shape, truth.shape[-1]))
            J[..., :2, :2] = gain(beacon[:, :2], truth[:, :2], sensor.sigma)
        bearing = self.scenario.bearing_sensor
        return J if bearing is None else J + informations(bearing, truth, beacon)

    def _beacon(
        self, b: int, i: int, samples: Integer[np.ndarray, " some"]
    ) -> Float[np.ndarray, "some 10"]:
        """A beacon as an AUV's sensor sees it at samples (`obsplan.sensors.BEACON`)."""
        beacon, some = self.scenario.beacons[b], samples.size
        found = np.zeros((some, len(BEACON)))
        found[:, :2] = self.beacon_places[b, samples]
        if beacon.carrier is not None:
            aid = self.aids[beacon.carrier]
            before = samples - 1  # what is held until the sample
            heading, speed = aid.pose[samples, 2], aid.speed[before]
            found[:, 2] = heading
            found[:, 3], found[:, 4] = speed * np.cos(heading), speed * np.sin(heading)
            found[:, 5] = aid.turn_rate[before]
        found[:, 6] = beacon.depth
        found[:, 7] = self.scenario.depths[samples, i]
        found[:, 8:] = self.scenario.currents[samples, i]
        return found

    @property
    def unbounded(self) -> str:
        """Why there is no certified bound; empty where there is one."""
        if not self.bounded:
            return "no bound over all paths was asked for"
        if not self.came.any():
            return "not one range was measured, and no path is better than another"
        sensor = self.scenario.range_sensor
        known = type(sensor) in GAINS and not (isinstance(sensor, Range) and not sensor.is_plain)
        if known and len(self.ranges) == 1 and self.scenario.bearing_sensor is None:
            return ""
        if type(sensor) not in GAINS:
            return (
                "no bound over all paths is known for the ranging "
                f"{type(sensor).__module__}:{type(sensor).__qualname__}; "
                "there is one for ranges and squared ranges of a constant standard deviation"
            )
        return "no bound over all paths is known for such ranging"

    @cached_property
    def information_bounds(self) -> tuple[InformationBound, ...]:
        """Per AUV, a certified lower bound on the mean square position error of every path.

        It is of unbiased estimators from the first covariance on, along the true AUV trajectory. A
        squared range is worth more the farther: there it holds for every path the aid vehicle can
        travel from its start.

        Raises
        ------
        ObsplanError
            There is none, and why; see `unbounded`.
        """
        return self.certify()

    def certify(self, progress: Progress | None = None) -> tuple[InformationBound, ...]:
        """Find the `information_bounds`, unless they are known, and say how far that is.

        Parameters
        ----------
        progress
            Called with (done, in all) as it goes on, in AUVs.

        Raises
        ------
        ObsplanError
            As `information_bounds`.
        """
        if self.unbounded:
            raise ObsplanError(self.unbounded)
        derived = vars(self)  # where a cached property keeps its value
        if "information_bounds" not in derived:
            derived["information_bounds"] = self._certified(progress or (lambda _done, _all: None))
        return derived["information_bounds"]

    def _certified(self, progress: Progress) -> tuple[InformationBound, ...]:
        auvs, bounds = len(self.names), []
        for i, (P0, Q) in enumerate(zip(*self._covariances, strict=True)):
            tell = partial(_tell, progress, i, auvs)
            F, pings = self._transitions(i), np.flatnonzero(self.came[0, i])
            J = self._own_information(i)
            sigma = self._least_sigma(i, pings)
            bounds.append(KEPT.bound(P0, F, Q, J, pings=pings - 1, sigma=sigma, progress=tell))
        return tuple(bounds)

    def _least_sigma(
        self, i: int, pings: Integer[np.ndarray, " pings"]
    ) -> Float[np.ndarray, " pings"]:
        """Smallest standard deviation [m] of a range that any path reaches at each ping."""
        sigma = self.scenario.range_sensor.sigma
        if self.scenario.ranging_kind == "range":
            return np.full(pings.size, sigma)
        start = np.hypot(*np.moveaxis(self.truth[i, pings, :2] - self.cna[0, :2], -1, 0))
        fastest = self.scenario.cna.speed
        if aids_of(self.scenario.table)[0].carried:
            fastest += float(self.scenario.water.strongest(0.0))
        return sigma / (2 * (start + fastest * self.time[pings]))

    @property
    def _covariances(self) -> tuple[np.ndarray, np.ndarray]:
        """First covariance and process noise over a step of each AUV, both (auvs x n x n)."""
        scenario = self.scenario
        rows = noise(scenario, scenario.truth_states, assumed=True)
        process = [np.diag(row**2 * scenario.table.time_step) for row in rows]
        return first_covariance(scenario, scenario.truth_states), np.stack(process)

    def _transitions(self, i: int) -> Float[np.ndarray, "steps n n"]:
        """Jacobians of an AUV's steps; not kept, as those of a long mission are large."""
        dt, vehicle = self.scenario.table.time_step, self.scenario.vehicles[i]
        return transitions(vehicle, self.truth[i, :-1], dt)

    def _own_information(self, i: int) -> Float[np.ndarray, "steps n n"]:
        """What an AUV's compass and log tell of its state on arrival at each sample."""
        n, every = self.truth.shape[-1], self.scenario.log_every[i]
        J = np.zeros((self.time.size - 1, n, n))
        J[:, 2, 2] = self.scenario.heading_sensor.sigma**-2
        due = np.arange(every, self.time.size, every) if every else np.empty(0, dtype=int)
        for sensor in self.scenario.true_logs[i]:
            J[due - 1] += informations(sensor, self.truth[i, due], self._beacon(0, i, due))
        return J

    @property
    def status_counts(self) -> dict[str, int]:
        """How often each status was given."""
        codes, counts = np.unique(self.status[np.isfinite(self.status)], return_counts=True)
        return {
            Status(int(code)).label: int(count) for code, count in zip(codes, counts, strict=True)
        }

    def summary(self, *, bounds: bool = True) -> dict[str, Any]:
        """Figures of merit over all AUVs and per AUV, in metres.

        ``bounds`` adds the certified bound, most of the work. Where there is none,
        ``unbounded`` says why. ``faults``, if any, says by status what was wrong first with the
        planner's answers.
        """
        from obsplan import __version__

        per_auv = {
            name: self._figures(slice(i, i + 1), bounds) for i, name in enumerate(self.names)
        }
        more: dict[str, Any] = {"faults": dict(self.faults)} if self.faults else {}
        if bounds and self.unbounded:
            more["unbounded"] = self.unbounded
        return more | {
            "scenario": self.scenario.table.name,
            "planner": self.planner,
            "seed": self.seed,
            "version": __version__,
            "all": self._figures(slice(None), bounds),
            "auv": per_auv,
            "status_counts": self.status_counts,
        }

    def _figures(self, auvs: slice, bounds: bool) -> dict[str, float | None]:
        nees, separation = self.nees[auvs], self.separation[auvs]
        of_each = np.sqrt(np.mean(self.cramer_rao_variance[auvs], axis=-1))
        achieved = np.sqrt(np.mean(of_each**2))
        bound, efficiency = np.nan, np.nan
        if bounds and not self.unbounded:
            bound = np.sqrt(np.mean([b.bound for b in self.information_bounds[auvs]]))
            efficiency = bound / achieved if achieved > 0 else 1.0
        figures = {
            "rms_error_m": np.sqrt(np.mean(self.error[auvs] ** 2)),
            "max_error_m": self.error[auvs].max(),
            "mean_nees": np.nan if np.isnan(nees).all() else np.nanmean(nees),
            "pcrb_rms_m": achieved,
            **({"bound_rms_m": bound, "efficiency": efficiency} if bounds else {}),
            "separation_mean_m": separation.mean(),
            "separation_max_m": separation.max(),
            **(self.heard.figures(auvs) if self.scenario.hearing_matters else {}),
            **(
                {"violation_max_m": self.violation[auvs].max()} if self.scenario.constraints else {}
            ),
        }
        return {key: float(value) if np.isfinite(value) else None for key, value in figures.items()}

    def plot(self) -> "Figure":
        """Draw the map: surveys, true tracks, estimates with 95 % ellipses, aid vehicle's path.

        Axes are east and north [m]. The figure belongs to no window. A script saves it,
        ``run.plot().savefig("map.png")``; a notebook shows it after ``%matplotlib inline``.
        """
        from obsplan.report import map_figure, styled

        with styled():
            return map_figure(self)


def _tell(progress: Progress, done: int, auvs: int, share: float) -> None:
    """Say that this share is done of one more AUV."""
    progress(done + share, auvs)
