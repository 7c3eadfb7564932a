"""Planners side by side, over one seed or many (thesis Tables 5.1 and 5.2)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from obsplan.report.tables import cell

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.table import Table

FIGURES = {
    "rms_error_m": "RMS error [m]",
    "max_error_m": "Worst error [m]",
    "separation_mean_m": "Mean separation [m]",
}
DECADE = 10.0  # ratio of the greatest to the least beyond which an axis is logarithmic
WIDTH, ROW = 10.0, 0.5  # of the figure, of a planner [inch]

Rows = Sequence[
    dict[str, Any]
]  # of each mission: planner, seed and the figures of merit over all AUVs


def compare_table(rows: Rows) -> "Table":
    """Tabulate planners, the best by median RMS error first: the figure itself, or median [first, third quartile] over the seeds."""
    from rich.table import Table
    from rich.text import Text

    seeds = len({row["seed"] for row in rows})
    what = "" if seeds == 1 else f", median [quartiles] over {seeds} seeds"
    table = Table("Planner", title=Text(f"Localization error{what}"), title_justify="left")
    for heading in FIGURES.values():
        table.add_column(Text(heading), justify="right")
    for planner in ranked(rows):
        table.add_row(
            Text(planner), *(Text(spread(values_of(rows, planner, key))) for key in FIGURES)
        )
    return table


def comparison_sentences(rows: Rows) -> list[str]:
    """Say which planner leads, by how much, and whether that could be chance."""
    import pandas as pd

    from obsplan.campaign.statistics import paired
    from obsplan.report.leader import Standing, leader_sentences

    missions = pd.DataFrame(list(rows))
    missions = missions.assign(rms_error_m=missions["rms_error_m"].astype(float))
    labelled = pd.DataFrame({"scenario": ""}, index=missions.index).join(missions)
    pairs = paired(labelled)
    return leader_sentences(Standing(missions=missions, pairs=pairs, comparisons=len(pairs)))


def ranked(rows: Rows) -> list[str]:
    """Planners by their median RMS error; of equals the one given first."""
    return sorted(
        dict.fromkeys(row["planner"] for row in rows),
        key=lambda planner: np.median(values_of(rows, planner, "rms_error_m")),
    )


def values_of(rows: Rows, planner: str, key: str) -> Float[np.ndarray, " seeds"]:
    """One figure of merit of all missions of a planner, inf where the filter failed."""
    return np.array(
        [np.inf if row[key] is None else row[key] for row in rows if row["planner"] == planner],
        dtype=float,
    )


def spread(values: Float[np.ndarray, " seeds"]) -> str:
    """Median and quartiles (by linear interpolation) as text, or how many filters failed."""
    if failed := np.count_nonzero(np.isinf(values)):
        return f"{failed} of {values.size} failed"
    first, median, third = np.quantile(values, [0.25, 0.5, 0.75])
    return (
        cell(median, 2)
        if values.size == 1
        else f"{cell(median, 2)} [{cell(first, 2)}, {cell(third, 2)}]"
    )


def compare_figure(rows: Rows, title: str = "") -> "Figure":
    """Draw each mission as a dot, with median and quartiles per planner; an axis that spans more than a decade is logarithmic."""
    from matplotlib.figure import Figure

    planners = ranked(rows)
    figure = Figure(figsize=(WIDTH, ROW * len(planners) + 1.5), layout="constrained")
    panels = figure.subplots(1, len(FIGURES), sharey=True)
    for axes, (key, label) in zip(panels, FIGURES.items(), strict=True):
        samples = [values_of(rows, planner, key) for planner in planners]
        _draw(axes, [values[np.isfinite(values)] for values in samples])
        axes.set_xlabel(label)
    panels[0].set_yticks(range(len(planners)), planners)
    panels[0].set_ylim(len(planners) - 0.5, -0.5)
    key = "dot: one mission; bar: median and quartiles" if len(rows) > len(planners) else ""
    figure.suptitle(
        ";  ".join(part for part in (title, key) if part), x=0.01, ha="left", fontsize=11
    )
    return figure


def _draw(axes: "Axes", samples: Sequence[Float[np.ndarray, " seeds"]]) -> None:
    """One figure of merit of all planners."""
    from obsplan.report.style import AID, colour, plain_decades

    for y, values in enumerate(samples):
        offset = (
            np.linspace(-0.22, 0.22, values.size) if values.size > 1 else np.zeros(values.size)
        )  # by seed, so that dots do not hide each other
        axes.plot(values, y + offset, "o", ms=4, mfc=colour(y), mec="white", mew=0.4, alpha=0.8)
        if values.size > 1:
            first, median, third = np.quantile(values, [0.25, 0.5, 0.75])
            axes.plot([first, third], [y, y], color=AID, lw=1.2)
            axes.plot(median, y, "|", ms=16, mew=2.0, color=AID)
    everything = np.concatenate(samples)
    if everything.size and everything.min() > 0 and everything.max() > DECADE * everything.min():
        axes.set_xscale("log")
        plain_decades(axes.xaxis)
    else:
        axes.set_xlim(left=0.0)
