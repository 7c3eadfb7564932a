"""The page of several runs side by side: a map each, and panels in which all are drawn."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from obsplan.report.page.chart import NO_CHART, Chart
from obsplan.report.page.charts import Panel, Series, panel
from obsplan.report.page.pack import line
from obsplan.report.page.run import about_place, player, scene_notes
from obsplan.report.page.scene import scene_of
from obsplan.report.style import planner_style, time_axis
from obsplan.run import Run


@dataclass(frozen=True, kw_only=True)
class Side:
    """What a page needs of one of several runs; small, so that the run need not be kept."""

    label: str
    scene: dict[str, Any]
    lines: dict[str, Series]  # by the panel they are in
    notes: list[str]
    place: dict[str, Any]  # origin, axes, unit of time
    noise: tuple[Any, ...]  # runs in which it is equal met the same


ERROR = "Position error, RMS over AUVs [m]"
BOUND = "Its Cramér–Rao bound [m]"
OWN = "As the filters say it, RMS over AUVs [m]"
FARTHEST = "Distance to the farthest AUV [m]"


def side_of(run: Run, label: str, *, runs: int) -> Side:
    """One of so many runs; the label tells it from the others."""
    scene = scene_of(run, label, runs=runs)
    table = run.scenario.table
    return Side(
        label=label,
        scene=scene,
        lines=dict(_lines(run, label)),
        notes=[] if run.is_replay else scene_notes(run, scene),
        place=about_place(run),
        noise=(table.name, run.seed, run.time.size, len(run.names), run.source),
    )


def _lines(run: Run, label: str) -> Iterator[tuple[str, Series]]:
    time, _ = time_axis(run.time)
    paint, _ = planner_style(label)
    drawn: Series = {"kind": "line", "name": label, "colour": paint}
    P = run.covariance[..., :2, :2]
    own = np.sqrt(np.mean(P[..., 0, 0] + P[..., 1, 1], axis=0))
    if run.known.all():
        yield ERROR, drawn | line(time, np.sqrt(np.mean(run.error**2, axis=0)))
    if not run.unbounded_below:
        yield BOUND, drawn | line(time, np.sqrt(np.mean(run.cramer_rao_variance, axis=0)))
    yield OWN, drawn | line(time, own)
    if run.known.all() and run.has_aid:
        yield FARTHEST, drawn | line(time, run.separation.max(axis=0))


def comparison_page(
    sides: Sequence[Side], title: str, notes: Sequence[str] = (), chart: Chart = NO_CHART
) -> str:
    """The page of several runs as HTML; ``notes`` are sentences on them."""
    of_sides = [note for side in sides for note in side.notes]
    said = dict.fromkeys([*notes, same_noise(sides), *chart.notes, *of_sides])
    longest = max(sides, key=lambda side: side.place["unit"][1])
    data = {
        "title": title,
        "about": ", ".join(side.label for side in sides),
        "scenes": [side.scene for side in sides],
        "panels": [*_panels(sides)],
        "chart": chart.lines,
        "pictures": chart.pictures,
        "notes": [*said],
        **longest.place,
    }
    return player(title, data)


def same_noise(sides: Sequence[Side]) -> str:
    """Whether the runs met the same noise."""
    if len({side.noise for side in sides}) > 1:
        return (
            "These runs are not of one scenario and seed: they met different noise, and what is "
            "luck in one is not in the other."
        )
    return f"All met the same noise, of seed {sides[0].noise[1]}."


def _panels(sides: Sequence[Side]) -> Iterator[Panel]:
    for title in (ERROR, BOUND, OWN, FARTHEST):
        series = [side.lines[title] for side in sides if title in side.lines]
        if series:
            yield panel(title, series)
