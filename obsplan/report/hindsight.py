"""What an aid vehicle's path was worth after a cruise, and what the default planner's had been."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.planners import DEFAULT_PLANNER
from obsplan.planning.team import Team
from obsplan.replay.result import completed
from obsplan.report.words import metres, percent
from obsplan.run import Run
from obsplan.scenario import Scenario, from_dict
from obsplan.scenario.states import BASIC
from obsplan.simulation import ClosedLoop
from obsplan.simulation.autopilot import FixedPath, pursuit
from obsplan.types import ObsplanError

SEEDS = 8  # the least and the greatest of so many hold the median with probability 0.992
STILL = 5.0  # [m]: an aid vehicle that has moved no farther stood
LEG, MOST_LEGS = 2.0, 2000  # least length [m] and greatest number of legs of a survey
SLOWEST, FASTEST = 1e-3, 10.0  # [m/s] of a leg
USUAL = 0.95  # quantile of the speeds that the aid vehicle went at
UNKNOWN_DEG = 360.0  # of a heading that was never measured

Progress = Callable[[float, int], None]  # done, in all


@dataclass(frozen=True, kw_only=True)
class Errors:
    """RMS position errors [m] by seed."""

    own: tuple[float, ...]  # the aid vehicle on its recorded path
    planned: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Hindsight:
    """What a recorded path was worth, and what the default planner makes of the same survey."""

    pcrb: float  # of this path: RMS position error by the posterior Cramér-Rao bound [m]
    bound: float | None  # of every path [m]; None where none is known
    unbounded: str  # why
    planner: str
    seeds: tuple[int, ...]
    errors: Errors
    deviation: float  # how far from the recorded path it was simulated [m], RMS
    along: str  # which tracks of the AUVs were taken for the true ones

    @property
    def efficiency(self) -> float | None:
        """Least error of any path over that of this one."""
        return None if self.bound is None else self.bound / self.pcrb

    def summary(self) -> dict[str, Any]:
        """Figures of merit, in metres."""
        return {
            "pcrb_rms_m": self.pcrb,
            "bound_rms_m": self.bound,
            "efficiency": self.efficiency,
            "along": self.along,
            "seeds": list(self.seeds),
            "planner": self.planner,
            "recorded_path_rms_error_m": _known(self.errors.own),
            "planned_path_rms_error_m": _known(self.errors.planned),
            "deviation_rms_m": self.deviation,
        }

    @property
    def sentence(self) -> str:
        """What a chief scientist wants to know."""
        worth = f"Your path: {metres(self.pcrb)} by its Cramér–Rao bound"
        if self.bound is None:
            worth += f" ({self.unbounded})"
        else:
            share = percent(self.bound / self.pcrb)
            worth += f", where no path gets below {metres(self.bound)} (efficiency {share})"
        pairs = zip(self.errors.planned, self.errors.own, strict=True)
        better = sum(planned < own for planned, own in pairs)
        return (
            f"{worth}. The default planner ({self.planner}) on the same survey: "
            f"{_interval(self.errors.planned)}; your path, simulated under the same noise: "
            f"{_interval(self.errors.own)}; the planner is better in {better} of "
            f"{len(self.seeds)} seeds. AUVs are taken to have been where {self.along}."
        )


def hindsight(run: Run, *, seeds: int = SEEDS, progress: Progress | None = None) -> Hindsight:
    """Weigh the aid vehicles' recorded paths against any, and against the default planner's.

    Paths are compared in simulations under the same noise, of the same survey: the AUVs' true
    tracks, or where they are not known the smoothed ones. They are ranged as often as they were,
    evenly in time.

    Parameters
    ----------
    seeds
        How many simulations there are of each, from the recording's seed on.
    progress
        Called with (done, in all).

    Raises
    ------
    ObsplanError
        There is nothing to compare, and why.
    """
    _check(run)
    known = as_true(run)
    bound = None
    if not known.unbounded:
        bound = float(np.sqrt(np.mean([one.bound for one in known.information_bounds])))
    scenario = surveyed(run)
    numbers = tuple(range(run.seed, run.seed + seeds))
    commands, deviation = _recorded_commands(run, scenario)
    tell = progress or (lambda _done, _all: None)
    own = _flown(scenario, commands, numbers, lambda done: tell(done, 2 * seeds))
    planned = _flown(scenario, scenario.team(), numbers, lambda done: tell(seeds + done, 2 * seeds))
    return Hindsight(
        pcrb=float(np.sqrt(np.mean(known.cramer_rao_variance))),
        bound=bound,
        unbounded=known.unbounded,
        planner=DEFAULT_PLANNER,
        seeds=numbers,
        errors=Errors(own=own, planned=planned),
        deviation=deviation,
        along=_along(run),
    )


def _check(run: Run) -> None:
    """Refuse a run of which nothing is to be said.

    Raises
    ------
    ObsplanError
        No aid vehicle that moves, no range to it, or states that no survey prescribes.
    """
    if not run.has_aid:
        raise ObsplanError("no aid vehicle was ranged to, whose path could be compared")
    if max(np.ptp(aid.pose[:, :2], axis=0).max() for aid in run.aids) < STILL:
        raise ObsplanError("the aid vehicle stood still, and has no path to compare")
    if not run.informative[_carried(run)].any():
        raise ObsplanError("not one range to an aid vehicle was taken")
    if len(run.scenario.truth_states) > BASIC:
        raise ObsplanError("the AUVs' vehicle model has states that no survey prescribes")
    if not np.isfinite(run.places).all():
        raise ObsplanError("it is not known throughout where the AUVs were")


def _carried(run: Run) -> list[int]:
    """Numbers of the beacons on aid vehicles."""
    beacons = enumerate(run.scenario.beacons)
    return [b for b, beacon in beacons if beacon.carrier is not None]


def _along(run: Run) -> str:
    if run.known.all():
        return "the truth says"
    return "the smoother puts them" if run.smoothed is not None else "the filter puts them"


def as_true(run: Run) -> Run:
    """The same run with the AUVs' best known tracks as the true ones."""
    if not run.unbounded_below:
        return run
    nothing = np.full((*run.places.shape[:2], 2), np.nan)
    states = np.concatenate([run.places, nothing], axis=-1)
    return replace(run, truth=completed(states, run.time))


def surveyed(run: Run) -> Scenario:
    """A scenario to simulate: the AUVs follow their tracks, and are ranged to as often."""
    data = run.scenario.resolved()
    duration, step = float(run.time[-1]), run.scenario.table.time_step
    for auv, track in zip(data["auv"], run.places, strict=True):
        auv.pop("speed", None)
        auv["survey"] = survey_of(track, run.time)
        if isinstance(auv.get("depth"), list):  # one a point, of other points
            auv["depth"] = float(np.mean(auv["depth"]))
        first = auv["first_estimate"]
        auv["first_estimate"] = {key: first[key] for key in first if key.startswith("sigma")}
    aids = data["cna"] if isinstance(data["cna"], list) else [data["cna"]]
    for aid, recorded in zip(aids, run.aids, strict=True):
        x, y, heading = recorded.pose[0].tolist()
        aid["start"] = {"x": x, "y": y, "heading_deg": float(np.rad2deg(heading) % 360.0)}
        moving = recorded.speed[recorded.speed > SLOWEST]
        usual = float(np.quantile(moving, USUAL)) if moving.size else 0.0
        aid["speed"] = max(aid["speed"], usual)
    carried = run.informative[_carried(run)]
    rounds = carried.sum() / (carried.shape[0] * carried.shape[1])
    ranging = data["ranging"]
    ranging["interval"] = max(1, round(duration / rounds / step)) * step
    ranging |= {"slot": 0.0, "jitter": 0.0, "silent": [], "loss": 0.0}
    if run.compass is not None and not run.compass.any():
        ranging["heading_sigma_deg"] = UNKNOWN_DEG
    data |= {"duration": duration, "planner": {"kind": DEFAULT_PLANNER}}
    return from_dict(data, source=f"{run.scenario.source}, as surveyed")


def survey_of(
    track: Float[np.ndarray, "samples 2"], time: Float[np.ndarray, " samples"]
) -> dict[str, Any]:
    """A survey that follows a track in its time, by legs of at least `LEG`."""
    length = float(np.hypot(*np.diff(track, axis=0).T).sum())
    least, chosen = max(LEG, length / MOST_LEGS), [0]
    for k, place in enumerate(track):
        if np.hypot(*(place - track[chosen[-1]])) >= least:
            chosen.append(k)
    if len(chosen) < 2:
        x, y = track.mean(axis=0).tolist()
        return {"kind": "static", "x": x, "y": y}
    points = track[chosen]
    speeds = np.hypot(*np.diff(points, axis=0).T) / np.diff(time[chosen])
    return {
        "kind": "waypoints",
        "points": points.tolist(),
        "speeds": speeds.clip(SLOWEST, FASTEST).tolist(),
    }


def _recorded_commands(run: Run, scenario: Scenario) -> tuple[FixedPath | Team, float]:
    """The aid vehicles on their recorded paths as far as they can, and how far off [m]."""
    members, off = [], []
    step = scenario.table.time_step
    for aid, cna, start in zip(run.aids, scenario.aids, scenario.starts, strict=True):
        path = np.ascontiguousarray(aid.pose[:, :2])
        points, commands = pursuit(path, start, cna, step)
        members.append(FixedPath(commands=commands, time_step=step))
        off.append(points - path)
    deviation = np.sqrt(np.mean(np.sum(np.square(off), axis=-1)))
    team = members[0] if len(members) == 1 else Team(tuple(members))
    return team, float(deviation)


def _flown(
    scenario: Scenario,
    planner: Any,  # a planner, or a team of them
    seeds: tuple[int, ...],
    tell: Callable[[int], None],
) -> tuple[float, ...]:
    """RMS errors [m] of a planner, by seed."""
    loop = ClosedLoop(scenario=scenario, planner=planner)
    errors = []
    for done, seed in enumerate(seeds, start=1):
        flown = loop.fly(seed, start=scenario.starts, covariances=False)
        errors.append(flown.rms_error)
        tell(done)
    return tuple(errors)


def _known(errors: tuple[float, ...]) -> list[float | None]:
    return [error if np.isfinite(error) else None for error in errors]


def _interval(errors: tuple[float, ...]) -> str:
    """Median, least and greatest of the seeds."""
    if not np.isfinite(errors).all():
        return "no estimate"
    middle, least, most = np.median(errors), min(errors), max(errors)
    return f"{metres(float(middle))} [{least:.3g} to {most:.3g}]"
