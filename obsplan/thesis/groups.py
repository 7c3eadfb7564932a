"""Figures 5.8 and 5.9: path inertia with a penalty about three AUVs, at rest and under way."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from obsplan.report.style import AID, FAINT
from obsplan.scenario import Scenario
from obsplan.thesis import claims
from obsplan.thesis.drawing import draw_over_time, draw_tracks, guide, log_ticks, panels
from obsplan.thesis.flights import fly, random_starts, scenario
from obsplan.thesis.item import Finding, Item

if TYPE_CHECKING:
    import xarray as xr

STARTS = 50
HALF_WIDTH = 3.0  # of the square of random starts [m]
TURN = 60.0  # [s]; when the moving formation turns: 6 m at 0.1 m/s
SETTLED = 20.0  # [s]; by then a start abeam is in its orbit
WITH = 2.0  # [m] from the centroid: with the formation, whose AUVs are 1.2 to 1.4 m from it
ABEAM = "#0072B2"
EVEN = 1.1  # ratio of condition numbers up to which AUVs fare equally


def static_formation() -> Scenario:
    """The triangle at rest, long enough for the first leg outward to be over.

    The start heads away from the centroid.
    """
    return scenario("fixed-formation", "path-inertia", "planner.gamma=1.0", "duration=300.0")


def centroid_offset(data: "xr.Dataset") -> np.ndarray:
    """Position of the aid vehicle relative to the AUVs' centroid [m], by start, time and axis."""
    return np.stack(
        [(data.x - data.auv_x.mean("auv")).values, (data.y - data.auv_y.mean("auv")).values],
        axis=-1,
    )


def typical_condition(data: "xr.Dataset", since: float = 0.0) -> np.ndarray:
    """Geometric mean over time of the predicted condition number, by start and AUV."""
    # the last sample decides nothing
    kept = data.condition.isel(time=slice(0, -1)).values[..., data.time.values[:-1] >= since]
    return np.exp(np.log(kept).mean(axis=-1))


def compute_static(*, runs: int, seed: int) -> "xr.Dataset":
    """Figure 5.8: the thesis's start, then random ones, whose condition numbers are summed up."""
    setup = static_formation()
    shown = fly(setup, [setup.start])
    others = fly(setup, random_starts(min(runs, STARTS), seed, HALF_WIDTH))
    summary = {"other_condition": (("other", "auv"), typical_condition(others), {"units": "1"})}
    return shown.assign(summary)


def draw_static(data: "xr.Dataset") -> Figure:
    """Path, distance to the centroid, and condition numbers."""
    figure, axes = panels(3, width=4.0)
    draw_tracks(axes[0], data, lw=0.6)
    axes[0].legend(loc="upper left", fontsize=8)
    away = np.hypot(*np.moveaxis(centroid_offset(data)[0], -1, 0))
    axes[1].plot(data.time, away, color="#333333", lw=0.7)
    guide(
        axes[1], claims.orbit_bound(1.0, data.min_turn_radius), "bound of the orbit about one AUV"
    )
    axes[1].set(xlabel="Time [s]", ylabel="Distance to the centroid [m]")
    draw_over_time(axes[2], data, "condition", "Predicted condition number κ(J) [-]")
    log_ticks(axes[2], "y")
    return figure


def found_static(data: "xr.Dataset") -> Finding:
    """About the centroid; not equally good for all."""
    names = [str(name) for name in data.auv.values]
    condition = typical_condition(data)[0]
    others = data.other_condition.values
    away = np.hypot(*np.moveaxis(centroid_offset(data)[0], -1, 0))
    last = data.time.values > data.time.values[-1] - 60.0
    best = names[int(condition.argmin())]
    uneven = others.max(axis=1) / others.min(axis=1)
    shares = ", ".join(
        f"{name} in {np.mean(others.argmin(axis=1) == i):.0%}" for i, name in enumerate(names)
    )
    kappas = ", ".join(
        f"{value:.1f} ({name})" for name, value in zip(names, condition, strict=True)
    )
    return Finding(
        agrees=bool(
            away[last].max() < 2 * claims.orbit_bound(1.0, data.min_turn_radius)
            and (uneven > EVEN).mean() > 0.5
        ),
        sentence=(
            f"The path is that about a single AUV at the centroid: out to {away.max():.1f} m, "
            "since the start heads straight away from it, and from then on within "
            f"{away[last].max():.2f} m. Equal weights are not equal performance: κ(J) is "
            f"{kappas}, "
            f"the best for {best}. Which one that is depends on the start: of {len(others)} "
            f"random ones {shares}; the worst κ is {np.median(uneven):.1f} times the best "
            f"(median), and over {EVEN} times in {np.mean(uneven > EVEN):.0%}."
        ),
    )


def compute_mobile(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure 5.9: from the thesis's start, and from the same place with the formation abeam."""
    setup = scenario("mobile-formation", "path-inertia", "planner.gamma=1.0")
    return fly(setup, [setup.start, replace(setup.start, heading=np.pi)])


def draw_mobile(data: "xr.Dataset") -> Figure:
    """Paths, and distances to the centroid."""
    figure, axes = panels(3, width=4.0)
    colours = (AID, ABEAM)
    for i, (title, paint) in enumerate(
        zip(
            ("(a) the thesis's start, heading +y", "(b) heading -x: formation abeam"),
            colours,
            strict=True,
        )
    ):
        one = data.isel(start=[i])
        draw_tracks(axes[i], one, [paint], lw=0.7)
        axes[i].plot(
            one.auv_x.mean("auv")[0],
            one.auv_y.mean("auv")[0],
            color="black",
            ls=":",
            lw=1.2,
            label="centroid",
            zorder=5,
        )
        axes[i].set_title(title)
        axes[2].plot(
            data.time,
            np.hypot(*np.moveaxis(centroid_offset(data)[i], -1, 0)),
            color=paint,
            lw=0.8,
            label=title[:3],
        )
    axes[0].legend(loc="upper left", fontsize=8)
    axes[2].axvline(TURN, color=FAINT, lw=1.0, ls="--")
    axes[2].set(
        xlabel="Time [s] (dashed: the formation turns)",
        ylabel="Distance to the centroid [m]",
        ylim=(0.0, None),
    )
    axes[2].legend()
    return figure


def found_mobile(data: "xr.Dataset") -> Finding:
    """It keeps with the centroid on both legs."""
    offset, time = centroid_offset(data), data.time.values
    away = np.hypot(*np.moveaxis(offset, -1, 0))
    legs = (time > SETTLED) & (time < TURN), time >= TURN
    mean = [float(np.hypot(*offset[1, leg].mean(axis=0))) for leg in legs]
    most = [float(away[1, leg].max()) for leg in legs]
    back = time[np.flatnonzero(away[0] > WITH)[-1]]
    return Finding(
        agrees=bool(max(most) < WITH and away[0, -1] < WITH),
        sentence=(
            "With the formation abeam at the start the path pivots about the moving centroid: on "
            f"average {mean[0]:.2f} m off it while it goes north and {mean[1]:.2f} m after the "
            f"turn, {max(most):.2f} m at most. From the thesis's start, which in our triangle "
            f"heads straight away from the centroid, a leg outward to {away[0].max():.1f} m comes "
            f"first; it is back after {back:.0f} s, and the formation's turn does not disturb it."
        ),
    )


ITEMS = (
    Item(
        name="fig5.8",
        title="Path inertia with a penalty (γ = 1), three AUVs at rest",
        claim=(
            "The path favours no AUV and acts about the centroid, but the condition numbers are "
            "best for one of them (lower right): equal weights do not give equal performance."
        ),
        compute=compute_static,
        draw=draw_static,
        found=found_static,
    ),
    Item(
        name="fig5.9",
        title="Path inertia with a penalty (γ = 1), three AUVs under way",
        claim=(
            "While the formation goes north, and then 45° to the right, the path keeps its "
            "typical behaviour about the moving centroid."
        ),
        compute=compute_mobile,
        draw=draw_mobile,
        found=found_mobile,
    ),
)
