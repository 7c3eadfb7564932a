"""What is known of a mission before it begins, for planners that plan all of it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, kw_only=True, eq=False)
class Filed:
    """Surveys as filed, sampled at the mission's instants, and how well the AUVs know themselves; equal where all numbers are."""

    time: Float[np.ndarray, " samples"]  # [s], in equal steps from 0 to the mission's end
    position: Float[np.ndarray, "samples auvs 2"]  # [m]
    heading: Float[np.ndarray, "samples auvs"]  # [rad]
    speed: Float[np.ndarray, "samples auvs"]  # through the water [m/s]
    covariance: Float[np.ndarray, "auvs 4 4"]  # of the first estimates of east, north, heading and speed
    process_noise: Float[np.ndarray, "auvs 4"]  # standard deviations per square root of a second, as the filters assume them
    weights: Float[np.ndarray, " auvs"]

    def __post_init__(self) -> None:
        if self.time.size < 2:
            raise ValueError(f"a mission needs at least two instants, got {self.time.size}: give it a duration of at least one time step")

    @property
    def time_step(self) -> float:
        """Time between samples [s]."""
        return float(self.time[1] - self.time[0])

    @cached_property
    def _key(self) -> tuple[bytes, ...]:
        return tuple(np.ascontiguousarray(getattr(self, name)).tobytes() for name in self.__dataclass_fields__)

    @cached_property
    def _hash(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Filed) and self._key == other._key

    def __hash__(self) -> int:
        return self._hash
