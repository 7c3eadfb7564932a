"""The water that carries the vehicles: its velocity by depth and time."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from jaxtyping import Float

from obsplan.quantities import CURRENT, DEPTH, TIDE_PERIOD, check_quantities

Component = Annotated[float, CURRENT]
SEMIDIURNAL = 44_714.0  # [s]; of the moon's principal tide, M2: 12.42 h


@dataclass(frozen=True, kw_only=True)
class Tide:
    r"""A current that goes to and fro along a line, the same at all depths.

    .. math:: c(t) = a \cos(2 π t / T - g)

    (A harmonic constituent with its phase lag g: Pugh 1987, eq. 4.1.) Time counts from the
    mission's beginning.

    Raises
    ------
    ValueError
        A number out of its range.
    """

    amplitude: tuple[Component, Component] = (0.0, 0.0)  # a, east and north [m/s]
    period: Annotated[float, TIDE_PERIOD] = SEMIDIURNAL  # T [s]
    phase: float = 0.0  # g [rad]

    def __post_init__(self) -> None:
        check_quantities(self)
        if not math.isfinite(self.phase):
            raise ValueError(f"phase must be finite [rad], got {self.phase}")

    def at(self, time: Float[np.ndarray, "*t"] | float) -> Float[np.ndarray, "*t 2"]:
        """Velocity [m/s], east and north, at times [s]."""
        angle = 2 * np.pi * np.asarray(time, dtype=float) / self.period - self.phase
        return np.cos(angle)[..., None] * np.array(self.amplitude)


@dataclass(frozen=True, kw_only=True)
class Water:
    """Currents of a mission: a uniform one, what depth adds to it, and a tide; their sum counts.

    Raises
    ------
    ValueError
        A number out of its range, or depths of the profile that do not increase.
    """

    current: tuple[Component, Component] = (0.0, 0.0)  # everywhere; east, north [m/s]
    # rows of depth [m], east, north [m/s]: linear between, constant above and below
    profile: tuple[tuple[float, float, float], ...] = ()
    tide: Tide | None = None

    def __post_init__(self) -> None:
        check_quantities(self)
        for i, row in enumerate(self.profile):
            depth, *velocity = row
            if depth not in DEPTH or not all(part in CURRENT for part in velocity):
                raise ValueError(
                    f"profile[{i}] must be a depth {DEPTH}, then a current, east and north, each "
                    f"{CURRENT}, got {list(row)}: correct it"
                )
        for (above, *_), (below, *_) in pairwise(self.profile):
            if not above < below:
                raise ValueError(
                    f"profile must have increasing depths, got {below} after {above}: order it"
                )

    @property
    def is_uniform(self) -> bool:
        """Whether it is the same at all depths and times."""
        return not self.profile and self.tide is None

    def at(
        self,
        time: Float[np.ndarray, "*#batch"] | float,
        depth: Float[np.ndarray, "*#batch"] | float,
    ) -> Float[np.ndarray, "*batch 2"]:
        """Velocity [m/s], east and north, at times [s] and depths [m]."""
        time, depth = np.broadcast_arrays(np.asarray(time, float), np.asarray(depth, float))
        steady = self.mean(depth)
        return steady if self.tide is None else steady + self.tide.at(time)

    def mean(self, depth: Float[np.ndarray, "*batch"] | float) -> Float[np.ndarray, "*batch 2"]:
        """Velocity [m/s] at depths [m], on average over whole tides.

        It is what surveys are laid out for: a vehicle that steers by it is carried off its line by
        the tide.
        """
        depth = np.asarray(depth, dtype=float)
        uniform = np.broadcast_to(np.array(self.current, dtype=float), (*depth.shape, 2))
        if not self.profile:
            return uniform
        depths, east, north = np.array(self.profile, dtype=float).T
        added = [np.interp(depth, depths, component) for component in (east, north)]
        return uniform + np.stack(added, axis=-1)

    def strongest(self, depth: Float[np.ndarray, "*batch"] | float) -> Float[np.ndarray, "*batch"]:
        """Greatest speed [m/s] that it ever has at depths [m]."""
        steady = self.mean(depth)
        tidal = np.zeros(2) if self.tide is None else np.array(self.tide.amplitude)
        flood, ebb = steady + tidal, steady - tidal  # the speed is convex between them
        return np.asarray(np.linalg.norm([flood, ebb], axis=-1).max(axis=0))
