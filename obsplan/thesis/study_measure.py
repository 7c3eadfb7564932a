"""A rival that the thesis names: the observability measure of a single beacon (section 1.3)."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Annotated

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

from formulations.metrics import relative_motion_index
from formulations.model.arcs import arcs
from formulations.model.frames import to_body
from formulations.solution import Status
from obsplan.planning.candidates import first_of_the_best
from obsplan.planning.checks import check_situation
from obsplan.planning.expressions import Command, Targets, decide
from obsplan.planning.fallback import two_thirds_turn
from obsplan.planning.situation import Situation
from obsplan.quantities import CANDIDATES, INTERVAL
from obsplan.scenario import Scenario, load
from obsplan.thesis.drawing import panels
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.montecarlo import fly_grid, metres
from obsplan.thesis.paired import Case, Paired, by_case, compare, draw_options, seeds, table
from obsplan.thesis.study_gramian import PACES, SMALL
from obsplan.types import Belief, Decision, Pose

if TYPE_CHECKING:
    import xarray as xr

INSTANTS = 16  # of the horizon at which the index is taken
ROUNDING = 1e-14  # of the index
DEFAULT = "default planner"
RIVAL = "index of relative motion"
PLANNERS = {  # and their settings
    RIVAL: ("obsplan.thesis.study_measure:RelativeMotion",),
    "Gramian, condition number": ("gramian",),
    "Gramian, unobservability index": ("gramian", 'planner.metric="unobservability-index"'),
    DEFAULT: ("information",),
    "default planner, its filter": ("information", "estimator.hypotheses=24"),
}
INTERVALS = ("planner.interval=1.0", "ranging.interval=1.0")  # [s]


@dataclass(frozen=True)
class RelativeMotion:
    """Hold the candidate turn rate with the greatest mean index of relative motion.

    The index (`formulations.relative_motion_index`, after Arrichiello et al. 2011, in all
    likelihood the thesis's reference [14]) is averaged over the horizon, two thirds of the smallest
    circle unless given, and over AUVs by their weights; AUVs keep their velocities. ``score`` is
    one minus that, from 0, the best, to 1.
    """

    condition_label = "1 / index"

    situation: Situation
    _: KW_ONLY
    turn_rates: Annotated[int, "number of candidates", CANDIDATES] = 21
    horizon: Annotated[
        float | None, "look-ahead [s]; default: two thirds of the smallest circle", INTERVAL
    ] = None
    time_scale: Annotated[float, "in which a velocity counts as a length [s]", INTERVAL] = 1.0

    def __post_init__(self) -> None:
        check_situation(self)

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Choose the best candidate."""
        return decide(self, pose, auvs, time)

    @property
    def candidates(self) -> np.ndarray:
        """Turn rates tried [rad/s], from the left limit to the right one."""
        limit = self.situation.cna.max_turn_rate
        return np.linspace(limit, -limit, self.turn_rates)

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:  # noqa: ARG002
        """The best candidate."""
        indices = [self._index(pose, targets, auv) for auv in range(targets.mean.shape[1])]
        each = ca.horzcat(*indices)
        totals = 1.0 - each @ (targets.weight / ca.sum1(targets.weight))
        choose, doubt = first_of_the_best(self.turn_rates), ca.DM.ones(self.turn_rates) * ROUNDING
        best, turn_rate = choose(totals, self.candidates, 0.0, doubt)
        condition = [choose(totals, 1.0 / index, ca.inf, doubt)[1] for index in indices]
        status = ca.if_else(best < ca.inf, float(Status.OPTIMAL), float(Status.UNOBSERVABLE))
        speed = ca.SX(self.situation.cna.speed)
        return Command(turn_rate, speed, best, ca.horzcat(*condition), status)

    def _index(self, pose: ca.SX, targets: Targets, auv: int) -> ca.SX:
        """Mean index of an AUV over the horizon, for each candidate (K)."""
        cna, c, s = self.situation.cna, ca.cos(pose[2]), ca.sin(pose[2])
        horizon = self.horizon or two_thirds_turn(cna)
        times = horizon * (np.arange(INSTANTS) + 1.0) / INSTANTS
        ahead = arcs(np.zeros((self.turn_rates, 3)), self.candidates, cna.speed, times)
        own = [cna.speed * direction(ahead[..., 2]) for direction in (np.cos, np.sin)]
        mean, velocity = targets.mean[:, auv], targets.velocity[:, auv]
        start = to_body(c, s, pose[0] - mean[0], pose[1] - mean[1])
        v = to_body(c, s, velocity[0], velocity[1])
        elapsed = ca.repmat(ca.DM(times).T, self.turn_rates, 1)
        position = [start[i] + ca.DM(ahead[..., i]) - v[i] * elapsed for i in range(2)]
        relative = [ca.DM(own[i]) - v[i] for i in range(2)]
        index = relative_motion_index(
            (position[0], position[1]), (relative[0], relative[1]), self.time_scale
        )
        return ca.sum2(index) / INSTANTS


def survey(name: str, planner: str, *settings: str) -> Scenario:
    """A survey of three short legs, decided and ranged once a second."""
    return load(name, planner=planner, settings=(*SMALL, *INTERVALS, *settings))


def compute(*, runs: int, seed: int) -> "xr.Dataset":
    """Errors by planner and survey."""
    cases = {
        (label, mission): survey(name, *planner)
        for label, planner in PLANNERS.items()
        for name, mission in PACES.items()
    }
    return fly_grid(cases, ("planner", "mission"), seeds(runs, seed))


def compare_planners(data: "xr.Dataset") -> dict[Case, Paired]:
    """Every planner beside the default one."""
    errors = by_case(data.rms_error, "mission", "planner")
    return compare(errors, lambda case: (case[0], DEFAULT))


def draw(data: "xr.Dataset") -> Figure:
    """Errors and separations by planner."""
    figure, axes = panels(2, width=5.0)
    draw_options(axes[0], data, "planner", "rms_error", "RMS error [m]")
    axes[0].set_yticklabels([str(name).replace(" as ", "\nas ") for name in data.mission.values])
    draw_options(axes[1], data, "planner", "separation", "Mean separation [m]")
    axes[1].set_yticklabels([])
    axes[1].legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def found(data: "xr.Dataset") -> Finding:
    """How the rival does."""
    compared, parts = compare_planners(data), []
    for mission in data.mission.values:
        away = data.separation.sel(planner=RIVAL, mission=mission).median("seed")
        others = [
            f"{label} {compared[mission, label].errs} ({compared[mission, label].against})"
            for label in PLANNERS
        ]
        parts.append(f"{mission}: {'; '.join(others)}; the rival stays {metres(float(away))} away")
    return Finding(
        agrees=None,
        sentence=(
            "RMS errors, median [quartiles], and ratios to the default planner's seed by seed. "
            f"{'. '.join(parts)}. The surveys' filter follows one position, as the thesis's does; "
            "the last planner's is obsplan's default, which follows several while ranges leave "
            "them. A learned policy, the thesis's [18], is not compared: it would be trained on "
            "one fleet and noise; one of your own flies as any other planner."
        ),
    )


ITEMS = (
    Item(
        name="study-measure",
        title="The observability measure of a single beacon as an objective",
        claim=(
            "A measure of observability specific to a single beacon [14] was not used to generate "
            "paths (section 1.3). Which paths does it generate?"
        ),
        compute=compute,
        draw=draw,
        found=found,
        rows=lambda data: table(("mission", "planner"), compare_planners(data)),
    ),
)
