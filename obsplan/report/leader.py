"""Which planner leads, by how much, and whether by chance: words of comparisons and campaigns."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false
# pyright: reportIndexIssue=false, reportOperatorIssue=false, reportReturnType=false
# because pandas is not typed: its columns may be anything

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from obsplan.campaign.statistics import LEVEL, fewest_pairs
from obsplan.constraints import ROUNDING
from obsplan.report.words import metres

if TYPE_CHECKING:
    import pandas as pd

MOST_NAMED = 3  # planners in a list
WHOLE = 10.0  # [m], from which on a difference is told in whole metres


@dataclass(frozen=True, eq=False)
class Standing:
    """Planners in one setting: their missions, and what `paired` says of each two of them.

    ``comparisons`` is the number of those that the p values are corrected for.
    """

    missions: "pd.DataFrame"
    pairs: "pd.DataFrame"
    comparisons: int

    @cached_property
    def errors(self) -> "pd.Series":
        """Median RMS error of each planner [m], the lowest first; a failed mission is infinite."""
        by_mission = self.missions.assign(rms_error_m=self.missions["rms_error_m"].fillna(np.inf))
        medians = by_mission.groupby("planner", sort=False)["rms_error_m"].median()
        return medians.sort_values(kind="stable")

    @cached_property
    def broken(self) -> dict[str, float]:
        """By how much [m] each planner that broke a limit in any mission did so at worst."""
        if "violation_max_m" not in self.missions:
            return {}
        worst = self.missions.groupby("planner")["violation_max_m"].max()
        return worst[worst > ROUNDING].to_dict()

    @cached_property
    def eligible(self) -> list[str]:
        """Planners that may lead, the lowest error first: those within the limits, if any were."""
        flown = [planner for planner, error in self.errors.items() if np.isfinite(error)]
        return [planner for planner in flown if planner not in self.broken] or flown

    @cached_property
    def rivals(self) -> dict[str, dict]:
        """The leader's difference from each other eligible planner, a row each."""
        seen = (facing(row, self.eligible[0]) for row in self.pairs.to_dict("records"))
        rows = {row["against"]: row for row in seen if row}
        return {planner: rows[planner] for planner in self.eligible[1:] if planner in rows}

    @cached_property
    def level(self) -> list[str]:
        """Rivals whose errors chance could explain to be the higher ones."""
        return [
            planner
            for planner, row in self.rivals.items()
            if not (row["p_holm"] < LEVEL and row["difference"] < 0)
        ]

    @property
    def winner(self) -> str | None:
        """The planner within the limits whose lead over all others is beyond chance, or None."""
        if not self.rivals or self.level or self.eligible[0] in self.broken:
            return None
        return self.eligible[0]

    @property
    def too_few(self) -> bool:
        """Whether no difference, however clear, could be told from chance over so few seeds."""
        return max(row["pairs"] for row in self.rivals.values()) < fewest_pairs(self.comparisons)


def facing(row: dict, planner: str) -> dict | None:
    """A comparison as seen from a planner, None if it is not in it: its error minus the other's."""
    if row["planner"] == planner:
        return row
    if row["against"] != planner:
        return None
    turned = {"difference": -row["difference"], "low": -row["high"], "high": -row["low"]}
    return row | turned | {"planner": planner, "against": row["planner"]}


def leader_sentences(standing: Standing) -> list[str]:
    """Say who has the lowest error, who comes next, whether by chance, and who broke limits.

    Nobody leads alone: of one planner only the limits it broke are told.
    """
    if not standing.eligible:
        return ["No planner has an error to compare: every filter failed."]
    if standing.missions["planner"].nunique() == 1:
        return broken_sentences(standing)
    leader = standing.eligible[0]
    error = metres(standing.errors[leader])
    lead = f"{leader} has the lowest RMS error{among(standing)}, {error}{over(standing)}"
    if not standing.rivals:
        return [f"{lead}.", *broken_sentences(standing)]
    return [f"{lead}; {margin(standing)}.", chance(standing), *broken_sentences(standing)]


def among(standing: Standing) -> str:
    """Of which planners, where some broke limits."""
    if not standing.broken:
        return ""
    kept = standing.eligible[0] not in standing.broken
    return (
        " of those that kept within the limits" if kept else ", though none kept within the limits"
    )


def over(standing: Standing) -> str:
    """Over how many seeds."""
    seeds = standing.missions["seed"].nunique()
    return f" in the median of {seeds} seeds" if seeds > 1 else ""


def margin(standing: Standing) -> str:
    """Who comes next, and how much higher its error is, seed by seed."""
    second, row = next(iter(standing.rivals.items()))
    gap = -row["difference"]
    more = f"{amount(abs(gap))} m {'higher' if gap >= 0 else 'lower'}"
    if np.isnan(row["low"]):
        return f"{second} comes next, {more}"
    interval = f"95 % interval {amount(-row['high'])} to {amount(-row['low'])} m"
    return f"{second} comes next, seed by seed {more} ({interval})"


def chance(standing: Standing) -> str:
    """Whether chance could explain the lead."""
    count = max(row["pairs"] for row in standing.rivals.values())
    if standing.too_few:
        least = fewest_pairs(standing.comparisons)
        seeds = "1 seed" if count == 1 else f"{count} seeds"
        advice = f"from {least} on (--runs {least}) it can be told"
        return f"With {seeds} any lead could be chance; {advice}."
    corrected = f"signed-rank test, corrected for {standing.comparisons} comparisons"
    if standing.comparisons == 1:
        corrected = "signed-rank test"
    if standing.level:
        p = max(standing.rivals[planner]["p_holm"] for planner in standing.level)
        lead = f"Its lead over {listed(standing.level)}"
        return f"{lead} could be chance (p up to {p:.2g}, {corrected}); more seeds may tell."
    p = max(row["p_holm"] for row in standing.rivals.values())
    told = f"p = {p:.1g}" if p >= 0.001 else "p < 0.001"
    whom = "" if len(standing.rivals) == 1 else " over every other planner"
    return f"Its lead{whom} is beyond chance ({told}, {corrected})."


def broken_sentences(standing: Standing) -> list[str]:
    """Who broke limits, the worst first."""
    worst = sorted(standing.broken.items(), key=lambda one: -one[1])
    if not worst:
        return []
    return [
        "Limits were broken by "
        f"{listed([f'{planner} (up to {metres(most)})' for planner, most in worst])}."
    ]


def listed(names: list[str]) -> str:
    """Names in a sentence, the first of many."""
    if len(names) > MOST_NAMED:
        return f"{', '.join(names[:MOST_NAMED])} and {len(names) - MOST_NAMED} more"
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def amount(length: float) -> str:
    """A length [m] to two figures."""
    return f"{length:.2g}" if abs(length) < WHOLE else f"{length:.0f}"
