"""One plain sentence per AUV: how well it knows where it is, and what to mistrust."""

from typing import Any

import numpy as np
from jaxtyping import Float

from formulations.solution import Status
from obsplan.report.words import metres, moment, percent
from obsplan.run import Run

OVERCONFIDENT, CAUTIOUS = (
    4.0,
    0.5,
)  # mean NEES, 2 if consistent: errors sqrt(2) times, or half, what the filter states
INSIDE = 5.991  # NEES on the 95 % ellipse: chi-square with 2 degrees
LOST = 5.0  # [σ] median error in the second half of the mission
AGREE = 0.2  # of the median error: a distance so much smaller explains it
STRAIGHT = 0.05  # of the mean separation: a track so narrow looks straight
FARTHEST = 2500.0  # [m], reach of the acoustic modems in use


def verdicts(run: Run) -> list[str]:
    """Say for each AUV how well it knows its position, whether its filter knows that, and whether it could be fooled.

    ``overconfident`` is a mean NEES above 4, ``cautious`` one below 0.5, where 2 is expected. Lost is a median error above 5σ in the second
    half of the mission.
    """
    figures = run.summary()["auv"]
    return [sentence(run, i, figures[name]) for i, name in enumerate(run.names)]


def planner_notes(run: Run) -> list[str]:
    """Say which decisions were not the optimum of what was asked, and what to do about it."""
    total = sum(run.status_counts.values())
    odd = [
        status
        for status in Status
        if status not in (Status.OPTIMAL, Status.CLIPPED) and status.label in run.status_counts
    ]
    return [
        f"{run.planner}: {run.status_counts[s.label]} of {total} decisions {s.label}: {s.advice}."
        for s in odd
    ]


def sentence(run: Run, i: int, figures: dict[str, Any]) -> str:
    """The verdict on one AUV, from its figures of merit."""
    failed = np.flatnonzero(~np.isfinite(run.error[i]))
    if failed.size:
        return f"{run.names[i]}: position lost {moment(run, int(failed[0]))}, where the filter's estimate stopped being a number."
    worst = f"worst {metres(figures['max_error_m'])}, {moment(run, int(run.error[i].argmax()))}"
    if is_lost(run, i):
        return f"{run.names[i]}: position lost, {metres(figures['rms_error_m'])} RMS off ({worst}); {explain_loss(run, i)}."
    clauses = [
        f"position known to {metres(figures['rms_error_m'])} RMS ({worst}){_against_bound(figures)}",
        _consistency(run.nees[i], figures["mean_nees"]),
        _ambiguity(run, i),
        _reach(figures["separation_max_m"]),
    ]
    return f"{run.names[i]}: {'; '.join(clause for clause in clauses if clause)}."


def is_lost(run: Run, i: int) -> bool:
    """Whether the error exceeds all that the filter allows for, through most of the second half of the mission."""
    late = slice(run.time.size // 2, None)
    sigma = np.sqrt(run.covariance[i, late, 0, 0] + run.covariance[i, late, 1, 1])
    return bool(np.median(run.error[i, late]) > LOST * np.median(sigma))


def explain_loss(run: Run, i: int) -> str:
    """Why an AUV is lost: its ranges fit its position, its mirror image's, or nothing at all."""
    late = slice(run.time.size // 2, None)
    truth, mean, cna = run.truth[i, late, :2], run.mean[i, late, :2], run.cna[late, :2]
    tolerance = AGREE * float(np.median(run.error[i, late]))
    misfit = np.abs(np.hypot(*(mean - cna).T) - np.hypot(*(truth - cna).T))
    if np.median(misfit) > tolerance:
        return "the filter has diverged: give it a better first estimate or more process noise"
    images = (2.0 * cna - truth, mirror(truth, run.cna[:, :2]))
    if any(np.median(np.hypot(*(mean - image).T)) < tolerance for image in images):
        return (
            "the filter is locked on a mirror image, whose ranges are the same: "
            "a straight or stationary aid vehicle cannot tell it apart"
        )
    return "the ranges fit although the position does not: give it a better first estimate, or an aid vehicle that goes round it"


def mirror(
    points: Float[np.ndarray, "n 2"], path: Float[np.ndarray, "samples 2"]
) -> Float[np.ndarray, "n 2"]:
    """Reflect points across the line that fits a path best."""
    center = path.mean(axis=0)
    along = np.linalg.svd(path - center, full_matrices=False)[2][0]
    offset = points - center
    return center + 2.0 * (offset @ along)[:, None] * along - offset


def _against_bound(figures: dict[str, Any]) -> str:
    """The error beside the Cramér-Rao bound of this path, and that beside the least bound of any path."""
    pcrb, least = figures["pcrb_rms_m"], figures.get("bound_rms_m")
    if not pcrb:
        return ""
    ratio = figures["rms_error_m"] / pcrb
    this = f"{ratio:.1f} times its" if ratio > 1 else "below its average"
    any_path = (
        f", which no path brings below {metres(least)} (efficiency {percent(least / pcrb)})"
        if least
        else ""
    )
    return f", {this} Cramér–Rao bound of {metres(pcrb)}{any_path}"


def _consistency(nees: Float[np.ndarray, " samples"], mean: float | None) -> str:
    if mean is None:
        return ""
    word = (
        "overconfident" if mean > OVERCONFIDENT else "cautious" if mean < CAUTIOUS else "consistent"
    )
    inside = float(np.mean(nees[np.isfinite(nees)] <= INSIDE))
    return f"filter {word} (NEES {mean:.3g} where 2 is expected, inside its 95 % ellipse {percent(inside)} of the time)"


def _ambiguity(run: Run, i: int) -> str:
    """What the aid vehicle's track, as seen from the AUV, cannot tell."""
    relative = run.cna[:, :2] - run.truth[i, :, :2]
    along = np.linalg.svd(relative - relative.mean(axis=0), full_matrices=False)[2]
    length, width = np.ptp(relative @ along.T, axis=0)
    narrow = STRAIGHT * run.separation[i].mean()
    if length < narrow:
        return "beware, the aid vehicle keeps still relative to it: ranges tell how far it is, not which way"
    if width < narrow:
        return "beware, the aid vehicle passes it on a straight line: ranges cannot tell left from right"
    return ""


def _reach(farthest: float) -> str:
    return (
        f"beware, {metres(farthest)} apart, where acoustic modems reach {metres(FARTHEST)} at best"
        if farthest > FARTHEST
        else ""
    )
