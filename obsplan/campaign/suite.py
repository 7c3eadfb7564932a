"""Planners over a suite of scenarios: who wins where, by how much, at what cost.

The certified bound says how far all of them are from what is possible.
"""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportReturnType=false
# because pandas is not typed: its columns may be anything

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from obsplan.campaign.statistics import LEVEL, medians, signed_rank_p
from obsplan.constraints import ROUNDING
from obsplan.planning.interface import expression_of
from obsplan.planning.team import Team
from obsplan.scenario import Scenario, load
from obsplan.simulation import ClosedLoop
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    import pandas as pd

    from obsplan.campaign.plan import Cell

WEIGHTED = ("rms_error_m", "rms_error_late_m", "pcrb_rms_m", "pcrb_rms_late_m")
BRIEF = "duration=60.0"  # [s]; long enough to time decisions
MEDIANS = (
    "scenario",
    "planner",
    "missions",
    "failed",
    "rms_error_m",
    "rms_error_m_low",
    "rms_error_m_high",
    "rms_error_q95_m",
    "rms_error_worst_m",
    "rms_error_late_m",
    "pcrb_rms_m",
    "violation_worst_m",
)


@dataclass(frozen=True, kw_only=True)
class Suite:
    """What a campaign over planners and scenarios says.

    ``cells`` has one row per scenario and planner: medians, of the RMS error with its 95 %
    interval, its 95 % quantile and the worst, the worst violation of any seed and whether it
    ``broke`` a limit, ``ratio`` to the scenario's best median error, ``p`` of Wilcoxon's
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
    cells = compared_cells(table).assign(
        efficiency=lambda cells: cells["scenario"].map(bounds) / cells["pcrb_rms_m"]
    )
    return Suite(cells=cells, planners=planners_on_the_whole(cells, decision_ms))


def compared_cells(table: "pd.DataFrame") -> "pd.DataFrame":
    """Each scenario's planners beside the best of them: ``broke``, ``ratio``, ``p``, ``ties``."""
    cells = medians(table)[[*MEDIANS]].rename(columns={"violation_worst_m": "violation_max_m"})
    cells["broke"] = cells["violation_max_m"] > ROUNDING
    best = best_of_each(cells)
    error = cells["rms_error_m"]
    # one that always failed has no error, and is infinitely worse than any other
    cells["ratio"] = (error / cells["scenario"].map(best["rms_error_m"])).fillna(np.inf)
    cells["p"] = against_the_best(table, cells, best)
    best_kept = cells["scenario"].map(~best["broke"]).eq(True)
    no_equal = cells["broke"] & best_kept
    cells["ties"] = (cells["p"] > LEVEL) & error.notna() & ~no_equal
    return cells


def best_of_each(cells: "pd.DataFrame") -> "pd.DataFrame":
    """The lowest median error of each scenario, of planners that kept its limits if any did."""
    flown = cells.dropna(subset="rms_error_m")
    order = flown.sort_values(["scenario", "broke", "rms_error_m"], kind="stable")
    return order.groupby("scenario").head(1).set_index("scenario")


def against_the_best(
    table: "pd.DataFrame", cells: "pd.DataFrame", best: "pd.DataFrame"
) -> list[float]:
    """P of each planner's errors against those of its scenario's best over the same seeds.

    It is 1 of the best against itself, and where there are no errors.
    """
    errors = table.pivot_table(
        index=["scenario", "seed"], columns="planner", values="rms_error_m", dropna=False
    )
    found = []
    for scenario, planner in zip(cells["scenario"], cells["planner"], strict=True):
        rival = best["planner"].get(scenario, "")
        if planner == rival or not {planner, rival} <= set(errors.columns):
            found.append(1.0)
            continue
        by_seed = errors.loc[scenario]
        differences = (by_seed[planner] - by_seed[rival]).dropna()
        found.append(signed_rank_p(differences.to_numpy()))
    return found


def planners_on_the_whole(cells: "pd.DataFrame", decision_ms: dict[str, float]) -> "pd.DataFrame":
    """Each planner over all scenarios, the best first."""
    planners = (
        cells.groupby("planner")
        .agg(
            wins=("ratio", lambda ratio: int((ratio == 1.0).sum())),
            ties=("ties", "sum"),
            mean_ratio=("ratio", lambda ratio: float(np.exp(np.mean(np.log(ratio))))),
            worst_ratio=("ratio", "max"),
            worst_scenario=("ratio", lambda ratio: cells.loc[ratio.idxmax(), "scenario"]),
            efficiency=("efficiency", "median"),
            violation_max_m=("violation_max_m", "max"),
            broke=("broke", "any"),
        )
        .reset_index()
    )
    planners["decision_ms"] = planners["planner"].map(decision_ms)
    return planners.sort_values(["broke", "mean_ratio", "planner"], ignore_index=True)


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
            f"{folder} has missions of these planners under several settings; "
            "give each --set one value, or another --out"
        )
    return found


def weighted(cells: "tuple[Cell, ...]", table: "pd.DataFrame") -> "pd.DataFrame":
    r"""A campaign's table whose RMS figures count AUVs by their weights, as planners are told to.

    .. math:: \sqrt{\sum_i w_i e_i^2 / \sum_i w_i}

    Where all weights of a scenario are alike its rows are as they were.
    """
    auvs = {cell.scenario: json.loads(cell.content)["auv"] for cell in cells}
    weights = {name: [auv.get("weight", 1.0) for auv in found] for name, found in auvs.items()}
    rows = table["scenario"].map(lambda name: len(set(weights.get(name, ()))) > 1)
    rows &= table["status"] == "done"
    table = table.copy()
    for place in table.index[rows]:
        figures = list(json.loads(table.at[place, "auv"]).values())
        shares = weights[table.at[place, "scenario"]]
        for figure in WEIGHTED:
            squares = np.square([auv[figure] for auv in figures])
            table.at[place, figure] = np.sqrt(np.average(squares, weights=shares))
    return table


def least_error(scenario: Scenario) -> float:
    """Certified least RMS position error [m] of any path of the aid vehicle, over all AUVs.

    It holds for the scenario's seed, and is nan where none is known: for ranging of a user's own.
    """
    loop = ClosedLoop(scenario=scenario, planner=scenario.team())
    run = loop.fly(scenario.table.seed)
    if run.unbounded:
        return float("nan")
    return float(np.sqrt(np.mean([bound.bound for bound in run.information_bounds])))


def called(planner: Any) -> Any:
    """The same planner, to be called between the steps."""
    return planner if expression_of(planner) is None else SimpleNamespace(plan=planner.plan)


def decision_time(scenario: Scenario) -> float:
    """Median time of a decision [ms] of the scenario's planner, called between the steps."""
    planners = [called(scenario.planner(aid)) for aid in range(len(scenario.aids))]
    walked = planners[0] if len(planners) == 1 else Team(tuple(planners))
    run = ClosedLoop(scenario=scenario, planner=walked).fly(scenario.table.seed)
    return float(np.median(run.timing.decision_seconds) * 1e3)


def yardsticks(
    scenarios: Sequence[str],
    planners: Sequence[str],
    settings: Sequence[str],
    progress: Callable[[int, int], None],
    *,
    bounded: bool = True,
) -> tuple[dict[str, float], dict[str, float]]:
    """The certified least error in each scenario [m]; each planner's median decision time [ms].

    The former are nan unless they are asked for: ``bounded``.
    """
    bounds: dict[str, float] = {}
    times: dict[str, list[float]] = {planner: [] for planner in planners}
    for done, name in enumerate(scenarios, start=1):
        plain = load(name, planner="circle", settings=settings)
        bounds[plain.table.name] = least_error(plain) if bounded else float("nan")
        for planner in planners:
            brief = load(name, planner=planner, settings=[*settings, BRIEF])
            times[planner].append(decision_time(brief))
        progress(done, len(scenarios))
    return bounds, {planner: float(np.median(taken)) for planner, taken in times.items()}


def beyond_chance(suite: Suite, planner: str) -> int:
    """In how many scenarios a planner leads all others that kept the limits beyond chance.

    Where there are no such others, it does.
    """
    cells = suite.cells.dropna(subset="rms_error_m")
    led = cells[(cells["planner"] == planner) & (cells["ratio"] == 1.0)]["scenario"]
    rivals = cells[(cells["planner"] != planner) & ~cells["broke"] & cells["scenario"].isin(led)]
    highest = rivals.groupby("scenario")["p"].max().to_numpy()
    return int(np.count_nonzero(highest <= LEVEL))
