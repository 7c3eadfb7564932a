"""What aid vehicles heard of the AUVs, in words."""

import numpy as np

from obsplan.report.words import clock, percent
from obsplan.run import Run
from obsplan.scenario.communication import SILENT

OVERDUE = 2.0  # times the age that reports have at most where none is lost
TOLD = 0.005  # of the time: what rounds to a percent


def hearing_notes(run: Run) -> list[str]:
    """Say of each AUV how old its newest report was, and for how long it was out of reach.

    Nothing is said where every report came with its range and on time.
    """
    if run.is_replay or not run.scenario.hearing_matters:
        return []
    said = [(name, _clauses(run, i)) for i, name in enumerate(run.names)]
    notes = [f"{name}, as heard: {'; '.join(clauses)}." for name, clauses in said if clauses]
    overdue = any(_overdue(run, i) for i in range(len(run.names)))
    if overdue and run.scenario.table.planner.knowledge == "estimate":
        notes.append(
            "Between reports planners took AUVs to go straight on (planner.knowledge = "
            '"estimate"); with "estimate-and-survey" they count on the turns that were filed.'
        )
    if run.scenario.communication.reports == SILENT:
        notes.append(
            'Nothing is heard of the AUVs (communication.reports = "none"): how sure they are, '
            "planners reckon from the surveys and the ranges to be expected."
        )
    return notes


def _clauses(run: Run, i: int) -> list[str]:
    heard, clauses = run.heard, []
    if heard.age is not None and _overdue(run, i):
        oldest, mean = clock(run, heard.age[i].max()), clock(run, heard.age[i].mean())
        clauses.append(f"newest report up to {oldest} old, {mean} in the mean")
    if heard.in_reach is not None:
        away = 1 - float(np.mean(heard.in_reach[i]))
        if away > TOLD:
            clauses.append(f"out of reach {percent(away)} of the time")
    if heard.throughput is not None:
        clauses.append(f"throughput {heard.throughput[i].mean():.3g} bit/s in the mean")
    return clauses


def _overdue(run: Run, i: int) -> bool:
    """Whether the newest report of an AUV was at times far older than where none is lost."""
    age, ranging = run.heard.age, run.scenario.table.ranging
    if age is None:
        return False
    last = run.scenario.offsets[:, i].max() + ranging.jitter
    due = ranging.interval + last + run.scenario.communication.latency
    return bool(age[i].max() > OVERDUE * due)
