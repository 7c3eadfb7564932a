"""Planners side by side, over one seed or many (thesis Tables 5.1 and 5.2)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from obsplan.report.tables import breaks, cell

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.table import Table

FIGURES = {
    "rms_error_m": "RMS error [m]",
    "max_error_m": "Worst error [m]",
    "separation_mean_m": "Mean separation [m]",
}
BROKEN_BY = "Limit broken by [m]"
DECADE = 10.0  # ratio of the greatest to the least beyond which an axis is logarithmic
WIDTH, ROW = 10.0, 0.5  # of the figure, of a planner [inch]

# of each mission: planner, seed and the figures of merit over all AUVs
Rows = Sequence[dict[str, Any]]


def compare_table(rows: Rows) -> "Table":
    """Tabulate planners in their order: figures, or medians and quartiles, and limits broken."""
    from rich.table import Table
    from rich.text import Text

    seeds = len({row["seed"] for row in rows})
    what = "" if seeds == 1 else f", median [quartiles] over {seeds} seeds"
    table = Table("Planner", title=Text(f"Localization error{what}"), title_justify="left")
    headings = [*FIGURES.values(), *([BROKEN_BY] if limited(rows) else [])]
    for heading in headings:
        table.add_column(Text(heading), justify="right")
    before = False
    for planner in ranked(rows):
        figures = [spread(values_of(rows, planner, key)) for key in FIGURES]
        if limited(rows):
            figures.append(broken_by(rows, planner))
        if breaks_limits(rows, planner) and not before and table.row_count:
            table.add_section()
        before = breaks_limits(rows, planner)
        table.add_row(Text(planner), *(Text(figure) for figure in figures))
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
    """Planners by their median RMS error, those that broke a limit after all that kept them.

    Of equals the one given first is first.
    """
    return sorted(
        dict.fromkeys(row["planner"] for row in rows),
        key=lambda planner: (
            breaks_limits(rows, planner),
            np.median(values_of(rows, planner, "rms_error_m")),
        ),
    )


def limited(rows: Rows) -> bool:
    """Whether the scenario has limits."""
    return any(row.get("violation_max_m") is not None for row in rows)


def violations_of(rows: Rows, planner: str) -> Float[np.ndarray, " seeds"]:
    """By how much [m] each mission of a planner broke a limit; 0 where it kept them all."""
    worst = [row.get("violation_max_m") for row in rows if row["planner"] == planner]
    return np.array([violation if breaks(violation) else 0.0 for violation in worst], dtype=float)


def breaks_limits(rows: Rows, planner: str) -> bool:
    """Whether a planner broke a limit in any mission."""
    return bool(violations_of(rows, planner).any())


def broken_by(rows: Rows, planner: str) -> str:
    """By how much at most, and in how many missions."""
    violations = violations_of(rows, planner)
    if not violations.any():
        return "kept"
    worst = cell(violations.max(), 2)
    if violations.size == 1:
        return worst
    return f"{worst} (in {np.count_nonzero(violations)} of {violations.size})"


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
    """Draw each mission as a dot, with median and quartiles per planner.

    Planners that broke a limit come last, and they and the missions in which they did so are
    marked. An axis that spans more than a decade is logarithmic.
    """
    from matplotlib.figure import Figure

    from obsplan.report.style import head, name_rows

    planners = ranked(rows)
    count = len(FIGURES) + limited(rows)
    figure = Figure(figsize=(WIDTH, ROW * len(planners) + 1.5), layout="constrained")
    panels = figure.subplots(1, count, sharey=True)
    violations = [violations_of(rows, planner) for planner in planners]
    for axes, (key, label) in zip(panels, FIGURES.items(), strict=False):
        _draw(axes, planners, [values_of(rows, planner, key) for planner in planners], violations)
        axes.set_xlabel(label)
    if limited(rows):
        _draw(panels[-1], planners, violations, violations)
        panels[-1].set_xlabel(BROKEN_BY)
    broke = [bool(one.any()) for one in violations]
    name_rows(panels[0], planners, broke)
    key = ["Dot: one mission; bar: median and quartiles."] if len(rows) > len(planners) else []
    key += ["Open dot, †: broke a limit."] if any(broke) else []
    head(figure, title, " ".join(key))
    return figure


def _draw(
    axes: "Axes",
    planners: Sequence[str],
    samples: Sequence[Float[np.ndarray, " seeds"]],
    violations: Sequence[Float[np.ndarray, " seeds"]],
) -> None:
    """One figure of merit of all planners."""
    from obsplan.report.style import AID, plain_decades, planner_style

    for y, (planner, values, broken) in enumerate(zip(planners, samples, violations, strict=True)):
        paint, marker = planner_style(planner)
        finite = np.isfinite(values)
        seeds = np.count_nonzero(finite)
        offset = np.linspace(-0.22, 0.22, seeds) if seeds > 1 else np.zeros(seeds)
        dot = {"marker": marker, "ls": "", "ms": 5, "zorder": 3}  # apart by seed: none is hidden
        for chosen, look in (
            (broken[finite] == 0, {"mfc": paint, "mec": "white", "mew": 0.4}),
            (broken[finite] > 0, {"mfc": "white", "mec": paint, "mew": 1.0}),
        ):
            if chosen.any():
                axes.plot(values[finite][chosen], y + offset[chosen], **dot, **look)
        if seeds > 1:
            first, median, third = np.quantile(values[finite], [0.25, 0.5, 0.75])
            axes.plot([first, third], [y, y], color=AID, lw=1.2)
            axes.plot(median, y, "|", ms=18, mew=2.0, color=AID)
    everything = np.concatenate(samples)
    everything = everything[np.isfinite(everything)]
    if everything.size and everything.min() > 0 and everything.max() > DECADE * everything.min():
        axes.set_xscale("log")
        plain_decades(axes.xaxis)
    else:
        axes.set_xlim(left=min(0.0, -0.03 * everything.max(initial=0.0)))
