"""The path that a planner had in mind at each of its decisions."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Integer

PATH = "path"  # in `Run.faults`, beside statuses: what was wrong with a path that was predicted


class Planned(NamedTuple):
    """Paths that the planner of one aid vehicle had in mind, one after the other.

    A planner that gave all of its commands beforehand has one path without places: that which was
    flown.
    """

    decided: Float[np.ndarray, " paths"]  # when [s]
    ends: Integer[np.ndarray, " paths"]  # places up to the end of each path, counted from the first
    time: Float[np.ndarray, " places"]  # when the vehicle was to be there [s]
    place: Float[np.ndarray, "places 2"]  # east and north, over ground [m]

    @property
    def is_flown(self) -> bool:
        """Whether all was planned beforehand, and flown so."""
        return self.time.size == 0

    @property
    def path(self) -> Integer[np.ndarray, " places"]:
        """Which path each place belongs to."""
        return np.searchsorted(self.ends, np.arange(self.time.size), side="right")


# what a planner had in mind that gave all of its commands beforehand
AS_FLOWN = Planned(np.zeros(1), np.zeros(1, dtype=int), np.empty(0), np.empty((0, 2)))
