"""Missions flown under many noise seeds, and their figures of merit."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from obsplan.planning.interface import Planner
from obsplan.run import Run
from obsplan.scenario import Scenario
from obsplan.simulation import ClosedLoop
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    import xarray as xr

FIGURES = {
    "rms_error": "RMS error over all AUVs",
    "worst_auv_rms": "RMS error of the worst AUV",
    "max_error": "greatest error",
}
FIGURES |= {"separation": "mean distance to the aid vehicle"}  # all in metres
# Steps in all. Fewer are done here before workers have started and built every case.
WORTH_A_CLUSTER = 10_000_000
Z95 = 1.96  # of a normal distribution, 95 % within

Cases = Mapping[tuple[str, ...], Scenario]


def fly_grid(
    cases: Cases, dims: tuple[str, ...], seeds: range, planner: Callable[..., Planner] | None = None
) -> "xr.Dataset":
    """Figures of merit over a grid of cases and seeds; every case meets the same noise.

    ``cases`` holds every combination of the coordinates of ``dims``. Large grids are flown as a
    campaign, on all cores. ``planner`` makes another planner than the scenario's from a case's
    coordinates.
    """
    import xarray as xr

    steps = sum(scenario.time.size for scenario in cases.values()) * len(seeds)
    if planner is not None:
        values = [fly_here(one, seeds, planner(*key)) for key, one in cases.items()]
    elif steps < WORTH_A_CLUSTER:
        values = fly_once_each(list(cases.values()), seeds)
    else:
        values = fly_as_campaign([(one, seeds) for one in cases.values()])
    coordinates = [list(dict.fromkeys(labels)) for labels in zip(*cases, strict=True)]
    table = np.array(values).reshape(*map(len, coordinates), len(seeds), len(FIGURES))
    named = {
        name: ((*dims, "seed"), table[..., k], {"units": "m", "long_name": text})
        for k, (name, text) in enumerate(FIGURES.items())
    }
    return xr.Dataset(
        named, coords={**dict(zip(dims, coordinates, strict=True)), "seed": list(seeds)}
    )


def fly_here(scenario: Scenario, seeds: range, planner: Planner | None = None) -> list[list[float]]:
    """Figures of one case by seed, flown in this process."""
    loop = ClosedLoop(scenario=scenario, planner=planner or scenario.planner(), compiled=True)
    return [figures(loop.fly(seed)) for seed in seeds]


def fly_once_each(scenarios: Sequence[Scenario], seeds: range) -> list[list[list[float]]]:
    """Figures of each case by seed; those that are the same under two names are flown once."""
    from obsplan.campaign.plan import cell_of

    keys = [cell_of(one, base="thesis", settings=(), seeds=seeds).key for one in scenarios]
    different = dict(zip(keys, scenarios, strict=True))
    flown = {key: fly_here(one, seeds) for key, one in different.items()}
    return [flown[key] for key in keys]


def figures(run: Run) -> list[float]:
    """The figures of merit of one run, in the order of `FIGURES`."""
    per_auv = np.sqrt(np.mean(run.error**2, axis=1))
    return [run.rms_error, float(per_auv.max()), run.max_error, float(run.separation.mean())]


def fly_as_campaign(cases: Sequence[tuple[Scenario, range]]) -> list[list[list[float]]]:
    """Figures of each case by seed, flown by a campaign's workers.

    Raises
    ------
    ObsplanError
        A mission failed.
    """
    from obsplan.campaign import Cell, fly_campaign, load_campaign
    from obsplan.campaign.plan import cell_of

    cells: dict[str, Cell] = {}
    keys = []
    for k, (scenario, seeds) in enumerate(cases):
        cell = cell_of(scenario, base="thesis", settings=(), seeds=seeds)
        keys.append(cell.key)
        # cases may be the same under two names
        if cell.key not in cells or len(seeds) > len(cells[cell.key].seeds):
            cells[cell.key] = replace(cell, scenario=f"case-{k}")
    with TemporaryDirectory() as folder:
        report = fly_campaign(tuple(cells.values()), folder)
        if report.failed:
            cell, seed, why = report.failures[0]
            raise ObsplanError(
                f"{report.failed} missions failed, the first of {cell.label} with seed {seed}: "
                f"{why}; try other seeds"
            )
        table = load_campaign(folder).set_index(["scenario", "seed"]).sort_index()
    return [
        [_row(table.loc[cells[key].scenario].loc[seed]) for seed in seeds]
        for key, (_, seeds) in zip(keys, cases, strict=True)
    ]


def _row(row: Any) -> list[float]:
    """The figures of one mission of a campaign's table."""
    worst = max(figures["rms_error_m"] for figures in json.loads(row["auv"]).values())
    return [
        float(value)
        for value in (row["rms_error_m"], worst, row["max_error_m"], row["separation_mean_m"])
    ]


def interval(share: float, n: int) -> tuple[float, float]:
    """95 % confidence interval of a share of n (Wilson 1927)."""
    scale = 1 + Z95**2 / n
    middle = (share + Z95**2 / (2 * n)) / scale
    variance = share * (1 - share) / n + Z95**2 / (4 * n**2)
    half = Z95 / scale * np.sqrt(variance)
    return middle - half, middle + half


def judged(share: float, n: int) -> bool | None:
    """Whether a share of n is more than a half, at 95 %; None where the seeds do not decide."""
    low, high = interval(share, n)
    return True if low > 0.5 else False if high < 0.5 else None


def counted(share: float, n: int) -> str:
    """A share of n seeds, with its interval, as text."""
    low, high = interval(share, n)
    return f"{share * n:.0f} of {n} [{max(low, 0.0):.0%}, {min(high, 1.0):.0%}]"


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
