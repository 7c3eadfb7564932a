"""Figures of a campaign: planners, errors against what was varied, and maps over two keys."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportGeneralTypeIssues=false
# because pandas is not typed: its columns may be anything

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from obsplan.campaign.statistics import medians, varied_keys, worded
from obsplan.report.style import AID, colour, plain_decades

if TYPE_CHECKING:
    import pandas as pd

ERROR, LABEL = "rms_error_m", "RMS error [m]"
DECADE = 10.0  # ratio of the greatest to the least beyond which an axis is logarithmic
WIDTH, ROW, PANEL = 8.0, 0.5, 3.2  # of a figure, of a planner's line, of a panel [inch]
RANGE = (0.05, 0.95)  # of the missions, between which the bar lies
MOST_NUMBERS = 100  # of fields in a map, for each to be labelled


def planners_figure(table: "pd.DataFrame") -> Figure:
    """Draw each planner's errors, per scenario: median with its interval, and where most missions lie."""
    scenarios, planners = names(table, "scenario"), names(table, "planner")
    height = len(scenarios) * (ROW * len(planners) + 0.9) + 0.5
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    panels = figure.subplots(len(scenarios), 1, squeeze=False)[:, 0]
    summary = medians(table, ["scenario", "planner"]).set_index(["scenario", "planner"])
    for axes, scenario in zip(panels, scenarios, strict=True):
        here = table[table["scenario"] == scenario]
        for y, planner in enumerate(planners):
            errors = here.loc[here["planner"] == planner, ERROR].dropna()
            if errors.size:
                row = summary.loc[(scenario, planner)]
                axes.plot(
                    errors.quantile(RANGE),
                    [y, y],
                    color=colour(y),
                    lw=7,
                    alpha=0.3,
                    solid_capstyle="butt",
                )
                axes.plot([row[f"{ERROR}_low"], row[f"{ERROR}_high"]], [y, y], color=AID, lw=1.6)
                axes.plot(row[ERROR], y, "o", color=colour(y), ms=6, mec="white", mew=0.6)
        axes.set_yticks(range(len(planners)), planners)
        axes.set_ylim(len(planners) - 0.5, -0.5)
        axes.set_title(scenario)
        axes.set_xlabel(LABEL)
        scaled(axes.xaxis, here[ERROR].quantile(RANGE).to_numpy())
    pooled = together([key for key in varied_keys(table) if table[key].nunique() > 1])
    figure.suptitle(
        f"Dot and line: median and its 95 % interval; bar: 5th to 95th percentile{pooled}",
        x=0.01,
        ha="left",
        fontsize=9,
    )
    return figure


def key_figure(table: "pd.DataFrame", key: str, pooled: Sequence[str] = ()) -> Figure:
    """Draw the median error against a varied key, a line per planner and a panel per scenario; other keys are pooled."""
    scenarios, planners = names(table, "scenario"), names(table, "planner")
    figure = Figure(figsize=(WIDTH, PANEL * len(scenarios) + 0.4), layout="constrained")
    panels = figure.subplots(len(scenarios), 1, squeeze=False)[:, 0]
    values = sorted(table[key].dropna().unique())
    summary = medians(table, ["scenario", "planner", key])
    numeric = not isinstance(values[0], str)
    for axes, scenario in zip(panels, scenarios, strict=True):
        here = summary[summary["scenario"] == scenario].dropna(subset=[key, ERROR])
        for i, planner in enumerate(planners):
            line = here[here["planner"] == planner]
            x = (
                line[key].to_numpy(dtype=float)
                if numeric
                else np.array([values.index(value) for value in line[key]], dtype=float)
            )
            axes.fill_between(
                x, line[f"{ERROR}_low"], line[f"{ERROR}_high"], color=colour(i), alpha=0.2, lw=0
            )
            axes.plot(x, line[ERROR], "o-", color=colour(i), ms=4, lw=1.2, label=planner)
        if numeric:
            scaled(axes.xaxis, np.array(values, dtype=float), from_zero=False)
        else:
            axes.set_xticks(range(len(values)), values)
        scaled(axes.yaxis, here[ERROR].to_numpy())
        axes.set_title(scenario)
        axes.set_xlabel(key)
        axes.set_ylabel(f"Median {LABEL}")
        axes.legend(fontsize=8)
    figure.suptitle(
        f"Median and its 95 % interval{together(pooled)}", x=0.01, ha="left", fontsize=9
    )
    return figure


def map_figure(table: "pd.DataFrame", keys: tuple[str, str], pooled: Sequence[str] = ()) -> Figure:
    """Draw one scenario's median error over two varied keys, a panel per planner on one colour scale; other keys are pooled."""
    planners = names(table, "planner")
    grids = {
        planner: table[table["planner"] == planner].pivot_table(
            index=keys[1], columns=keys[0], values=ERROR, aggfunc="median"
        )
        for planner in planners
    }
    figure = Figure(figsize=(WIDTH, PANEL * len(grids) + 0.4), layout="constrained")
    panels = figure.subplots(len(grids), 1, squeeze=False)[:, 0]
    norm = norm_of(np.concatenate([grid.to_numpy().ravel() for grid in grids.values()]))
    for axes, (planner, grid) in zip(panels, grids.items(), strict=True):
        mesh = axes.pcolormesh(grid.to_numpy(), norm=norm, cmap="viridis")
        axes.grid(False)
        axes.set_xticks(np.arange(grid.shape[1]) + 0.5, [worded(value) for value in grid.columns])
        axes.set_yticks(np.arange(grid.shape[0]) + 0.5, [worded(value) for value in grid.index])
        axes.set_xlabel(keys[0])
        axes.set_ylabel(keys[1])
        axes.set_title(planner)
        if grid.size <= MOST_NUMBERS:
            write_numbers(axes, grid.to_numpy(), norm)
        figure.colorbar(mesh, ax=axes, label=f"Median {LABEL}")
    figure.suptitle(f"{table['scenario'].iloc[0]}{together(pooled)}", x=0.01, ha="left", fontsize=9)
    return figure


def write_numbers(axes: Axes, grid: np.ndarray, norm: Normalize) -> None:
    """Write the medians into their fields, light on dark."""
    dark = 0.6  # of the colour map, below which white is read better
    for (row, column), value in np.ndenumerate(grid):
        if np.isfinite(value):
            axes.text(
                column + 0.5,
                row + 0.5,
                f"{value:.3g}",
                ha="center",
                va="center",
                fontsize=8,
                color="white" if norm(value) < dark else "black",
            )


def norm_of(values: np.ndarray) -> Normalize:
    """Colour scale of all panels: logarithmic over more than a decade."""
    finite = values[np.isfinite(values)]
    low, high = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
    return LogNorm(low, high) if 0 < low < high / DECADE else Normalize(low, high)


def scaled(axis: Axis, values: np.ndarray, *, from_zero: bool = True) -> None:
    """Make an axis logarithmic over more than a decade; else let it begin at zero, if asked."""
    finite = values[np.isfinite(values)]
    if finite.size and finite.min() > 0 and finite.max() > DECADE * finite.min():
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        plain_decades(axis)
    elif from_zero:
        axis.axes.set(**{f"{axis.axis_name}lim": (0.0, None)})


def names(table: "pd.DataFrame", column: str) -> list[str]:
    """What a column has, sorted: colours stay with their planners from figure to figure."""
    return sorted(table[column].unique())


def together(pooled: Sequence[str]) -> str:
    """Words about the keys that are not told apart."""
    return f"; all values of {', '.join(pooled)} together" if pooled else ""
