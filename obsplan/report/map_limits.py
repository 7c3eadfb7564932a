"""The limits of the aid vehicle on the map, and where it broke them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.patches import Polygon as Outline
from matplotlib.patheffects import withStroke

from obsplan.constraints import Disc, LimitHistory, Polygon
from obsplan.report.style import BROKEN, LIMIT
from obsplan.report.words import after
from obsplan.run import Run

BINDING = 0.2  # of a separation: a limit that the aid vehicle came so near to has a ring
_KEEP_OUT: dict[str, Any] = {"fc": (0, 0, 0, 0.05), "ec": LIMIT, "hatch": "////", "lw": 0.8}
_NUMBER: dict[str, Any] = {
    "fontsize": 7,
    "ha": "center",
    "va": "center",
    "clip_on": True,
    "zorder": 11,
    "path_effects": [withStroke(linewidth=2.5, foreground="white")],
}
_FENCE: dict[str, Any] = {"color": LIMIT, "lw": 1.2, "ls": (0, (6, 2, 1, 2))}
_RING: dict[str, Any] = {"color": LIMIT, "lw": 1.0, "ls": (0, (1, 1.5))}
_BROKEN: dict[str, Any] = {"color": BROKEN, "lw": 4.0, "alpha": 0.7}
ROUNDNESS = 181  # points of a circle


def boundary(area: Disc | Polygon) -> Float[np.ndarray, "corners 2"]:
    """Edge of an area [m], closed."""
    if isinstance(area, Disc):
        angle = np.linspace(0.0, 2 * np.pi, ROUNDNESS)
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.array([area.x, area.y]) + area.radius * circle
    return np.array([*area.points, area.points[0]], dtype=float)


def draw_limits(axes: Axes, run: Run) -> list[Line2D | Patch]:
    """Draw keep-outs, geofence, binding separations and where a limit was broken.

    Returns what the legend says of them.
    """
    limits = run.scenario.constraints
    handles: list[Line2D | Patch] = []
    for k, area in enumerate(limits.keep_out, start=1):
        axes.add_patch(_keep_out(area))
        axes.text(*_middle(area), f"keep-out {k}", **_NUMBER)
    if limits.keep_out:
        handles.append(Patch(**_KEEP_OUT, label="keep-out"))
    if limits.geofence is not None:
        axes.plot(*boundary(limits.geofence).T, **_FENCE, zorder=1.2)
        handles.append(Line2D([], [], **_FENCE, label="geofence"))
    for limit in binding_separations(run):
        _draw_ring(axes, run, limit)
        handles.append(Line2D([], [], **_RING, label=_ring_in_words(run, limit)))
    if _draw_breaches(axes, run):
        handles.append(Line2D([], [], **_BROKEN, label="limit broken"))
    return handles


def binding_separations(run: Run) -> list[LimitHistory]:
    """For least and greatest separation, the AUV whose limit is broken most or nearly broken."""
    kinds: dict[str, list[LimitHistory]] = {}
    for limit in run.limits:
        if limit.auv is not None:
            kinds.setdefault(limit.name.split()[0], []).append(limit)
    worst = [max(same, key=lambda limit: limit.violation.max()) for same in kinds.values()]
    return [one for one in worst if one.violation.max() > -BINDING * (one.distance or 0.0)]


def _keep_out(area: Disc | Polygon) -> Patch:
    if isinstance(area, Disc):
        return Circle((area.x, area.y), area.radius, **_KEEP_OUT, zorder=0.8)
    return Outline(np.array(area.points), closed=True, **_KEEP_OUT, zorder=0.8)


def _middle(area: Disc | Polygon) -> tuple[float, float]:
    """A place well inside an area."""
    if isinstance(area, Disc):
        return area.x, area.y
    import shapely

    center = shapely.Polygon(area.points).representative_point()
    return center.x, center.y


def _draw_ring(axes: Axes, run: Run, limit: LimitHistory) -> None:
    """The circle of a separation, and a line from its AUV to the aid vehicle."""
    aid = run.aids[limit.aid].pose
    line = np.stack([run.places[limit.auv, limit.worst], aid[limit.worst, :2]])
    axes.plot(*ring(run, limit).T, **_RING, zorder=6)
    axes.plot(*line.T, color=LIMIT, lw=0.7, marker="x", ms=5, zorder=6)


def ring(run: Run, limit: LimitHistory) -> Float[np.ndarray, "corners 2"]:
    """Circle [m] of a separation about its AUV when it was broken most, or closest to that."""
    x, y = run.places[limit.auv, limit.worst]
    return boundary(Disc(x=float(x), y=float(y), radius=limit.distance or 0.0))


def _ring_in_words(run: Run, limit: LimitHistory) -> str:
    kind, auv = limit.name.split()[0], run.names[limit.auv or 0]
    return f"{kind} separation, {limit.distance:g} m,\nfrom {auv} {after(run, limit.worst)}"


def _draw_breaches(axes: Axes, run: Run) -> bool:
    """Broaden the aid vehicles' paths where they break a limit; whether one does."""
    any_broken = False
    for k, aid in enumerate(run.aids):
        broken = np.zeros(run.time.size, dtype=bool)
        for limit in run.limits:
            if limit.aid == k:
                broken |= limit.broken
        if not broken.any():
            continue
        any_broken = True
        pieces = stretches(aid.pose[:, :2], broken)
        lines = LineCollection(pieces, **_BROKEN, zorder=3.5, capstyle="round")
        axes.add_collection(lines, autolim=False)
    return any_broken


def stretches(
    path: Float[np.ndarray, "samples 2"], chosen: np.ndarray
) -> Sequence[Float[np.ndarray, "_ 2"]]:
    """The parts of a path whose samples are chosen; a lone sample is a line of no length."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int)))
    return [
        path[a : max(b, a + 1)].repeat(2 if b == a + 1 else 1, axis=0)
        for a, b in edges.reshape(-1, 2)
    ]
