"""What of the sea was in a run, in words: ranges that were lost, and what nobody was told."""

from typing import Any

import numpy as np

from obsplan.report.words import clock
from obsplan.run import Run
from obsplan.scenario.ranging import RangingTable
from obsplan.scenario.tables import aids_of
from obsplan.simulation.arrivals import Arrivals

# keys of [ranging] that no filter and no planner knows, at work if not 0
UNTOLD = (
    *("outliers", "duplicates", "scale_sigma", "clock_offset", "clock_drift"),
    "compass_bias_deg",
)


def summary_of(run: Run, *, bounds: bool = True) -> dict[str, Any]:
    """`Run.summary`, with how many ranges were due, lost and delivered twice where that matters."""
    summary = run.summary(bounds=bounds)
    if run.is_replay or not Arrivals.matter(run):
        return summary
    counts = Arrivals.of(run)
    summary["all"] |= counts.figures(slice(None))
    for i, name in enumerate(run.names):
        summary["auv"][name] |= counts.figures(slice(i, i + 1))
    return summary


def sea_notes(run: Run) -> list[str]:
    """Say what came of the ranges, and where filter and planners count on other than the truth.

    Of a recording nobody knows.
    """
    if run.is_replay:
        return []
    return [*_arrivals(run), *_silence(run), *_told(run), *_untold(run), *_water(run)]


def _arrivals(run: Run) -> list[str]:
    """Per AUV, of the ranges due how many came, by beacon if there are several."""
    if not Arrivals.matter(run):
        return []
    counts = Arrivals.of(run)
    notes = []
    for i, name in enumerate(run.names):
        due, came = counts.due[:, i], counts.came[:, i]
        if not due.any():
            continue
        said = f"{name}: {due.sum()} ranges were due, {due.sum() - came.sum()} were lost"
        if len(due) > 1:
            beacons = zip(run.scenario.beacons, due - came, due, strict=True)
            said += f" ({', '.join(f'{lost} of {n} of {b.name}' for b, lost, n in beacons)})"
        again = counts.twice[:, i].sum()
        said += f"; {again} came twice" if run.scenario.table.ranging.duplicates else ""
        notes.append(f"{said}.")
    return notes


def _silence(run: Run) -> list[str]:
    """For how long nothing was ranged as scheduled."""
    silent = np.array(run.scenario.table.ranging.silent).reshape(-1, 2)
    spans = np.diff(np.clip(silent, 0.0, run.time[-1]), axis=1)
    if not spans.any():
        return []
    total = clock(run, float(spans.sum()))
    return [f"No range was due during the silent intervals, {total} in all (ranging.silent)."]


def _told(run: Run) -> list[str]:
    """Which keys of ranges filter and planners count on otherwise than they are."""
    scenario = run.scenario
    truth, told = scenario.table.ranging, scenario.filter_ranging
    planned, notes = scenario.planner_ranging, []
    wrong, planned_wrong = _differences(truth, told), _differences(truth, planned)
    if wrong and wrong == planned_wrong:
        return [f"Filters and planners take ranges for what they are not: {wrong}."]
    if wrong:
        notes.append(f"Filters take ranges for what they are not: {wrong}.")
    if planned_wrong:
        notes.append(f"Planners take ranges for what they are not: {planned_wrong}.")
    elif wrong:
        notes.append("Planners are told how they are.")
    return notes


def _differences(truth: RangingTable, told: RangingTable) -> str:
    """Keys of what is told that differ from the truth's, with both values."""
    true, said = truth.model_dump(), told.model_dump()
    unlike = [key for key, value in said.items() if true.get(key) != value]
    return "; ".join(
        f"{key} is {_value(true.get(key))}, told {_value(said[key])}" for key in unlike
    )


def _value(value: Any) -> str:
    """A key's value."""
    if isinstance(value, float):
        return f"{value:g}"
    return "not set" if value is None else str(value)


def _untold(run: Run) -> list[str]:
    """What is false of ranges and headings without anybody being told."""
    ranging = run.scenario.table.ranging
    at_work = [key for key in UNTOLD if getattr(ranging, key)]
    if not at_work:
        return []
    keys = ", ".join(f"{key} = {_value(getattr(ranging, key))}" for key in at_work)
    return [f"Neither filters nor planners are told of ranging.{keys}."]


def _water(run: Run) -> list[str]:
    """Whose water differs from the current that it counts on, and what carries aid vehicles."""
    scenario, notes = run.scenario, []
    off = scenario.unknown_currents
    for i, name in enumerate(run.names):
        speed = np.zeros(1) if off is None else np.hypot(*off[:, i].T)
        if not speed.any():
            continue
        east, north = scenario.assumed_currents[i]
        notes.append(
            f"{name} counts on a current of {east:g} m/s east and {north:g} m/s north, and its "
            f"water differs from that by up to {speed.max():.2g} m/s ({speed.mean():.2g} m/s in "
            "the mean), which carries it off its survey."
        )
    carried = [n for n, a in zip(run.aid_names, aids_of(scenario.table), strict=True) if a.carried]
    if carried and scenario.water.strongest(0.0) > 0:
        who = "The aid vehicle is" if not run.others else f"{', '.join(carried)}: aid vehicles"
        notes.append(
            f"{who} carried by the current: headings and speeds are through the water, the path "
            "and its files over ground."
        )
    return notes
