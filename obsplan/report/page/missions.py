"""The page of a campaign: its missions in a table to sort and filter, and how to fly one again."""

from pathlib import Path
from typing import Any

from obsplan.campaign.layout import FIGURES
from obsplan.campaign.table import LABELS, Layout, existing_store
from obsplan.report.page.html import own, page
from obsplan.report.page.pack import packed
from obsplan.scenario.scenario import Scenario, from_dict
from obsplan.types import ObsplanError

MOST_MISSIONS = 50_000  # in a page: some 5 MB
MISSION = "CELL/SEED"  # how one is named
SHOWN = {  # figures in the table, with their headings
    "rms_error_m": "RMS error [m]",
    "max_error_m": "Worst error [m]",
    "pcrb_rms_m": "PCRB RMS [m]",
    "mean_nees": "NEES",
    "separation_mean_m": "Mean sep. [m]",
    "violation_max_m": "Limit broken by [m]",
}


def campaign_page(folder: Path | str) -> str:
    """The page of a campaign as HTML, of what has been flown up to now.

    Raises
    ------
    ObsplanError
        The folder has no campaign, no mission has been flown yet, or the store is damaged.
    """
    folder = Path(folder)
    with existing_store(folder) as store:
        store.check()
        layout = Layout.of(store)
        rows = [
            (cell, label, mission) for cell, label in layout.cells for mission in store.rows(cell)
        ]
    if not rows:
        raise ObsplanError(f"{folder} has no missions yet; let `obsplan campaign` run first")
    kept = rows[:MOST_MISSIONS]
    title = f"Campaign: {folder.resolve().name}"
    data = {
        "title": title,
        "labels": [*LABELS, *layout.varied],
        "columns": [_values(kept, layout, k) for k in range(len(LABELS) + len(layout.varied))],
        "cells": packed([cell for cell, _, _ in kept]),
        "seeds": [mission[0] for _, _, mission in kept],
        "errors": {k: mission[1] for k, (*_, mission) in enumerate(kept) if mission[1]},
        "headings": [*SHOWN.values()],
        "figures": [packed(_figure(kept, name)) for name in SHOWN],
        "folder": folder.name or str(folder.resolve()),
        "left_out": len(rows) - len(kept),
    }
    return page(title, own("missions.html"), [own("missions.js")], data)


def _values(rows: list[Any], layout: Layout, column: int) -> dict[str, Any]:
    """A label of each mission, each of its values once."""
    values = list(dict.fromkeys(label[column] for _, label in layout.cells))
    number = {value: k for k, value in enumerate(values)}
    return {"values": values, "of": packed([number[label[column]] for _, label, _ in rows])}


def _figure(rows: list[Any], name: str) -> list[float]:
    at = 2 + FIGURES.index(name)  # after the seed and the error
    return [float("nan") if row[at] is None else row[at] for _, _, row in rows]


def scenario_of(folder: Path | str, mission: str) -> tuple[Scenario, int]:
    """The scenario of a mission named ``CELL/SEED`` in a campaign's page, and its seed.

    Raises
    ------
    ObsplanError
        The folder has no campaign, or that mission is not in it.
    """
    cell, _, seed = mission.partition("/")
    if not (cell.isdecimal() and seed.isdecimal() and len(cell + seed) < 30):
        raise ObsplanError(
            f"--mission {mission}: give it as {MISSION}, as the campaign's page does"
        )
    with existing_store(Path(folder)) as store:
        contents = {number: content for number, *_, content in store.current_cells()}
        flown = int(cell) in contents and any(row[0] == int(seed) for row in store.rows(int(cell)))
    if not flown:
        raise ObsplanError(
            f"--mission {mission}: {folder} has no such mission; its page names those it has"
        )
    return from_dict(contents[int(cell)], source=f"cell {cell} of {folder}"), int(seed)
