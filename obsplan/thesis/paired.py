"""Options of a study beside a reference, seed by seed: each pair of missions met the same noise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from obsplan.report.style import AID, colour
from obsplan.thesis.drawing import log_ticks
from obsplan.thesis.montecarlo import spread

if TYPE_CHECKING:
    import xarray as xr

SHARE = 5  # a fifth of the seeds for each case of a study
# seeds of a case at least: with fewer, Wilcoxon's test finds nothing below 0.05, whatever happens
FEWEST = 6
QUARTILES = (0.25, 0.5, 0.75)
SMALLEST = 0.001  # p that is told as it is
LEVEL = 0.05  # of significance: a difference with a smaller p is not put down to chance

Case = tuple[str, ...]


@dataclass(frozen=True)
class Paired:
    """Errors of a case by seed, over those of its reference, and whether they differ by chance.

    ``p`` is Wilcoxon's signed-rank test of the logarithms of the ratios, two-sided, corrected by
    Holm for all comparisons of the study; nan for a reference itself.
    """

    errors: Float[np.ndarray, " seeds"]  # [m]
    ratios: Float[np.ndarray, " seeds"]
    p: float

    @property
    def differs(self) -> bool:
        """Whether the difference is not put down to chance."""
        return self.p < LEVEL

    @property
    def ratio(self) -> float:
        """Median of the ratios."""
        return float(np.median(self.ratios))

    @property
    def errs(self) -> str:
        """Median error and quartiles."""
        return f"{spread(self.errors)} m"

    @property
    def against(self) -> str:
        """How it compares with its reference."""
        if np.isnan(self.p):
            return "the reference"
        chance = "< 0.001" if self.p < SMALLEST else f"= {self.p:.2g}"
        return f"{factors(self.ratios)} times, p {chance}"


def seeds(runs: int, seed: int) -> range:
    """Seeds of each case of a study."""
    return range(seed, seed + max(FEWEST, runs // SHARE))


def factors(ratios: Float[np.ndarray, " seeds"]) -> str:
    """Median ratio and quartiles."""
    first, median, third = np.quantile(ratios, QUARTILES)
    return f"{median:.2f} [{first:.2f}, {third:.2f}]"


def by_case(errors: "xr.DataArray", *dims: str) -> dict[Case, np.ndarray]:
    """Errors by seed of each combination of the coordinates of ``dims``, as text."""
    values = errors.transpose(*dims, "seed").values
    labels = [[str(label) for label in errors[dim].values] for dim in dims]
    return {
        tuple(names[i] for names, i in zip(labels, place, strict=True)): values[place]
        for place in np.ndindex(values.shape[:-1])
    }


def compare(
    errors: Mapping[Case, np.ndarray], reference: Callable[[Case], Case]
) -> dict[Case, Paired]:
    """Each case beside its reference, which is a case too."""
    from obsplan.campaign.statistics import holm, signed_rank_p

    ratios = {case: own / errors[reference(case)] for case, own in errors.items()}
    tested = [case for case in errors if reference(case) != case]
    chances = np.array([signed_rank_p(np.log(ratios[case])) for case in tested])
    p = dict(zip(tested, holm(chances).tolist(), strict=True))
    return {case: Paired(own, ratios[case], p.get(case, np.nan)) for case, own in errors.items()}


def table(heading: Sequence[str], compared: Mapping[Case, Paired]) -> list[list[str]]:
    """A row for each case; ``heading`` names the parts of a case."""
    rows = [[*heading, "RMS error [m]", "to the reference"]]
    for case, one in compared.items():
        rows.append([*case, spread(one.errors), one.against])
    return rows


def draw_medians(axes: Axes, x: np.ndarray, errors: np.ndarray, paint: str, label: str) -> None:
    """Median over the last axis, and quartiles as a band."""
    first, median, third = np.quantile(errors, QUARTILES, axis=-1)
    axes.fill_between(x, first, third, color=paint, alpha=0.2, lw=0)
    axes.plot(x, median, "o-", ms=4, lw=1.0, color=paint, label=label)


def draw_options(axes: Axes, data: "xr.Dataset", option: str, variable: str, label: str) -> None:
    """Medians and quartiles of each option, side by side for each mission."""
    values, n = data[variable].transpose("mission", option, "seed").values, data.sizes[option]
    for k, name in enumerate(data[option].values):
        y = np.arange(len(values)) + 0.7 * ((k + 0.5) / n - 0.5)
        first, median, third = np.quantile(values[:, k], QUARTILES, axis=-1)
        axes.hlines(y, first, third, color=colour(k), lw=1.5)
        axes.plot(median, y, "o", ms=5, color=colour(k), label=str(name))
    axes.set_yticks(range(len(values)), [str(name) for name in data.mission.values])
    axes.set_ylim(len(values) - 0.5, -0.5)
    axes.set_xlabel(label)
    log_ticks(axes, "x")
    for y in range(1, len(values)):
        axes.axhline(y - 0.5, color=AID, lw=0.4)
