"""What a filter says of itself over time, where the truth is not known; and its hypotheses."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from obsplan.record import NO_TRUTH
from obsplan.report.innovations import draw_innovations, innovation_handles, shows_innovations
from obsplan.report.panels import curve_handles, draw_line, empty_rows, finish, scale_errors
from obsplan.report.style import FAINT, colour, dark, named, time_axis
from obsplan.report.words import sailed, title
from obsplan.run import Run

_NORTH: dict[str, Any] = {"lw": 0.9, "ls": (0, (4, 1.5))}
_SMOOTHED: dict[str, Any] = {"lw": 0.9, "alpha": 0.6}


def sigmas_figure(run: Run) -> Figure:
    """Draw a row per AUV: standard deviations east and north, and innovations of its ranges."""
    measured, several = shows_innovations(run), shows_hypotheses(run)
    figure = Figure()
    rows = empty_rows(figure, [1 + measured] * len(run.names) + [1] * several)
    time, label = time_axis(run.time)
    for i in range(len(run.names)):
        _draw_sigmas(rows[i][0], run, time, i)
        if measured:
            draw_innovations(rows[i][1], run, i)
    if several:
        draw_hypotheses(rows[-1][0], run, time)
    for axes in figure.axes:
        axes.set_xlim(time[0], time[-1])
    for axes in rows[-1]:
        axes.set_xlabel(label)
    handles = [*_handles(run), *(innovation_handles(run) if measured else [])]
    handles += curve_handles(figure)
    heading = f"{title(run.scenario.table.name)}, {sailed(run)}: {NO_TRUTH}"
    finish(figure, rows, handles, heading)
    return figure


def _draw_sigmas(axes: Axes, run: Run, time: Float[np.ndarray, " n"], i: int) -> None:
    sigma = _sigmas(run.covariance[i, :, :2, :2])
    for one, style in zip(sigma, ({"lw": 0.9}, _NORTH), strict=True):
        draw_line(axes, time, one, color=colour(i), **style)
    if run.smoothed_covariance is not None:
        both = np.hypot(*_sigmas(run.smoothed_covariance[i])) / np.sqrt(2)
        draw_line(axes, time, both, color=dark(colour(i)), **_SMOOTHED)
    scale_errors([axes], sigma, sigma, signed=False)
    axes.set_title(f"{run.names[i]}: standard deviations as its filter says")
    axes.set_ylabel("σ [m]")


def _sigmas(P: Float[np.ndarray, "samples 2 2"]) -> Float[np.ndarray, "2 samples"]:
    """Standard deviations east and north [m]."""
    return np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), 0.0)).T


def shows_hypotheses(run: Run) -> bool:
    """Whether more than one position fitted at some time."""
    return run.hypotheses is not None and bool((run.hypotheses > 1).any())


def draw_hypotheses(axes: Axes, run: Run, time: Float[np.ndarray, " n"]) -> None:
    """Draw how many positions fit."""
    assert run.hypotheses is not None
    for i, count in enumerate(run.hypotheses):
        axes.step(time, count, where="post", color=colour(i), lw=0.9)
    axes.set_ylim(bottom=0.0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_title("Positions that fit")
    axes.set_ylabel("Hypotheses [-]")


def _handles(run: Run) -> Iterator[Line2D | Patch]:
    one = colour(0) if len(run.names) == 1 else FAINT
    if len(run.names) > 1:
        for i, name in enumerate(run.names):
            yield Line2D([], [], color=colour(i), lw=2.5, label=named(name))
    yield Line2D([], [], color=one, lw=0.9, label="σ east")
    yield Line2D([], [], color=one, **_NORTH, label="σ north")
    if run.smoothed_covariance is not None:
        yield Line2D([], [], color=dark(one), **_SMOOTHED, label="σ, smoothed")
