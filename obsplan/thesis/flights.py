"""Missions for the thesis's figures, whose planners are told the truth: noise hardly matters."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from obsplan.run import Run
from obsplan.scenario import Scenario, load
from obsplan.simulation import ClosedLoop
from obsplan.types import Pose

if TYPE_CHECKING:
    import xarray as xr

WORTH_COMPILING = 20_000  # steps in all; fewer are sooner done than the C compiler


def scenario(name: str, planner: str, *settings: str, time_step: float = 0.1) -> Scenario:
    """A shipped scenario under another planner, with a decision and a range at each step [s]."""
    steps = (
        f"time_step={time_step!r}",
        f"planner.interval={time_step!r}",
        f"ranging.interval={time_step!r}",
    )
    return load(name, planner=planner, settings=(*steps, *settings))


def pose(x: float, y: float, heading_deg: float) -> Pose:
    """A start [m, m, degrees]."""
    return Pose(x, y, float(np.deg2rad(heading_deg)))


def random_starts(count: int, seed: int, half_width: float) -> list[Pose]:
    """Starts drawn evenly from a square about the origin [m] and from all headings."""
    draws = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3)) * (
        half_width,
        half_width,
        np.pi,
    )
    return [Pose(*(float(value) for value in draw)) for draw in draws]


def fly(scenario: Scenario, starts: Sequence[Pose]) -> "xr.Dataset":
    """Fly a scenario from every start on one compiled step, and keep the tracks."""
    steps = len(starts) * (scenario.time.size - 1)
    loop = ClosedLoop(
        scenario=scenario, planner=scenario.planner(), compiled=steps > WORTH_COMPILING
    )
    return tracks([loop.fly(scenario.table.seed, start=start) for start in starts])


def tracks(runs: Sequence[Run]) -> "xr.Dataset":
    """Tracks, distances and predicted condition numbers of a scenario's runs, by start and AUV."""
    import xarray as xr

    def variable(name: str, values: list[np.ndarray], unit: str, *, auv: bool = False):
        return (
            ("start", "auv", "time") if auv else ("start", "time"),
            np.stack(values),
            {"units": unit, "long_name": name},
        )

    table, cna = runs[0].scenario.table, runs[0].scenario.cna
    east = [run.cna[:, 0] for run in runs]
    north = [run.cna[:, 1] for run in runs]
    heading = [run.cna[:, 2] for run in runs]
    turn_rate = [run.turn_rate for run in runs]
    auv_east = [run.true[..., 0] for run in runs]
    auv_north = [run.true[..., 1] for run in runs]
    distance = [run.separation for run in runs]
    condition = [run.condition for run in runs]
    variables = {
        "x": variable("aid vehicle, east", east, "m"),
        "y": variable("aid vehicle, north", north, "m"),
        "heading": variable("heading, counter-clockwise from east", heading, "rad"),
        "turn_rate": variable("turn rate", turn_rate, "rad s-1"),
        "auv_x": variable("AUV, east", auv_east, "m", auv=True),
        "auv_y": variable("AUV, north", auv_north, "m", auv=True),
        "distance": variable("aid vehicle to AUV", distance, "m", auv=True),
        "condition": variable("predicted condition number", condition, "1", auv=True),
    }
    return xr.Dataset(
        variables,
        coords={"time": ("time", runs[0].time, {"units": "s"}), "auv": runs[0].names},
        attrs={
            "speed": cna.speed,
            "min_turn_radius": cna.min_turn_radius,
            "time_step": table.time_step,
        },
    )


def poses(data: "xr.Dataset") -> np.ndarray:
    """Poses by start and time, as an array (start, time, 3)."""
    return np.stack([data.x.values, data.y.values, data.heading.values], axis=-1)
