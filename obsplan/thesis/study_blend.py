"""Open question: the condition number, the unobservability index, or a blend of both."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsplan.report.style import FAINT, colour
from obsplan.scenario import Scenario, load
from obsplan.thesis.drawing import log_ticks, panels
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
from obsplan.thesis.study_gramian import PACES, small

if TYPE_CHECKING:
    import xarray as xr

CONDITION, INDEX = "condition-number", "unobservability-index"
METRICS = (CONDITION, INDEX, "log-det", "trace-inverse")
# of the index's logarithm beside the condition number's, which alone is weight 0; none of the
# condition number: the index alone
WEIGHTS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
TRIANGLE = "triangle of 2 m under way"


def missions(*settings: str) -> dict[str, Scenario]:
    """Surveys at both paces, and a formation, under the Gramian method."""
    surveys = {label: small(name, *settings) for name, label in PACES.items()}
    formation = load("mobile-formation", planner="gramian", settings=settings)
    return surveys | {TRIANGLE: formation}


def blended(weight: float) -> str:
    """A blend's name."""
    return f"blend, weight {weight:g}"


def options() -> dict[str, tuple[str, ...]]:
    """Metrics and blends: their settings."""
    metrics = {metric: (f'planner.metric="{metric}"',) for metric in METRICS}
    blends = {
        blended(weight): ('planner.metric="blend"', f"planner.blend_weight={weight}")
        for weight in WEIGHTS
    }
    return metrics | blends


def compute(*, runs: int, seed: int) -> "xr.Dataset":
    """Errors by metric and mission."""
    cases = {
        (metric, mission): one
        for metric, settings in options().items()
        for mission, one in missions(*settings).items()
    }
    return fly_grid(cases, ("metric", "mission"), seeds(runs, seed))


def compare_metrics(data: "xr.Dataset") -> dict[Case, Paired]:
    """Every metric and every blend beside the condition number.

    Which metric, and which weight, are two questions: p are corrected for each by itself.
    """
    blends = [blended(weight) for weight in WEIGHTS]
    compared: dict[Case, Paired] = {}
    for names in (list(METRICS), [CONDITION, *blends]):
        errors = by_case(data.rms_error.sel(metric=names), "mission", "metric")
        compared |= compare(errors, lambda case: (case[0], CONDITION))
    return dict(sorted(compared.items(), key=lambda one: one[0][0]))


def draw(data: "xr.Dataset") -> Figure:
    """Errors over the blend's weight, and metrics beside each other."""
    figure, axes = panels(3, width=4.4)
    for k, mission in enumerate(data.mission.values):
        _draw_curve(axes[0], data.sel(mission=mission), colour(k))
    axes[0].set(
        xlabel="Weight of the index in the blend [-]\n"
        "(left of it the condition number alone, right the index)",
        ylabel="RMS error [m]",
    )
    axes[0].legend(fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    log_ticks(axes[0], "y")
    alone = data.sel(metric=list(METRICS))
    draw_options(axes[1], alone, "metric", "rms_error", "RMS error [m]")
    axes[1].set_yticklabels([str(name).replace(" as ", "\nas ") for name in data.mission.values])
    draw_options(axes[2], alone, "metric", "separation", "Mean separation [m]")
    axes[2].set_yticklabels([])
    axes[2].legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _draw_curve(axes: Axes, data: "xr.Dataset", paint: str) -> None:
    """Errors of a mission over the weight; of either metric alone beside the curve's ends."""
    names = [blended(weight) for weight in WEIGHTS]
    errors = data.rms_error.sel(metric=names).transpose("metric", "seed").values
    draw_medians(axes, np.array(WEIGHTS), errors, paint, str(data.mission.values))
    for metric, at in ((CONDITION, WEIGHTS[0] / 4), (INDEX, WEIGHTS[-1] * 4)):
        first, median, third = np.quantile(data.rms_error.sel(metric=metric), QUARTILES)
        axes.vlines(at, first, third, color=paint, lw=3.0, alpha=0.3)
        axes.plot(at, median, "_", ms=12, mew=2.0, color=paint)
    log_ticks(axes, "x")
    axes.set_xticks(WEIGHTS, [f"{weight:g}" for weight in WEIGHTS])
    for end in (WEIGHTS[0] / 2, WEIGHTS[-1] * 2):
        axes.axvline(end, color=FAINT, lw=0.6)


def found(data: "xr.Dataset") -> Finding:
    """What the index alone gains, and whether any blend of both is better than it."""
    compared = compare_metrics(data)
    parts = []
    for mission in data.mission.values:
        condition, index = compared[mission, CONDITION], compared[mission, INDEX]
        medians = {name: np.median(compared[mission, name].errors) for name in options()}
        blends = {blended(weight): medians[blended(weight)] for weight in WEIGHTS}
        best = min(blends, key=lambda name: blends[name])
        least = min(medians, key=lambda name: medians[name])
        parts.append(
            f"{mission}: {index.errs} by the index, {condition.errs} by the condition number "
            f"({index.against}); the best blend, {best}, {figure(blends[best])} m, that of weight "
            f"1 {figure(blends[blended(1.0)])} m; least of all by {least}, "
            f"{figure(medians[least])} m"
        )
    return Finding(agrees=None, sentence=f"{headline(compared)} {'. '.join(parts)}.")


def headline(compared: dict[Case, Paired]) -> str:
    """What the index alone gains in the surveys."""
    surveys = [compared[mission, INDEX] for mission in PACES.values()]
    if not all(one.differs and one.ratio < 1.0 for one in surveys):
        return "With these seeds the index alone is not better than the condition number in both."
    gains = sorted(1.0 / one.ratio for one in surveys)
    return (
        f"The unobservability index alone errs {gains[0]:.1f} to {gains[1]:.1f} times less in the "
        "surveys than the condition number. RMS errors, median [quartiles], and ratios seed by "
        "seed."
    )


ITEMS = (
    Item(
        name="study-blend",
        title="The unobservability index alone beats the condition number in surveys",
        claim=(
            "Does a combination of the condition number with the unobservability index give "
            "better paths (chapter 6)?"
        ),
        compute=compute,
        draw=draw,
        found=found,
        rows=lambda data: table(("mission", "metric"), compare_metrics(data)),
    ),
)
