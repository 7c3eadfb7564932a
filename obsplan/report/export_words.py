"""What was written for the vehicle, and what it costs to load it, in words."""

from collections.abc import Sequence

import numpy as np

from obsplan.report.export import (
    CLOSED_LOOP,
    FLOWN,
    LATE,
    ON_TIME,
    Costs,
    Export,
    late_by,
)
from obsplan.report.words import metres

LARGE = 0.1  # share by which an error is larger than that of the path as flown
SEEN = 0.01  # [m] of a violation
WITHOUT_LIMITS = {"waypoints", "gpx", "csv"}  # formats that hold no areas


def exports_sentences(exports: Sequence[Export]) -> list[str]:
    """`export_sentences` of all aid vehicles; what their paths cost together is said once."""
    if not exports:
        return []
    if len(exports) == 1:
        return export_sentences(exports[0])
    said = []
    for export in exports:
        own = [_mission(export), _limits(export)]
        said += [f"{export.name}: {sentence}" for sentence in own if sentence]
    return [*said, _policy(exports[0])]


def export_sentences(export: Export) -> list[str]:
    """Say how the mission differs from the path flown, what files leave out, and what it costs."""
    said = [_mission(export), _limits(export), _policy(export)]
    return [sentence for sentence in said if sentence]


def _mission(export: Export) -> str:
    """Count, deviation and timing."""
    table, mission = export.scenario.table.export, export.simplified
    near = f"at most {metres(mission.deviation)} from the path flown"
    if mission.track.speed is not None:
        near += f" and {mission.timing:.1f} s from its time, at {_speeds(mission.track.speed)}"
    parts = [f"The mission to load has {_items(export)}; it is {near}"]
    if mission.deviation > table.tolerance or mission.timing > table.timing:
        asked = f"{metres(table.tolerance)} and {table.timing:g} s"
        least = f"{table.max_items} items and no leg under {table.min_spacing:g} m"
        parts.append(f"with at most {least} it cannot be within the {asked} that [export] asks for")
    if export.widening:
        own = export.cna.min_turn_radius
        turns = f"turns of {table.min_turn_radius:g} m instead of {own:g} m"
        parts.append(f"{turns} had moved it by up to {metres(export.widening)} before")
    return f"{'; '.join(parts)}."


def _items(export: Export) -> str:
    """How many items there are, and how long the shortest leg is."""
    mission = export.simplified
    lengths = np.hypot(*np.diff(mission.track.points, axis=0).T)
    legs = f" and no leg under {metres(float(lengths.min()))}" if lengths.size else ""
    return f"{mission.items} items ({export.scenario.table.export.max_items} fit){legs}"


def _speeds(speed: np.ndarray) -> str:
    """A speed, or the least and the greatest."""
    least, greatest = float(speed.min()), float(speed.max())
    if least == greatest:
        return f"{least:.3g} m/s throughout"
    changes = np.count_nonzero(np.diff(speed))
    often = "once" if changes == 1 else f"{changes} times"
    return f"{least:.3g} to {greatest:.3g} m/s, changed {often}"


def _limits(export: Export) -> str:
    """Which limits no file holds, and which files hold none."""
    limits = export.scenario.constraints
    said = []
    if limits.keep_out or limits.geofence:
        without = [
            f"{export.stem}.{n}"
            for n in export.scenario.table.export.formats
            if n in WITHOUT_LIMITS
        ]
        if without:
            said.append(f"keep-outs and geofence are not in {', '.join(without)}")
    if limits.min_separation > 0 or np.isfinite(limits.max_separation):
        said.append("no file holds the separations from the AUVs, and no autopilot keeps them")
    if limits.min_separation_cna > 0:
        said.append("no file holds the distance between aid vehicles, and no autopilot keeps it")
    if export.violation > SEEN:
        said.append(f"a leg breaks the fixed limits by {metres(export.violation)}")
    text = "; ".join(said)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _policy(export: Export) -> str:
    """What the path costs under other noise, on time and late."""
    costs = export.costs
    if costs is None:
        return "What the path costs under other noise was not asked for (export.replays = 0)."
    gives = "this one gives" if len(export.scenario.aids) == 1 else "these give"
    late = {late_by(s): f"{s:.0f} s late" for s in LATE if late_by(s) in costs.rms_error}
    as_flown = f"the path as flown {_metres(costs.rms_error[FLOWN])}"
    told = [
        (
            f"sailed as loaded under the noise of {_seeds(costs.seeds)}, {gives} "
            f"{_metres(costs.rms_error[ON_TIME])} RMS in the median{_broken(costs, ON_TIME)} "
            f"({as_flown})"
        ),
        *(f"{when} {_late(costs, way)}" for way, when in late.items()),
    ]
    clauses = []
    if costs.closed_loop_seeds == costs.seeds:
        clauses.append(f"{export.planner} on board gives {_metres(costs.rms_error[CLOSED_LOOP])}")
    if any(costs.above(way) > LARGE for way in (ON_TIME, *late)):
        clauses.append(_advice(export.planner))
    return f"A path is not a policy: {'; '.join([', '.join(told), *clauses])}."


def _advice(planner: str) -> str:
    """What to do where the loss is large."""
    if planner == "whole-mission":
        return "start it on time, or plan again from where and when it starts"
    return (
        "start it on time, or decide on board; "
        "--planner whole-mission plans a path that is meant for loading"
    )


def _late(costs: Costs, way: str) -> str:
    """Median error of a late start, how it compares, and what limits are broken."""
    compared = f" ({100 * costs.above(way):+.0f} %)" if np.isfinite(costs.above(way)) else ""
    return f"{_metres(costs.rms_error[way])}{compared}{_broken(costs, way)}"


def _broken(costs: Costs, way: str) -> str:
    """By how much a limit is broken, if any is."""
    broken = costs.violation.get(way, 0.0)
    return f", {metres(broken)} beyond a limit" if broken > SEEN else ""


def _metres(error: float) -> str:
    """An error; a filter may have failed."""
    return metres(error) if np.isfinite(error) else "no estimate"


def _seeds(seeds: tuple[int, ...]) -> str:
    return f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
