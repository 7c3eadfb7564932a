"""Figures B.1 to B.8: one mission of each policy, slow and fast, as in the thesis's Appendix B."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from obsplan.run import Run
from obsplan.scenario import Scenario
from obsplan.simulation import ClosedLoop
from obsplan.thesis import assumptions
from obsplan.thesis.appendix_drawing import draw
from obsplan.thesis.assumptions import (
    AS_ASSUMED,
    BEACON,
    CHANGES,
    CIRCLE,
    EXACT,
    FAST,
    GRAMIAN,
    INERTIA,
    ITERATED,
    LOOSE,
    SIGMA,
    SLOW,
    START,
    STATIONARY,
    THESIS,
    TURNS,
    VAGUE,
    Change,
)
from obsplan.thesis.clauses import Clause, Numbers, each, turned_over, verdict
from obsplan.thesis.flights import fly, random_starts
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.marks import LOST, MARKS, marks
from obsplan.thesis.montecarlo import counted, figure

if TYPE_CHECKING:
    import xarray as xr

SAMPLING = 0.2  # [s] between the samples kept
TRIALS = 40  # seeds by which a claim is judged
FEW = 4  # such a part of them under each change
FOLLOWS = 5.0  # greatest distance [m] of an aid vehicle that follows the AUV
GROWS = 1.5  # ratio from which on deviations or errors grow with the AUV's turns
SIMILAR = 2.0  # ratio of errors up to which a policy is as good as another
# A Gaussian error is outside three deviations, east or north, for 0.5 % of the time.
OUTSIDE = 0.05
ENCIRCLED = 10.0  # turns about the AUV
STARTS, HALF_WIDTH = 50, 8.0  # random starts, within a square of half that width [m]
OURS = "ours"


@dataclass(frozen=True, kw_only=True)
class Claim:
    """What a figure shows, in clauses that can each fail, and what may decide them."""

    survey: str
    policy: str
    clauses: tuple[Clause, ...]
    changes: tuple[str, ...]  # of `CHANGES`, one at a time
    rival: tuple[str, str] | None = None  # survey and policy whose error "ratio" is over


LOST_CLAUSE = Clause(text="lost: RMS error over 10 m", mark="rms_error", above=LOST)
FOLLOWED = Clause(text="stays within 5 m", mark="farthest", below=FOLLOWS)
SIGMA_GROWS = Clause(
    text="σ east and north are 1.5 times greater on legs along than across",
    mark="sigma_exchange",
    above=GROWS,
)
ERROR_GROWS = Clause(text="so is the error", mark="least_exchange", above=GROWS)
WITHIN = Clause(text="error outside ±3σ for under 5 % of the time", mark="outside", below=OUTSIDE)
ROUND = Clause(text="goes round it over 10 times", mark="rounds", above=ENCIRCLED)


def missions(claim: Claim, label: str) -> list[Scenario]:
    """The claim's mission, and its rival's, under a change or with our own noise."""
    flown = [(claim.survey, claim.policy)] + ([claim.rival] if claim.rival else [])
    if label == OURS:
        return [assumptions.ours(survey, Change())[policy] for survey, policy in flown]
    return [assumptions.like(survey, CHANGES[label])[policy] for survey, policy in flown]


def measured(scenarios: Sequence[Scenario], seeds: range) -> tuple[Numbers, ClosedLoop]:
    """Marks of a mission by seed, "ratio" over its rival's error, and the loop that flew it."""
    loop, *rival = [
        ClosedLoop(scenario=one, planner=one.planner(), compiled=True) for one in scenarios
    ]
    found = [marks(loop.fly(seed)) for seed in seeds]
    numbers = {mark: np.array([one[mark] for one in found]) for mark in MARKS}
    if rival:
        others = np.array([rival[0].fly(seed).rms_error for seed in seeds])
        numbers["ratio"] = numbers["rms_error"] / others
    return numbers, loop


def compute(claim: Claim, *, runs: int, seed: int) -> "xr.Dataset":
    """Marks over seeds, as assumed and under changes, and the tracks of one mission.

    That mission is the first of the seeds in which all clauses hold, or else the first.
    """
    seeds = range(seed, seed + max(2, min(runs, TRIALS)))
    few = seeds[: max(2, len(seeds) // FEW)]
    numbers, loop = measured(missions(claim, AS_ASSUMED), seeds)
    labels = [*claim.changes, OURS]
    changed = [measured(missions(claim, label), few)[0] for label in labels]
    whole = np.logical_and.reduce([clause.holds(numbers) for clause in claim.clauses])
    variables = {mark: ("seed", values) for mark, values in numbers.items()}
    variables |= {
        f"changed_{mark}": (("change", "few"), np.array([one[mark] for one in changed]))
        for mark in numbers
    }
    shown = recorded(loop.fly(seeds[int(whole.argmax())]))
    return shown.assign(variables).assign_coords(seed=list(seeds), change=labels, few=list(few))


def compute_with_starts(claim: Claim, *, runs: int, seed: int) -> "xr.Dataset":
    """The same, and where the printed and the exact Gramian end from random starts."""
    data = compute(claim, runs=runs, seed=seed)
    starts = random_starts(min(runs, STARTS), seed, HALF_WIDTH)
    far = [
        fly(assumptions.like(claim.survey, CHANGES[label])[claim.policy], starts).distance
        for label in (AS_ASSUMED, EXACT)
    ]
    last = [one.isel(auv=0, time=-1).values for one in far]
    attributes = {"units": "m", "long_name": "distance at the end"}
    return data.assign(ends=(("gramian", "start"), np.array(last), attributes)).assign_coords(
        gramian=["printed", "exact"]
    )


def recorded(run: Run) -> "xr.Dataset":
    """Tracks, estimates and standard deviations of a run's only AUV, every `SAMPLING`."""
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
    }
    return xr.Dataset(
        {key: ("time", values, {"units": unit}) for key, (values, unit) in columns.items()},
        coords={"time": ("time", run.time[every], {"units": "s"})},
        attrs={
            "shown": run.seed,
            "rms_error_drawn": run.rms_error,
            "max_error_drawn": run.max_error,
        },
    )


def encirclements(data: "xr.Dataset") -> float:
    """How many turns about the AUV the aid vehicle makes, to the left and to the right."""
    bearing = np.unwrap(np.arctan2(data.cna_y - data.auv_y, data.cna_x - data.auv_x))
    return float(np.abs(np.diff(bearing)).sum() / (2.0 * np.pi))


def as_assumed(data: "xr.Dataset") -> Numbers:
    """Marks by seed."""
    return {str(name): one.values for name, one in data.data_vars.items() if one.dims == ("seed",)}


def under(data: "xr.Dataset", change: str) -> Numbers:
    """Marks by seed under a change."""
    one = data.sel(change=change)
    return {
        str(name).removeprefix("changed_"): values.values
        for name, values in one.data_vars.items()
        if values.dims == ("few",)
    }


def found(claim: Claim, data: "xr.Dataset") -> Finding:
    """Each clause by itself, and what decides it."""
    numbers = as_assumed(data)
    held = each(claim.clauses, numbers)
    clauses = "; ".join(
        f"{clause.text} in {counted(float(one.mean()), one.size)}"
        for clause, one in zip(claim.clauses, held, strict=True)
    )
    rms, most = THESIS[claim.survey][claim.policy]
    typical = [float(np.median(numbers[mark])) for mark in ("rms_error", "max_error")]
    return Finding(
        agrees=verdict(claim.clauses, numbers),
        sentence=(
            f"In seeds: {clauses}. Median RMS error {figure(typical[0])} m, greatest "
            f"{figure(typical[1])} m (thesis {rms:g} and {most:g} m). Drawn is seed {data.shown}, "
            f"with {figure(data.rms_error_drawn)} and {figure(data.max_error_drawn)} m. "
            f"{decisive(claim, data)}"
        ),
    )


def decisive(claim: Claim, data: "xr.Dataset") -> str:
    """Which changes, each alone, turn a clause over: from most seeds to few, or the other way."""
    before = each(claim.clauses, as_assumed(data))
    texts = []
    for label in data.change.values:
        after = each(claim.clauses, under(data, str(label)))
        turned = [
            f"{clause.text} in {now.sum()} of {now.size}"
            for clause, was, now in zip(claim.clauses, before, after, strict=True)
            if turned_over(float(was.mean()), float(now.mean()), now.size)
        ]
        if turned:
            texts.append(f"{label} ({', '.join(turned)})")
    return f"What decides, changed alone: {'; '.join(texts)}." if texts else "No change decides it."


def found_with_starts(claim: Claim, data: "xr.Dataset") -> Finding:
    """The same, and from how many starts each Gramian loses the AUV."""
    finding = found(claim, data)
    lost = {
        str(name): counted(float((data.ends.sel(gramian=name) > LOST).mean()), data.sizes["start"])
        for name in data.gramian.values
    }
    ends = "; ".join(f"the {name} one from {text}" for name, text in lost.items())
    return Finding(
        agrees=finding.agrees,
        sentence=(
            f"{finding.sentence} Of random starts within ±8 m the Gramian loses the AUV, by more "
            f"than 10 m at the end: {ends}."
        ),
    )


def rows(claim: Claim, data: "xr.Dataset") -> list[list[str]]:
    """The ablation: in how many seeds each clause holds under each assumption."""
    table = [["changed alone", *(clause.text for clause in claim.clauses), "RMS error [m]"]]
    listed = {AS_ASSUMED: as_assumed(data)}
    listed |= {str(label): under(data, str(label)) for label in data.change.values}
    for label, numbers in listed.items():
        held = each(claim.clauses, numbers)
        shares = [f"{one.sum()} of {one.size}" for one in held]
        table.append([label, *shares, figure(float(np.median(numbers["rms_error"])))])
    return table


def item(number: int, claim: Claim, text: str) -> Item:
    """One figure of the appendix."""
    pace = "slow" if claim.survey == SLOW else "fast"
    starts = claim.policy == GRAMIAN and claim.survey == SLOW
    return Item(
        name=f"figB.{number}",
        title=f"Localization, {pace} aid vehicle: {claim.policy}",
        claim=text,
        compute=partial(compute_with_starts if starts else compute, claim),
        draw=draw,
        found=partial(found_with_starts if starts else found, claim),
        rows=partial(rows, claim),
    )


ITEMS: tuple[Item, ...] = (
    item(
        1,
        Claim(
            survey=SLOW,
            policy=CIRCLE,
            clauses=(
                LOST_CLAUSE,
                Clause(text="lost in the first third", mark="lost_at", below=1 / 3),
                Clause(
                    text="until then along the line of sight most of the time",
                    mark="aligned",
                    above=0.5,
                ),
            ),
            changes=(LOOSE, VAGUE, SIGMA),
        ),
        "Very poor, with a large drift that begins while the AUV moves along the line of sight.",
    ),
    item(
        2,
        Claim(
            survey=SLOW,
            policy=STATIONARY,
            clauses=(Clause(text="on the AUV most of the time", mark="at_truth", above=0.5),),
            changes=(LOOSE, BEACON, SIGMA),
        ),
        "The survey moves enough for the filter to lock on to the AUV's position.",
    ),
    item(
        3,
        Claim(
            survey=SLOW,
            policy=INERTIA,
            clauses=(
                FOLLOWED,
                SIGMA_GROWS,
                Clause(text="the error is not", mark="most_exchange", below=GROWS),
                WITHIN,
            ),
            changes=(LOOSE, SIGMA, ITERATED),
        ),
        (
            "The path essentially follows the AUV; the uncertainty in x and y grows and shrinks "
            "as the AUV turns, the error does not."
        ),
    ),
    item(
        4,
        Claim(
            survey=SLOW,
            policy=GRAMIAN,
            clauses=(
                Clause(text="does not follow: over 5 m away", mark="farthest", above=FOLLOWS),
                Clause(text="error over twice path inertia's", mark="ratio", above=SIMILAR),
            ),
            changes=(EXACT, TURNS, START, LOOSE),
            rival=(SLOW, INERTIA),
        ),
        "An unintuitive path; the method may suffer where the AUV is as fast as the aid vehicle.",
    ),
    item(
        5,
        Claim(
            survey=FAST,
            policy=CIRCLE,
            clauses=(
                LOST_CLAUSE,
                Clause(text="speed estimate over twice the speed", mark="overshoot", above=2.0),
                Clause(text="RMS error greater than slow", mark="ratio", above=1.0),
            ),
            changes=(LOOSE, VAGUE),
            rival=(SLOW, CIRCLE),
        ),
        "Very poor, worse than slow: an inflated speed estimate causes a large excursion.",
    ),
    item(
        6,
        Claim(
            survey=FAST,
            policy=STATIONARY,
            clauses=(
                LOST_CLAUSE,
                Clause(
                    text="on the mirror image over the y-axis most of the time",
                    mark="at_mirror",
                    above=0.5,
                ),
            ),
            changes=(LOOSE, BEACON),
        ),
        "The filter locks on an incorrect estimate that mirrors the position over the y-axis.",
    ),
    item(
        7,
        Claim(
            survey=FAST,
            policy=INERTIA,
            clauses=(FOLLOWED, ROUND, SIGMA_GROWS, ERROR_GROWS, WITHIN),
            changes=(LOOSE,),
        ),
        (
            "The path follows the AUV, encircling it repeatedly; the uncertainty in x and y grows "
            "and shrinks as the AUV turns, and the error slightly with it."
        ),
    ),
    item(
        8,
        Claim(
            survey=FAST,
            policy=GRAMIAN,
            clauses=(
                FOLLOWED,
                ROUND,
                SIGMA_GROWS,
                ERROR_GROWS,
                Clause(text="error under twice path inertia's", mark="ratio", below=SIMILAR),
            ),
            changes=(EXACT, LOOSE),
            rival=(FAST, INERTIA),
        ),
        "A path similar to path inertia's, and an error with the same trend.",
    ),
)
