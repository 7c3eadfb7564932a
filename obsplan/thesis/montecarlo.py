"""Missions flown under many noise seeds, and their figures of merit."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from obsplan.planners.protocol import Planner
from obsplan.run import Run
from obsplan.scenario import Scenario
from obsplan.simulation import ClosedLoop

if TYPE_CHECKING:
    import xarray as xr

FIGURES = {"rms_error": "m", "worst_auv_rms": "m", "max_error": "m", "mirrored": "1", "separation": "m"}
Z95 = 1.96  # of a normal distribution, 95 % within


def fly_seeds(cases: Mapping[str, Scenario], seeds: Sequence[int], planners: Mapping[str, Planner] | None = None) -> "xr.Dataset":
    """Figures of merit by case and seed; every case meets the same noise. ``planners`` replaces those of the scenarios, by case."""
    import xarray as xr

    values = np.empty((len(FIGURES), len(cases), len(seeds)))
    for i, (name, scenario) in enumerate(cases.items()):
        planner = scenario.planner() if planners is None else planners[name]
        loop = ClosedLoop(scenario=scenario, planner=planner, compiled=True)
        for k, seed in enumerate(seeds):
            values[:, i, k] = figures(loop.fly(seed))
    variables = {name: (("case", "seed"), values[i], {"units": unit}) for i, (name, unit) in enumerate(FIGURES.items())}
    return xr.Dataset(variables, coords={"case": list(cases), "seed": list(seeds)})


def figures(run: Run) -> list[float]:
    """The figures of merit of one run, in the order of `FIGURES`."""
    per_auv = np.sqrt(np.mean(run.error**2, axis=1))
    return [run.rms_error, float(per_auv.max()), run.max_error, float(is_mirrored(run)), float(run.separation.mean())]


def is_mirrored(run: Run) -> bool:
    """Whether the first AUV's estimate ends nearer to the point reflection of the truth about the aid vehicle than to the truth.

    Ranges and headings of that image are the same if its speed is the opposite: an aid vehicle at rest can never tell.
    """
    late = slice(run.time.size // 2, None)
    truth, mean, center = run.truth[0, late, :2], run.mean[0, late, :2], run.cna[late, :2]
    return bool(np.median(np.hypot(*(mean - (2.0 * center - truth)).T)) < np.median(run.error[0, late]))


def interval(share: float, n: int) -> tuple[float, float]:
    """95 % confidence interval of a share of n (Wilson 1927)."""
    middle = (share + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
    half = Z95 / (1 + Z95**2 / n) * np.sqrt(share * (1 - share) / n + Z95**2 / (4 * n**2))
    return middle - half, middle + half


def spread(values: np.ndarray) -> str:
    """Median and quartiles as text."""
    first, median, third = np.quantile(values, [0.25, 0.5, 0.75])
    return f"{figure(median)} [{figure(first)}, {figure(third)}]"


def figure(value: float) -> str:
    """A length [m] to two or three digits."""
    return f"{value:.2f}" if value < 10.0 else f"{value:.0f}"


def metres(value: float) -> str:
    """A length with its unit."""
    return f"{figure(value)} m"
