"""Trajectory: optimise the turns over a receding horizon, under limits on position."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property, lru_cache
from time import perf_counter
from typing import Annotated, Literal, NamedTuple

import numpy as np

from formulations.model.schedule import ROUNDING, time_to_next
from formulations.solution import Solution, Status
from formulations.trajectory import (
    Areas,
    Controls,
    PathLimits,
    Task,
    build,
    convex_areas,
    freer_side,
    optimise,
)
from obsplan.constraints import Constraints, Disc, Polygon
from obsplan.next_move import loiter_violation
from obsplan.planning.checks import check_situation
from obsplan.planning.fallback import straight_on, unusable
from obsplan.planning.interface import Progress
from obsplan.planning.limits import SURE, LimitsAhead, margins
from obsplan.planning.situation import Situation
from obsplan.quantities import INTERVAL, ITERATIONS, TURN_ACCELERATION, TURNS, VESSEL_SPEED
from obsplan.types import Belief, Decision, Pose
from obsplan.vehicles import Unicycle

# Within the horizon, however rare pings are. With half as many it does not pay to come near, and
# the vehicle moves away.
LEAST_PINGS = 6

Objective = Literal["covariance", "log-det", "smallest-eigenvalue", "condition-number"]


@dataclass(frozen=True)
class Trajectory:
    """Optimise the turns of the next stages by nonlinear programming and take the first.

    The program is `formulations.trajectory`. The criterion ``covariance`` minimises the time mean
    of the trace of each AUV's predicted position covariance [m^2], as `InformationHorizon` does:
    each AUV's ranges come in its slot, over its height, err and are lost as the ranging says; a
    depth that an AUV has to estimate counts as known.
    The other criteria score the position block of each AUV's Gramian of the squared range over
    the horizon. It grows with distance: limit the separation, unless the ranging's error grows as
    well or ranges are lost with distance, since they then count the less
    (`formulations.trajectory.share`). When ranges come does not enter it. ``score`` is the weighted
    mean over AUVs of the trace, of -log det, of -log λmin, or of log((κ + 1)²/4κ).

    A stage lasts a whole number of decision intervals, and ends at a multiple of its length. So
    the rest of a trajectory can be followed. The first stage is what is left of the present one.

    Every trajectory ends with a terminal safe set: one of the smallest circles at its end is
    within the geofence and free of keep-outs, so that there is always a path to follow. Limits
    that cannot be kept are softened, and the status says so. It also says which rung of the
    ladder of fallbacks the trajectory is from.

    Separations are kept from where AUVs are expected. A margin covers the uncertainty of their
    positions and how far they may stray in a stage.

    Programs are built before a mission (`prepare`); elsewhere by the first decision, for seconds,
    unless it is prepared for AUVs like those that are to come (`build`). Under a deadline no
    solver is begun that has no time for its iterations: as long as those of the last answer each.

    The warm start is the planner's last trajectory, as long as time goes on. Asked about the same
    time again, about an earlier one, or about one after the trajectory's end, it starts afresh.
    """

    situation: Situation
    _: KW_ONLY
    objective: Annotated[Objective, "what is minimised"] = "covariance"
    horizon: Annotated[
        float,
        "least look-ahead [s]; ``covariance`` looks six pings ahead at least, past silences",
        INTERVAL,
    ] = 20.0
    stages: Annotated[int, "turns over the horizon, at least 2", TURNS] = 12
    max_turn_acceleration: Annotated[
        float | None,
        "largest change of the turn rate [rad/s^2], taken at decisions; default: none",
        TURN_ACCELERATION,
    ] = None
    speed_range: Annotated[
        tuple[Annotated[float, VESSEL_SPEED], Annotated[float, VESSEL_SPEED]] | None,
        "least and greatest speed [m/s]; default: the vehicle's alone",
    ] = None
    max_iterations: Annotated[int, "of each solver", ITERATIONS] = 100
    deadline: Annotated[
        float | None,
        "time a decision may take, about [s]; default: no limit, so that results repeat",
        INTERVAL,
    ] = None

    def __post_init__(self) -> None:
        check_situation(self)
        if (
            self.speed_range is not None
            and not 0 < self.speed_range[0] <= self.speed_range[1] < np.inf
        ):
            raise ValueError(
                "speed_range must be 0 < least <= greatest [m/s], "
                f"got {self.speed_range}: correct it"
            )
        most = self.situation.cna.speed
        if self.speed_range is not None and self.speed_range[1] > most:
            raise ValueError(
                f"speed_range must not exceed the vehicle's speed, {most:g} m/s, "
                f"got {self.speed_range}; lower it, or give the vehicle its true speed"
            )

    @property
    def constraints(self) -> Constraints:
        """The limits it keeps within."""
        return self.situation.constraints

    @property
    def condition_label(self) -> str:
        """What the condition numbers are of."""
        return "" if self.objective == "covariance" else "κ(W)"

    @cached_property
    def _memory(self) -> "dict[str, _Plan]":
        """The last trajectory; no field, since planners with the same options are equal."""
        return {}

    def prepare(self, pose: Pose, progress: Progress) -> None:  # noqa: ARG002 - it is soon done
        """Build the programs before the mission, so that no decision waits for that."""
        built(self, pose)

    def build(self, pose: Pose, auvs: Sequence[Belief]) -> None:
        """Build the programs that AUVs like these need, every solver's, and decide once."""
        if unusable(self.situation.cna, pose, auvs) is not None:
            return
        durations = self._durations(0.0)
        build(
            self._task(pose, auvs, 0.0, durations),
            self.objective,
            limits=self._limits(auvs, durations) if self.constraints else None,
            max_iterations=self.max_iterations,
            timed=self.deadline is not None,
        )
        replace(self, deadline=None).plan(pose, auvs)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose the first turn of the best trajectory."""
        decision = unusable(self.situation.cna, pose, auvs)
        if decision is not None:
            self._memory.clear()
            return decision
        began = perf_counter()
        durations = self._durations(time)
        task = self._task(pose, auvs, time, durations)
        if not all(
            np.isfinite(part).all()
            for part in (task.positions, task.heights, task.covariance, task.process_noise)
        ):
            self._memory.clear()
            return straight_on(self.situation.cna, pose, Status.INVALID_INPUT, len(auvs))
        last = self._memory.pop("plan", None)
        limits = self._limits(auvs, durations) if self.constraints else None
        found = optimise(
            task,
            self.objective,
            limits=limits,
            last=None if last is None else last.shifted(time, durations, self.situation.cna),
            max_iterations=self.max_iterations,
            seconds_left=lambda: (self.deadline or np.inf) - (perf_counter() - began),
        )
        side = float(freer_side(limits.terminal(found.poses[-1:]))[0]) if limits else 0.0
        self._memory["plan"] = _Plan(
            time, time + np.cumsum(durations), found.x[:, 0], found.x[:, 1], side
        )
        return self._decision(found, durations)

    def _decision(self, found: Solution, durations: np.ndarray) -> Decision:
        turn_rate, speed = found.x[0].tolist()
        limit = speed / self.situation.cna.min_turn_radius
        return Decision(
            turn_rate=min(max(turn_rate, -limit), limit),
            speed=speed,
            predict=lambda: found.poses,
            score=found.objective,
            status=found.status,
            condition=found.condition,
            lasting=durations,
        )

    def _durations(self, time: float) -> np.ndarray:
        """Durations [s] of the stages; the first is the rest of the present stage.

        The others last a whole number of decision intervals, and all end at multiples of that.
        """
        horizon = self.horizon
        if self.objective == "covariance":
            least = LEAST_PINGS * self.situation.ping_interval
            horizon = max(horizon, self.situation.schedule.span(time, least))
        interval = self.situation.decision_interval
        length = interval * max(1, round(horizon / self.stages / interval))
        durations = np.full(self.stages, length)
        durations[0] = time_to_next(time, length)
        return durations

    def _task(self, pose: Pose, auvs: Sequence[Belief], time: float, durations: np.ndarray) -> Task:
        cna = self.situation.cna
        ends = np.concatenate([[0.0], np.cumsum(durations)])
        times = np.sort(np.concatenate([ends, ends[:-1] + durations / 2]))
        positions = np.stack([auv.ahead(times) for auv in auvs], axis=1)
        headings, speeds = self._motions(auvs, positions[::2], durations)
        noise = np.array([auv.process_noise for auv in auvs])
        growth = noise[:, 0] + durations[-1] * (speeds.max(axis=0) * noise[:, 1] + noise[:, 2])
        straying = SURE * growth * np.sqrt(durations[-1])
        above = [auv.depth - self.situation.transducer_depth for auv in auvs]
        heights = np.tile(above, (len(times), 1))
        covariance = np.array([auv.horizontal_covariance for auv in auvs])
        weights = np.array([auv.weight for auv in auvs], dtype=float)
        return Task(
            pose=np.array([pose.x, pose.y, pose.heading]),
            turn_rate=pose.turn_rate,
            speed=self.speed_range or (cna.speed, cna.speed),
            min_turn_radius=cna.min_turn_radius,
            durations=durations,
            reach=self._reach(),
            pings=self.situation.schedule.pings(time + ends, len(auvs)),
            positions=positions,
            heights=heights,
            headings=headings,
            speeds=speeds,
            covariance=covariance,
            process_noise=noise[:, [0, 0, 1, 2]],
            spread=np.hypot(margins(auvs), straying),
            weights=weights,
            ranging=self.situation.ranging,
            areas=self._areas,
            least=self.constraints.min_separation,
            greatest=self.constraints.max_separation,
            current=self.situation.current,
        )

    def _motions(
        self, auvs: Sequence[Belief], positions: np.ndarray, durations: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Headings [rad] and speeds through the water [m/s] between positions, stages x AUVs."""
        over_ground = np.diff(positions, axis=0) / durations[:, None, None]
        water = over_ground - np.array([auv.current for auv in auvs])
        speeds = np.hypot(water[..., 0], water[..., 1])
        still = speeds <= ROUNDING * self.situation.cna.speed
        ways = np.arctan2(water[..., 1], water[..., 0])
        return np.where(still, [auv.mean[2] for auv in auvs], ways), speeds

    def _reach(self) -> np.ndarray | None:
        """By how much the turn rate may change at each decision [rad/s]; None: by any amount."""
        if self.max_turn_acceleration is None:
            return None
        largest = self.max_turn_acceleration * self.situation.decision_interval
        return np.full(self.stages, largest)

    @cached_property
    def _areas(self) -> Areas:
        limits = self.constraints
        discs = np.array(
            [[area.x, area.y, area.radius] for area in limits.keep_out if isinstance(area, Disc)],
            dtype=float,
        )
        polygons = [
            np.array(area.points, dtype=float)
            for area in limits.keep_out
            if isinstance(area, Polygon)
        ]
        fence = limits.geofence
        if isinstance(fence, Disc):
            fence = fence.inscribed()
        corners = None if fence is None else np.array(fence.points, dtype=float)
        return convex_areas(discs.reshape(-1, 3), polygons, corners)

    def _limits(self, auvs: Sequence[Belief], durations: np.ndarray) -> PathLimits:
        """The constraints, the AUVs being where they are expected."""
        limits, radius = self.constraints, self.situation.cna.min_turn_radius
        stream, end = self.situation.stream, durations.sum(keepdims=True)

        def terminal(poses: np.ndarray) -> np.ndarray:
            there = stream.over_ground(poses[:, None], end)[:, 0]
            return loiter_violation(limits, there, radius, stream)

        return PathLimits(along=LimitsAhead(self.situation, auvs).along, terminal=terminal)


@lru_cache(maxsize=16)
def built(planner: Trajectory, pose: Pose) -> bool:
    """Build the programs for the surveys as filed, if any, in this process.

    AUVs at rest have other programs than those that move: both are built where both are to come.
    """
    filed = planner.situation.filed
    if filed is None:
        return False
    fastest = filed.speed.max(axis=1)
    for sample in sorted({0, int(fastest.argmin()), int(fastest.argmax())}):
        planner.build(pose, filed.beliefs_at(sample))
    return True


class _Plan(NamedTuple):
    """A trajectory as remembered."""

    time: float  # of the decision [s]
    ends: np.ndarray  # of its stages [s]
    turn_rates: np.ndarray
    speeds: np.ndarray
    # Of the circle that is free at the end: 1 left, -1 right; 0: no limits, the last turn is held.
    side: float

    def shifted(self, time: float, durations: np.ndarray, cna: Unicycle) -> Controls | None:
        """What is left of it on new stages, then the free circle; None if it is not recent."""
        if not self.time < time < self.ends[-1]:
            return None
        middles = time + np.cumsum(durations) - durations / 2
        which = np.searchsorted(self.ends, middles)
        speeds = np.append(self.speeds, self.speeds[-1])
        then = self.side * speeds[-1] / cna.min_turn_radius if self.side else self.turn_rates[-1]
        return Controls(np.append(self.turn_rates, then)[which], speeds[which])
