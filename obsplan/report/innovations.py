"""Innovations over time in their standard deviations, by beacon, and what was rejected and why."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from obsplan.fates import Fate
from obsplan.ranged import Ranged
from obsplan.report.panels import bend, curve_handles, empty_rows, finish, round_up
from obsplan.report.style import AID, BROKEN, COLOURS, FAINT, named, time_axis
from obsplan.report.words import title
from obsplan.run import Run

BAND = 1.96  # [σ], that holds 95 % of a consistent filter's
FARTHEST = 5.0  # [σ], beyond which the axis is logarithmic
MOST_BEACONS = 8  # named in the legend
_BAND: dict[str, Any] = {"fc": to_rgba(FAINT, 0.2), "ec": FAINT, "lw": 0.6, "ls": ":"}
_TAKEN: dict[str, Any] = {"marker": "o", "ms": 2.6, "mew": 0, "ls": ""}
_REJECTED: dict[str, Any] = {"ms": 5, "ls": "", "mec": BROKEN, "mew": 0.9, "mfc": "none"}
MARKERS = {
    Fate.NO_ESTIMATE: "|",
    Fate.DUPLICATE: "2",
    Fate.OUT_OF_ORDER: "1",
    Fate.OUT_OF_REACH: "^",
    Fate.SHORTER_THAN_DEPTH: "v",
    Fate.INNOVATION: "x",
    Fate.UNKNOWN_BEACON: "d",
}
OTHER = "*"


def shows_innovations(run: Run) -> bool:
    """Whether there is an innovation to show."""
    return run.ranged is not None and bool(np.isfinite(run.ranged.normalised).any())


def innovations_figure(run: Run) -> Figure:
    """Draw a panel per AUV: its innovations by beacon, with the band of a consistent filter."""
    figure = Figure()
    rows = empty_rows(figure, [1] * len(run.names))
    for i, (axes,) in enumerate(rows):
        draw_innovations(axes, run, i)
    rows[-1][0].set_xlabel(time_axis(run.time)[1])
    heading = f"{title(run.scenario.table.name)}: innovations of ranges"
    finish(figure, rows, [*innovation_handles(run), *curve_handles(figure)], heading)
    return figure


def draw_innovations(axes: Axes, run: Run, i: int) -> None:
    """Draw those of an AUV; what was rejected unseen is marked at the lower edge."""
    assert run.ranged is not None
    own = run.ranged.of(auv=i)
    scale, _ = time_axis(run.time)
    length = run.time[-1] / scale[-1]
    time, normalised = own.received / length, own.normalised
    for b in own.heard:
        shown = (own.beacon == b) & own.taken
        axes.plot(time[shown], normalised[shown], color=_colour(run.ranged, b), **_TAKEN)
    for fate in own.rejected:
        rejected, marker = own.fate == fate, MARKERS.get(fate, OTHER)
        seen = rejected & np.isfinite(normalised)
        axes.plot(time[seen], normalised[seen], marker=marker, **_REJECTED)
        unseen = time[rejected & ~seen]
        edge: Any = axes.get_xaxis_transform()
        axes.plot(unseen, np.full(unseen.size, 0.03), marker=marker, transform=edge, **_REJECTED)
    axes.axhspan(-BAND, BAND, **_BAND)
    _scale(axes, normalised)
    axes.set_xlim(scale[0], scale[-1])
    axes.set_title(f"{run.names[i]}: innovations, normalised")
    axes.set_ylabel("Innovation [σ]")


def _colour(ranged: Ranged, beacon: int) -> str:
    """Colour of a beacon: from the other end than those of AUVs."""
    alone = not np.ptp(ranged.beacon)
    return AID if alone else COLOURS[-1 - beacon % len(COLOURS)]


def _scale(axes: Axes, normalised: Float[np.ndarray, " n"]) -> None:
    """Make an axis that holds all, logarithmic where some are far out."""
    most = float(np.fmax.reduce(np.abs(normalised), initial=BAND))
    if most > 2 * FARTHEST:
        bend(axes, FARTHEST, round_up(1.2 * most), signed=True)
    else:
        axes.set_ylim(-1.2 * most, 1.2 * most)


def innovation_handles(run: Run) -> list[Line2D | Patch]:
    """What is drawn, for a legend."""
    assert run.ranged is not None
    return [*_handles(run.ranged)]


def _handles(ranged: Ranged) -> Iterator[Line2D | Patch]:
    heard = ranged.heard
    for b in heard[:MOST_BEACONS]:
        yield Line2D([], [], color=_colour(ranged, b), **_TAKEN, label=named(ranged.beacons[b]))
    if len(heard) > MOST_BEACONS:
        more = len(heard) - MOST_BEACONS
        yield Line2D([], [], color=FAINT, **_TAKEN, label=f"and {more} more")
    yield Patch(**_BAND, label="95 % if consistent")
    for fate in ranged.rejected:
        yield Line2D(
            [], [], marker=MARKERS.get(fate, OTHER), **_REJECTED, label=f"rejected: {fate.words}"
        )
