"""A campaign read: tables, sentences and figures, from its folder into its folder."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportGeneralTypeIssues=false
# because pandas is not typed: its columns may be anything

import math
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from obsplan.campaign.statistics import medians, paired, varied_keys, worded
from obsplan.campaign.table import load_campaign
from obsplan.files import write_atomically
from obsplan.report.tables import cell
from obsplan.report.words import metres
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

FOLDER = "report"
OURS = (
    "medians.csv",
    "pairs.csv",
    "planners.png",
    "error-vs-*.png",
    "map-*.png",
)  # what a report may have left there before
SIGNIFICANT = 0.05  # of corrected p values
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
    files: list[str]


def write_campaign_report(folder: Path | str) -> CampaignReport:
    """Write medians, paired comparisons and figures of a campaign into its folder's ``report``; those of an earlier report go.

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
    target = made(Path(folder) / FOLDER)
    contents: dict[str, str | bytes] = {
        "medians.csv": by_cell.to_csv(index=False),
        "pairs.csv": pairs.to_csv(index=False),
    }
    contents |= {name: png(draw) for name, draw in figures(table).items()}
    for name, content in contents.items():
        write_atomically(target / name, content)
    for stale in {path for pattern in OURS for path in target.glob(pattern)} - {
        target / name for name in contents
    }:
        with suppress(OSError):
            stale.unlink()
    return CampaignReport(
        medians=by_cell, pairs=pairs, sentences=sentences(by_cell, pairs), files=list(contents)
    )


def made(folder: Path) -> Path:
    """A folder, made unless it is there."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise ObsplanError(
            f"{folder} cannot be made ({error.strerror}): make the campaign's folder writable, or copy it"
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


def limit_sentences(by_cell: "pd.DataFrame") -> list[str]:
    """Which planners broke a limit, how often and by how much."""
    said = []
    for planner, rows in by_cell.groupby("planner"):
        if violated := int(rows["violated"].sum()):
            most = metres(float(rows["violation_worst_m"].max()))
            of = int(rows["missions"].sum())
            said.append(f"{planner} broke a limit in {violated} of {of} missions, by up to {most}.")
    return said


def interval(value: float, low: float, high: float) -> str:
    """A median and its interval, as far as there are any."""
    if math.isnan(value):
        return "–"
    return f"{value:.3g}" + ("" if math.isnan(low) else f" [{low:.3g}, {high:.3g}]")


def sentences(by_cell: "pd.DataFrame", pairs: "pd.DataFrame") -> list[str]:
    """What the comparisons say, setting by setting where they are few, and what is left out of them."""
    labels = list(pairs.columns[: pairs.columns.get_loc("planner")])
    groups = {values: group for values, group in pairs.groupby(labels, dropna=False)}
    if len(groups) <= MOST_SENTENCES:
        said = [verdict(labels, values, group) for values, group in groups.items()]
    else:
        said = [tally([winner(group) for group in groups.values()])]
    said += limit_sentences(by_cell)
    if failed := int(by_cell["failed"].sum()):
        said.append(
            f"{failed} of {int(by_cell['missions'].sum())} missions failed and are left out of all medians and comparisons."
        )
    return said


def tally(winners: list[str | None]) -> str:
    """In how many settings each planner has the lowest error."""
    counts = Counter(planner for planner in winners if planner is not None)
    won = "; ".join(f"{planner} in {count}" for planner, count in counts.most_common())
    none = f"in {winners.count(None)} chance could explain the lead"
    settings = f"of {len(winners)} settings"
    leads = f"{won}; {none}" if won else none
    return (
        f"Lowest error of all planners under the same noise, {settings}: {leads} (see pairs.csv)."
    )


def winner(group: "pd.DataFrame") -> str | None:
    """The planner with a lower error than each other one in a setting, if chance could not explain it."""
    beaten: dict[str, set[str]] = {}
    for row in group.to_dict("records"):
        if row["p_holm"] < SIGNIFICANT and row["difference"] != 0:
            better, worse = (row["planner"], row["against"])[:: 1 if row["difference"] < 0 else -1]
            beaten.setdefault(better, set()).add(worse)
    planners = {*group["planner"], *group["against"]}
    return next(
        (planner for planner, others in beaten.items() if others == planners - {planner}), None
    )


def verdict(labels: list[str], values: tuple, group: "pd.DataFrame") -> str:
    """Which planner has the lowest error in one setting, and by how much."""
    where = ", ".join(
        [
            values[0],
            *(
                f"{key} = {worded(value)}"
                for key, value in zip(labels[1:], values[1:], strict=True)
            ),
        ]
    )
    best = winner(group)
    if best is None:
        return f"{where}: no planner leads all others by more than chance could explain."
    rows = [row for row in group.to_dict("records") if best in (row["planner"], row["against"])]
    closest = min(rows, key=lambda row: abs(row["difference"]))
    other = closest["against"] if closest["planner"] == best else closest["planner"]
    p = max(row["p_holm"] for row in rows)
    lead = f"by {metres(abs(closest['difference']))} in the median of {closest['pairs']} seeds against {other}"
    return f"{where}: {best} has the lowest error, {lead} (corrected p at most {p:.1g})."
