"""Figures of a campaign: planners, errors against what was varied, and maps over two keys."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# because pandas is not typed: its columns may be anything

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from obsplan.campaign.statistics import medians, varied_keys, worded
from obsplan.report.style import AID, head, name_rows, named, plain_decades, planner_style
from obsplan.report.words import marked, title
from obsplan.scenario.schema import described

if TYPE_CHECKING:
    import pandas as pd

ERROR, LABEL = "rms_error_m", "RMS error [m]"
DECADE = 10.0  # ratio of the greatest to the least beyond which an axis is logarithmic
WIDTH, ROW, PANEL = 8.0, 0.5, 3.2  # of a figure, of a planner's line, of a panel [inch]
RANGE = (0.05, 0.95)  # of the missions, between which the bar lies
MOST_NUMBERS = 100  # of fields in a map, for each to be labelled


def planners_figure(table: "pd.DataFrame") -> Figure:
    """Draw each planner's errors, per scenario: median, its interval, where most missions lie."""
    scenarios, planners = names(table, "scenario"), names(table, "planner")
    height = len(scenarios) * (ROW * len(planners) + 0.9) + 0.7
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    panels = figure.subplots(len(scenarios), 1, squeeze=False)[:, 0]
    summary = medians(table, ["scenario", "planner"]).set_index(["scenario", "planner"])
    for axes, scenario in zip(panels, scenarios, strict=True):
        here = table[table["scenario"] == scenario]
        rows = summary.loc[scenario].reindex(planners)
        for y, planner in enumerate(planners):
            errors = here.loc[here["planner"] == planner, ERROR].dropna()
            if errors.size:
                _draw_planner(axes, y, planner, errors, rows.loc[planner])
        name_rows(axes, planners, list(rows["violated"] > 0))
        axes.set_title(title(scenario))
        axes.set_xlabel(LABEL)
        scaled(axes.xaxis, here[ERROR].quantile(RANGE).to_numpy())
    pooled = together([key for key in varied_keys(table) if table[key].nunique() > 1])
    key = f"Symbol and line: median and its 95 % interval; bar: 5th to 95th percentile{pooled}."
    head(figure, "Position error by planner", key + dagger(summary))
    return figure


def _draw_planner(axes: Axes, y: int, planner: str, errors: "pd.Series", row: "pd.Series") -> None:
    paint, marker = planner_style(planner)
    bar = {"color": paint, "lw": 7, "alpha": 0.3, "solid_capstyle": "butt"}
    axes.plot(errors.quantile(RANGE), [y, y], **bar)
    axes.plot([row[f"{ERROR}_low"], row[f"{ERROR}_high"]], [y, y], color=AID, lw=1.6)
    axes.plot(
        row[ERROR], y, marker, ms=6, color=paint, **symbol(paint, broke=bool(row["violated"] > 0))
    )


def key_figure(table: "pd.DataFrame", key: str, pooled: Sequence[str] = ()) -> Figure:
    """Draw the median error against a varied key: a line per planner, a panel per scenario.

    Other keys are pooled.
    """
    scenarios, planners = names(table, "scenario"), names(table, "planner")
    figure = Figure(figsize=(WIDTH, PANEL * len(scenarios) + 0.7), layout="constrained")
    panels = figure.subplots(len(scenarios), 1, squeeze=False)[:, 0]
    values = sorted(table[key].dropna().unique())
    summary = medians(table, ["scenario", "planner", key])
    numeric = not isinstance(values[0], str)
    for axes, scenario in zip(panels, scenarios, strict=True):
        here = summary[summary["scenario"] == scenario].dropna(subset=[key, ERROR])
        for planner in planners:
            line = here[here["planner"] == planner]
            places = line[key] if numeric else [values.index(value) for value in line[key]]
            _draw_line(axes, planner, np.array(places, dtype=float), line)
        if numeric:
            scaled(axes.xaxis, np.array(values, dtype=float), from_zero=False)
        else:
            axes.set_xticks(range(len(values)), values)
        scaled(axes.yaxis, here[ERROR].to_numpy())
        axes.set_title(title(scenario))
        axes.set_xlabel(key_label(key, numeric=numeric, width=80))
        axes.set_ylabel(f"Median {LABEL}")
    handles = [_line_in_legend(planner, summary) for planner in planners]
    figure.legend(handles=handles, loc="outside right upper", fontsize=8)
    how = f"Line and band: median and its 95 % interval{together(pooled)}."
    head(figure, f"Position error against {key}", how + dagger(summary))
    return figure


def _draw_line(axes: Axes, planner: str, x: Float[np.ndarray, " n"], line: "pd.DataFrame") -> None:
    paint, marker = planner_style(planner)
    low, high = line[f"{ERROR}_low"], line[f"{ERROR}_high"]
    axes.fill_between(x, low, high, color=paint, alpha=0.2, lw=0)
    axes.plot(x, line[ERROR], color=paint, lw=1.2, label=named(planner))
    for place, error, violated in zip(x, line[ERROR], line["violated"], strict=True):
        axes.plot(
            place,
            error,
            marker,
            ms=5,
            zorder=3,
            color=paint,
            **symbol(paint, broke=bool(violated > 0)),
        )


def _line_in_legend(planner: str, summary: "pd.DataFrame") -> Line2D:
    paint, marker = planner_style(planner)
    broke = bool((summary.loc[summary["planner"] == planner, "violated"] > 0).any())
    label = named(marked(planner, broke))
    return Line2D([], [], color=paint, lw=1.2, marker=marker, ms=5, mec="white", label=label)


def symbol(paint: str, *, broke: bool) -> dict[str, Any]:
    """How a median is drawn: open where a limit was broken."""
    if broke:
        return {"mfc": "white", "mec": paint, "mew": 1.2}
    return {"mfc": paint, "mec": "white", "mew": 0.6}


def map_figure(table: "pd.DataFrame", keys: tuple[str, str], pooled: Sequence[str] = ()) -> Figure:
    """Draw one scenario's median error over two varied keys: a panel per planner, one colour scale.

    Other keys are pooled.
    """
    planners = names(table, "planner")
    summary = medians(table, ["planner", *keys]).dropna(subset=list(keys))
    grids = {
        planner: summary[summary["planner"] == planner].pivot(
            index=keys[1], columns=keys[0], values=[ERROR, "violated"]
        )
        for planner in planners
    }
    figure = Figure(figsize=(WIDTH, PANEL * len(grids) + 0.7), layout="constrained")
    panels = figure.subplots(len(grids), 1, squeeze=False)[:, 0]
    norm = norm_of(np.concatenate([grid[ERROR].to_numpy().ravel() for grid in grids.values()]))
    numeric = [not isinstance(table[key].dropna().iloc[0], str) for key in keys]
    for axes, (planner, grid) in zip(panels, grids.items(), strict=True):
        errors, broke = grid[ERROR], grid["violated"].to_numpy() > 0
        mesh = axes.pcolormesh(errors.to_numpy(), norm=norm, cmap="viridis")
        axes.grid(False)
        columns, rows = errors.columns, errors.index
        axes.set_xticks(np.arange(len(columns)) + 0.5, [worded(value) for value in columns])
        axes.set_yticks(np.arange(len(rows)) + 0.5, [worded(value) for value in rows])
        axes.set_xlabel(key_label(keys[0], numeric=numeric[0], width=70))
        axes.set_ylabel(key_label(keys[1], numeric=numeric[1], width=36))
        axes.set_title(marked(planner, bool(broke.any())))
        if errors.size <= MOST_NUMBERS:
            write_numbers(axes, errors.to_numpy(), broke, norm)
        figure.colorbar(mesh, ax=axes, label=f"Median {LABEL}")
    how = f"Medians{together(pooled)}." if pooled else ""
    name = title(str(table["scenario"].iloc[0]))
    head(figure, f"{name}: position error", how + dagger(summary, "†"))
    return figure


def key_label(key: str, *, numeric: bool, width: int) -> str:
    """An axis's label for a varied key: its name, meaning and unit, on lines of so many letters."""
    meaning = described(key).replace("^2", "²").replace("sqrt(s)", "√s")
    unit = " [-]" if numeric and "[" not in meaning else ""
    return fill(f"{key}: {meaning}{unit}" if meaning else f"{key}{unit}", width)


def dagger(summary: "pd.DataFrame", marks: str = "Open symbol, †") -> str:
    """Words about the marks of those who broke a limit, if any did."""
    return f" {marks}: broke a limit." if (summary["violated"] > 0).any() else ""


def write_numbers(axes: Axes, grid: np.ndarray, broke: np.ndarray, norm: Normalize) -> None:
    """Write the medians into their fields, light on dark, with a mark where a limit was broken."""
    dark = 0.6  # of the colour map, below which white is read better
    for (row, column), value in np.ndenumerate(grid):
        if np.isfinite(value):
            axes.text(
                column + 0.5,
                row + 0.5,
                marked(f"{value:.3g}", bool(broke[row, column])),
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
    """What a column has, sorted."""
    return sorted(table[column].unique())


def together(pooled: Sequence[str]) -> str:
    """Words about the keys that are not told apart."""
    return f"; all values of {', '.join(pooled)} together" if pooled else ""
