"""One planner against the best of the others, scenario by scenario: medians, tails, chance.

Of others, those that know more than it (`REFERENCES`) are no rivals and stand beside.
"""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportReturnType=false
# because pandas is not typed: its columns may be anything

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from obsplan.campaign.statistics import (
    LEVEL,
    holm,
    medians,
    signed_rank_p,
    tail_ratio,
    with_failures,
)
from obsplan.constraints import ROUNDING

if TYPE_CHECKING:
    import pandas as pd

REFERENCES = ("whole-mission", "rolling")  # that plan with the surveys as filed
BEST, LEVEL_WITH, WORSE, BROKE = "best", "level", "worse", "broke a limit"
FIGURES = {  # of each planner in a row, and where `medians` has them
    "median": "rms_error_m",
    "low": "rms_error_m_low",
    "high": "rms_error_m_high",
    "q95": "rms_error_q95_m",
    "worst": "rms_error_worst_m",
    "late": "rms_error_late_m",
    "violation": "violation_worst_m",
}


def evidence(
    table: "pd.DataFrame", planner: str, *, corrected: bool = True
) -> "tuple[pd.DataFrame, pd.DataFrame]":
    """Compare a planner with the best other one of each scenario.

    Parameters
    ----------
    table
        One row per mission, as `load_campaign` gives it, of one setting.
    planner
        The one that is compared.
    corrected
        Whether p values are corrected by Holm for the number of scenarios before a verdict; left
        uncorrected a planner is the sooner called worse.

    Returns
    -------
    One row per scenario, and `medians` of all. A row has ``seeds``, ``failed``; the `FIGURES` [m]
    of the planner, of ``rival`` (lowest median of those that kept the limits, of all if none did),
    of ``tail_rival`` (lowest 95 % quantile of the same) and of each reference, as ``rival_q95``;
    ``ratio``, the median of the planner's error over its rival's, seed by seed; ``p`` of Wilcoxon's
    signed-rank test and ``p_holm``; ``tail_ratio`` of the 95 % quantiles with its 95 % interval;
    ``verdict`` and ``tail_verdict``; ``over_bound``, the greatest error after the first tenth over
    the Cramér-Rao bound of the same. Rivals are chosen by what is compared, which favours them.
    """
    import pandas as pd

    cells = medians(table, ["scenario", "planner"])
    cells["broke"] = cells["violation_worst_m"] > ROUNDING
    rows = []
    for scenario, missions in table.groupby("scenario", sort=True):
        here = cells[cells["scenario"] == scenario].set_index("planner")
        if planner in here.index:
            rows.append({"scenario": scenario, **compared(missions, here, planner)})
    found = pd.DataFrame(rows)
    found["p_holm"] = holm(found["p"].to_numpy(dtype=float)) if rows else []
    decisive = "p_holm" if corrected else "p"
    found["verdict"] = [verdict(row, row[decisive]) for row in rows_of(found)]
    found["tail_verdict"] = [tail_verdict(row) for row in rows_of(found)]
    return found, cells


def rows_of(found: "pd.DataFrame") -> list[dict[str, Any]]:
    """Rows as tables by column."""
    return found.to_dict("records")


def compared(missions: "pd.DataFrame", here: "pd.DataFrame", planner: str) -> dict[str, Any]:
    """All of a scenario's row but what depends on other rows."""
    errors = missions.pivot(index="seed", columns="planner", values="rms_error_m")
    ours = with_failures(errors[planner])
    row = {"seeds": len(ours), "failed": int(here["failed"].sum())}
    row |= figures_of(here.loc[planner], "")
    row["broke"] = bool(here.loc[planner, "broke"])
    own = missions[missions["planner"] == planner]
    row["over_bound"] = float((own["rms_error_late_m"] / own["pcrb_rms_late_m"]).max())
    others = here.drop(index=[name for name in (planner, *REFERENCES) if name in here.index])
    row |= beside(errors, ours, others)
    for reference in REFERENCES:
        if reference in here.index:
            name = reference.replace("-", "_")
            row |= figures_of(here.loc[reference], f"{name}_")
            row[f"{name}_ratio"] = paired_ratio(ours, with_failures(errors[reference]))
    return row


def figures_of(cell: "pd.Series", prefix: str) -> dict[str, float]:
    """A planner's figures in a row."""
    return {f"{prefix}{short}": float(cell[figure]) for short, figure in FIGURES.items()}


def beside(
    errors: "pd.DataFrame", ours: Float[np.ndarray, " n"], others: "pd.DataFrame"
) -> dict[str, Any]:
    """The best of the others, by the median and by the tail, and how the planner compares."""
    rival, tail_rival = lowest(others, "rms_error_m"), lowest(others, "rms_error_q95_m")
    if rival is None or tail_rival is None:
        nothing = ("ratio", "tail_ratio", "tail_low", "tail_high")
        return {"rival": "", "tail_rival": "", "p": 1.0} | dict.fromkeys(nothing, np.nan)
    row: dict[str, Any] = {"rival": rival, "tail_rival": tail_rival}
    row |= figures_of(others.loc[rival], "rival_")
    row |= figures_of(others.loc[tail_rival], "tail_rival_")
    row["rival_broke"] = bool(others.loc[rival, "broke"])
    theirs = with_failures(errors[rival])
    both = np.isfinite(ours) | np.isfinite(theirs)  # where both failed neither is better
    row["ratio"] = paired_ratio(ours, theirs)
    row["p"] = signed_rank_p(ours[both] - theirs[both])
    ratio, low, high = tail_ratio(ours, with_failures(errors[tail_rival]))
    return row | {"tail_ratio": ratio, "tail_low": low, "tail_high": high}


def lowest(others: "pd.DataFrame", figure: str) -> str | None:
    """The planner with the lowest figure, of those that kept all limits if any did."""
    flown = others.dropna(subset=[figure])
    if flown.empty:
        return None
    return str(flown.sort_values(["broke", figure], kind="stable").index[0])


def paired_ratio(ours: Float[np.ndarray, " n"], theirs: Float[np.ndarray, " n"]) -> float:
    """Median over seeds of the ratio of two planners' errors."""
    both = np.isfinite(ours) | np.isfinite(theirs)
    return float(np.median(ours[both] / theirs[both])) if both.any() else np.nan


def verdict(row: dict[str, Any], p: float) -> str:
    """What a row says of the median: best or worse beyond chance, or level."""
    if row["broke"] and not row.get("rival_broke", False):
        return BROKE
    if p > LEVEL or np.isnan(row["ratio"]):
        return LEVEL_WITH
    return BEST if row["ratio"] < 1 else WORSE


def tail_verdict(row: dict[str, Any]) -> str:
    """What a row says of the 95 % quantile: level where the ratio's interval has 1 in it."""
    if row["broke"] and not row.get("rival_broke", False):
        return BROKE
    if row["tail_high"] < 1:
        return BEST
    return WORSE if row["tail_low"] > 1 else LEVEL_WITH


def lowest_in(rows: "pd.DataFrame", figure: str, rival: str) -> Sequence[bool]:
    """In which rows a planner's figure is no greater than its rival's, and limits are kept."""
    kept = (rows["verdict"] != BROKE).to_numpy()
    return (kept & (rows[figure] <= rows[f"{rival}_{figure}"]).to_numpy()).tolist()
