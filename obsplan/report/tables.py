"""Figures of merit of a run as a table, for the terminal and for notebooks."""

from collections.abc import Sequence
from html import escape
from typing import Any

from rich.table import Table
from rich.text import Text

from obsplan.constraints import ROUNDING
from obsplan.record import REPLAY
from obsplan.report.sea import summary_of
from obsplan.run import Run

# Heading of each figure of merit, in words short enough for 80 columns, and its decimals.
COLUMNS = {
    "rms_error_m": ("RMS error [m]", 2),
    "max_error_m": ("Worst error [m]", 2),
    "smoothed_rms_error_m": ("Smooth [m]", 2),
    "sigma_rms_m": ("Own σ [m]", 2),
    "pcrb_rms_m": ("PCRB RMS [m]", 2),
    "bound_rms_m": ("Bound RMS [m]", 2),
    "efficiency": ("Eff. [-]", 2),
    "mean_nees": ("NEES [-]", 1),
    "separation_mean_m": ("Mean sep. [m]", 1),
    "separation_max_m": ("Max sep. [m]", 1),
    "violation_max_m": ("Limit broken by [m]", 2),
}
# and for what no terminal has room: there they are said in words
IN_NOTEBOOKS = COLUMNS | {"ranges_due": ("Ranges due", 0), "ranges_lost": ("Lost", 0)}
SAID = {  # of columns that need an explanation
    "pcrb_rms_m": "PCRB: posterior Cramér–Rao bound of this path",
    "bound_rms_m": "Bound: of any path",
    "efficiency": "Eff.: Bound / PCRB",
    "mean_nees": "NEES: 2 if consistent",
    "separation_mean_m": "sep.: separation",
    "smoothed_rms_error_m": "Smooth: RMS error once all ranges are known",
    "sigma_rms_m": "Own σ: RMS error as the filter says it",
}


def run_table(run: Run) -> Table:
    """Tabulate each AUV's figures of merit, and those of all."""
    summary = run.summary()
    columns = [key for key in COLUMNS if key in summary["all"]]
    table = Table(
        title=Text(title(summary)),
        title_justify="left",
        caption=caption(columns),
        caption_justify="left",
    )
    table.add_column("AUV")
    for key in columns:
        table.add_column(Text(COLUMNS[key][0]), justify="right")
    for name, figures in summary["auv"].items():
        table.add_row(Text(name), *(_figure(key, figures.get(key)) for key in columns))
    if len(summary["auv"]) > 1:
        table.add_section()
        table.add_row("all", *(_figure(key, summary["all"][key]) for key in columns))
    return table


def run_html(run: Run) -> str:
    """Tabulate the same in HTML, without the certified bound, which takes a while."""
    summary = summary_of(run, bounds=False)
    columns = [key for key in IN_NOTEBOOKS if key in summary["all"]]
    rows = dict(summary["auv"])
    if len(rows) > 1:
        rows["all"] = summary["all"]
    head = "".join(f"<th>{escape(IN_NOTEBOOKS[key][0])}</th>" for key in columns)
    lines = [
        "<table>",
        f"<caption>{escape(title(summary))}</caption>",
        f"<thead><tr><th>AUV</th>{head}</tr></thead>",
        "<tbody>",
    ]
    for name, figures in rows.items():
        cells = "".join(f"<td>{_figure(key, figures.get(key))}</td>" for key in columns)
        lines.append(f"<tr><th>{escape(name)}</th>{cells}</tr>")
    return "\n".join([*lines, "</tbody>", "</table>"])


def caption(columns: Sequence[str]) -> str:
    """What headings mean."""
    return "; ".join(text for key, text in SAID.items() if key in columns)


def title(summary: dict[str, Any]) -> str:
    """What was flown."""
    if summary.get("source") == REPLAY:
        return f"{summary['scenario']}, replayed"
    return f"{summary['scenario']}, {summary['planner']}, seed {summary['seed']}"


def _figure(key: str, value: Any) -> str:
    """A figure of merit as its column shows it; of an AUV without truth some are not known."""
    return violation_cell(value) if key == "violation_max_m" else cell(value, IN_NOTEBOOKS[key][1])


def breaks(violation: float | None) -> bool:
    """Whether that is more than rounding [m]."""
    return violation is not None and violation > ROUNDING


def violation_cell(violation: float | None) -> str:
    """By how much a limit was broken [m], if one was."""
    return cell(violation, 2) if violation is None or breaks(violation) else "kept"


def cell(value: Any, decimals: int) -> str:
    """A number, or a dash where there is none."""
    return "–" if value is None else f"{value:.{decimals}f}" if abs(value) < 1e5 else f"{value:.1e}"
