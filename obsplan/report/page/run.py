"""The page of one run, and of several side by side."""

from collections.abc import Sequence
from typing import Any

from obsplan.planned import PATH
from obsplan.report.map import degrees, heading
from obsplan.report.page.chart import NO_CHART, Chart
from obsplan.report.page.charts import panels_of
from obsplan.report.page.html import library, own, page
from obsplan.report.page.scene import scene_of
from obsplan.report.words import time_unit
from obsplan.run import Run

HELD = (
    "Dotted before the aid vehicle is the course for half a minute on its present command: "
    "{planner} decides a turn and holds it until it decides again{or_older}."
)
OLDER = ", or this run is older than planned.csv"


def run_page(run: Run, notes: Sequence[str] = (), chart: Chart = NO_CHART) -> str:
    """The page of a run as HTML; ``notes`` are sentences on it."""
    (title, _), *more = heading(run)
    scene = scene_of(run, run.planner)
    data = {
        "title": title,
        "about": "; ".join(text for text, _ in more),
        "groups": run.names,
        "scenes": [scene],
        "panels": panels_of(run),
        "chart": chart.lines,
        "pictures": chart.pictures,
        "notes": [*notes, *chart.notes, *scene_notes(run, scene)],
        **about_place(run),
    }
    return player(title, data)


def player(title: str, data: dict[str, Any]) -> str:
    """A page that plays what the data says."""
    return page(title, own("player.html"), [*library(), own("player.js")], data)


def about_place(run: Run) -> dict[str, Any]:
    """Origin, axes and the unit of time."""
    origin = run.scenario.table.origin
    told = (origin.lat, origin.lon) != (0.0, 0.0)
    east = f"East of {degrees(origin.lon, 'E', 'W')} [m]" if told else "East [m]"
    north = f"North of {degrees(origin.lat, 'N', 'S')} [m]" if told else "North [m]"
    seconds, symbol = time_unit(float(run.time[-1]))
    return {
        "origin": [origin.lat, origin.lon] if told else None,
        "axes": [east, north],
        "unit": [symbol, seconds],
    }


def scene_notes(run: Run, scene: dict[str, Any]) -> list[str]:
    """What is left out of a page, and how its axes begin."""
    notes = []
    if run.has_aid and not run.is_replay:
        notes += path_notes(run, scene)
    if scene["thinned"]:
        notes.append(
            f"Of a mission this long one sample in {scene['thinned']} is played; lines in panels "
            "keep every peak."
        )
    if scene["pings"]["thinned"]:
        notes.append(f"One range in {scene['pings']['thinned']} is on the map.")
    notes.append(
        "Axes of errors begin with what follows the first quarter of the mission; the first "
        "estimate may be beyond them. All values are in tracks.nc."
    )
    return notes


def path_notes(run: Run, scene: dict[str, Any]) -> list[str]:
    """Where what is drawn ahead of aid vehicles is not the whole of what was planned."""
    planned = [aid["planned"] for aid in scene["aids"] if "planned" in aid]
    thinned = max((one["thinned"] for one in planned), default=0)
    notes = []
    if PATH in run.faults:
        notes.append(f"Not every path that {run.planner} predicted is drawn: {run.faults[PATH]}.")
    if not planned:
        older = "" if run.planned else OLDER
        notes.append(HELD.format(planner=run.planner, or_older=older))
    if thinned:
        notes.append(f"One planned path in {thinned} is drawn; planned.csv has all.")
    return notes
