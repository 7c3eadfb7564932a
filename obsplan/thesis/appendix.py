"""Figures B.1 to B.8: one mission of each policy, slow and fast, as in the thesis's Appendix B."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsplan.report.style import AID, colour, time_axis
from obsplan.run import Run
from obsplan.scenario import Scenario
from obsplan.simulation import ClosedLoop, simulate
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.montecarlo import is_mirrored
from obsplan.thesis.tables import LOST, THESIS, policies

if TYPE_CHECKING:
    import xarray as xr

SAMPLING = 0.2  # [s] between the samples kept
TRIALS = 20  # seeds looked through for the image that the thesis shows
FOLLOWS = 5.0  # greatest distance [m] of an aid vehicle that follows the AUV
# between the AUV's course and the line of sight: motion nearly through the beacon
ALIGNED = np.deg2rad(20.0)
BEGINNING = 120.0  # [s]; the filter has settled by then
SIMILAR = 1.5  # ratio of errors up to which two policies perform alike


def compute(name: str, policy: str, *, runs: int, seed: int) -> "xr.Dataset":  # noqa: ARG001
    """Fly one survey under one policy, and under all others for comparison of their RMS errors."""
    scenarios = policies(name, printed=False)
    flown = {label: simulate(scenario, seed=seed) for label, scenario in scenarios.items()}
    rms = {label: run.rms_error for label, run in flown.items()}
    shown = as_shown(name, scenarios[policy], seed) if policy == "Stationary" else flown[policy]
    return (
        recorded(shown)
        .assign(policy_rms=("policy", list(rms.values()), {"units": "m"}))
        .assign_coords(policy=list(rms))
    )


def as_shown(name: str, scenario: Scenario, seed: int) -> Run:
    """The first seed, from one on, whose filter locks on what the thesis's did.

    That is the AUV or its image. If none does, it is the last seed tried.
    """
    wanted = THESIS[name]["Stationary"][0] > LOST
    loop = ClosedLoop(scenario=scenario, planner=scenario.planner())
    runs = (loop.fly(seed + k) for k in range(TRIALS))
    return next((run for run in runs if is_mirrored(run) == wanted), loop.fly(seed + TRIALS - 1))


def recorded(run: Run) -> "xr.Dataset":
    """Tracks, estimates and standard deviations of a run's only AUV, once a second."""
    import xarray as xr

    every = slice(None, None, round(SAMPLING / run.scenario.table.time_step))
    truth, mean, P = run.true[0, every], run.mean[0, every], run.covariance[0, every]
    columns = {
        "cna_x": (run.cna[every, 0], "m"),
        "cna_y": (run.cna[every, 1], "m"),
        "auv_x": (truth[:, 0], "m"),
        "auv_y": (truth[:, 1], "m"),
        "estimate_x": (mean[:, 0], "m"),
        "estimate_y": (mean[:, 1], "m"),
        "sigma_x": (np.sqrt(P[:, 0, 0]), "m"),
        "sigma_y": (np.sqrt(P[:, 1, 1]), "m"),
        "heading": (truth[:, 2], "rad"),
        "speed": (truth[:, 3], "m s-1"),
        "speed_estimate": (mean[:, 3], "m s-1"),
    }
    return xr.Dataset(
        {key: ("time", values, {"units": unit}) for key, (values, unit) in columns.items()},
        coords={"time": ("time", run.time[every], {"units": "s"})},
        attrs={
            "rms_error": run.rms_error,
            "max_error": run.max_error,
            "mirrored": int(is_mirrored(run)),
            "seed": run.seed,
        },
    )


def draw(data: "xr.Dataset") -> Figure:
    """(a) tracks, (b) the estimate, (c), (d) errors east and north with three deviations."""
    figure = Figure(figsize=(11.0, 7.2), layout="constrained")
    (tracks, estimate), (east, north) = figure.subplots(2, 2, height_ratios=(1.5, 1.0))
    _draw_map(tracks, data, (("auv", "AUV", colour(0)), ("cna", "aid vehicle", AID)), "(a) tracks")
    _draw_map(
        estimate,
        data,
        (("auv", "AUV", colour(0)), ("estimate", "estimate", colour(1))),
        "(b) estimated track",
    )
    for axes, axis, label in ((east, "x", "(c) east"), (north, "y", "(d) north")):
        _draw_error(axes, data, axis, label)
    return figure


def _draw_map(
    axes: Axes, data: "xr.Dataset", drawn: tuple[tuple[str, str, str], ...], title: str
) -> None:
    for prefix, label, paint in drawn:
        x, y = data[f"{prefix}_x"].values, data[f"{prefix}_y"].values
        moves = bool(np.ptp(x) + np.ptp(y) > 0)
        axes.plot(
            x,
            y,
            color=paint,
            lw=0.9 if moves else 0.0,
            marker="" if moves else "o",
            ms=6,
            label=label,
        )
    axes.set(xlabel="East [m]", ylabel="North [m]", title=title)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=8, loc="upper right")


def _draw_error(axes: Axes, data: "xr.Dataset", axis: str, label: str) -> None:
    time, text = time_axis(data.time.values)
    error, band = data[f"estimate_{axis}"] - data[f"auv_{axis}"], 3.0 * data[f"sigma_{axis}"]
    axes.fill_between(time, -band, band, color=colour(1), alpha=0.2, lw=0, label="±3σ")
    axes.plot(time, error, color=colour(1), lw=0.9)
    highest = 1.1 * max(float(np.abs(error).max()), float(np.quantile(band, 0.98)))
    axes.set(
        xlabel=text,
        ylabel="Error [m]",
        title=label,
        ylim=(-highest, highest),
        xlim=(time[0], time[-1]),
    )
    axes.legend(fontsize=8, loc="upper right")


def encirclements(data: "xr.Dataset") -> float:
    """How many turns about the AUV the aid vehicle makes, to the left and to the right."""
    bearing = np.unwrap(np.arctan2(data.cna_y - data.auv_y, data.cna_x - data.auv_x))
    return float(np.abs(np.diff(bearing)).sum() / (2.0 * np.pi))


def separation(data: "xr.Dataset") -> np.ndarray:
    """Distance between the vehicles [m]."""
    return np.hypot(data.cna_x.values - data.auv_x.values, data.cna_y.values - data.auv_y.values)


def aligned_share(data: "xr.Dataset") -> float:
    """Share of the mission's first third in which the AUV moves nearly along the line of sight."""
    third = slice(0, data.sizes["time"] // 3)
    sight = np.arctan2(data.cna_y - data.auv_y, data.cna_x - data.auv_x)
    return float((np.abs(np.sin((sight - data.heading).values[third])) < np.sin(ALIGNED)).mean())


def along_and_across(data: "xr.Dataset") -> tuple[float, float]:
    """Mean standard deviation [m] along and across the AUV's course, without the first minutes."""
    vertical = np.abs(np.sin(data.heading.values)) > np.sin(np.pi / 4)
    along = np.where(vertical, data.sigma_y.values, data.sigma_x.values)[
        data.time.values > BEGINNING
    ]
    across = np.where(vertical, data.sigma_x.values, data.sigma_y.values)[
        data.time.values > BEGINNING
    ]
    return float(along.mean()), float(across.mean())


def performance(name: str, policy: str, data: "xr.Dataset") -> str:
    """Our and the thesis's error."""
    rms, most = THESIS[name][policy]
    ours = f"RMS error {data.rms_error:.2f} m, greatest {data.max_error:.1f} m"
    return f"{ours} (thesis {rms:g} and {most:g} m)"


def found_circle(name: str, data: "xr.Dataset") -> Finding:
    """Poor: drift, speed estimate overshooting."""
    overshoot = float((data.speed_estimate / data.speed).max())
    return Finding(
        agrees=data.rms_error > LOST,
        sentence=(
            f"{performance(name, 'Circular', data)}. With our noise the filter does not drift "
            "away. Of the causes the thesis gives, the AUV moves within 20° of the line of sight "
            f"{aligned_share(data):.0%} of the first third, and the speed estimate, which starts "
            f"at 0, overshoots to {overshoot:.1f} times the speed before it comes back."
        ),
    )


def found_stationary(name: str, data: "xr.Dataset") -> Finding:
    """Locked on the truth or on its image."""
    expected = THESIS[name]["Stationary"][0] > LOST
    end = float((data.speed_estimate[-1] / data.speed[-1]).item())
    state = (
        "the point reflection about the aid vehicle, whose ranges and headings are the same"
        if data.mirrored
        else "the truth"
    )
    return Finding(
        agrees=bool(data.mirrored) == expected,
        sentence=(
            f"{performance(name, 'Stationary', data)}. With seed {data.seed}, the first that "
            f"shows it, the filter locks on {state} (speed estimate {end:+.2f} times the speed at "
            "the end). Which of the two it is depends on the noise of the first ranges, fast or "
            "slow: see table5.1 and table5.2."
        ),
    )


def found_follower(name: str, policy: str, data: "xr.Dataset") -> Finding:
    """Follows or encircles; uncertainty comes and goes with the AUV's turns."""
    far, rounds, (along, across) = (
        separation(data).max(),
        encirclements(data),
        along_and_across(data),
    )
    rms = dict(zip(data.policy.values, data.policy_rms.values, strict=True))
    other = "Path Inertia" if policy == "Empirical Gramian" else "Empirical Gramian"
    ratio = rms[policy] / rms[other]
    close = bool(far < FOLLOWS and data.rms_error < LOST)
    claimed = {
        ("survey-slow", "Path Inertia"): close,
        ("survey-slow", "Empirical Gramian"): bool(ratio > SIMILAR),
        ("survey-fast", "Path Inertia"): close and rounds > 10.0,
        ("survey-fast", "Empirical Gramian"): close and 1.0 / SIMILAR < ratio < SIMILAR,
    }[name, policy]
    return Finding(
        agrees=bool(claimed),
        sentence=(
            f"{performance(name, policy, data)}. The aid vehicle stays within {far:.1f} m of the "
            f"AUV and goes round it {rounds:.0f} times. The filter's σ is {along:.2f} m along the "
            f"AUV's course and {across:.2f} m across, so that each turn of the survey exchanges "
            f"east and north. The error is {ratio:.2f} times that of the {other} method."
        ),
    )


def item(
    number: int, name: str, policy: str, found: Callable[["xr.Dataset"], Finding], claim: str
) -> Item:
    """One figure of the appendix."""
    pace = "slow" if name == "survey-slow" else "fast"
    return Item(
        name=f"figB.{number}",
        title=f"Localization, {pace} aid vehicle: {policy}",
        claim=claim,
        compute=partial(compute, name, policy),
        draw=draw,
        found=found,
    )


SLOW, FAST = "survey-slow", "survey-fast"
ITEMS = (
    item(
        1,
        SLOW,
        "Circular",
        partial(found_circle, SLOW),
        "Very poor, with a large drift that begins while the AUV moves along the line of sight.",
    ),
    item(
        2,
        SLOW,
        "Stationary",
        partial(found_stationary, SLOW),
        "The survey moves enough for the filter to lock on to the AUV's position.",
    ),
    item(
        3,
        SLOW,
        "Path Inertia",
        partial(found_follower, SLOW, "Path Inertia"),
        (
            "The path essentially follows the AUV; the uncertainty in x and y grows and shrinks "
            "as the AUV turns, the error does not."
        ),
    ),
    item(
        4,
        SLOW,
        "Empirical Gramian",
        partial(found_follower, SLOW, "Empirical Gramian"),
        "An unintuitive path; the method may suffer where the AUV is as fast as the aid vehicle.",
    ),
    item(
        5,
        FAST,
        "Circular",
        partial(found_circle, FAST),
        "Very poor, worse than slow: an inflated speed estimate causes a large excursion.",
    ),
    item(
        6,
        FAST,
        "Stationary",
        partial(found_stationary, FAST),
        "The filter locks on an incorrect estimate that mirrors the position.",
    ),
    item(
        7,
        FAST,
        "Path Inertia",
        partial(found_follower, FAST, "Path Inertia"),
        (
            "The path follows the AUV, encircling it repeatedly; the uncertainty in x and y grows "
            "and shrinks as the AUV turns."
        ),
    ),
    item(
        8,
        FAST,
        "Empirical Gramian",
        partial(found_follower, FAST, "Empirical Gramian"),
        "A path, and an error, similar to path inertia's.",
    ),
)
