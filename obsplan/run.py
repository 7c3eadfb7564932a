"""What was recorded of a mission, and what follows from it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from formulations.certified_bound import InformationBound
from formulations.consistency import effective_samples
from formulations.solution import Status
from obsplan.bounds import Bounds
from obsplan.constraints import LimitHistory
from obsplan.estimators import Process
from obsplan.estimators.jacobian import predictions
from obsplan.heard import Heard
from obsplan.scenario import Scenario
from obsplan.scenario.beacons import aid_names
from obsplan.scenario.states import noise
from obsplan.sensors import Range, SquaredRange
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[float, int], None]  # done, in all


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
        limits, found = self.scenario.constraints, []
        paths = [np.ascontiguousarray(aid.pose[:, :2]) for aid in self.aids]
        for k, path in enumerate(paths):
            apart = np.hypot(*np.moveaxis(self.truth[..., :2] - path, -1, 0))
            own = limits.histories(path, apart, self.names)
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

    @cached_property
    def cramer_rao(self) -> Float[np.ndarray, "auvs samples n n"]:
        """Posterior Cramér-Rao bound of the true states along the true path.

        It begins with their first covariance and counts the process noise that the filter assumes,
        and the ranges that came. Of them it is as if nothing moved while the sound travels, at its
        true speed; that is off by the vehicles' speed over that of sound. A filter that has to find
        out more than these states cannot reach it.
        """
        return np.stack([*self._bounds.posterior()])

    @cached_property
    def cramer_rao_variance(self) -> Float[np.ndarray, "auvs samples"]:
        """Mean square position error by the `cramer_rao` bound [m^2]; a smaller array than that."""
        return np.stack([P[:, 0, 0] + P[:, 1, 1] for P in self._bounds.posterior()])

    @cached_property
    def unaided_variance(self) -> Float[np.ndarray, "auvs samples"]:
        """`cramer_rao_variance` as it would be without a single range: that of dead reckoning."""
        return np.stack([P[:, 0, 0] + P[:, 1, 1] for P in self._bounds.posterior(aided=False)])

    @cached_property
    def forecast_variance(self) -> Float[np.ndarray, "auvs samples"]:
        """`cramer_rao_variance` of this path as expected before it is known which ranges come."""
        return np.stack([P[:, 0, 0] + P[:, 1, 1] for P in self._bounds.forecast()])

    @property
    def _bounds(self) -> Bounds:
        return Bounds(
            scenario=self.scenario,
            time=self.time,
            truth=self.truth,
            came=self.came,
            beacon_places=self.beacon_places,
            aids=self.aids,
        )

    @property
    def unbounded(self) -> str:
        """Why there is no certified bound; empty where there is one."""
        if not self.bounded:
            return "no bound over all paths was asked for"
        if not self.came.any():
            return "not one range was measured, and no path is better than another"
        if self.scenario.bearing_sensor is not None:
            return (
                "no bound over all paths is known for bearings: the nearer the aid vehicle is, the "
                "more they tell"
            )
        sensor = type(self.scenario.range_sensor)
        if sensor in (Range, SquaredRange):
            return ""
        return (
            "no bound over all paths is known for the ranging "
            f"{sensor.__module__}:{sensor.__qualname__}; "
            'there is one for the kinds "range" and "squared-range"'
        )

    @cached_property
    def information_bounds(self) -> tuple[InformationBound, ...]:
        """Per AUV, a certified lower bound on the mean square position error of every path.

        It is of unbiased estimators from the first covariance on, along the true AUV trajectory,
        by ranges that come when they came; those to moored beacons are as they are. Where what a
        range tells depends on distance, it holds for every path that the aid vehicles can travel
        from their starts.

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
            tell = progress or (lambda _done, _all: None)
            derived["information_bounds"] = self._bounds.certified(tell)
        return derived["information_bounds"]

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
        forecast = np.nan
        if self.scenario.ranges_may_be_lost:
            forecast = np.sqrt(np.mean(self.forecast_variance[auvs]))
        figures = {
            "rms_error_m": np.sqrt(np.mean(self.error[auvs] ** 2)),
            "max_error_m": self.error[auvs].max(),
            "mean_nees": np.nan if np.isnan(nees).all() else np.nanmean(nees),
            "pcrb_rms_m": achieved,
            **({"bound_rms_m": bound, "efficiency": efficiency} if bounds else {}),
            "separation_mean_m": separation.mean(),
            "separation_max_m": separation.max(),
            **(self.heard.figures(auvs) if self.scenario.hearing_matters else {}),
            **({"pcrb_forecast_rms_m": forecast} if self.scenario.ranges_may_be_lost else {}),
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
