"""A mission as recorded, and how good it was: errors against bounds, consistency, figures."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from formulations.branch_and_bound import OptimalBound
from formulations.certified_bound import InformationBound
from formulations.consistency import effective_samples
from formulations.joint_paths import JointBound
from formulations.solution import Status
from obsplan.bounds import Bounds
from obsplan.estimators.jacobian import predictions
from obsplan.fates import TAKEN
from obsplan.record import NO_TRUTH, AidTrack, Record, Timing, distance, rms
from obsplan.scenario.states import noise
from obsplan.sensors import Range, SquaredRange
from obsplan.types import ObsplanError
from obsplan.vehicles import STATES

if TYPE_CHECKING:
    from matplotlib.figure import Figure
__all__ = ["AidTrack", "Run", "Timing"]

Progress = Callable[[float, int], None]  # done, in all
SETTLED = 0.1  # of the mission, after which errors are no longer those of the first estimate


def _untold(_share: float) -> None:
    """Progress that nobody asked for."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Run(Record):
    """One mission as recorded, simulated or replayed; errors, consistency and bounds are derived.

    See `Record` for what is kept. Without the truth (``Run.truth``) whatever follows from it is
    absent: from `summary` and from files; asked for here it is refused.
    """

    def __repr__(self) -> str:
        auvs = len(self.mean)
        how = f"planner {self.planner}, seed {self.seed}"
        parts = [
            self.source if self.is_replay else how,
            f"{auvs} AUV{'s' * (auvs != 1)}",
            f"{self.time[-1]:g} s",
        ]
        if self.known.any():
            parts += [f"RMS error {self.rms_error:.2f} m", f"worst {self.max_error:.2f} m"]
        else:
            parts.append(NO_TRUTH)
        return f"<Run of {self.scenario.table.name}: {', '.join(parts)}>"

    def _repr_html_(self) -> str:
        """Each AUV's figures of merit as a table, for notebooks; `animate` plays the mission."""
        from obsplan.report import run_html

        return run_html(self)

    @cached_property
    def independent_errors(self) -> Float[np.ndarray, " auvs"]:
        """How many independent errors each AUV's mean NEES is worth (see `effective_samples`)."""
        scenario, dt = self.scenario, self.scenario.table.time_step
        assumed = noise(scenario, scenario.filter_states, assumed=True)
        counts = []
        for i, (own, P, mean) in enumerate(zip(assumed, self.covariance, self.mean, strict=True)):
            process = scenario.filter_process(i, dt)
            F = predictions(scenario.estimator, process, mean[:-1])
            counts.append(effective_samples(P, F, np.diag(own**2 * dt)))
        return np.array(counts)

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

    @cached_property
    def informative(self) -> Bool[np.ndarray, "beacons auvs samples"]:
        """Which ranges bounds count: those that came, of a recording those that a filter took.

        What is false in a recording is not known otherwise.
        """
        if not self.is_replay or self.fates is None:
            return self.came
        return self.came & np.isin(self.fates, TAKEN)

    @property
    def unbounded_below(self) -> str:
        """Why there is no Cramér-Rao bound; empty where there is one."""
        if self.truth is None:
            return NO_TRUTH
        return "" if np.isfinite(self.truth).all() else "the truth is not known throughout"

    @property
    def _bounds(self) -> Bounds:
        return Bounds(
            scenario=self.scenario,
            time=self.time,
            truth=self.true,
            came=self.informative,
            beacon_places=self.beacon_places,
            aids=self.aids,
            compass=self.compass,
        )

    @property
    def unbounded(self) -> str:
        """Why there is no certified bound; empty where there is one."""
        if not self.bounded:
            return "no bound over all paths was asked for"
        if self.unbounded_below:
            return self.unbounded_below
        if not self.has_aid:
            return "no aid vehicle moves, and there is one path only"
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

    def joint_bound(self, progress: Callable[[float], None] = _untold) -> JointBound:
        """Bound all AUVs' mean square error, of every path of vehicles this fast, from below.

        It counts what `information_bounds` leave out: that one vehicle serves all AUVs, and that
        its speed is limited. It takes seconds. Assumptions are otherwise the same.

        Raises
        ------
        ObsplanError
            As `information_bounds`.
        """
        if self.unbounded:
            raise ObsplanError(self.unbounded)
        return self._bounds.joint(progress)

    def optimal_bound(
        self, max_nodes: int = 2000, progress: Callable[[float], None] = _untold
    ) -> OptimalBound:
        """Bound how far the flown path's Cramér-Rao error is above the best path's, at most.

        For short missions: some ten pings. A node takes some milliseconds, and more nodes give a
        closer bound; see `formulations.optimal_bound`.

        Raises
        ------
        ObsplanError
            As `information_bounds`.
        """
        if self.unbounded:
            raise ObsplanError(self.unbounded)
        return self._bounds.optimal(max_nodes, progress)

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
        found = more | {
            "scenario": self.scenario.table.name,
            "planner": self.planner,
            "seed": self.seed,
            "version": __version__,
            "all": self._figures(slice(None), bounds),
            "auv": per_auv,
            "status_counts": self.status_counts,
        }
        return found | self._estimation()

    @property
    def hidden(self) -> dict[str, dict[str, dict[str, Any]]]:
        """What filters found out besides `STATES`: by AUV and state its last value and sigma."""
        states = [*self.scenario.filter_states.items()][len(STATES) :]
        found: dict[str, dict[str, dict[str, Any]]] = {}
        for i, name in enumerate(self.names if states else ()):
            last, P = self.mean[i, -1], self.covariance[i, -1]
            if not np.isfinite(np.diag(P)).all():  # not recorded, or a filter that has failed
                continue
            own = {}
            for k, (state, kind) in enumerate(states, start=len(STATES)):
                sigma = float(np.sqrt(P[k, k]))
                own[state] = {"value": float(last[k]), "sigma": sigma, "unit": kind.unit}
            found[name] = own
        return found

    def _estimation(self) -> dict[str, Any]:
        """Where the run comes from if not simulated, what became of ranges, what was announced."""
        found: dict[str, Any] = {"source": self.source} if self.is_replay else {}
        if self.began is not None:
            found["began"] = self.began.isoformat()
        if self.ranged is not None:
            own = {name: self.ranged.of(auv=i) for i, name in enumerate(self.names)}
            found["ranges"] = {name: ranged.summary() for name, ranged in own.items()}
        if self.hidden:
            found["states"] = self.hidden
        if self.announcements:
            found["announcements"] = list(self.announcements)
        return found

    @property
    def settled(self) -> Bool[np.ndarray, " samples"]:
        """Which samples come after the first tenth of the mission."""
        return self.time >= SETTLED * self.time[-1]

    def _figures(self, auvs: slice, bounds: bool) -> dict[str, float | None]:
        known, figures = self.known[auvs], {}
        if known.any():
            error, nees = self.error[auvs][known], self.nees[auvs][known]
            figures["rms_error_m"] = rms(error)
            figures["max_error_m"] = error.max()
            late = self.known[auvs] & self.settled
            if late.any():
                figures["rms_error_late_m"] = rms(self.error[auvs][late])
            figures["mean_nees"] = np.nan if np.isnan(nees).all() else np.nanmean(nees)
            if self.smoothed is not None:
                figures["smoothed_rms_error_m"] = rms(
                    distance(self.smoothed, self.true)[auvs][known]
                )
        if not known.all() or self.is_replay:
            figures["sigma_rms_m"] = np.sqrt(np.mean(position_variance(self.covariance[auvs])))
        figures |= self._bound_figures(auvs, bounds)
        if known.any() and self.has_aid:
            separation = self.separation[auvs][known]
            figures["separation_mean_m"] = separation.mean()
            figures["separation_max_m"] = separation.max()
        if self.scenario.hearing_matters and not self.is_replay:
            figures |= self.heard.figures(auvs)
        if self.scenario.ranges_may_be_lost and not self.is_replay:
            figures["pcrb_forecast_rms_m"] = np.sqrt(np.mean(self.forecast_variance[auvs]))
        if self.scenario.constraints and known.all() and self.has_aid:
            figures["violation_max_m"] = self.violation[auvs].max()
        return {key: float(value) if np.isfinite(value) else None for key, value in figures.items()}

    def _bound_figures(self, auvs: slice, bounds: bool) -> dict[str, float]:
        """Bounds that hold for this path and for any, and their ratio."""
        if self.unbounded_below:
            return {}
        of_each = np.sqrt(np.mean(self.cramer_rao_variance[auvs], axis=-1))
        achieved = np.sqrt(np.mean(of_each**2))
        late = self.cramer_rao_variance[auvs][:, self.settled]
        figures = {"pcrb_rms_m": achieved, "pcrb_rms_late_m": np.sqrt(np.mean(late))}
        if bounds and self.has_aid:
            figures["bound_rms_m"] = figures["efficiency"] = np.nan
            if not self.unbounded:
                bound = np.sqrt(np.mean([b.bound for b in self.information_bounds[auvs]]))
                figures["bound_rms_m"] = bound
                figures["efficiency"] = bound / achieved if achieved > 0 else 1.0
        return figures

    def animate(self) -> Any:
        """Play the mission back in a notebook: the page that is ``report.html`` in its folder.

        It is some megabytes in the notebook; nothing is fetched from a network. What is returned
        is shown where it is a cell's last value, and its ``save(path)`` writes it into a file.
        """
        from obsplan.report import played

        return played(self)

    def plot(self) -> "Figure":
        """Draw the map: surveys, true tracks, estimates with 95 % ellipses, aid vehicle's path.

        Axes are east and north [m]. The figure belongs to no window. A script saves it,
        ``run.plot().savefig("map.png")``; a notebook shows it after ``%matplotlib inline``.
        """
        from obsplan.report import map_figure, styled

        with styled():
            return map_figure(self)


def position_variance(P: Float[np.ndarray, "*n m m"]) -> Float[np.ndarray, "*n"]:
    """Mean square distance from the estimate, as its covariance says [m^2]."""
    return P[..., 0, 0] + P[..., 1, 1]
