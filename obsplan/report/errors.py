"""Errors of a run over time, against what the filter says of them."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from obsplan.report.style import FAINT, colour, outline, plain_decades, time_axis
from obsplan.run import Run

SIGMAS = 3.0
NEES_BAND = (0.0506, 7.378)  # 2.5 % and 97.5 % of chi-square with 2 degrees
WIDTH, ROW = 11.0, 2.0  # of the figure, of a row [inch]


def errors_figure(run: Run) -> Figure:
    """Draw a row per AUV (east error, north error, distance) and a row of separation, predicted condition number and consistency."""
    rows = len(run.names) + 1
    figure = Figure(figsize=(WIDTH, ROW * rows + 0.6), layout="constrained")
    grid = GridSpec(rows, 6, figure=figure)
    time, label = time_axis(run.time)
    for i in range(rows - 1):
        for axis, name in enumerate(("East", "North")):
            _draw_error(
                figure.add_subplot(grid[i, 2 * axis : 2 * axis + 2]), run, time, i, axis, name
            )
        _draw_distance(figure.add_subplot(grid[i, 4:]), run, time, i)
    lower = [_draw_separation, _draw_nees] + (
        [_draw_condition] if np.isfinite(run.condition).any() else []
    )
    for k, draw in enumerate(lower):
        span = 6 // len(lower)
        draw(figure.add_subplot(grid[-1, k * span : (k + 1) * span]), run, time)
    for axes in figure.axes:
        axes.set_xlim(time[0], time[-1])
    for axes in figure.axes[-len(lower) :]:
        axes.set_xlabel(label)
    if len(run.names) > 1:
        figure.legend(
            *figure.axes[-len(lower)].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=8,
            fontsize=8,
        )
    figure.suptitle(
        f"{run.scenario.table.name}, {run.planner}: RMS position error {run.rms_error:.2f} m, worst {run.max_error:.2f} m",
        x=0.01,
        ha="left",
        fontsize=11,
    )
    return figure


def _line(
    axes: Axes, time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], **how: object
) -> None:
    """A line over time, thinned."""
    shown = outline(values)
    axes.plot(time[shown], values[shown], **how)  # pyright: ignore[reportArgumentType]


def _highest(errors: Float[np.ndarray, " n"], stated: Float[np.ndarray, " n"]) -> float:
    """End of an axis that shows every error, and what is stated of them but for the first moments."""
    return 1.1 * float(max(np.nanmax(errors), np.nanquantile(stated, 0.98))) or 1.0


def _draw_error(
    axes: Axes, run: Run, time: Float[np.ndarray, " n"], i: int, axis: int, name: str
) -> None:
    error = run.mean[i, :, axis] - run.truth[i, :, axis]
    band = SIGMAS * np.sqrt(np.maximum(run.covariance[i, :, axis, axis], 0.0))
    shown = outline(band)
    axes.fill_between(
        time[shown], -band[shown], band[shown], color=colour(i), alpha=0.2, lw=0, label="±3σ"
    )
    _line(axes, time, error, color=colour(i), lw=0.8, label="error")
    axes.axhline(0.0, color=FAINT, lw=0.5)
    highest = _highest(np.abs(error), band)
    axes.set_ylim(-highest, highest)
    axes.set_title(f"{run.names[i]}: {name.lower()} error and ±3σ")
    axes.set_ylabel(f"{name} error [m]")


def _draw_distance(axes: Axes, run: Run, time: Float[np.ndarray, " n"], i: int) -> None:
    _line(axes, time, run.error[i], color=colour(i), lw=0.8, label="error")
    bound = np.sqrt(run.cramer_rao[i, :, 0, 0] + run.cramer_rao[i, :, 1, 1])
    _line(axes, time, bound, color="black", lw=1.0, ls="--", label="Cramér–Rao bound, RMS")
    axes.set_ylim(0.0, _highest(run.error[i], bound))
    axes.set_title(f"{run.names[i]}: distance from the truth")
    axes.set_ylabel("Error [m]")
    axes.legend(loc="upper right", fontsize=7)


def _draw_separation(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i, name in enumerate(run.names):
        _line(axes, time, run.separation[i], color=colour(i), lw=0.8, label=name)
    axes.set_ylim(bottom=0.0)
    axes.set_title("Distance to the aid vehicle")
    axes.set_ylabel("Separation [m]")


def _draw_condition(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i, condition in enumerate(run.condition):
        decided = np.isfinite(condition)
        _line(axes, time[decided], condition[decided], color=colour(i), lw=0.8)
    axes.set_yscale("log")
    plain_decades(axes.yaxis)
    axes.set_title("Condition number the planner predicts")
    axes.set_ylabel(f"{run.condition_label} [-]")


def _draw_nees(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    for i, nees in enumerate(run.nees):
        known = nees > 0
        if known.any():
            _line(axes, time[known], nees[known], color=colour(i), lw=0.8)
    axes.axhspan(*NEES_BAND, color=FAINT, alpha=0.2, lw=0, label="95 % if consistent")
    axes.set_yscale("log")
    axes.set_title("Normalised error squared (NEES)")
    axes.set_ylabel("NEES [-]")
    axes.legend(loc="upper right", fontsize=7)
