"""How planners did over a suite of scenarios, in tables, sentences and a figure."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportReturnType=false
# because pandas is not typed: its columns may be anything

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from obsplan.campaign.statistics import fewest_pairs
from obsplan.campaign.suite import Suite, beyond_chance
from obsplan.constraints import ROUNDING
from obsplan.files import write_atomically
from obsplan.report.tables import cell, violation_cell
from obsplan.report.words import marked, metres, title

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from rich.table import Table

FEWEST = fewest_pairs(1)  # seeds of which a difference can be told from chance
WRITTEN = (  # in a square of the figure
    "ratio",
    "rms_error_m",
    "rms_error_m_low",
    "rms_error_m_high",
    "rms_error_q95_m",
    "ties",
    "broke",
)
SHOWN_WORST = 5.0  # times the best, at which the figure's colours end


def suite_table(suite: Suite) -> "Table":
    """Tabulate planners, the best on the whole first."""
    from rich.table import Table

    n = suite.cells["scenario"].nunique()
    headings = (
        f"Lowest of {n}",
        "Or equal",
        "Mean ratio",
        "Worst ratio",
        "in",
        "Efficiency",
        "Decision [ms]",
        "Limit broken by [m]",
    )
    table = Table(title="RMS error against the best planner of each scenario", title_justify="left")
    add_columns(table, ["Planner", *headings], words=("Planner", "in"))
    for row in suite.planners.itertuples():
        numbers = (
            f"{row.mean_ratio:.2f}",
            f"{row.worst_ratio:.2f}",
            str(row.worst_scenario),
            share(row.efficiency),
        )
        table.add_row(
            marked(str(row.planner), bool(row.broke)),
            str(row.wins),
            str(int(row.ties)),
            *numbers,
            f"{row.decision_ms:.2f}",
            violation_cell(None if np.isnan(row.violation_max_m) else row.violation_max_m),
        )
    return table


def add_columns(table: "Table", headings: Sequence[str], words: Sequence[str]) -> None:
    """Add columns, those of numbers justified to the right; units in brackets are no markup."""
    from rich.text import Text

    for heading in headings:
        table.add_column(Text(heading), justify="left" if heading in words else "right")


def suite_sentences(suite: Suite) -> list[str]:
    """Say who leads on the whole, how often beyond chance and by how much, and who broke limits."""
    first, *others = suite.planners.to_dict("records")
    scenarios = suite.cells["scenario"].nunique()
    said = (
        f"{first['planner']} leads on the whole: lowest median error in {first['wins']} of "
        f"{scenarios} scenarios, in {beyond_chance(suite, first['planner'])} of them beyond chance"
    )
    if others:
        behind = others[0]["mean_ratio"] / first["mean_ratio"]
        said += (
            f"; {others[0]['planner']} comes next, with {behind:.2f} times its error in the mean"
        )
    sentences = [f"{said}."]
    if suite.cells["missions"].min() < FEWEST:
        sentences.append(
            f"With fewer than {FEWEST} seeds (--runs) no difference can be told from chance: "
            "all planners count as equal."
        )
    for row in (first, *others):
        if row["violation_max_m"] > ROUNDING:
            worst = metres(row["violation_max_m"])
            sentences.append(f"{row['planner']} broke a limit, by up to {worst}.")
    return sentences


def scenario_table(suite: Suite) -> "Table":
    """Tabulate by scenario the planner that is best on the whole beside the best of the others."""
    from rich.table import Table

    first = suite.planners["planner"].iloc[0]
    table = Table(title=f"{first}, by scenario", title_justify="left")
    headings = ("Scenario", "RMS [m]", "Best other", "RMS [m]", "Ratio", "p", "Efficiency")
    add_columns(table, headings, words=("Scenario", "Best other"))
    for name, cells in suite.cells.groupby("scenario"):
        own = cells[cells["planner"] == first].iloc[0]
        others = cells[cells["planner"] != first].dropna(subset=["rms_error_m"])
        error = marked(f"{own.rms_error_m:.2f}", bool(own.broke))
        rival = rival_cells(own, others)
        table.add_row(str(name), error, *rival, share(own.efficiency))
    return table


def share(efficiency: float) -> str:
    """An efficiency, or a dash where there is no bound."""
    return cell(None if np.isnan(efficiency) else efficiency, 2)


def rival_cells(own: "pd.Series", others: "pd.DataFrame") -> tuple[str, str, str, str]:
    """The best of the others in a scenario: its name and error, the ratio to it, p."""
    if others.empty:
        return "", "", "", ""
    other = others.sort_values(["broke", "rms_error_m"], kind="stable").iloc[0]
    p = other.p if own.ratio == 1.0 else own.p
    return (
        marked(str(other.planner), bool(other.broke)),
        f"{other.rms_error_m:.2f}",
        f"{own.rms_error_m / other.rms_error_m:.2f}",
        f"{p:.2g}",
    )


def suite_figure(suite: Suite) -> "Figure":
    """Draw every planner in every scenario: its median RMS error, with interval and 95 % quantile.

    The colour says how many times the best the median is.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    from obsplan.report.style import head

    planners = list(suite.planners["planner"])
    scenarios = sorted(suite.cells["scenario"].unique())
    grid = suite.cells.pivot_table(index="scenario", columns="planner", values=[*WRITTEN]).loc[
        scenarios
    ]
    ratio = grid["ratio"][planners].to_numpy(dtype=float)
    width = 2.2 + 1.15 * len(planners)
    height = 1.6 + 0.46 * len(scenarios)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(ratio, norm=LogNorm(1.0, SHOWN_WORST), cmap="YlOrBr", aspect="auto")
    for i, scenario in enumerate(scenarios):
        for j, planner in enumerate(planners):
            square = grid.loc[scenario].xs(planner, level="planner")
            write_error(axes, (j, i), square)
    axes.set_xticks(range(len(planners)), planners, rotation=30, ha="right")
    axes.set_yticks(range(len(scenarios)), [title(scenario) for scenario in scenarios])
    axes.grid(visible=False)
    add_colour_bar(figure, image)
    key = "Median [its 95 % interval], below it the 95 % quantile of missions. "
    key += "Bold: the best, or not distinguishable from it."
    if bool(suite.cells["broke"].any()):
        key += " †: broke a limit."
    head(figure, "Median RMS position error [m]", key)
    return figure


def write_error(axes: "Axes", place: tuple[int, int], square: "pd.Series") -> None:
    """Write a planner's error into its square: bold if it ties, marked if it broke a limit."""
    number = marked(f"{square['rms_error_m']:.2f}", bool(square["broke"] == 1))
    tail = spread_of(square)
    weight = "bold" if square["ties"] == 1 else "normal"
    colour = "white" if square["ratio"] > SHOWN_WORST / 2 else "black"
    axes.text(*place, number, ha="center", va="bottom", fontsize=8, weight=weight, color=colour)
    axes.text(*place, tail, ha="center", va="top", fontsize=6, color=colour)


def spread_of(square: "pd.Series") -> str:
    """A median's interval, as far as there is one, and the 95 % quantile of missions."""
    low, high = square["rms_error_m_low"], square["rms_error_m_high"]
    interval = "" if np.isnan(low) else f"[{low:.2f}, {high:.2f}]\n"
    return f"{interval}{square['rms_error_q95_m']:.2f}"


def add_colour_bar(figure: "Figure", image: "AxesImage") -> None:
    """Say what the colours mean."""
    ticks = [1.0, 1.5, 2.0, 3.0, SHOWN_WORST]
    bar = figure.colorbar(image, label="Times the best [-]", extend="max", ticks=ticks)
    bar.ax.set_yticklabels([f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()


def write_suite(suite: Suite, folder: Path) -> list[str]:
    """Write ``suite.csv``, ``planners.csv`` and ``suite.png`` to a folder; returns their names."""
    from obsplan.report.style import png

    timeless = suite.planners.drop(columns="decision_ms")  # the same bytes on every machine
    write_atomically(folder / "suite.csv", suite.cells.to_csv(index=False, float_format="%.6g"))
    write_atomically(folder / "planners.csv", timeless.to_csv(index=False, float_format="%.6g"))
    write_atomically(folder / "suite.png", png(lambda: suite_figure(suite)))
    return ["suite.csv", "planners.csv", "suite.png"]
