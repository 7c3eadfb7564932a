"""Figures 5.1 to 5.3: path inertia without a penalty, about one AUV at rest."""

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from obsplan.thesis import claims
from obsplan.thesis.drawing import draw_over_time, draw_tracks, panels
from obsplan.thesis.flights import fly, pose, poses, random_starts, scenario
from obsplan.thesis.item import Finding, Item

if TYPE_CHECKING:
    import xarray as xr

STARTS = 50  # of the thesis's Monte Carlo experiments
HALF_WIDTH = 3.0  # of the square starts are drawn from [m]; the thesis does not give it
ROUNDING = 1e-9  # [m], [-]; sums of some 1000 steps
NEAR = 0.1  # [m]; "very near zero": the length of one step
CLASS_COLOURS = {"outward": "#D55E00", "right": "#009E73", "inward": "#0072B2"}
CLASS_NAMES = {
    "outward": "obtuse: AUV behind",
    "right": "right: AUV abeam",
    "inward": "acute: AUV ahead",
}


def first_distance(data: "xr.Dataset") -> np.ndarray:
    """Distances to the first AUV, by start and time."""
    return data.distance.isel(auv=0).values


def first_offsets(data: "xr.Dataset") -> list[tuple[float, float]]:
    """(s, b) of each start."""
    return [(float(s), float(b)) for s, b in zip(*claims.offsets(poses(data)[:, 0]), strict=True)]


def compute_circle(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure 5.1."""
    return fly(scenario("fixed-auv", "path-inertia", "planner.gamma=0.0"), [pose(1.0, 0.0, 90.0)])


def draw_circle(data: "xr.Dataset") -> Figure:
    """Path, distance and condition number."""
    figure, axes = panels(3)
    draw_tracks(axes[0], data)
    draw_over_time(axes[1], data, "distance", "Distance [m]")
    draw_over_time(axes[2], data, "condition", "Predicted condition number κ(J) [-]")
    axes[1].set_ylim(0.0, 2.0)
    axes[2].set_ylim(0.0, 2.0)
    return figure


def found_circle(data: "xr.Dataset") -> Finding:
    """Circle of the start's distance about the AUV, condition number 1."""
    off, worst = np.abs(first_distance(data) - 1.0).max(), np.nanmax(data.condition.values) - 1.0
    turned = data.sizes["time"] * data.time_step / (2.0 * math.pi)
    return Finding(
        agrees=bool(off < ROUNDING and worst < ROUNDING),
        sentence=(
            f"The path is the circle of 1 m about the AUV to {off:.0e} m over {turned:.1f} turns, "
            f"and κ(J) = 1 to {worst:.0e}."
        ),
    )


def compute_classes(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure 5.2: obtuse, right and acute."""
    return fly(
        scenario("fixed-auv", "path-inertia", "planner.gamma=0.0", "duration=40.0"),
        [pose(1.0, 0.0, 45.0), pose(1.0, 0.0, 90.0), pose(2.0, 0.0, 120.0)],
    )


def draw_classes(data: "xr.Dataset") -> Figure:
    """A panel for each class."""
    figure, axes = panels(data.sizes["start"])
    for i, (kind, one) in enumerate(zip(classes(data), axes, strict=True)):
        draw_tracks(one, data.isel(start=[i]), [CLASS_COLOURS[kind]])
        one.set_title(f"({'abc'[i]}) {CLASS_NAMES[kind]}")
    return figure


def classes(data: "xr.Dataset") -> list[claims.Class]:
    """Class of each start by its s."""
    return [claims.initial_class(s) for s, _ in first_offsets(data)]


def found_classes(data: "xr.Dataset") -> Finding:
    """Outward for ever; round and round; in, past and out."""
    d = first_distance(data)
    grows, stays = (np.diff(d[0]) > 0).all(), np.ptp(d[1])
    passes = claims.is_monotone(d[2], -1.0, slack=0.0)
    return Finding(
        agrees=bool(grows and stays < ROUNDING and passes and d[2].min() < NEAR),
        sentence=(
            f"Obtuse: the distance {'grows at every step' if grows else 'does not only grow'}, to "
            f"{d[0, -1]:.1f} m after {data.time[-1]:.0f} s. Right: it stays {d[1, 0]:.0f} m to "
            f"{stays:.0e} m. Acute: it falls to {d[2].min():.3f} m and "
            f"{'only grows' if passes else 'does not only grow'} after that."
        ),
    )


def compute_random(*, runs: int, seed: int) -> "xr.Dataset":
    """Figure 5.3."""
    return fly(
        scenario("fixed-auv", "path-inertia", "planner.gamma=0.0", "duration=100.0"),
        random_starts(min(runs, STARTS), seed, HALF_WIDTH),
    )


def draw_random(data: "xr.Dataset") -> Figure:
    """All paths, and all distances, coloured by class."""
    figure, axes = panels(2, width=5.0, height=4.5)
    colours = [CLASS_COLOURS[kind] for kind in classes(data)]
    draw_tracks(axes[0], data, colours, lw=0.6)
    axes[0].set_title("(a) paths of the aid vehicle")
    draw_over_time(axes[1], data, "distance", "Distance [m]", colours)
    axes[1].set_title("(b) distance to the AUV")
    for kind in ("outward", "inward"):
        axes[1].plot([], [], color=CLASS_COLOURS[kind], label=CLASS_NAMES[kind])
    axes[1].legend(loc="upper left")
    return figure


def found_random(data: "xr.Dataset") -> Finding:
    """Every start behaves as its class says; closed forms are met to the time step's error."""
    d, starts = first_distance(data), first_offsets(data)
    monotone = sum(claims.is_monotone(d[i], s, slack=0.0) for i, (s, _) in enumerate(starts))
    last = d.shape[1] - 1
    passed = [i for i, (s, _) in enumerate(starts) if s < 0 and d[i].argmin() < last]
    expected = np.array([claims.nearest_pass(*starts[i], data.min_turn_radius) for i in passed])
    nearest = d[passed].min(axis=1)
    through = expected == 0.0
    inward = sum(s < 0 for s, _ in starts)
    fallen = nearest[through].max(initial=0.0)
    farthest = nearest.max(initial=0.0)
    misfit = np.abs(nearest - expected).max(initial=0.0)
    radius = data.min_turn_radius
    return Finding(
        agrees=None if monotone == len(starts) and fallen < NEAR else False,
        sentence=(
            f"The distance is monotone as claimed, at every step, in {monotone} of {len(starts)} "
            f"random starts, {len(starts) - inward} outward and {inward} inward. {through.sum()} "
            f"of the {len(passed)} inward ones that arrive within {data.time[-1]:.0f} s fall to "
            f"{fallen:.3f} m or less; the others do not fall to zero: a start with |s| < "
            f"{radius:g} m passes at {radius:g} m - |s|, here up to {farthest:.2f} m (closed form "
            f"met to {misfit:.2f} m). From d² = d0² + 2Vs0t, the limit of short steps, the "
            f"distance differs by {involute_error(data):.2f} m at most at {data.time_step:g} s a "
            "step."
        ),
    )


def involute_error(data: "xr.Dataset") -> float:
    """Greatest difference [m] from the closed form, while it holds, of starts outside the clip."""
    error, time = 0.0, data.time.values
    for d, (s, b) in zip(first_distance(data), first_offsets(data), strict=True):
        holds = time < claims.unclipped(s, b, data.min_turn_radius, data.speed)
        if abs(b) >= data.min_turn_radius:
            apart = np.abs(d - claims.involute_distance(time, s, b, data.speed))
            error = max(error, apart[holds].max(initial=0.0))
    return float(error)


ITEMS = (
    Item(
        name="fig5.1",
        title="Path inertia, from the analytic solution's start",
        claim=(
            "From (1, 0), heading +y, the path agrees with the analytic circle, and the condition "
            "number stays at its minimum, one."
        ),
        compute=compute_circle,
        draw=draw_circle,
        found=found_circle,
    ),
    Item(
        name="fig5.2",
        title="Path inertia: the three kinds of path",
        claim=(
            "An obtuse angle between heading and ray to the AUV gives an outward spiral, a right "
            "one a circle, an acute one a fall toward the AUV and an outward spiral after it."
        ),
        compute=compute_classes,
        draw=draw_classes,
        found=found_classes,
    ),
    Item(
        name="fig5.3",
        title="Path inertia, 50 random starts",
        claim=(
            "If the distance grows at first, it grows monotonically; if it falls at first, it "
            "falls to zero or very near, and grows monotonically from there."
        ),
        compute=compute_random,
        draw=draw_random,
        found=found_random,
    ),
)
