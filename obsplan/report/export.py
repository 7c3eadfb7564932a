"""A run's path as a mission for an autopilot, and what it costs to sail it open loop."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from formulations.model.arcs import arcs
from obsplan.constraints import Constraints, Disc
from obsplan.missions import Area, Mission, Track, to_geographic
from obsplan.missions.export import Simplified, simplify
from obsplan.missions.flown_path import Allowance
from obsplan.planners import name_of
from obsplan.planning.team import Team, members_of
from obsplan.run import Run
from obsplan.scenario import Scenario
from obsplan.simulation.autopilot import Autopilot, FixedPath, in_wider_turns
from obsplan.simulation.inputs import stream
from obsplan.simulation.loop import ClosedLoop, Progress
from obsplan.simulation.step import folded
from obsplan.types import Pose
from obsplan.vehicles import Unicycle

LATE = (60.0, 180.0)  # [s]
SAGITTA = 0.05  # of the tolerance, by which the path may bulge between two of its samples
LEG_SAMPLE = 0.1  # [m] between the places of a leg that are held against the limits

ON_TIME, FLOWN, CLOSED_LOOP = "as_loaded", "path_as_flown", "closed_loop"


def late_by(seconds: float) -> str:
    """Key of a late start."""
    return f"{seconds:.0f}_s_late"


@dataclass(frozen=True, kw_only=True, eq=False)
class Costs:
    """What became of the AUVs under the noise of several seeds, by how the aid vehicle went."""

    seeds: tuple[int, ...]
    closed_loop_seeds: tuple[int, ...]  # the same, where that takes no longer than a replay
    rms_error: dict[str, float]  # median over the seeds [m]
    violation: dict[str, float]  # worst over the seeds [m]; empty without limits

    def above(self, way: str, other: str = FLOWN) -> float:
        """By what share the error of one way is above that of another."""
        return self.rms_error[way] / self.rms_error[other] - 1.0 if self.rms_error[other] else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Export:
    """The mission made of an aid vehicle's path, in local metres, and what is known of it."""

    scenario: Scenario
    planner: str
    aid: int  # number of the aid vehicle
    name: str  # of the aid vehicle
    simplified: Simplified
    widening: float  # how far wider turns moved the path [m]
    violation: float  # how far its legs break the fixed limits [m]; at most 0 where they keep them
    costs: Costs | None  # of all aid vehicles sailing so

    @property
    def cna(self) -> Unicycle:
        """The aid vehicle as planned."""
        return self.scenario.aids[self.aid]

    @property
    def stem(self) -> str:
        """What its files are called, before the format."""
        return "path" if len(self.scenario.aids) == 1 else f"path-{self.name}"

    @property
    def mission(self) -> Mission:
        """The mission with its limits, in degrees; home is where the vehicle started."""
        origin = self.scenario.table.origin
        local = Mission(
            tracks={self.name: self.simplified.track},
            geographic=False,
            keep_outs=tuple(map(area_of, self.scenario.constraints.keep_out)),
            geofences=tuple(map(area_of, fences(self.scenario.constraints))),
        )
        mission = to_geographic(local, (origin.lat, origin.lon))
        lat, lon = mission.tracks[self.name].points[0].tolist()
        return replace(mission, home=(lat, lon))

    def summary(self) -> dict[str, Any]:
        """Figures of merit, in metres and seconds."""
        track, costs = self.simplified.track, self.costs
        lengths = np.hypot(*np.diff(track.points, axis=0).T)
        return {
            "items": self.simplified.items,
            "waypoints": len(track.points),
            "least_leg_m": float(lengths.min()) if lengths.size else None,
            "deviation_m": self.simplified.deviation,
            "timing_s": self.simplified.timing,
            **({"widening_m": self.widening} if self.widening else {}),
            **({"violation_m": self.violation} if np.isfinite(self.violation) else {}),
            "seeds": list(costs.seeds) if costs else [],
            "closed_loop_seeds": list(costs.closed_loop_seeds) if costs else [],
            "rms_error_m": _known(costs.rms_error) if costs else None,
            **({"violation_max_m": _known(costs.violation)} if costs and costs.violation else {}),
        }


def _known(values: dict[str, float]) -> dict[str, float | None]:
    """Numbers where they are: a filter may have failed."""
    return {key: value if np.isfinite(value) else None for key, value in values.items()}


def make_export(run: Run, *, progress: Progress | None = None) -> Export:
    """The (first) aid vehicle's of `make_exports`."""
    return make_exports(run, progress=progress)[0]


def make_exports(run: Run, *, progress: Progress | None = None) -> tuple[Export, ...]:
    """Simplify aid vehicles' paths as the scenario's ``[export]`` says; sail them in other noise.

    Parameters
    ----------
    progress
        Called with (flights done, flights in all).
    """
    table, limits = run.scenario.table.export, run.scenario.constraints
    cnas = [_loaded_vehicle(run.scenario, planned) for planned in run.scenario.aids]
    made = [_simplified(run, aid, cna) for aid, cna in enumerate(cnas)]
    tracks = [simplified.track for simplified, _ in made]
    costs = judge(run, tracks, cnas, progress) if table.replays else None
    return tuple(
        Export(
            scenario=run.scenario,
            planner=run.planner,
            aid=aid,
            name=run.aid_names[aid],
            simplified=simplified,
            widening=widening,
            violation=leg_violation(simplified.track.points, limits),
            costs=costs,
        )
        for aid, (simplified, widening) in enumerate(made)
    )


def summaries(exports: Sequence[Export]) -> dict[str, Any]:
    """Figures of merit of the one aid vehicle's mission, or of each by its name."""
    if len(exports) == 1:
        return exports[0].summary()
    return {export.name: export.summary() for export in exports}


def _loaded_vehicle(scenario: Scenario, cna: Unicycle) -> Unicycle:
    """The vehicle that a mission is loaded into, which may turn wider than the planned one."""
    radius = scenario.table.export.min_turn_radius
    return cna if radius is None else Unicycle(speed=cna.speed, min_turn_radius=radius)


def _simplified(run: Run, aid: int, cna: Unicycle) -> tuple[Simplified, float]:
    """The mission, and how far [m] wider turns moved the path before."""
    table = run.scenario.table.export
    flown, sagitta = flown_track(run, SAGITTA * table.tolerance, aid)
    widening = 0.0
    if cna.min_turn_radius > run.scenario.aids[aid].min_turn_radius:
        step = float(run.time[-1]) / (len(flown.points) - 1)
        wider = in_wider_turns(flown.points, start_of(run, aid), cna, step)
        widening = float(np.hypot(*(wider - flown.points).T).max())
        flown = replace(flown, points=wider)
    allowance = Allowance(
        items=table.max_items,
        spacing=table.min_spacing,
        tolerance=table.tolerance - sagitta,
        timing=table.timing,
    )
    limits = run.scenario.constraints
    simplified = simplify(flown, allowance, end=table.end, constraints=limits)
    return replace(simplified, deviation=simplified.deviation + sagitta), widening


def start_of(run: Run, aid: int = 0) -> Pose:
    """Where an aid vehicle started."""
    return Pose(*run.aids[aid].pose[0].tolist())


def flown_track(run: Run, sagitta: float, aid: int = 0) -> tuple[Track, float]:
    """An aid vehicle's path with its times, and how near [m] the line through it is.

    It is sampled so densely that the sagitta is kept: between two samples the vehicle is on an
    arc.
    """
    own = run.aids[aid]
    step, turn_rate, speed = run.scenario.table.time_step, own.turn_rate[:-1], own.speed[:-1]
    bulge = float(np.max(abs(turn_rate) * speed, initial=0.0)) * step**2 / 8
    parts = max(1, int(np.ceil(np.sqrt(bulge / sagitta))))
    since = step * np.arange(parts) / parts
    points = arcs(own.pose[:-1], turn_rate, speed, since)[..., :2]
    points += stream(run.scenario)[:, aid, None] * since[:, None]  # while the water carries it
    points = points.reshape(-1, 2)
    time = (run.time[:-1, None] + since).ravel()
    to_the_end = np.vstack([points, own.pose[-1:, :2]])
    track = Track(points=to_the_end, time=np.append(time, run.time[-1]))
    return track, bulge / parts**2


def judge(
    run: Run,
    tracks: Sequence[Track],
    cnas: Sequence[Unicycle],
    progress: Progress | None = None,
) -> Costs:
    """Sail missions as loaded, on time and late, and the paths as flown, under other noise."""
    seeds = tuple(run.seed + 1 + n for n in range(run.scenario.table.export.replays))
    reacting = _quick_planner(run)
    late = [seconds for seconds in (0.0, *LATE) if seconds < run.time[-1]]
    flights = len(seeds) * (1 + len(late) + (reacting is not None))
    error, violation = {CLOSED_LOOP: run.rms_error}, {}
    done = 0
    starts = [start_of(run, aid) for aid in range(len(cnas))]
    for way, loop in _ways(run, tracks, cnas, late, reacting):
        start = None if way == CLOSED_LOOP else starts
        outcomes = []
        for seed in seeds:
            outcomes.append(_outcome(loop, seed, start))
            done += 1
            if progress:
                progress(done, flights)
        errors, violations = zip(*outcomes, strict=True)
        error[way] = float(np.median(errors))
        if run.scenario.constraints:
            violation[way] = max(violations)
    return Costs(
        seeds=seeds,
        closed_loop_seeds=seeds if reacting else (run.seed,),
        rms_error=error,
        violation=violation,
    )


def _outcome(loop: ClosedLoop, seed: int, start: list[Pose] | None) -> tuple[float, float]:
    """RMS error and violation [m] of a flight, whose recording is not kept: many are flown."""
    flown = loop.fly(seed, start=start, covariances=False)
    return flown.rms_error, float(flown.violation.max())


def _ways(
    run: Run,
    tracks: Sequence[Track],
    cnas: Sequence[Unicycle],
    late: Sequence[float],
    reacting: ClosedLoop | None,
) -> Iterator[tuple[str, ClosedLoop]]:
    """The paths as flown, the missions as loaded and so late [s], and the planner on board."""
    step, steps = run.scenario.table.time_step, run.time.size - 1

    def fixed(commands: Sequence[Float[np.ndarray, "steps 2"]]) -> FixedPath | Team:
        paths = tuple(FixedPath(commands=one, time_step=step) for one in commands)
        return paths[0] if len(paths) == 1 else Team(paths)

    as_flown = fixed([np.column_stack([a.turn_rate[:-1], a.speed[:-1]]) for a in run.aids])
    flown = ClosedLoop(scenario=run.scenario, planner=as_flown)
    yield FLOWN, flown
    acceptance = run.scenario.table.export.min_spacing
    streams = stream(run.scenario)
    for seconds in late:
        way = late_by(seconds) if seconds else ON_TIME
        commands = []
        for aid, (track, cna) in enumerate(zip(tracks, cnas, strict=True)):
            autopilot, start = Autopilot(cna=cna, acceptance=acceptance), start_of(run, aid)
            own = autopilot.commands(
                track,
                start,
                time_step=step,
                steps=steps,
                late=seconds,
                stream=streams[:, aid],
            )
            commands.append(own)
        yield way, flown.along(fixed(commands))
    if reacting:
        yield CLOSED_LOOP, reacting


def _quick_planner(run: Run) -> ClosedLoop | None:
    """The run's own planner, where flying it takes no longer than a fixed path."""
    planner = run.scenario.team()
    for member in members_of(planner):
        if name_of(member) != run.planner or folded(run.scenario, member) is None:
            return None
    return ClosedLoop(scenario=run.scenario, planner=planner)


def leg_violation(points: Float[np.ndarray, "k 2"], limits: Constraints) -> float:
    """How far [m] straight legs break the fixed limits; -inf without any."""
    lengths = np.hypot(*np.diff(points, axis=0).T)
    worst = float(limits.fixed_violation(points).max())
    if not np.isfinite(worst):
        return worst
    for (a, b), length in zip(pairwise(points), lengths, strict=True):
        share = np.linspace(0.0, 1.0, int(np.ceil(length / LEG_SAMPLE)) + 1)[:, None]
        worst = max(worst, float(limits.fixed_violation(a + share * (b - a)).max()))
    return worst


def area_of(limit: Any) -> Area:
    """A keep-out or geofence as mission files have it."""
    if isinstance(limit, Disc):
        return Area(points=np.array([[limit.x, limit.y]]), radius=limit.radius)
    return Area(points=np.array(limit.points, dtype=float))


def fences(limits: Constraints) -> tuple[Any, ...]:
    """The geofence, if there is one."""
    return () if limits.geofence is None else (limits.geofence,)
