"""Open questions about path inertia: unequal and dynamic weights, and the condition number."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

from obsplan.planners.path_inertia import PathInertia
from obsplan.planning.expressions import Command, Targets, decide
from obsplan.planning.situation import Situation
from obsplan.report.style import AID, colour
from obsplan.scenario import Scenario, load
from obsplan.thesis.drawing import draw_tracks, log_ticks, panels
from obsplan.thesis.flights import fly, pose, scenario
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.montecarlo import figure, fly_grid
from obsplan.thesis.paired import (
    QUARTILES,
    Case,
    Paired,
    by_case,
    compare,
    draw_medians,
    draw_options,
    seeds,
    table,
)
from obsplan.thesis.study_gramian import PACES, SMALL, WIDE
from obsplan.types import Belief, Decision, Pose

if TYPE_CHECKING:
    import xarray as xr

EQUAL = 1 / 3
# share of the AUV that is hard to localize
WEIGHTS = (0.0, 0.2, EQUAL, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 1.0)
DYNAMIC = "dynamic weights"
TAILS = 2  # times the seeds of other studies: few missions are lost
LOST = 2.0  # RMS error [m] of the worst AUV from which a mission is lost
STRAYS = (  # the first AUV strays ten times as much as the others
    "duration=300.0",
    *(f"auv.{i}.process_noise.position={0.3 if i == 0 else 0.03}" for i in range(3)),
    "ranging.interval=1.0",
)
RULES = {  # of path inertia: its options
    "difference, γ = 0": ("planner.gamma=0.0",),
    "difference, γ = 1": ("planner.gamma=1.0",),
    "condition number": ('planner.objective="condition-number"',),
}
OUTWARD = (1.0, 0.0, 45.0)  # the obtuse start of Figure 5.2 [m, m, degrees]


@dataclass(frozen=True)
class CovarianceWeighted:
    """A planner whose weights are the traces of the position covariances that AUVs report."""

    condition_label = "κ(J)"

    situation: Situation
    planner: PathInertia

    def plan(self, pose: Pose, auvs: Sequence[Belief], *, time: float = 0.0) -> Decision:
        """Decide with the weights of this moment."""
        return decide(self, pose, auvs, time)

    def expression(self, time: ca.SX, pose: ca.SX, targets: Targets) -> Command:
        """The planner's expression under the weights of this moment."""
        variance = targets.position_covariance[0, :] + targets.position_covariance[2, :]
        return self.planner.closed_form(time, pose, targets._replace(weight=variance.T))


def strayed(*settings: str) -> Scenario:
    """The wide triangle at rest, of which one AUV strays more."""
    return load(
        "fixed-formation",
        planner="path-inertia",
        settings=(*WIDE, *STRAYS, 'planner.knowledge="estimate"', *settings),
    )


def compute_weights(*, runs: int, seed: int) -> "xr.Dataset":
    """Errors by the straying AUV's share of the weight, and with weights by the covariances."""
    numbers, one = seeds(TAILS * runs, seed), strayed()
    cases = {}
    for share in WEIGHTS:
        others = (1 - share) / 2
        weights = (share, others, others)
        settings = [f"auv.{i}.weight={weight}" for i, weight in enumerate(weights)]
        cases[(f"{share:.2f}",)] = strayed(*settings)
    static = fly_grid(cases, ("share",), numbers).assign_coords(share=list(WEIGHTS))
    planner = CovarianceWeighted(one.situation, PathInertia(one.situation, gamma=1.0))
    dynamic = fly_grid({("dynamic",): one}, ("weights",), numbers, lambda _: planner).isel(
        weights=0, drop=True
    )
    return static.assign(
        {f"dynamic_{name}": dynamic[name] for name in ("rms_error", "worst_auv_rms")}
    )


def draw_weights(data: "xr.Dataset") -> Figure:
    """Errors over the weight's share, and of the dynamic weights."""
    figure, axes = panels(2, width=5.0)
    for one, name, label in zip(
        axes, ("rms_error", "worst_auv_rms"), ("over all AUVs", "of the worst AUV"), strict=True
    ):
        draw_medians(one, data.share.values, data[name].values, colour(0), "fixed weights")
        first, median, third = np.quantile(data[f"dynamic_{name}"], QUARTILES)
        one.axhspan(first, third, color=colour(1), alpha=0.2, lw=0)
        one.axhline(median, color=colour(1), lw=1.2, label="weights following the covariances")
        one.axvline(EQUAL, color="#888888", lw=1.0, ls="--")
        one.set(
            xlabel="Weight of the AUV that strays most (dashed: equal)",
            ylabel=f"RMS error {label} [m]",
        )
        log_ticks(one, "y")
    axes[0].legend(fontsize=8)
    return figure


def compare_weights(data: "xr.Dataset") -> dict[Case, Paired]:
    """Fixed shares and dynamic weights beside equal ones."""
    errors = {
        (share_of(share),): data.rms_error.sel(share=share).values for share in data.share.values
    }
    errors[(DYNAMIC,)] = data.dynamic_rms_error.values
    return compare(errors, lambda _: (share_of(EQUAL),))


def weight_rows(data: "xr.Dataset") -> list[list[str]]:
    """Errors, ratios and missions lost by weights."""
    heading, *rows = table(("weights",), compare_weights(data))
    missing, n = lost(data), data.sizes["seed"]
    counted = [[*row, f"{missing[row[0]]} of {n}"] for row in rows]
    return [[*heading, f"worst AUV beyond {LOST:g} m"], *counted]


def share_of(share: float) -> str:
    """A share in words."""
    return "equal weights" if share == EQUAL else f"share {share:.2g}"


def lost(data: "xr.Dataset") -> dict[str, int]:
    """In how many missions the worst AUV errs by more than `LOST`, by weights."""
    errors = {share_of(s): data.worst_auv_rms.sel(share=s).values for s in data.share.values}
    errors[DYNAMIC] = data.dynamic_worst_auv_rms.values
    return {weights: int(np.sum(own > LOST)) for weights, own in errors.items()}


def recommended(data: "xr.Dataset") -> str:
    """The fixed share under which the error that 95 % of the missions keep within is least."""
    from obsplan.campaign.statistics import tail

    tails = tail(data.rms_error.transpose("share", "seed").values)
    return share_of(float(data.share.values[tails.argmin()]))


def found_weights(data: "xr.Dataset") -> Finding:
    """What fixed and dynamic weights gain, and at which risk."""
    compared, missing, seeds_flown = compare_weights(data), lost(data), data.sizes["seed"]
    take, dynamic = recommended(data), compared[(DYNAMIC,)]
    gains = dynamic.differs and dynamic.ratio < 1.0
    risky = [
        f"{weights} loses {missing[weights]} of {seeds_flown}"
        for weights in missing
        if missing[weights] > missing[take] and weights not in (DYNAMIC, share_of(EQUAL))
    ]
    gained = (
        f"{compared[(take,)].errs} ({compared[(take,)].against}) against "
        f"{compared[(share_of(EQUAL),)].errs} with equal weights; weights following the "
        f"covariances {dynamic.errs} ({dynamic.against})"
    )
    risked = ", ".join(
        [
            f"{take} loses {missing[take]} of {seeds_flown}",
            f"equal weights {missing[share_of(EQUAL)]}",
            f"dynamic ones {missing[DYNAMIC]}",
            *risky,
        ]
    )
    return Finding(
        agrees=None,
        sentence=(
            "One of three AUVs at rest strays ten times as much as the others. Unequal weights "
            f"help, dynamic ones {'do, too' if gains else 'gain nothing'}. Recommended: {take} "
            "for it, of which the worst missions are best. RMS errors, median [quartiles]: "
            f"{gained}. A mission is lost where the worst AUV errs by more than {LOST:g} m: "
            f"{risked}. Path inertia sees the AUVs only through their weighted centroid: weights "
            "move the centre of the same orbit."
        ),
    )


def compute_curvature(*, runs: int, seed: int) -> "xr.Dataset":
    """Paths from one start under each rule, and errors by rule and mission."""
    import xarray as xr

    flown = [
        fly(scenario("fixed-auv", "path-inertia", "duration=40.0", *options), [pose(*OUTWARD)])
        for options in RULES.values()
    ]
    cases = {
        (rule, label): load(name, planner="path-inertia", settings=(*SMALL, *options))
        for rule, options in RULES.items()
        for name, label in PACES.items()
    }
    errors = fly_grid(cases, ("rule", "mission"), seeds(runs, seed))[["rms_error", "separation"]]
    paths = xr.concat(flown, dim=xr.DataArray(list(RULES), dims="rule", name="rule"))
    return xr.merge([paths, errors], combine_attrs="override")


def spiral(data: "xr.Dataset") -> np.ndarray:
    """The logarithmic spiral's distance, d(t) = d0 + V cos(θ0) t.

    It is the limit of short steps where the condition number is minimised.
    """
    x, y, heading = OUTWARD[0], OUTWARD[1], np.deg2rad(OUTWARD[2])
    away = np.hypot(x, y)
    return away + data.speed * (np.cos(heading) * x + np.sin(heading) * y) / away * data.time.values


def draw_curvature(data: "xr.Dataset") -> Figure:
    """Paths, distances and condition numbers from one start; errors in surveys."""
    figure, axes = panels(4, width=3.6, height=3.4)
    for k, rule in enumerate(data.rule.values):
        one = data.sel(rule=rule)
        draw_tracks(axes[0], one, [colour(k)])
        axes[1].plot(data.time, one.distance[0, 0], color=colour(k), lw=1.0, label=str(rule))
        axes[2].plot(data.time[:-1], one.condition[0, 0, :-1], color=colour(k), lw=1.0)
    axes[1].plot(data.time, spiral(data), color=AID, lw=0.8, ls="--", label="logarithmic spiral")
    axes[1].set(xlabel="Time [s]", ylabel="Distance [m]")
    axes[1].legend(fontsize=7)
    axes[2].set(xlabel="Time [s]", ylabel="Predicted condition number κ(J) [-]")
    draw_options(axes[3], data, "rule", "rms_error", "RMS error in the survey [m]")
    axes[3].set_yticks([0, 1], ["10 times\nas fast", "as fast"])
    return figure


def compare_rules(data: "xr.Dataset") -> dict[Case, Paired]:
    """Every rule beside the thesis's with its penalty."""
    reference = list(RULES)[1]
    return compare(by_case(data.rms_error, "mission", "rule"), lambda case: (case[0], reference))


def found_curvature(data: "xr.Dataset") -> Finding:
    """What minimising κ itself does."""
    last, mean = [], []
    for rule in data.rule.values:
        one = data.sel(rule=rule)
        last.append(float(one.distance[0, 0, -1]))
        mean.append(float(one.condition[0, 0, :-1].mean()))
    off = float(np.abs(data.distance.sel(rule="condition number")[0, 0] - spiral(data)).max())
    compared, parts = compare_rules(data), []
    for mission in data.mission.values:
        away = data.separation.sel(mission=mission).median("seed")
        each = [
            f"{rule} {compared[mission, rule].errs} at {figure(float(away.sel(rule=rule)))} m "
            f"({compared[mission, rule].against})"
            for rule in RULES
        ]
        parts.append(f"{mission}: {', '.join(each)}")
    return Finding(
        agrees=None,
        sentence=(
            "From an obtuse start it holds the angle to the line of sight: a logarithmic spiral, "
            f"whose distance grows in proportion to time (to {off:.2f} m), {last[2]:.0f} m after "
            f"{data.time[-1]:.0f} s where the difference of eigenvalues leads to {last[0]:.0f} m "
            f"and with γ = 1 to {last[1]:.1f} m; its κ(J), the least at each instant, averages "
            f"{mean[2]:.2f} over its own path, theirs {mean[0]:.2f} and {mean[1]:.2f}. In "
            f"surveys, RMS error, median [quartiles], at the mean separation: {'; '.join(parts)}."
        ),
    )


ITEMS = (
    Item(
        name="study-weights",
        title="Unequal and dynamic weights",
        claim=(
            "Is there use in unequal weights of several AUVs, or in weights that change over time "
            "(chapter 6)?"
        ),
        compute=compute_weights,
        draw=draw_weights,
        found=found_weights,
        rows=weight_rows,
    ),
    Item(
        name="study-curvature",
        title="The condition number itself",
        claim=(
            "What does minimising the condition number itself do that minimising the difference "
            "of eigenvalues, as in (3.20), does not?"
        ),
        compute=compute_curvature,
        draw=draw_curvature,
        found=found_curvature,
        rows=lambda data: table(("mission", "rule"), compare_rules(data)),
    ),
)
