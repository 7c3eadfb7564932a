"""What a campaign's table says: medians with intervals, planners compared under the same noise."""
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# because pandas is not typed: its columns may be anything

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from obsplan.campaign.layout import FIGURES
from obsplan.constraints import ROUNDING

if TYPE_CHECKING:
    import pandas as pd

CONFIDENCE = 0.95
TAIL = 0.95  # the quantile over missions that is told beside a median
LEVEL = 0.05  # of significance: a difference with a smaller p is not put down to chance
RESAMPLES = 2000  # of the bootstrap: a 95 % interval ends at its 50th value from either side
AT_ONCE = 10_000_000  # numbers the bootstrap holds in memory
SEED = 0  # of the bootstrap: the same table gives the same intervals


def varied_keys(table: "pd.DataFrame") -> list[str]:
    """The columns that hold varied settings."""
    columns = list(table.columns)
    return columns[columns.index("planner") + 1 : columns.index("seed")]


def medians(table: "pd.DataFrame", by: list[str] | None = None) -> "pd.DataFrame":
    """Median of each figure with its bootstrap 95 % interval, over the missions that did not fail.

    One row per combination of the columns ``by`` (default: scenario, planner and every varied key):
    ``missions``, ``failed``, ``violated`` (how many broke a limit), ``violation_worst_m`` (by how
    much at most; nan without limits, negative where there was something to spare),
    ``rms_error_q95_m`` and ``rms_error_worst_m`` (95 % quantile and greatest RMS error, infinite
    where that mission failed); then for each figure its name, name_low and name_high; nan where
    fewer than one or, for the interval, two missions have the figure.
    """
    import pandas as pd

    by = ["scenario", "planner", *varied_keys(table)] if by is None else by
    rows = []
    for labels, group in table.groupby(by, dropna=False, sort=True):
        failed = int((group["status"] == "failed").sum())
        errors = with_failures(group["rms_error_m"])
        row: dict[str, Any] = {
            **dict(zip(by, labels, strict=True)),
            "missions": len(group),
            "failed": failed,
            "violated": int((group["violation_max_m"] > ROUNDING).sum()),
            "violation_worst_m": float(group["violation_max_m"].max()),
            "rms_error_q95_m": tail(errors),
            "rms_error_worst_m": float(errors.max()),
        }
        for figure in FIGURES:
            row[figure], row[f"{figure}_low"], row[f"{figure}_high"] = median_interval(
                group[figure].dropna().to_numpy()
            )
        rows.append(row)
    return pd.DataFrame(rows)


def with_failures(errors: "pd.Series") -> Float[np.ndarray, " n"]:
    """Errors of missions; a mission that failed counts as worse than any."""
    return errors.fillna(np.inf).to_numpy(dtype=float)


def tail(errors: Float[np.ndarray, "*m n"]) -> Any:
    """The least of the errors, along the last axis, that 95 % of them do not exceed."""
    return np.quantile(errors, TAIL, axis=-1, method="inverted_cdf")


def tail_ratio(
    ours: Float[np.ndarray, " n"], theirs: Float[np.ndarray, " n"]
) -> tuple[float, float, float]:
    """Ratio of two 95 % quantiles, and its percentile-bootstrap 95 % interval.

    Missions are resampled in pairs: those of one place met the same noise.
    """
    places = np.random.default_rng(SEED).integers(ours.size, size=(RESAMPLES, ours.size))
    with np.errstate(invalid="ignore"):  # where both failed
        resampled = tail(ours[places]) / tail(theirs[places])
        ratio = float(tail(ours) / tail(theirs))
    beyond = (1 - CONFIDENCE) / 2
    low, high = np.nanquantile(resampled, [beyond, 1 - beyond], method="nearest")
    return ratio, float(low), float(high)


def median_interval(values: Float[np.ndarray, " n"]) -> tuple[float, float, float]:
    """Median and its percentile-bootstrap 95 % interval."""
    if values.size < 2:
        return float(values[0]) if values.size else np.nan, np.nan, np.nan
    batch = max(1, AT_ONCE // values.size)
    resampled = stats.bootstrap(
        (values,),
        np.median,
        n_resamples=RESAMPLES,
        batch=batch,
        confidence_level=CONFIDENCE,
        method="percentile",
        random_state=np.random.default_rng(SEED),
    )
    low, high = resampled.confidence_interval
    return float(np.median(values)), float(low), float(high)


def paired(table: "pd.DataFrame", figure: str = "rms_error_m") -> "pd.DataFrame":
    """Compare planners two by two, seed by seed: each pair of missions met the same noise.

    One row per scenario, setting and pair: ``pairs`` of missions neither of which failed;
    ``difference``, the median of planner minus ``against`` with its bootstrap 95 % interval
    ``low``, ``high``; ``better``, the share of seeds where planner is lower; ``p`` of Wilcoxon's
    signed-rank test that the differences are symmetric about 0, two-sided; ``p_holm``, corrected
    by Holm's step-down method for all comparisons in this table, so that with probability 0.95
    none of those below 0.05 is due to chance.
    """
    import pandas as pd

    settings = ["scenario", *varied_keys(table)]
    columns = [*settings, "planner", "against", "pairs", "difference", "low", "high", "better", "p"]
    rows = []
    for labels, group in table.groupby(settings, dropna=False, sort=True):
        by_seed = group.pivot_table(index="seed", columns="planner", values=figure, observed=True)
        for one, other in combinations(by_seed.columns, 2):
            d = (by_seed[one] - by_seed[other]).dropna().to_numpy()
            rows.append(
                [
                    *labels,
                    one,
                    other,
                    d.size,
                    *median_interval(d),
                    float(np.mean(d < 0)) if d.size else np.nan,
                    signed_rank_p(d),
                ]
            )
    compared = pd.DataFrame(rows, columns=columns)
    return compared.assign(p_holm=holm(compared["p"].to_numpy(dtype=float)))


def signed_rank_p(differences: Float[np.ndarray, " n"]) -> float:
    """Two-sided p of Wilcoxon's signed-rank test; 1 where nothing differs, which is no evidence."""
    return float(stats.wilcoxon(differences).pvalue) if np.any(differences) else 1.0


def fewest_pairs(comparisons: int) -> int:
    r"""Least number of pairs with which the signed-rank test can tell a difference from chance.

    The test is corrected by Holm for m comparisons:

    .. math:: \min\{n : m \, 2^{1-n} < 0.05\}

    Of the :math:`2^n` patterns of signs, the two of one sign are the most extreme.
    """
    return int(np.floor(np.log2(2 * comparisons / LEVEL))) + 1


def holm(p: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    r"""Correct p values for their number by the step-down method of Holm (1979).

    It is valid however the tests depend on each other.

    .. math:: \tilde p_{(i)} = \max_{j \le i} \min(1, (m - j + 1) p_{(j)})
    """
    order = np.argsort(p)
    stepped = np.maximum.accumulate(np.minimum(1.0, p[order] * np.arange(p.size, 0, -1)))
    corrected = np.empty_like(p)
    corrected[order] = stepped
    return corrected


def worded(value: Any) -> str:
    """A value of a varied key."""
    return value if isinstance(value, str) else f"{value:g}"
