"""Planners over a suite of scenarios: who wins where, by how much, at what cost, and how far all are from the physical limit."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportGeneralTypeIssues=false
# pyright: reportReturnType=false
# because pandas is not typed: its columns may be anything

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from obsplan.campaign.statistics import LEVEL, fewest_pairs, medians, signed_rank_p
from obsplan.constraints import ROUNDING
from obsplan.files import write_atomically
from obsplan.planning.interface import expression_of
from obsplan.report.tables import violation_cell
from obsplan.report.words import marked, metres, title
from obsplan.scenario import Scenario, load
from obsplan.simulation import ClosedLoop
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.table import Table

    from obsplan.campaign.plan import Cell

FEWEST = fewest_pairs(1)  # seeds of which a difference can be told from chance
BRIEF = "duration=60.0"  # [s]; long enough to time decisions
SHOWN_WORST = 5.0  # times the best, at which the figure's colours end


@dataclass(frozen=True, kw_only=True)
class Suite:
    """What a campaign over planners and scenarios says.

    ``cells`` has one row per scenario and planner: medians, the worst violation of any seed and
    whether it ``broke`` a limit, ``ratio`` to the scenario's best median error, ``p`` of Wilcoxon's
    signed-rank test against that planner over paired seeds, ``ties`` whether it is the best or not
    distinguishable from it, ``efficiency``. ``planners`` has one row per planner: ``wins``,
    ``ties``, mean and worst ratio, decision time. The best is the lowest of those that kept all
    limits in the scenario; planners that broke one come last.
    """

    cells: "pd.DataFrame"
    planners: "pd.DataFrame"


def read_suite(
    table: "pd.DataFrame", bounds: dict[str, float], decision_ms: dict[str, float]
) -> Suite:
    """Read a campaign's table.

    Parameters
    ----------
    table
        One row per mission, as `load_campaign` gives it.
    bounds
        Certified least RMS error of any path, per scenario [m].
    decision_ms
        Median time of a decision, per planner [ms].
    """
    cells = medians(table)[
        [
            "scenario",
            "planner",
            "missions",
            "failed",
            "rms_error_m",
            "pcrb_rms_m",
            "violation_worst_m",
        ]
    ].rename(columns={"violation_worst_m": "violation_max_m"})
    cells["broke"] = cells["violation_max_m"] > ROUNDING
    errors = table.pivot_table(
        index=["scenario", "seed"], columns="planner", values="rms_error_m", dropna=False
    )
    flown = cells.dropna(
        subset="rms_error_m"
    )  # a planner that always failed has no error, and is infinitely worse than any other
    best = _best(flown)
    against = [best["planner"].get(scenario, "") for scenario in cells["scenario"]]
    kept = cells["scenario"].map(~best["broke"]).eq(True)  # the best has: who has not is no equal
    p = [
        _p(errors.loc[s], one, other)
        for s, one, other in zip(cells["scenario"], cells["planner"], against, strict=True)
    ]
    cells = cells.assign(
        ratio=(cells["rms_error_m"] / cells["scenario"].map(best["rms_error_m"])).fillna(np.inf),
        p=p,
        ties=(np.array(p) > LEVEL) & cells["rms_error_m"].notna() & ~(cells["broke"] & kept),
        efficiency=cells["scenario"].map(bounds) / cells["pcrb_rms_m"],
    )
    by_planner = cells.groupby("planner")
    planners = by_planner.agg(
        wins=("ratio", lambda r: int((r == 1.0).sum())),
        ties=("ties", "sum"),
        mean_ratio=("ratio", lambda r: float(np.exp(np.mean(np.log(r))))),
        worst_ratio=("ratio", "max"),
        worst_scenario=("ratio", lambda r: cells.loc[r.idxmax(), "scenario"]),
        efficiency=("efficiency", "median"),
        violation_max_m=("violation_max_m", "max"),
        broke=("broke", "any"),
    ).reset_index()
    planners["decision_ms"] = planners["planner"].map(decision_ms)
    order = ["broke", "mean_ratio", "planner"]
    return Suite(cells=cells, planners=planners.sort_values(order, ignore_index=True))


def _best(flown: "pd.DataFrame") -> "pd.DataFrame":
    """The lowest median error of each scenario, of planners that kept its limits if any did."""
    order = flown.sort_values(["scenario", "broke", "rms_error_m"], kind="stable")
    return order.groupby("scenario").head(1).set_index("scenario")


def _p(errors: "pd.DataFrame", one: str, other: str) -> float:
    """Of the two planners' errors over the same seeds; 1 of a planner against itself, or where there are none."""
    if one == other or not {one, other} <= set(errors.columns):
        return 1.0
    return signed_rank_p((errors[one] - errors[other]).dropna().to_numpy())


def missions_of(cells: "tuple[Cell, ...]", table: "pd.DataFrame", folder: Path) -> "pd.DataFrame":
    """Those missions of a campaign's table that the cells plan.

    Raises
    ------
    ObsplanError
        The folder has missions of the same planners and seeds under other settings.
    """
    planned = {(cell.scenario, cell.planner, seed) for cell in cells for seed in cell.seeds}
    keys = list(zip(table["scenario"], table["planner"], table["seed"], strict=True))
    found = table[[key in planned for key in keys]]
    if len(found) > len(planned) or sum(len(cell.seeds) for cell in cells) > len(planned):
        raise ObsplanError(
            f"{folder} has missions of these planners under several settings; give each --set one value, or another --out"
        )
    return found


def least_error(scenario: Scenario) -> float:
    """Certified least RMS position error [m] of any path of the aid vehicle, over all AUVs, for the scenario's seed."""
    loop = ClosedLoop(scenario=scenario, planner=scenario.planner())
    bounds = loop.fly(scenario.table.seed).information_bounds
    return float(np.sqrt(np.mean([bound.bound for bound in bounds])))


def decision_time(scenario: Scenario) -> float:
    """Median time of a decision of the scenario's planner, called between the steps of the mission [ms]."""
    planner = scenario.planner()
    walked = planner if expression_of(planner) is None else SimpleNamespace(plan=planner.plan)
    return float(
        np.median(
            ClosedLoop(scenario=scenario, planner=walked)
            .fly(scenario.table.seed)
            .timing.decision_seconds
        )
        * 1e3
    )


def yardsticks(
    scenarios: Sequence[str],
    planners: Sequence[str],
    settings: Sequence[str],
    progress: Callable[[int, int], None],
) -> tuple[dict[str, float], dict[str, float]]:
    """The certified least error in each scenario [m], and the median decision time of each planner over them [ms]."""
    bounds: dict[str, float] = {}
    times: dict[str, list[float]] = {planner: [] for planner in planners}
    for done, name in enumerate(scenarios, start=1):
        plain = load(name, planner="circle", settings=settings)
        bounds[plain.table.name] = least_error(plain)
        for planner in planners:
            brief = load(name, planner=planner, settings=[*settings, BRIEF])
            times[planner].append(decision_time(brief))
        progress(done, len(scenarios))
    return bounds, {planner: float(np.median(taken)) for planner, taken in times.items()}


def suite_table(suite: Suite) -> "Table":
    """Tabulate planners, the best on the whole first."""
    from rich.table import Table

    n = suite.cells["scenario"].nunique()
    headings = (
        f"Lowest of {n}",
        "Or equal",
        "Mean ratio",
        "Worst ratio",
        "in",
        "Efficiency",
        "Decision [ms]",
        "Limit broken by [m]",
    )
    table = Table(title="RMS error against the best planner of each scenario", title_justify="left")
    add_columns(table, ["Planner", *headings], words=("Planner", "in"))
    for row in suite.planners.itertuples():
        numbers = (
            f"{row.mean_ratio:.2f}",
            f"{row.worst_ratio:.2f}",
            str(row.worst_scenario),
            f"{row.efficiency:.2f}",
        )
        table.add_row(
            marked(str(row.planner), bool(row.broke)),
            str(row.wins),
            str(int(row.ties)),
            *numbers,
            f"{row.decision_ms:.2f}",
            violation_cell(None if np.isnan(row.violation_max_m) else row.violation_max_m),
        )
    return table


def add_columns(table: "Table", headings: Sequence[str], words: Sequence[str]) -> None:
    """Add columns, those of numbers justified to the right; units in brackets are no markup."""
    from rich.text import Text

    for heading in headings:
        table.add_column(Text(heading), justify="left" if heading in words else "right")


def suite_sentences(suite: Suite) -> list[str]:
    """Say who leads on the whole, how often beyond chance and by how much, and who broke limits."""
    first, *others = suite.planners.to_dict("records")
    scenarios = suite.cells["scenario"].nunique()
    said = (
        f"{first['planner']} leads on the whole: lowest median error in {first['wins']} of "
        f"{scenarios} scenarios, in {beyond_chance(suite, first['planner'])} of them beyond chance"
    )
    if others:
        behind = others[0]["mean_ratio"] / first["mean_ratio"]
        said += (
            f"; {others[0]['planner']} comes next, with {behind:.2f} times its error in the mean"
        )
    few = f"With fewer than {FEWEST} seeds (--runs) no difference can be told from chance: all planners count as equal."
    broken = [
        f"{row['planner']} broke a limit, by up to {metres(row['violation_max_m'])}."
        for row in (first, *others)
        if row["violation_max_m"] > ROUNDING
    ]
    return [f"{said}.", *([few] if suite.cells["missions"].min() < FEWEST else []), *broken]


def beyond_chance(suite: Suite, planner: str) -> int:
    """In how many scenarios a planner leads all others that kept the limits, if there are any, beyond chance."""
    cells = suite.cells.dropna(subset="rms_error_m")
    led = cells[(cells["planner"] == planner) & (cells["ratio"] == 1.0)]["scenario"]
    rivals = cells[(cells["planner"] != planner) & ~cells["broke"] & cells["scenario"].isin(led)]
    highest = rivals.groupby("scenario")["p"].max().to_numpy()
    return int(np.count_nonzero(highest <= LEVEL))


def scenario_table(suite: Suite) -> "Table":
    """Tabulate, scenario by scenario, the planner that is best on the whole beside the best of the others."""
    from rich.table import Table

    first = suite.planners["planner"].iloc[0]
    table = Table(title=f"{first}, by scenario", title_justify="left")
    headings = ("Scenario", "RMS [m]", "Best other", "RMS [m]", "Ratio", "p", "Efficiency")
    add_columns(table, headings, words=("Scenario", "Best other"))
    for name, cells in suite.cells.groupby("scenario"):
        own, others = (
            cells[cells["planner"] == first].iloc[0],
            cells[cells["planner"] != first].dropna(subset=["rms_error_m"]),
        )
        errors, rival = marked(f"{own.rms_error_m:.2f}", bool(own.broke)), ("", "", "", "")
        if len(others):
            other = others.sort_values(["broke", "rms_error_m"], kind="stable").iloc[0]
            p = other.p if own.ratio == 1.0 else own.p
            rival = (
                marked(str(other.planner), bool(other.broke)),
                f"{other.rms_error_m:.2f}",
                f"{own.rms_error_m / other.rms_error_m:.2f}",
                f"{p:.2g}",
            )
        table.add_row(str(name), errors, *rival, f"{own.efficiency:.2f}")
    return table


def suite_figure(suite: Suite) -> "Figure":
    """Draw every planner in every scenario: its median RMS error, coloured by how many times the best it is."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    from obsplan.report.style import head

    planners, scenarios = list(suite.planners["planner"]), sorted(suite.cells["scenario"].unique())
    grid = suite.cells.pivot_table(
        index="scenario", columns="planner", values=["ratio", "rms_error_m", "ties", "broke"]
    ).loc[scenarios]
    ratio = grid["ratio"][planners].to_numpy(dtype=float)
    figure = Figure(
        figsize=(2.2 + 0.95 * len(planners), 1.4 + 0.32 * len(scenarios)), layout="constrained"
    )
    axes = figure.subplots()
    image = axes.imshow(ratio, norm=LogNorm(1.0, SHOWN_WORST), cmap="YlOrBr", aspect="auto")
    for (i, j), times in np.ndenumerate(ratio):
        error, tied, broke = (
            grid[key][planners].iloc[i, j] for key in ("rms_error_m", "ties", "broke")
        )
        style = {
            "weight": "bold" if tied == 1 else "normal",
            "color": "white" if times > SHOWN_WORST / 2 else "black",
        }
        number = marked(f"{error:.2f}", bool(broke == 1))
        axes.text(j, i, number, ha="center", va="center", fontsize=8, **style)
    axes.set_xticks(range(len(planners)), planners, rotation=30, ha="right")
    axes.set_yticks(range(len(scenarios)), [title(scenario) for scenario in scenarios])
    axes.grid(visible=False)
    ticks = [1.0, 1.5, 2.0, 3.0, SHOWN_WORST]
    bar = figure.colorbar(image, label="Times the best [-]", extend="max", ticks=ticks)
    bar.ax.set_yticklabels([f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
    key = "Bold: the best, or not distinguishable from it."
    if bool(suite.cells["broke"].any()):
        key += " †: broke a limit."
    head(figure, "Median RMS position error [m]", key)
    return figure


def write_suite(suite: Suite, folder: Path) -> list[str]:
    """Write ``suite.csv``, ``planners.csv`` and ``suite.png`` into a folder; returns their names."""
    from obsplan.report.style import png

    timeless = suite.planners.drop(columns="decision_ms")  # the same bytes on every machine
    write_atomically(folder / "suite.csv", suite.cells.to_csv(index=False, float_format="%.6g"))
    write_atomically(folder / "planners.csv", timeless.to_csv(index=False, float_format="%.6g"))
    write_atomically(folder / "suite.png", png(lambda: suite_figure(suite)))
    return ["suite.csv", "planners.csv", "suite.png"]
