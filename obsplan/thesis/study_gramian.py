"""Open questions about the empirical Gramian method: horizon, time step and aggregate."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

from formulations.gramian.range import DisplacementMoments, gramian_entries
from formulations.metrics import score_expression
from formulations.model.frames import to_body
from formulations.solution import Status
from obsplan.planning.expressions import Command, Targets, decide
from obsplan.planning.fallback import two_thirds_turn
from obsplan.planning.situation import Situation
from obsplan.report.style import colour
from obsplan.scenario import Scenario, load
from obsplan.thesis.drawing import log_ticks, panels
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.montecarlo import fly_grid
from obsplan.thesis.paired import (
    Case,
    Paired,
    by_case,
    compare,
    draw_medians,
    draw_options,
    seeds,
    table,
)
from obsplan.types import Belief, Decision, Pose

if TYPE_CHECKING:
    import xarray as xr

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
THESIS = 2 / 3
PACES = {
    "survey-fast": "aid vehicle 10 times as fast",
    "survey-slow": "aid vehicle as fast as the AUV",
}
AGGREGATES = ("mean", "rms", "max")
WHOSE = {"rms_error": "all AUVs", "worst_auv_rms": "the worst AUV"}
WIDE = (  # the triangle ten metres wide instead of two
    "auv.0.survey.y=5.0",
    "auv.1.survey.x=-5.0",
    "auv.1.survey.y=-5.0",
    "auv.2.survey.x=5.0",
    "auv.2.survey.y=-5.0",
)


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


def compare_horizons(data: "xr.Dataset") -> dict[Case, Paired]:
    """Durations beside the thesis's, and numbers of Euler steps beside the greatest."""
    errors = {}
    for name, label in PACES.items():
        one = data.sel(scenario=name)
        for turns in HORIZONS:
            errors[label, circles(turns)] = one.rms_error.sel(turns=turns).values
        for steps in EULER_STEPS:
            errors[label, euler(steps)] = one.euler_rms_error.sel(euler_steps=steps).values
    finest, thesis = euler(EULER_STEPS[-1]), circles(THESIS)
    return compare(errors, lambda case: (case[0], finest if "Euler" in case[1] else thesis))


def circles(turns: float) -> str:
    """A duration in words."""
    return f"{turns:.2g} circles"


def euler(steps: int) -> str:
    """A number of steps in words."""
    return f"{steps} Euler steps"


def found_horizon(data: "xr.Dataset") -> Finding:
    """What horizon is best, and how fine is fine enough."""
    compared, parts = compare_horizons(data), []
    for label in PACES.values():
        durations = {circles(turns): compared[label, circles(turns)] for turns in HORIZONS}
        medians = {name: np.median(one.errors) for name, one in durations.items()}
        best = min(medians, key=lambda name: medians[name])
        worst = max(medians, key=lambda name: medians[name])
        coarse = [steps for steps in EULER_STEPS if compared[label, euler(steps)].differs]
        enough = min(steps for steps in EULER_STEPS if steps > max(coarse, default=0))
        parts.append(
            f"{label}: {durations[circles(THESIS)].errs} at the thesis's two thirds of a circle; "
            f"at best {durations[best].errs} at {best} ({durations[best].against}), at worst "
            f"{durations[worst].errs} at {worst} ({durations[worst].against}); from {enough} Euler "
            f"steps on no difference from {EULER_STEPS[-1]} can be told"
        )
    return Finding(agrees=None, sentence=f"RMS errors, median [quartiles]. {'; '.join(parts)}.")


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


def compare_aggregates(data: "xr.Dataset") -> dict[Case, Paired]:
    """Root mean square and maximum beside the mean, of all AUVs and of the worst."""
    errors = {}
    for variable, whose in WHOSE.items():
        for case, own in by_case(data[variable], "mission", "aggregate").items():
            errors[*case, whose] = own
    return compare(errors, lambda case: (case[0], "mean", case[2]))


def found_aggregate(data: "xr.Dataset") -> Finding:
    """How much the aggregate matters."""
    compared, parts = compare_aggregates(data), []
    for mission in data.mission.values:
        each = [
            f"{whose}: mean {compared[mission, 'mean', whose].errs}, "
            + ", ".join(
                f"{aggregate} {compared[mission, aggregate, whose].against}"
                for aggregate in AGGREGATES[1:]
            )
            for whose in WHOSE.values()
        ]
        parts.append(f"{mission}, {'; '.join(each)}")
    told = [one for one in compared.values() if one.differs]
    better = sum(one.ratio < 1.0 for one in told)
    return Finding(
        agrees=None,
        sentence=(
            f"Of {2 * len(WHOSE) * data.sizes['mission']} comparisons with the mean, {better} are "
            f"better and {len(told) - better} worse beyond chance; the others cannot be told from "
            f"it. RMS errors, median [quartiles], and ratios to the mean's. {'. '.join(parts)}."
        ),
    )


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
        rows=lambda data: table(("mission", "look-ahead"), compare_horizons(data)),
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
        rows=lambda data: table(("mission", "aggregate", "of"), compare_aggregates(data)),
    ),
)
