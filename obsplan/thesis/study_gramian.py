"""Open questions about the empirical Gramian method: horizon, time step, aggregate and metric."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from formulations.gramian.range import DisplacementMoments, gramian_entries
from formulations.metrics import score_expression
from formulations.model.frames import to_body
from formulations.solution import Status
from obsplan.planning.expressions import Command, Targets, decide
from obsplan.planning.fallback import two_thirds_turn
from obsplan.planning.situation import Situation
from obsplan.report.style import AID, colour
from obsplan.scenario import Scenario, load
from obsplan.thesis.drawing import log_ticks, panels
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.montecarlo import figure, fly_grid, metres
from obsplan.types import Belief, Decision, Pose

if TYPE_CHECKING:
    import xarray as xr

SHARE = 5  # a fifth of the seeds for each case of a study
SMALL = ("auv.0.survey.legs=3", "auv.0.survey.length=20.0")  # 76 m of survey
# of the smallest circle; the thesis's is two thirds
HORIZONS = (
    1 / 6,
    1 / 3,
    2 / 3,
    1.0,
    2.0,
    4.0,
)
# of the simulated horizon; 21 are of 0.1 s, the time step of these missions
EULER_STEPS = (
    1,
    2,
    5,
    21,
    84,
)
SAME = 0.15  # relative difference of errors that is none
MATTERS = 1.3  # ratio of the greatest to the least error from which a choice matters
PACES = {
    "survey-fast": "aid vehicle 10 times as fast",
    "survey-slow": "aid vehicle as fast as the AUV",
}
AGGREGATES = ("mean", "rms", "max")
METRICS = ("condition-number", "blend", "unobservability-index", "log-det", "trace-inverse")
WIDE = (  # the triangle ten metres wide instead of two
    "auv.0.survey.y=5.0",
    "auv.1.survey.x=-5.0",
    "auv.1.survey.y=-5.0",
    "auv.2.survey.x=5.0",
    "auv.2.survey.y=-5.0",
)


def seeds(runs: int, seed: int) -> range:
    """Seeds of each case of a study."""
    return range(seed, seed + max(2, runs // SHARE))


@dataclass(frozen=True)
class EulerHorizon:
    """Algorithm 1 as one would first write it: Euler steps, and the Gramian is their plain sum."""

    condition_label = "κ(W)"

    situation: Situation
    steps: int
    turn_rates: int = 21

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Take the turn rate of least mean condition number."""
        return decide(self, pose, auvs, time)

    def moments(self) -> DisplacementMoments:
        """Sums, not integrals, of the displacement's powers over the steps, in the body frame."""
        dt = two_thirds_turn(self.situation.cna) / self.steps
        heading = self.candidates[:, None] * np.arange(self.steps) * dt
        # (candidate, step)
        d1, d2 = (
            self.situation.cna.speed * dt * np.cumsum(f(heading), axis=1) for f in (np.cos, np.sin)
        )
        sums = [
            dt * power.sum(axis=1)
            for power in (np.ones_like(d1), d1, d2, d1 * d1, d1 * d2, d2 * d2)
        ]
        # of t^1 and t^2: AUVs at rest need none
        return DisplacementMoments(*(np.stack([total, 0 * total, 0 * total]) for total in sums))

    @property
    def candidates(self) -> np.ndarray:
        """Turn rates tried [rad/s]."""
        return np.linspace(
            self.situation.cna.max_turn_rate, -self.situation.cna.max_turn_rate, self.turn_rates
        )

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002
        """The best candidate."""
        east, north = pose[0] - targets.mean[0, :], pose[1] - targets.mean[1, :]
        c, s = ca.cos(pose[2]), ca.sin(pose[2])
        conditions = score_expression(
            "condition-number",
            gramian_entries(self.moments(), to_body(c, s, east, north)),
        )
        turn_rate, best, chosen = ca.SX(0.0), ca.SX(ca.inf), ca.SX.inf(1, conditions.shape[1])
        for k, candidate in enumerate(self.candidates):
            total = ca.sum2(conditions[k, :]) / conditions.shape[1]
            better = total < best
            turn_rate, best = (
                ca.if_else(better, candidate, turn_rate),
                ca.if_else(better, total, best),
            )
            chosen = ca.if_else(better, conditions[k, :], chosen)
        status = ca.if_else(best < ca.inf, float(Status.OPTIMAL), float(Status.UNOBSERVABLE))
        return Command(turn_rate, ca.SX(self.situation.cna.speed), best, chosen, status)


def small(name: str, *settings: str) -> Scenario:
    """A survey of three short legs under the Gramian method."""
    return load(name, planner="gramian", settings=(*SMALL, *settings))


def compute_horizon(*, runs: int, seed: int) -> "xr.Dataset":
    """Errors by pace and horizon, and by pace and number of Euler steps."""
    numbers, turn = seeds(runs, seed), 1.5 * two_thirds_turn(small("survey-fast").cna)
    lengths = {
        (name, f"{turns:.2f}"): small(name, f"planner.horizon={turns * turn}")
        for name in PACES
        for turns in HORIZONS
    }
    by_length = fly_grid(lengths, ("scenario", "turns"), numbers).assign_coords(
        turns=list(HORIZONS)
    )
    steps = {(name, str(n)): small(name) for name in PACES for n in EULER_STEPS}
    situation = small("survey-fast").situation
    by_steps = fly_grid(
        steps, ("scenario", "euler_steps"), numbers, lambda _, n: EulerHorizon(situation, int(n))
    )
    return by_length.assign(
        euler_rms_error=by_steps.rms_error.assign_coords(euler_steps=list(EULER_STEPS))
    )


def draw_horizon(data: "xr.Dataset") -> Figure:
    """Error over the horizon's length and over its number of steps."""
    figure, axes = panels(2, width=5.0)
    for i, (name, label) in enumerate(PACES.items()):
        draw_medians(
            axes[0], data.turns.values, data.rms_error.sel(scenario=name).values, colour(i), label
        )
        draw_medians(
            axes[1],
            data.euler_steps.values,
            data.euler_rms_error.sel(scenario=name).values,
            colour(i),
            label,
        )
    axes[0].axvline(2 / 3, color="#888888", lw=1.0, ls="--")
    axes[0].set_xlabel("Horizon [smallest circles] (dashed: the thesis's)")
    axes[1].set_xlabel("Euler steps of the horizon [-]")
    for one in axes:
        log_ticks(one, "x")
        log_ticks(one, "y")
        one.set_ylabel("RMS error [m]")
    axes[0].legend(fontsize=8)
    return figure


def draw_medians(axes: Axes, x: np.ndarray, errors: np.ndarray, paint: str, label: str) -> None:
    """Median over the last axis, and quartiles as a band."""
    first, median, third = np.quantile(errors, [0.25, 0.5, 0.75], axis=-1)
    axes.fill_between(x, first, third, color=paint, alpha=0.2, lw=0)
    axes.plot(x, median, "o-", ms=4, lw=1.0, color=paint, label=label)


def found_horizon(data: "xr.Dataset") -> Finding:
    """What horizon is best, and how fine is fine enough."""
    parts = []
    for name, label in PACES.items():
        median = data.rms_error.sel(scenario=name).median("seed").values
        euler = data.euler_rms_error.sel(scenario=name).median("seed").values
        best = int(median.argmin())
        thesis = HORIZONS.index(2 / 3)
        factor = median.max() / median.min()
        coarse = np.flatnonzero(np.abs(euler / euler[-1] - 1.0) > SAME)
        enough = EULER_STEPS[coarse[-1] + 1] if coarse.size else EULER_STEPS[0]
        parts.append(
            f"{label}: the duration "
            f"{'hardly matters' if factor < MATTERS else f'matters by a factor of {factor:.1f}'}, "
            f"{metres(median[best])} at {HORIZONS[best]:.2g} circles, {metres(median[thesis])} at "
            f"the thesis's two thirds, {metres(median.max())} at worst; from {enough} Euler steps "
            f"on, more change nothing ({', '.join(figure(e) for e in euler)} m with "
            f"{', '.join(map(str, EULER_STEPS))})"
        )
    return Finding(agrees=None, sentence=f"Median RMS errors, {'; '.join(parts)}.")


def formations(*settings: str) -> dict[str, Scenario]:
    """Three formations under the Gramian method."""
    return {
        "triangle of 2 m at rest": load("fixed-formation", planner="gramian", settings=settings),
        "triangle of 10 m at rest": load(
            "fixed-formation", planner="gramian", settings=(*WIDE, *settings)
        ),
        "triangle of 2 m under way": load("mobile-formation", planner="gramian", settings=settings),
    }


def compute_aggregate(*, runs: int, seed: int) -> "xr.Dataset":
    """Errors by aggregate and formation."""
    cases = {
        (a, mission): one
        for a in AGGREGATES
        for mission, one in formations(f'planner.aggregate="{a}"').items()
    }
    return fly_grid(cases, ("aggregate", "mission"), seeds(runs, seed))


def draw_options(axes: Axes, data: "xr.Dataset", option: str, variable: str, label: str) -> None:
    """Medians and quartiles of each option, side by side for each mission."""
    values, n = data[variable].transpose("mission", option, "seed").values, data.sizes[option]
    for k, name in enumerate(data[option].values):
        y = np.arange(len(values)) + 0.7 * ((k + 0.5) / n - 0.5)
        first, median, third = np.quantile(values[:, k], [0.25, 0.5, 0.75], axis=-1)
        axes.hlines(y, first, third, color=colour(k), lw=1.5)
        axes.plot(median, y, "o", ms=5, color=colour(k), label=str(name))
    axes.set_yticks(range(len(values)), [str(name) for name in data.mission.values])
    axes.set_ylim(len(values) - 0.5, -0.5)
    axes.set_xlabel(label)
    log_ticks(axes, "x")
    for y in range(1, len(values)):
        axes.axhline(y - 0.5, color=AID, lw=0.4)


def draw_pair(data: "xr.Dataset", option: str, second: tuple[str, str]) -> Figure:
    """RMS error and another figure of merit by option and mission."""
    figure, axes = panels(2, width=5.5)
    draw_options(axes[0], data, option, "rms_error", "RMS error over all AUVs [m]")
    draw_options(axes[1], data, option, *second)
    axes[1].set_yticklabels([])
    axes[1].legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def draw_aggregate(data: "xr.Dataset") -> Figure:
    """Error over all AUVs and of the worst one."""
    return draw_pair(data, "aggregate", ("worst_auv_rms", "RMS error of the worst AUV [m]"))


def found_aggregate(data: "xr.Dataset") -> Finding:
    """How much the aggregate matters."""
    parts = []
    for mission in data.mission.values:
        one = data.sel(mission=mission).median("seed")
        all_, worst = (
            one[name].sel(aggregate=list(AGGREGATES)).values
            for name in ("rms_error", "worst_auv_rms")
        )
        parts.append(
            f"{mission}: RMS {against(all_[1] / all_[0])} mean, maximum "
            f"{against(all_[2] / all_[0])} mean ({', '.join(map(figure, all_))} m over all, "
            f"{', '.join(map(figure, worst))} m for the worst AUV)"
        )
    return Finding(
        agrees=None, sentence=f"Median errors under mean, RMS and maximum. {'; '.join(parts)}."
    )


def against(ratio: float) -> str:
    """How one error compares with another."""
    if abs(ratio - 1.0) < SAME:
        return "as good as the"
    return (
        f"{ratio:.1f} times the error of the" if ratio > 1.0 else f"{1 - ratio:.0%} better than the"
    )


def compute_blend(*, runs: int, seed: int) -> "xr.Dataset":
    """Errors by metric and mission."""
    cases = {}
    for metric in METRICS:
        option = f'planner.metric="{metric}"'
        cases |= {(metric, label): small(name, option) for name, label in PACES.items()}
        cases[metric, "triangle of 2 m under way"] = load(
            "mobile-formation", planner="gramian", settings=(option,)
        )
    return fly_grid(cases, ("metric", "mission"), seeds(runs, seed))


def draw_blend(data: "xr.Dataset") -> Figure:
    """Error and separation."""
    return draw_pair(data, "metric", ("separation", "Mean separation [m]"))


def found_blend(data: "xr.Dataset") -> Finding:
    """Whether the blend is better than either."""
    parts = []
    for mission in data.mission.values:
        one = data.sel(mission=mission, metric=list(METRICS)).median("seed")
        median, away = one.rms_error.values, one.separation.values
        each = ", ".join(
            f"{metric} {figure(m)} m ({figure(d)} m)"
            for metric, m, d in zip(METRICS, median, away, strict=True)
        )
        parts.append(
            f"{mission}: the blend is {against(median[1] / median[0])} condition number and "
            f"{against(median[1] / median[2])} index; least error by "
            f"{METRICS[int(median.argmin())]} ({each})"
        )
    return Finding(agrees=None, sentence=f"Median RMS error (mean separation). {'; '.join(parts)}.")


ITEMS = (
    Item(
        name="study-horizon",
        title="How far and how finely to look ahead",
        claim=(
            "What is the trade-off between the duration of the simulated horizon and its accuracy "
            "(chapter 6)?"
        ),
        compute=compute_horizon,
        draw=draw_horizon,
        found=found_horizon,
    ),
    Item(
        name="study-aggregate",
        title="Mean, root mean square or maximum over AUVs",
        claim=(
            "Would the least RMS or the least maximal condition number serve several AUVs better "
            "than the mean (chapter 6)?"
        ),
        compute=compute_aggregate,
        draw=draw_aggregate,
        found=found_aggregate,
    ),
    Item(
        name="study-blend",
        title="Condition number, unobservability index, or both",
        claim=(
            "Does a combination of the condition number with the unobservability index give "
            "better paths (chapter 6)?"
        ),
        compute=compute_blend,
        draw=draw_blend,
        found=found_blend,
    ),
)
