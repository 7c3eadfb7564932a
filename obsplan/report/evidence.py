"""Evidence in words: tables of Markdown, a summary that is computed, and a figure."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# because pandas is not typed: its columns may be anything

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from obsplan.campaign.evidence import BEST, BROKE, LEVEL_WITH, WORSE, lowest_in, rows_of
from obsplan.constraints import ROUNDING
from obsplan.report.tables import cell
from obsplan.report.words import marked

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GOOD = (BEST, LEVEL_WITH)
HIGHEST = 2.5  # times the planner's median, at which the figure ends


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write a table."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def number(value: float) -> str:
    """An error or ratio; a mission that failed has an infinite one."""
    return "failed" if np.isinf(value) else cell(None if np.isnan(value) else value, 2)


def chance(p: float) -> str:
    """A p value."""
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


def spread(row: Mapping[str, Any], prefix: str = "") -> str:
    """A median with its interval."""
    low, high = number(row[f"{prefix}low"]), number(row[f"{prefix}high"])
    return f"{number(row[f'{prefix}median'])} [{low}, {high}]"


def broken(violation: float) -> str:
    """By how much a limit was broken at most, if there is any."""
    if np.isnan(violation):
        return "–"
    return f"{violation:.2f} †" if violation > ROUNDING else "kept"


def median_table(rows: "pd.DataFrame", planner: str, told: Mapping[str, str]) -> str:
    """Tabulate medians beside the best other planner and the reference.

    ``told`` says by scenario what planners know; "estimate" is left out.
    """
    reference = "whole_mission_median" in rows
    headings = ["scenario", "seeds", f"`{planner}` [m]", "best other", "its error [m]"]
    headings += ["ratio", "p (Holm)", "verdict"]
    headings += ["`whole-mission` [m]", "ratio to it"] if reference else []
    lines = []
    for row in rows_of(rows):
        own = [f"{row['seeds']}", marked(spread(row), row["broke"])]
        rival = [marked(f"`{row['rival']}`", row["rival_broke"]), spread(row, "rival_")]
        compared = [number(row["ratio"]), chance(row["p_holm"]), row["verdict"]]
        line = [scenario_cell(row["scenario"], told), *own, *rival, *compared]
        if reference:
            line += [spread(row, "whole_mission_"), number(row["whole_mission_ratio"])]
        lines.append(line)
    return markdown(headings, lines)


def scenario_cell(scenario: str, told: Mapping[str, str]) -> str:
    """A scenario's name, marked where planners know more or less than AUVs' estimates."""
    knowledge = told.get(scenario, "estimate")
    return f"`{scenario}`" + ("" if knowledge == "estimate" else f" ({knowledge})")


def tail_table(rows: "pd.DataFrame", planner: str, told: Mapping[str, str]) -> str:
    """Tabulate tails beside the other planner whose 95 % quantile is the lowest."""
    headings = ["scenario", f"`{planner}`: 95 %", "worst", "late", "limits", "lowest other"]
    headings += ["its 95 %", "worst", "late", "limits", "ratio of 95 %", "verdict", "worst / bound"]
    lines = []
    for row in rows_of(rows):
        line = [scenario_cell(row["scenario"], told), *tails(row, ""), f"`{row['tail_rival']}`"]
        ratio = f"{number(row['tail_ratio'])} [{number(row['tail_low'])}, "
        ratio += f"{number(row['tail_high'])}]"
        line += [*tails(row, "tail_rival_"), ratio, row["tail_verdict"], number(row["over_bound"])]
        lines.append(line)
    return markdown(headings, lines)


def tails(row: Mapping[str, Any], prefix: str) -> list[str]:
    """A planner's 95 % quantile, worst mission, late error and greatest violation."""
    errors = [number(row[f"{prefix}{figure}"]) for figure in ("q95", "worst", "late")]
    return [*errors, broken(row[f"{prefix}violation"])]


def summary(rows: "pd.DataFrame", planner: str) -> list[str]:
    """Say in sentences what the rows say, each number counted from them."""
    verdicts = rows["verdict"]
    lowest, best = sum(lowest_in(rows, "median", "rival")), int((verdicts == BEST).sum())
    said = [
        f"`{planner}` has the lowest median in {lowest} of {len(rows)} scenarios, and is lowest or "
        f"level in {int(verdicts.isin(GOOD).sum())}; in {best} it is lower beyond chance.",
        listed(rows, verdicts == WORSE, "Worse in the median beyond chance"),
        listed(rows, verdicts == BROKE, "It broke a limit that its best rival kept"),
    ]
    said += worst_ratio(rows, "ratio", "the best other planner")
    if "whole_mission_ratio" in rows:
        said += worst_ratio(rows, "whole_mission_ratio", "`whole-mission`")
    if failed := int(rows["failed"].sum()):
        said.append(f"{failed} missions failed, and count as worse than any other.")
    return said


def tail_summary(rows: "pd.DataFrame") -> list[str]:
    """Say the same of 95 % quantiles."""
    verdicts = rows["tail_verdict"]
    lowest, level = sum(lowest_in(rows, "q95", "tail_rival")), int(verdicts.isin(GOOD).sum())
    both = int((rows["verdict"].isin(GOOD) & verdicts.isin(GOOD)).sum())
    return [
        f"Its 95 % quantile is the lowest in {lowest} of {len(rows)}, and lowest or level in "
        f"{level}; in {both} it is lowest or level in both.",
        listed(rows, verdicts == WORSE, "Worse in the 95 % quantile beyond chance"),
    ]


def listed(rows: "pd.DataFrame", where: "pd.Series", what: str) -> str:
    """A sentence that names scenarios, or says that there are none."""
    names = ", ".join(f"`{name}`" for name in rows.loc[where, "scenario"])
    return f"{what}: {names or 'nowhere'}."


def worst_ratio(rows: "pd.DataFrame", column: str, other: str) -> list[str]:
    """Say how far behind a planner is at most, and how often within 5 and 10 %."""
    ratios = rows.set_index("scenario")[column].dropna()
    if ratios.empty:
        return []
    within = [int((ratios <= 1 + share).sum()) for share in (0.05, 0.1)]
    return [
        f"The worst ratio to {other} is {ratios.max():.2f}, in `{ratios.idxmax()}`; "
        f"it is at most 1.05 in {within[0]} and 1.10 in {within[1]} of {len(ratios)}."
    ]


def evidence_figure(rows: "pd.DataFrame", planner: str) -> "Figure":
    """Draw each scenario's medians with intervals and 95 % quantiles, over the planner's median."""
    from matplotlib.figure import Figure

    from obsplan.report.style import COLOURS, head

    who = {planner: "", "best other": "rival_", "whole-mission": "whole_mission_"}
    drawn = {name: prefix for name, prefix in who.items() if f"{prefix}median" in rows}
    figure = Figure(figsize=(8.0, 1.6 + 0.3 * len(rows)), layout="constrained")
    axes = figure.subplots()
    for k, (name, prefix) in enumerate(drawn.items()):
        draw_planner(axes, rows, prefix, name, COLOURS[k], 0.24 * (k - 1))
    axes.set_yticks(range(len(rows)), list(rows["scenario"]))
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xscale("log")
    ticks = [0.6, 0.8, 1.0, 1.25, 1.6, 2.0, HIGHEST]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlim(0.55, HIGHEST)
    axes.axvline(1.0, color="#888888", lw=0.8, zorder=0)
    axes.set_xlabel(f"RMS position error over the median of {planner} [-]")
    beside_the_title = (1.0, 1.0)
    axes.legend(loc="lower right", bbox_to_anchor=beside_the_title, ncols=3, fontsize=8)
    how = "Symbol and bar: median and its 95 % interval. Stroke: 95 % quantile of missions."
    head(figure, f"{planner} beside the best other planner", how)
    return figure


def draw_planner(
    axes: "Axes", rows: "pd.DataFrame", prefix: str, name: str, paint: str, aside: float
) -> None:
    """Draw one planner's medians and tails in all rows; what is beyond the figure ends at it."""
    y = np.arange(len(rows)) + aside
    own = rows["median"].to_numpy()
    names = ("median", "low", "high", "q95")
    values = {short: rows[f"{prefix}{short}"].to_numpy() / own for short in names}
    within = {short: np.minimum(value, HIGHEST) for short, value in values.items()}
    axes.hlines(y, within["median"], within["q95"], color=paint, lw=0.7)
    axes.hlines(y, within["low"], within["high"], color=paint, lw=2.4)
    axes.plot(within["median"], y, "o", ms=4, color=paint, label=name)
    axes.plot(within["q95"], y, "|", ms=6, color=paint)
