"""Figures 5.4 to 5.7: path inertia with a penalty on separation, about one AUV at rest."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from obsplan.report.style import AID, FAINT
from obsplan.thesis import claims
from obsplan.thesis.drawing import draw_over_time, draw_tracks, guide, panels
from obsplan.thesis.flights import fly, pose, random_starts, scenario
from obsplan.thesis.inertia import (
    CLASS_COLOURS,
    CLASS_NAMES,
    HALF_WIDTH,
    classes,
    first_distance,
    first_offsets,
)
from obsplan.thesis.item import Finding, Item

if TYPE_CHECKING:
    import xarray as xr

STARTS = 25  # of the thesis's second Monte Carlo experiment
GAMMAS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
LEG_START = (1.5, 0.5)  # (b, s) of Figure 5.7 [m]: outside the clip for every γ
SHORT_STEP = (
    0.02  # [s]; the closed form is the limit of short steps, and small γ is sensitive to them
)
LAST = 60.0  # [s] at the end, over which an orbit is judged: some ten petals


def compute_pivot(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure 5.4."""
    return fly(
        scenario("fixed-auv", "path-inertia", "planner.gamma=1.0", "duration=60.0"),
        [pose(1.0, 0.0, 90.0)],
    )


def draw_pivot(data: "xr.Dataset") -> Figure:
    """Path and distance, beside the analytic circle."""
    figure, axes = panels(3)
    draw_tracks(axes[0], data)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    axes[0].plot(
        np.cos(angle), np.sin(angle), color=FAINT, ls="--", lw=1.0, label="analytic circle"
    )
    draw_over_time(axes[1], data, "distance", "Distance [m]")
    guide(axes[1], 1.0, "analytic circle")
    axes[1].set_ylim(0.0, 1.3)
    draw_over_time(axes[2], data, "condition", "Predicted condition number κ(J) [-]")
    axes[2].set_ylim(bottom=0.0)
    return figure


def found_pivot(data: "xr.Dataset") -> Finding:
    """Closer on average than the circle."""
    d = first_distance(data)[0]
    bound = claims.orbit_bound(1.0, data.min_turn_radius)
    return Finding(
        agrees=bool(d.mean() < 1.0),
        sentence=(
            f"The mean distance is {d.mean():.2f} m, against 1 m on the circle: petals through "
            f"the AUV that reach {d.max():.2f} m (bound {bound:.3f} m as the time step goes to "
            f"0). κ(J) pays for it: {np.nanmean(data.condition.values):.1f} on average instead of "
            "1."
        ),
    )


def compute_two(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure 5.5."""
    return fly(
        scenario("fixed-auv", "path-inertia", "planner.gamma=1.0", "duration=80.0"),
        [pose(1.0, 0.0, 45.0), pose(2.0, 0.0, 120.0)],
    )


def draw_two(data: "xr.Dataset") -> Figure:
    """A panel for each kind, and both distances."""
    figure, axes = panels(3)
    colours = [CLASS_COLOURS[kind] for kind in classes(data)]
    for i, title in enumerate(("(a) obtuse: out, then back", "(b) acute: no leg outward")):
        draw_tracks(axes[i], data.isel(start=[i]), [colours[i]])
        axes[i].set_title(title)
    draw_over_time(axes[2], data, "distance", "Distance [m]", colours)
    guide(axes[2], claims.orbit_bound(1.0, data.min_turn_radius), "bound of the orbit")
    return figure


def found_two(data: "xr.Dataset") -> Finding:
    """The outward start goes out once; both end within the bound."""
    out, falling = first_distance(data)
    bound = claims.orbit_bound(1.0, data.min_turn_radius)
    last = data.time.values > data.time.values[-1] - LAST / 2
    grows, step = np.diff(falling)[0] > 0, data.speed * data.time_step
    leg = claims.first_turn(out)
    return Finding(
        agrees=bool(
            out[1] > out[0]
            and not grows
            and max(out[last].max(), falling[last].max()) < bound + step
        ),
        sentence=(
            f"Obtuse: out to {out[leg]:.2f} m during {data.time[leg]:.1f} s, then back. Acute: no "
            "leg outward. Both end in an orbit through or about the AUV within "
            f"{max(out[last].max(), falling[last].max()):.2f} m, the bound being {bound:.3f} m. "
            f"Its tightest curves have {1.0 / np.abs(data.turn_rate.values).max():.1f} m, the "
            "smallest turning radius."
        ),
    )


def compute_random(*, runs: int, seed: int) -> "xr.Dataset":
    """Figure 5.6."""
    setup = scenario("fixed-auv", "path-inertia", "planner.gamma=1.0", "duration=300.0")
    return fly(setup, random_starts(min(runs, STARTS), seed, HALF_WIDTH))


def draw_random(data: "xr.Dataset") -> Figure:
    """All paths, and all distances, coloured by class."""
    figure, axes = panels(2, width=5.0, height=4.5)
    colours = [CLASS_COLOURS[kind] for kind in classes(data)]
    draw_tracks(axes[0], data, colours, lw=0.6)
    axes[0].set_title("(a) paths of the aid vehicle")
    draw_over_time(axes[1], data, "distance", "Distance [m]", colours)
    axes[1].set_title("(b) distance to the AUV")
    guide(axes[1], claims.orbit_bound(1.0, data.min_turn_radius), "bound of the orbit")
    for kind in ("outward", "inward"):
        axes[1].plot([], [], color=CLASS_COLOURS[kind], label=CLASS_NAMES[kind])
    axes[1].set_ylim(top=1.25 * float(data.distance.max()))  # space for the legend
    axes[1].legend(loc="upper right")
    return figure


def settled(data: "xr.Dataset") -> np.ndarray:
    """Whether each start stays within the bound, up to a step's length, through the last minute."""
    last = data.time.values > data.time.values[-1] - LAST
    bound = claims.orbit_bound(1.0, data.min_turn_radius) + data.speed * data.time_step
    return first_distance(data)[:, last].max(axis=1) < bound


def found_random(data: "xr.Dataset") -> Finding:
    """Two classes; all that are given time settle, and the closed form tells which are."""
    d, starts, done = first_distance(data), first_offsets(data), settled(data)
    needed = np.array(
        [
            claims.capture_time(s, b, gamma=1.0, min_radius=data.min_turn_radius, speed=data.speed)
            for s, b in starts
        ]
    )
    given, kinds = needed < float(data.time[-1]) - LAST, classes(data)
    as_classed = sum((d[i, 1] > d[i, 0]) == (kind == "outward") for i, kind in enumerate(kinds))
    bound = claims.orbit_bound(1.0, data.min_turn_radius)
    last = data.time.values > data.time.values[-1] - LAST
    return Finding(
        agrees=bool(done[given].all() and as_classed == len(kinds)),
        sentence=(
            f"{as_classed} of {len(kinds)} random starts ({kinds.count('outward')} outward) begin "
            f"as their class says; {done.sum()} end in an orbit within "
            f"{d[done][:, last].max(initial=0.0):.2f} m, bounded by (r + τ)²/2τ = {bound:.3f} m. "
            f"The closed form gives {given.sum()} of them time enough in {data.time[-1]:.0f} s: "
            f"{(done & given).sum()} of these are settled, and the others need up to "
            f"{needed.max():.0f} s, as the thesis says of its one outlier."
        ),
    )


def compute_gamma(*, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Figure 5.7: the leg outward from one start for each γ, at two time steps, and the paths."""
    import xarray as xr

    b, s = LEG_START
    # (step, γ, duration | farthest)
    measured = np.array([[flown_leg(gamma, SHORT_STEP / k) for gamma in GAMMAS] for k in (1, 2)])
    exact = np.array([claims.outward_leg(s, b, gamma=gamma, speed=1.0) for gamma in GAMMAS])
    shown = [
        fly(
            scenario("fixed-auv", "path-inertia", f"planner.gamma={g}", "duration=120.0"),
            [pose(b, s, 90.0)],
        )
        for g in GAMMAS
    ]
    legs = {
        "leg_duration": (("step", "gamma"), measured[..., 0], {"units": "s"}),
        "leg_farthest": (("step", "gamma"), measured[..., 1], {"units": "m"}),
        "exact_duration": ("gamma", exact[:, 0], {"units": "s"}),
        "exact_farthest": ("gamma", exact[:, 1], {"units": "m"}),
        "step": ("step", [SHORT_STEP, SHORT_STEP / 2], {"units": "s"}),
    }
    return xr.concat(shown, dim="start").assign(legs).assign_coords(gamma=("gamma", list(GAMMAS)))


def flown_leg(gamma: float, time_step: float) -> tuple[float, float]:
    """Duration [s] and farthest distance [m] of the leg outward, as flown."""
    b, s = LEG_START
    longest = 1.5 * claims.outward_leg(s, b, gamma=gamma, speed=1.0)[0] + 1.0
    setup = scenario(
        "fixed-auv",
        "path-inertia",
        f"planner.gamma={gamma}",
        f"duration={longest}",
        time_step=time_step,
    )
    data = fly(setup, [pose(b, s, 90.0)])
    d = first_distance(data)[0]
    turn = claims.first_turn(d)
    return float(data.time[turn]), float(d[turn])


def draw_gamma(data: "xr.Dataset") -> Figure:
    """Paths for some γ, and the leg's duration and farthest distance against the closed form."""
    figure, axes = panels(3, width=4.0)
    for gamma, paint in zip(
        (0.01, 0.1, 1.0, 10.0), ("#56B4E9", "#0072B2", "#E69F00", "#D55E00"), strict=True
    ):
        draw_tracks(axes[0], data.isel(start=[GAMMAS.index(gamma)]), [paint])
        axes[0].plot([], [], color=paint, label=f"γ = {gamma:g}")
    axes[0].legend(loc="upper right", fontsize=8)
    axes[0].set_title(f"{data.time[-1]:.0f} s from the same start")
    for one, name, label in zip(
        axes[1:],
        ("duration", "farthest"),
        ("Leg outward [s]", "Farthest distance [m]"),
        strict=True,
    ):
        one.loglog(data.gamma, data[f"exact_{name}"], color=AID, lw=1.0, label="closed form")
        one.loglog(
            data.gamma,
            data[f"leg_{name}"][1],
            "o",
            ms=5,
            mfc="none",
            color="#D55E00",
            label=f"flown, {SHORT_STEP / 2:g} s steps",
        )
        one.set_xlabel("γ [-]")
        one.set_ylabel(label)
        one.legend()
    return figure


def extrapolated(data: "xr.Dataset", name: str) -> np.ndarray:
    """Richardson's limit of short steps from two of them, the error being of first order."""
    coarse, fine = data[f"leg_{name}"].values
    return 2.0 * fine - coarse


def found_gamma(data: "xr.Dataset") -> Finding:
    """The larger γ, the shorter the leg; duration and distance meet the closed form."""
    duration, exact = data.leg_duration.values[1], data.exact_duration.values
    off = [
        np.abs(extrapolated(data, name) / data[f"exact_{name}"].values - 1.0).max()
        for name in ("duration", "farthest")
    ]
    b, s = LEG_START
    limit = 2.0 * (b - 0.5) * s + 4.0 * s**3 / 3.0  # τ → 1/2 m
    falls = bool((np.diff(duration) < 0).all())
    return Finding(
        agrees=falls and max(off) < 0.05,
        sentence=(
            f"From one start the leg outward lasts {duration[0]:.0f} s at γ = {GAMMAS[0]:g}, "
            f"{duration[GAMMAS.index(1.0)]:.1f} s at 1 and {duration[-1]:.2f} s at "
            f"{GAMMAS[-1]:g}: {'shorter with every γ' if falls else 'not shorter with every γ'}. "
            f"Extrapolated to short steps, durations meet the closed form to {off[0]:.1%} and "
            f"distances to {off[1]:.1%}. As γ → 0 it grows as 4s³/(3Vγ²), without bound; as γ → ∞ "
            f"it does not vanish but goes to {limit:.2f} s ({exact[-1]:.2f} s at γ = "
            f"{GAMMAS[-1]:g})."
        ),
    )


ITEMS = (
    Item(
        name="fig5.4",
        title="Path inertia with a penalty (γ = 1), from the analytic solution's start",
        claim="The path is no longer the analytic circle, but on average closer to the AUV.",
        compute=compute_pivot,
        draw=draw_pivot,
        found=found_pivot,
    ),
    Item(
        name="fig5.5",
        title="Path inertia with a penalty (γ = 1): the two kinds of path",
        claim=(
            "An obtuse initial angle gives a period of growing separation, then a nearly steady "
            "pivoting orbit; a right or acute one the orbit without that period. The smallest "
            "curves are the smallest turning radius."
        ),
        compute=compute_two,
        draw=draw_two,
        found=found_two,
    ),
    Item(
        name="fig5.6",
        title="Path inertia with a penalty (γ = 1), 25 random starts",
        claim=(
            "All but one show the two kinds of path completely; the outlier was not given enough "
            "time."
        ),
        compute=compute_random,
        draw=draw_random,
        found=found_random,
    ),
    Item(
        name="fig5.7",
        title="Path inertia: what γ does",
        claim=(
            "Very small γ permits seemingly indefinite growth of the separation; the larger γ, "
            "the shorter the period of growth."
        ),
        compute=compute_gamma,
        draw=draw_gamma,
        found=found_gamma,
    ),
)
