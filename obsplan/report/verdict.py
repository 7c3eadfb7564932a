"""One plain sentence per AUV: how well it knows where it is, and what to mistrust."""

from typing import Any

import numpy as np
from jaxtyping import Float

from formulations.consistency import mean_interval
from formulations.solution import Status
from obsplan.constraints import LimitHistory
from obsplan.report.words import (
    NO_BOUND,
    after,
    capital,
    clock,
    limit_name,
    metres,
    moment,
    percent,
)
from obsplan.run import Run
from obsplan.scenario.states import BASIC
from obsplan.scenario.tables import aids_of

TELLING = 4.0  # mean NEES, 2 if consistent, of errors sqrt(2) times too large: to be told apart
INSIDE = 5.991  # NEES on the 95 % ellipse: chi-square with 2 degrees
OWN = (Status.OPTIMAL, Status.CLIPPED, Status.INACCURATE, Status.RESTARTED, Status.SECOND_SOLVER)
STRONG = 0.25  # of the aid vehicle's speed: a current that is felt
LOST = 5.0  # [σ] median error in the second half of the mission
AGREE = 0.2  # of the median error: a distance so much smaller explains it
ASTRAY = 2.0  # times what an AUV is known to be within: an error that says it is not known at all
FOUND = 0.1  # of the same: a median error in the second half that says it has become known
TOLD = 0.98  # of the variance of dead reckoning: what ranges leave if they tell next to nothing
STRAIGHT = 0.05  # of the mean separation: a track so narrow looks straight
FARTHEST = 2500.0  # [m], reach of the acoustic modems in use


def verdicts(run: Run) -> list[str]:
    """Say for each AUV how well it knows its position, and whether its filter knows that.

    The verdict also says whether the filter could be fooled. A filter is ``overconfident`` or
    ``cautious`` where its mean NEES is above or below the 95 % chi-square interval of as many
    independent errors as the run is worth (`Run.independent_errors`), and consistent within it.
    The errors are too few to tell where even errors sqrt(2) times too large (a mean NEES of 4)
    would be within it, too. Lost is a median error above 5σ in the second half of the mission.
    """
    figures = run.summary()["auv"]
    return [sentence(run, i, figures[name]) for i, name in enumerate(run.names)]


def limit_notes(run: Run) -> list[str]:
    """Say of each limit broken by how much, when and where; if none was, which was the closest."""
    if not run.limits:
        return []
    broken = [limit for limit in run.limits if limit.broken.any()]
    if broken:
        return [_breach(run, limit) for limit in broken]
    nearest = max(run.limits, key=lambda limit: limit.violation.max())
    spare = metres(max(-float(nearest.violation.max()), 0.0))
    return [
        f"No limit was broken; the closest was {limit_name(nearest)}, "
        f"with {spare} to spare {_place(run, nearest)}."
    ]


def _breach(run: Run, limit: LimitHistory) -> str:
    most, step = metres(float(limit.violation.max())), run.scenario.table.time_step
    lasted = clock(run, step * np.count_nonzero(limit.broken))
    where = _place(run, limit)
    return f"{capital(limit_name(limit))} was broken by up to {most} {where}, for {lasted} in all."


def _place(run: Run, limit: LimitHistory) -> str:
    """When and where the aid vehicle was that broke a limit most, or came nearest to that."""
    k = limit.worst
    x, y = run.aids[limit.aid].pose[k, :2]
    return f"{after(run, k)} (aid vehicle at east {x:.1f} m, north {y:.1f} m)"


def planner_notes(run: Run) -> list[str]:
    """Say which decisions were not the optimum of what was asked, and what to do about it.

    Say also what planners know of one's own classes.
    """
    total = sum(run.status_counts.values())
    odd = [
        status
        for status in Status
        if status not in (Status.OPTIMAL, Status.CLIPPED) and status.label in run.status_counts
    ]
    decisions = [
        f"{run.planner}: {run.status_counts[s.label]} of {total} decisions {s.label}: {s.advice}."
        + (f" {capital(run.faults[s.label]).rstrip('.')}." if s.label in run.faults else "")
        for s in odd
    ]
    own = sum(run.status_counts.get(status.label, 0) for status in OWN)
    if total and not own:
        decisions.append(
            f"Not one of its {total} decisions is what {run.planner} was asked for: the path says "
            "nothing of this planner."
        )
    return [*decisions, *_current_notes(run), *_own_notes(run)]


def _current_notes(run: Run) -> list[str]:
    """What is taken for granted of vehicles in a current that is strong for them."""
    scenario = run.scenario
    current = float(scenario.water.strongest(0.0))
    steered = [aid.speed for aid in aids_of(scenario.table) if not aid.carried]
    speed = min(steered, default=np.inf)
    notes = []
    if current > STRONG * speed:
        notes.append(
            f"The aid vehicle is taken to hold its track over ground: against the current of "
            f"{current:g} m/s that takes up to {speed + current:g} m/s through the water."
        )
    strongest = np.hypot(*np.moveaxis(scenario.currents, -1, 0)).max(axis=0).tolist()
    for name, reference, current in zip(run.names, scenario.references, strongest, strict=True):
        keeps = len(reference.polyline) == 1 or (
            reference.hold is not None and reference.hold.any()
        )
        if keeps and reference.speed is not None and np.max(reference.speed) < current:
            notes.append(
                f"{name} keeps station in a current of {current:g} m/s, which takes that speed "
                f"through the water, and not the {np.max(reference.speed):g} m/s it is given."
            )
    return notes


def _own_notes(run: Run) -> list[str]:
    """What planners and bounds take for granted of ranges and states that are a user's own."""
    scenario, notes = run.scenario, []
    if not run.bounded:
        notes.append(NO_BOUND)
    elif run.unbounded and scenario.pings.size:
        unit = "m^2" if scenario.ranging_kind == "squared-range" else "m"
        sigma = f"{scenario.range_sensor.sigma:g} {unit}"
        notes.append(f"Planners count on ranges that err by {sigma} everywhere; {run.unbounded}.")
    states = [*scenario.filter_states]
    if len(states) > BASIC:
        own = ", ".join(states[BASIC:])
        notes.append(f"Planners know nothing of {own}: they see the other states as estimated.")
    return notes


def sentence(run: Run, i: int, figures: dict[str, Any]) -> str:
    """The verdict on one AUV, from its figures of merit."""
    failed = np.flatnonzero(~np.isfinite(run.error[i]))
    if failed.size:
        when = moment(run, int(failed[0]))
        why = "where the filter's estimate stopped being a number"
        return f"{run.names[i]}: position lost {when}, {why}."
    if not run.scenario.pings.size:
        return _unmeasured(run, i, figures)
    worst = f"worst {metres(figures['max_error_m'])}, {moment(run, int(run.error[i].argmax()))}"
    if is_lost(run, i):
        lost = f"position lost, {metres(figures['rms_error_m'])} RMS off ({worst})"
        return f"{run.names[i]}: {lost}; {explain_loss(run, i)}."
    if np.sqrt(np.mean(run.error[i] ** 2)) > ASTRAY * whereabouts(run, i):
        return _astray(run, i, worst)
    untold = _untold(run, i)
    clauses = [
        (
            f"position known to {metres(figures['rms_error_m'])} RMS "
            f"({worst}){'' if untold else _against_bound(figures)}"
        ),
        _consistency(run.nees[i], figures["mean_nees"], float(run.independent_errors[i])),
        untold,
        _ambiguity(run, i),
        _reach(float(run.separation[i].min()), figures["separation_max_m"]),
    ]
    return f"{run.names[i]}: {'; '.join(clause for clause in clauses if clause)}."


def _unmeasured(run: Run, i: int, figures: dict[str, Any]) -> str:
    """The verdict on an AUV that no range has reached."""
    interval, duration = run.scenario.table.ranging.interval, float(run.time[-1])
    return (
        f"{run.names[i]}: not one range was measured (ranging.interval = {interval:.10g} s, in a "
        f"mission of {duration:.10g} s): dead reckoning alone, "
        f"{metres(figures['rms_error_m'])} RMS off, whatever the aid vehicle does."
    )


def whereabouts(run: Run, i: int) -> float:
    """Size [m] of what an AUV is known to be in before anything is measured.

    It is its own track, or its greatest distance from the aid vehicle.
    """
    extent = np.hypot(*np.ptp(run.truth[i, :, :2], axis=0))
    return float(max(extent, run.separation[i].max()))


def _astray(run: Run, i: int, worst: str) -> str:
    """The verdict on an AUV whose error is greater than its `whereabouts`."""
    late = float(np.median(run.error[i, run.time.size // 2 :]))
    size = metres(whereabouts(run, i))
    rms = metres(float(np.sqrt(np.mean(run.error[i] ** 2))))
    if late < FOUND * whereabouts(run, i):
        return (
            f"{run.names[i]}: position found late, to {metres(late)} in the second half; {rms} "
            f"RMS off in all ({worst}), and the mission takes place within {size}: look at "
            "first_estimate."
        )
    return (
        f"{run.names[i]}: position not known, {rms} RMS off ({worst}), and the mission takes place "
        f"within {size}: look at first_estimate, process_noise and ranging."
    )


def _untold(run: Run, i: int) -> str:
    """What to say where the ranges have told next to nothing."""
    alone, aided = np.mean(run.unaided_variance[i]), np.mean(run.cramer_rao_variance[i])
    if aided < TOLD * alone:
        return ""
    return "beware, its ranges told next to nothing: dead reckoning alone is as good"


def is_lost(run: Run, i: int) -> bool:
    """Whether the error exceeds what the filter allows for, most of the mission's second half."""
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
    return (
        "the ranges fit although the position does not: "
        "give it a better first estimate, or an aid vehicle that goes round it"
    )


def mirror(
    points: Float[np.ndarray, "n 2"], path: Float[np.ndarray, "samples 2"]
) -> Float[np.ndarray, "n 2"]:
    """Reflect points across the line that fits a path best."""
    center = path.mean(axis=0)
    along = np.linalg.svd(path - center, full_matrices=False)[2][0]
    offset = points - center
    return center + 2.0 * (offset @ along)[:, None] * along - offset


def _against_bound(figures: dict[str, Any]) -> str:
    """The error beside the Cramér-Rao bound of this path, and that beside any path's bound."""
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


def _consistency(nees: Float[np.ndarray, " samples"], mean: float | None, samples: float) -> str:
    """Whether errors are what the filter says, as far as so many independent ones tell."""
    if mean is None or not np.isfinite(samples):
        return ""
    low, high = mean_interval(samples, degrees=2)
    evidence = f"about {samples:.0f} independent error{'s' if round(samples) != 1 else ''}"
    if low <= mean <= high and high > TELLING:
        return f"whether its filter is consistent cannot be told (NEES {mean:.3g} of {evidence})"
    chance = f"NEES {mean:.3g}; chance allows {low:.1f} to {high:.1f} for {evidence}"
    if low <= mean <= high:
        return f"filter consistent ({chance})"
    word = "overconfident" if mean > high else "cautious"
    inside = percent(float(np.mean(nees[np.isfinite(nees)] <= INSIDE)))
    return f"filter {word} ({chance}; inside its 95 % ellipse {inside} of the time)"


def _ambiguity(run: Run, i: int) -> str:
    """What the aid vehicle's track, as seen from the AUV, cannot tell."""
    relative = run.cna[:, :2] - run.truth[i, :, :2]
    along = np.linalg.svd(relative - relative.mean(axis=0), full_matrices=False)[2]
    length, width = np.ptp(relative @ along.T, axis=0)
    narrow = STRAIGHT * run.separation[i].mean()
    if length < narrow:
        return (
            "beware, the aid vehicle keeps still relative to it: "
            "ranges tell how far it is, not which way"
        )
    if width < narrow:
        return (
            "beware, the aid vehicle passes it on a straight line: "
            "ranges cannot tell left from right"
        )
    return ""


def _reach(nearest: float, farthest: float) -> str:
    if nearest > FARTHEST:
        return (
            f"beware, never nearer than {metres(nearest)}, and acoustic modems reach "
            f"{metres(FARTHEST)} at best: no real one would have measured these ranges"
        )
    return (
        f"beware, {metres(farthest)} apart, where acoustic modems reach {metres(FARTHEST)} at best"
        if farthest > FARTHEST
        else ""
    )
