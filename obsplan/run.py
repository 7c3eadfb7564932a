"""What was recorded of a mission, and what follows from it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Integer

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
from obsplan.kept_bounds import KEPT
from obsplan.scenario import Scenario
from obsplan.scenario.states import first_covariance, noise
from obsplan.sensors import Range, SquaredRange
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
    range: Float[np.ndarray, "auvs samples"]  # as measured [m or m^2]; nan without a ping
    condition: Float[np.ndarray, "auvs samples"]  # predicted condition number at each decision
    score: Float[np.ndarray, " samples"]  # the planner's own objective
    status: Float[np.ndarray, " samples"]  # code of a Status; nan without a decision
    timing: Timing = field(repr=False)
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
    def cramer_rao(self) -> Float[np.ndarray, "auvs samples n n"]:
        """Posterior Cramér-Rao bound of the true states along the true path.

        It begins with their first covariance and counts the process noise that the filter assumes.
        A filter that has to find out more than these states cannot reach it.
        """
        return np.stack(list(self._posterior(self._range_information(self.scenario.pings))))

    @cached_property
    def cramer_rao_variance(self) -> Float[np.ndarray, "auvs samples"]:
        """Mean square position error by the `cramer_rao` bound [m^2]; a smaller array than that."""
        return self._position_variance(self._range_information(self.scenario.pings))

    @cached_property
    def unaided_variance(self) -> Float[np.ndarray, "auvs samples"]:
        """`cramer_rao_variance` as it would be without a single range: that of dead reckoning."""
        n, pings = self.truth.shape[-1], self.scenario.pings.size
        return self._position_variance(np.zeros((len(self.names), pings, n, n)))

    def _position_variance(
        self, of_ranges: Float[np.ndarray, "auvs pings n n"]
    ) -> Float[np.ndarray, "auvs samples"]:
        """Mean square position error of each AUV by the bound of `_posterior` [m^2]."""
        return np.stack([P[:, 0, 0] + P[:, 1, 1] for P in self._posterior(of_ranges)])

    def _posterior(
        self, of_ranges: Float[np.ndarray, "auvs pings n n"]
    ) -> Iterator[Float[np.ndarray, "samples n n"]]:
        """Posterior Cramér-Rao bound of each AUV, compass and ranges at the pings counted."""
        pings, of_compass = self.scenario.pings, self._compass_information()
        for i, (P0, Q) in enumerate(zip(*self._covariances, strict=True)):
            J = of_compass.copy()
            J[pings - 1] += of_ranges[i]
            yield posterior_cramer_rao(P0, self._transitions(i), Q, J)

    def _range_information(self, pings: Integer[np.ndarray, " pings"]) -> np.ndarray:
        """What the range at each ping tells of the true state (auvs x pings x n x n)."""
        sensor, truth, cna = self.scenario.range_sensor, self.truth[:, pings], self.cna[pings]
        gain = GAINS.get(type(sensor))
        if gain is None:
            return informations(sensor, truth, cna)
        J = np.zeros((*truth.shape, truth.shape[-1]))
        J[..., :2, :2] = gain(cna[:, :2], truth[..., :2], sensor.sigma)
        return J

    @property
    def unbounded(self) -> str:
        """Why there is no certified bound; empty where there is one."""
        if not self.bounded:
            return "no bound over all paths was asked for"
        if not self.scenario.pings.size:
            return "not one range was measured, and no path is better than another"
        sensor = type(self.scenario.range_sensor)
        if sensor in GAINS:
            return ""
        return (
            "no bound over all paths is known for the ranging "
            f"{sensor.__module__}:{sensor.__qualname__}; "
            "there is one for ranges and squared ranges of a constant standard deviation"
        )

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
        auvs = len(self.names)
        pings, J = self.scenario.pings, self._compass_information()
        parts = zip(*self._covariances, self._least_sigma(), strict=True)
        bounds = []
        for i, (P0, Q, sigma) in enumerate(parts):
            tell = partial(_tell, progress, i, auvs)
            F = self._transitions(i)
            bounds.append(KEPT.bound(P0, F, Q, J, pings=pings - 1, sigma=sigma, progress=tell))
        return tuple(bounds)

    def _least_sigma(self) -> Float[np.ndarray, "auvs pings"]:
        """Smallest standard deviation [m] of a range that any path reaches at each ping."""
        pings, sigma = self.scenario.pings, self.scenario.range_sensor.sigma
        if self.scenario.ranging_kind == "range":
            return np.full((len(self.names), pings.size), sigma)
        start = np.hypot(*np.moveaxis(self.truth[:, pings, :2] - self.cna[0, :2], -1, 0))
        return sigma / (2 * (start + self.scenario.cna.speed * self.time[pings]))

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

    def _compass_information(self) -> Float[np.ndarray, "steps n n"]:
        """What the heading measured on arrival at each sample after the first tells of states."""
        n = self.truth.shape[-1]
        J = np.zeros((self.time.size - 1, n, n))
        J[:, 2, 2] = self.scenario.heading_sensor.sigma**-2
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
