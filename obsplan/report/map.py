"""The map of a run: who was where, and how sure of it."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from obsplan.report.style import AID, FAINT, colour
from obsplan.run import Run

PROBABILITY = 0.95
RADIUS = float(
    np.sqrt(-2.0 * np.log(1.0 - PROBABILITY))
)  # of the ellipse in standard deviations: chi-square with 2 degrees
ELLIPSES = 32  # in all
SMALLEST = 0.004  # semi-axis of an ellipse worth drawing, as a share of the map's width
ARROWS = 9  # along the aid vehicle's path
WINDING = 20.0  # times the map's width: the path is so long that it would hide the rest
MOST_VERTICES = 50_000  # of a track
WIDTH, LOWEST, HIGHEST = 8.0, 4.0, 9.0  # of the figure [inch]
LEGEND = 2.0  # [inch]
BAND = 0.35  # opacity of a true track
_START: dict[str, Any] = {"marker": "o", "ms": 5, "mfc": "white", "mew": 1.5, "ls": ""}


def map_figure(run: Run) -> Figure:
    """Draw surveys, true tracks, estimates with their 95 % ellipses, and the aid vehicle's path, from above."""
    low, high = extent(run)
    width, height = high - low
    figure = Figure(
        figsize=(WIDTH, float(np.clip((WIDTH - LEGEND) * height / width + 1.0, LOWEST, HIGHEST))),
        layout="constrained",
    )
    axes = figure.add_subplot(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    for i, reference in enumerate(run.scenario.references):
        axes.plot(
            *reference.polyline.T,
            color=FAINT,
            lw=0.8,
            ls=(0, (5, 3)),
            marker="+" if len(reference.polyline) == 1 else "",
            zorder=1,
        )
        _draw_auv(axes, run, i, smallest=SMALLEST * width)
    _draw_aid(axes, run)
    origin = run.scenario.table.origin
    axes.set_xlabel(f"East of {abs(origin.lon):g}° {'E' if origin.lon >= 0 else 'W'} [m]")
    axes.set_ylabel(f"North of {abs(origin.lat):g}° {'N' if origin.lat >= 0 else 'S'} [m]")
    axes.set_title(
        f"{run.scenario.table.name}, {run.planner}: RMS position error {run.rms_error:.2f} m, worst {run.max_error:.2f} m"
    )
    axes.legend(
        handles=_legend(run),
        loc="upper left",
        bbox_to_anchor=(1.01, 1.0),
        fontsize=8,
        handlelength=2.4,
    )
    return figure


def extent(run: Run) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Lower left and upper right corner [m] of all tracks, with a margin."""
    tracks = [
        run.cna[:, :2],
        *run.truth[..., :2],
        *run.mean[..., :2],
        *(r.polyline for r in run.scenario.references),
    ]
    points = np.concatenate(tracks)
    low, high = (
        np.nanmin(points, axis=0),
        np.nanmax(points, axis=0),
    )  # nan where a filter has failed
    margin = 0.06 * max(*(high - low), 1.0)
    flattest = 0.25 * (high - low).max()  # a map is not a line
    spare = np.maximum(flattest - (high - low), 0.0) / 2
    return low - spare - margin, high + spare + margin


def ellipses(
    covariance: Float[np.ndarray, "n 2 2"], center: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 49 2"]:
    """Outlines of the 95 % ellipses."""
    variance, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = RADIUS * np.stack([np.cos(angle), np.sin(angle)])
    half_axes = axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :]
    return center[:, None, :] + np.swapaxes(half_axes @ circle, 1, 2)


def apart(
    shapes: Float[np.ndarray, "n 49 2"], center: Float[np.ndarray, "n 2"], smallest: float
) -> list[int]:
    """Which ellipses to draw: those large enough [m] that do not hide, and are not much like, the one drawn before."""
    size = np.linalg.norm(shapes - center[:, None], axis=-1).max(axis=-1)
    drawn: list[int] = []
    for k in np.flatnonzero(size >= smallest):
        last = drawn[-1] if drawn else k
        if (
            not drawn
            or np.hypot(*(center[k] - center[last])) > size[last]
            or not 0.5 < size[k] / size[last] < 2.0
        ):
            drawn.append(int(k))
    return drawn


def _draw_auv(axes: Axes, run: Run, i: int, *, smallest: float) -> None:
    paint, every = colour(i), _every(run)
    axes.plot(
        *run.truth[i, every, :2].T,
        color=paint,
        alpha=BAND,
        lw=3.5,
        solid_capstyle="round",
        zorder=2,
    )
    axes.plot(*run.mean[i, every, :2].T, color=paint, lw=0.9, zorder=5)
    axes.plot(*run.truth[i, 0, :2], **_START, mec=paint, zorder=6)
    at = np.unique(
        np.linspace(0, run.time.size - 1, max(4, ELLIPSES // len(run.names))).astype(int)
    )
    at = at[np.isfinite(run.covariance[i, at, :2, :2]).all(axis=(1, 2))]
    shapes = ellipses(run.covariance[i, at, :2, :2], run.mean[i, at, :2])
    shapes = shapes[apart(shapes, run.mean[i, at, :2], smallest)]
    axes.add_collection(
        PolyCollection(list(shapes), fc=to_rgba(paint, 0.2), ec=paint, lw=0.6, zorder=3),
        autolim=False,
    )
    if len(run.names) > 1:
        _draw_name(axes, run, i)


def _draw_name(axes: Axes, run: Run, i: int) -> None:
    """An AUV's name at its start, on the side away from the others'."""
    start = run.truth[:, 0, :2]
    left, below = start[i] < start.mean(axis=0)
    axes.annotate(
        run.names[i],
        start[i],
        xytext=(-6 if left else 6, -6 if below else 6),
        textcoords="offset points",
        ha="right" if left else "left",
        va="top" if below else "bottom",
        color=colour(i),
        fontsize=8,
        zorder=9,
        bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.7},
    )


def _draw_aid(axes: Axes, run: Run) -> None:
    path = run.cna[_every(run), :2]
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    winding = length[-1] > WINDING * np.ptp(path, axis=0).max()
    axes.plot(
        *path.T,
        color=AID,
        lw=0.3 if winding else 0.8,
        alpha=0.6 if winding else 0.75,
        zorder=1.5 if winding else 4,
    )
    if length[-1] > 0:
        for k in np.searchsorted(length, (np.arange(ARROWS) + 0.5) / ARROWS * length[-1]):
            degrees = np.rad2deg(run.cna[_every(run), 2][k])
            axes.plot(
                *path[k],
                marker=(3, 0, degrees - 90.0),
                ms=7,
                mfc=AID,
                mec="white",
                mew=0.4,
                ls="",
                zorder=7,
            )
        axes.plot(*path[-1], marker="s", ms=6, mfc=AID, mec="white", ls="", zorder=8)
    axes.plot(*path[0], marker="o", ms=7, mfc="white", mec=AID, mew=1.6, ls="", zorder=8)


def _every(run: Run) -> slice:
    return slice(None, None, -(-run.time.size // MOST_VERTICES))


def _legend(run: Run) -> list[Line2D | Patch]:
    one = colour(0) if len(run.names) == 1 else FAINT
    moves = bool((run.cna[:, :2] != run.cna[0, :2]).any())
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=FAINT, lw=0.8, ls=(0, (5, 3)), label="survey plan"),
        Line2D([], [], color=one, lw=3.5, alpha=BAND, label="AUV, true"),
        Line2D([], [], **_START, mec=one, label="AUV, start"),
        Line2D([], [], color=one, lw=0.9, label="AUV, estimated"),
        Patch(
            fc=to_rgba(one, 0.2),
            ec=one,
            lw=0.6,
            label=f"{PROBABILITY:.0%} ellipse".replace("%", " %"),
        ),
        Line2D(
            [],
            [],
            color=AID,
            lw=0.8 * moves,
            marker="o",
            ms=7,
            mfc="white",
            mec=AID,
            mew=1.6,
            label="aid vehicle, start",
        ),
    ]
    if moves:
        handles.append(
            Line2D([], [], color=AID, lw=0.8, marker=(3, 0, -90), ms=7, label="aid vehicle, course")
        )
        handles.append(
            Line2D([], [], color=AID, lw=0.8, marker="s", ms=6, label="aid vehicle, end")
        )
    if len(run.names) > 1:
        handles += [
            Line2D([], [], color=colour(i), lw=2.5, label=name) for i, name in enumerate(run.names)
        ]
    return handles
