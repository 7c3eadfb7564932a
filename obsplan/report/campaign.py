"""A campaign read: tables, sentences and figures, from its folder into its folder."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# because pandas is not typed: its columns may be anything

import math
from collections import Counter
from collections.abc import Container
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from obsplan.campaign.statistics import fewest_pairs, medians, paired, varied_keys, worded
from obsplan.campaign.table import load_campaign
from obsplan.files import write_atomically
from obsplan.report.leader import Standing, leader_sentences
from obsplan.report.tables import cell
from obsplan.report.words import metres
from obsplan.spelling import inert
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

FOLDER = "report"
# what a report may have left there before
OURS = ("medians.csv", "pairs.csv", "planners.png", "error-vs-*.png", "map-*.png")
MOST_ROWS = 40  # on a terminal
MOST_SENTENCES = 3
COLUMNS = {
    "rms_error_m": "RMS error [m]",
    "max_error_m": "Worst error [m]",
    "mean_nees": "NEES (2 if consistent)",
}


@dataclass(frozen=True, kw_only=True)
class CampaignReport:
    """What was found and written."""

    medians: "pd.DataFrame"
    pairs: "pd.DataFrame"
    sentences: list[str]
    folder: Path
    files: list[str]


def write_campaign_report(folder: Path | str, out: Path | str | None = None) -> CampaignReport:
    """Write medians, paired comparisons and figures of a campaign.

    They go to ``out``, or into the campaign's folder, to ``report``. Those of an earlier report go.

    Raises
    ------
    ObsplanError
        The folder has no campaign, no mission has been flown yet, or it cannot be written.
    """
    from obsplan.report.style import png

    table = load_campaign(folder)
    if table.empty:
        raise ObsplanError(f"{folder} has no missions yet; let `obsplan campaign` run first")
    by_cell, pairs = medians(table), paired(table)
    target = made(Path(folder) / FOLDER if out is None else Path(out))
    contents: dict[str, str | bytes] = {
        "medians.csv": by_cell.map(inert).to_csv(index=False),
        "pairs.csv": pairs.map(inert).to_csv(index=False),
    }
    contents |= {name: png(draw) for name, draw in figures(table).items()}
    for name, content in contents.items():
        write_atomically(target / name, content)
    remove_stale(target, keep=contents)
    return CampaignReport(
        medians=by_cell,
        pairs=pairs,
        sentences=sentences(table, pairs),
        folder=target,
        files=list(contents),
    )


def remove_stale(folder: Path, *, keep: Container[str]) -> None:
    """Remove what an earlier report left, as far as that goes."""
    for pattern in OURS:
        for path in folder.glob(pattern):
            if path.name not in keep:
                with suppress(OSError):
                    path.unlink()


def made(folder: Path) -> Path:
    """A folder, made unless it is there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ObsplanError(
            f"{folder} cannot be made ({error.strerror}): "
            "make its place writable, or give another with --out"
        ) from error
    return folder


def figures(table: "pd.DataFrame") -> dict[str, partial]:
    """The figures of a table by their file names, to be drawn."""
    from obsplan.report.campaign_figures import key_figure, map_figure, planners_figure

    keys = [key for key in varied_keys(table) if table[key].nunique() > 1]
    drawn = {"planners.png": partial(planners_figure, table)}
    for key in keys:
        drawn[f"error-vs-{key}.png"] = partial(
            key_figure, table, key, [other for other in keys if other != key]
        )
    for two in combinations(keys, 2):
        for scenario, part in table.dropna(subset=[*two]).groupby("scenario"):
            pooled = [key for key in keys if key not in two]
            drawn[f"map-{scenario}-{two[0]}-{two[1]}.png"] = partial(map_figure, part, two, pooled)
    return drawn


def campaign_table(by_cell: "pd.DataFrame") -> "Table":
    """Tabulate medians with their 95 % intervals, the first rows of many."""
    from rich.table import Table
    from rich.text import Text

    labels = list(by_cell.columns[: by_cell.columns.get_loc("missions")])
    caption = (
        f"and {len(by_cell) - MOST_ROWS} more in medians.csv" if len(by_cell) > MOST_ROWS else None
    )
    table = Table(title=Text("Medians [95 % intervals]"), title_justify="left", caption=caption)
    for label in labels:
        table.add_column(Text(label))
    limited = bool(by_cell["violation_worst_m"].notna().any())
    broken = ["Limit broken by [m]"] if limited else []
    for heading in ("Missions", "Failed", *COLUMNS.values(), *broken):
        table.add_column(Text(heading), justify="right")
    for row in by_cell.head(MOST_ROWS).to_dict("records"):
        figures_of = (interval(row[key], row[f"{key}_low"], row[f"{key}_high"]) for key in COLUMNS)
        table.add_row(
            *(Text(worded(row[label])) for label in labels),
            f"{row['missions']}",
            f"{row['failed']}",
            *map(Text, figures_of),
            *([broken_by(row)] if limited else []),
        )
    return table


def broken_by(row: dict[str, Any]) -> str:
    """By how much a limit was broken at most [m], and in how many missions."""
    if not row["violated"]:
        return "–" if math.isnan(row["violation_worst_m"]) else "kept"
    return f"{cell(row['violation_worst_m'], 2)} (in {row['violated']})"


def interval(value: float, low: float, high: float) -> str:
    """A median and its interval, as far as there are any."""
    if math.isnan(value):
        return "–"
    return f"{value:.3g}" + ("" if math.isnan(low) else f" [{low:.3g}, {high:.3g}]")


def sentences(table: "pd.DataFrame", pairs: "pd.DataFrame") -> list[str]:
    """Who leads, setting by setting where they are few, and what is left out."""
    settings = standings(table, pairs)
    if len(settings) <= MOST_SENTENCES:
        said = [
            f"{where}: {' '.join(leader_sentences(standing))}"
            for where, standing in settings.items()
        ]
    else:
        said = tally([*settings.values()])
    if failed := int((table["status"] == "failed").sum()):
        said.append(
            f"{failed} of {len(table)} missions failed "
            "and are left out of all medians and comparisons."
        )
    return said


def standings(table: "pd.DataFrame", pairs: "pd.DataFrame") -> dict[str, Standing]:
    """The planners' standing in each scenario and setting where several flew, by words for it."""
    keys = ["scenario", *varied_keys(table)]
    by_setting = {known(labels): group for labels, group in pairs.groupby(keys, dropna=False)}
    return {
        setting(keys, labels): Standing(
            missions=missions, pairs=by_setting[known(labels)], comparisons=len(pairs)
        )
        for labels, missions in table.groupby(keys, dropna=False)
        if known(labels) in by_setting
    }


def known(labels: tuple) -> tuple:
    """Labels that can be looked up: none for nan, which is not equal to itself."""
    return tuple(None if label != label else label for label in labels)


def setting(keys: list[str], labels: tuple) -> str:
    """A scenario and the values of what was varied, in words."""
    scenario, *values = labels
    varied = zip(keys[1:], known(tuple(values)), strict=True)
    given = (f"{key} = {worded(value)}" for key, value in varied if value is not None)
    return ", ".join([scenario, *given])


def tally(settings: list[Standing]) -> list[str]:
    """Say in how many settings each planner leads, by how much, and who broke limits.

    Say also whether more seeds could tell more.
    """
    led = [one for one in settings if one.eligible and one.eligible[0] not in one.broken]
    counts = Counter(one.eligible[0] for one in led)
    leads = [
        share(planner, [one for one in led if one.eligible[0] == planner])
        for planner, _ in counts.most_common()
    ]
    leaders = "; ".join(leads) or "no planner"
    said = [
        f"Lowest RMS error under the same noise, of {len(settings)} settings: "
        f"{leaders} (see pairs.csv)."
    ]
    comparisons = settings[0].comparisons
    if few := sum(bool(one.rivals) and one.too_few for one in led):
        least = fewest_pairs(comparisons)
        said.append(
            f"In {few} of them there are too few seeds to tell any lead from chance: "
            f"with {comparisons} comparisons that takes {least} (--runs {least})."
        )
    broke = Counter(planner for one in settings for planner in one.broken)
    for planner, count in broke.most_common():
        worst = max(one.broken.get(planner, 0.0) for one in settings)
        said.append(
            f"{planner} broke a limit in {count} of them, by up to {metres(worst)}, "
            "and is counted as leading in none of these."
        )
    return said


def share(planner: str, led: list[Standing]) -> str:
    """In how many settings a planner leads, in how many beyond chance, and how far ahead."""
    certain = sum(one.winner == planner for one in led)
    behind = []
    for one in led:
        if one.rivals:
            next_best = next(iter(one.rivals))
            behind.append(one.errors[next_best] / one.errors[planner])
    if not behind:
        return f"{planner} in {len(led)}, as the only one within the limits"
    ratio = math.exp(sum(map(math.log, behind)) / len(behind))
    return (
        f"{planner} in {len(led)} ({certain} beyond chance), "
        f"the next with {ratio:.2f} times its error"
    )
