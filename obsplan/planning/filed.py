"""What is known of a mission before it begins, for planners that plan all of it."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from obsplan.types import Belief


@dataclass(frozen=True, kw_only=True, eq=False)
class Filed:
    """Surveys as filed, sampled at the mission's instants, and the AUVs' own uncertainty.

    Two are equal where all their numbers are. The arrays are copies that nobody can write to.
    """

    time: Float[np.ndarray, " samples"]  # [s], in equal steps from 0 to the mission's end
    position: Float[np.ndarray, "samples auvs 2"]  # [m]
    heading: Float[np.ndarray, "samples auvs"]  # [rad]
    speed: Float[np.ndarray, "samples auvs"]  # through the water [m/s]
    # of the first estimates of east, north, heading and speed
    covariance: Float[np.ndarray, "auvs 4 4"]
    # standard deviations per sqrt(s), as the filters assume them; east's is north's
    process_noise: Float[np.ndarray, "auvs 4"]
    weights: Float[np.ndarray, " auvs"]
    # [m]; one for all that have the same
    depth: Float[np.ndarray, "#samples #auvs"] = field(default_factory=lambda: np.zeros((1, 1)))

    def __post_init__(self) -> None:
        if self.time.size < 2:
            raise ValueError(
                f"a mission needs at least two instants, got {self.time.size}: "
                "give it a duration of at least one time step"
            )
        for name in self.__dataclass_fields__:
            kept = np.array(getattr(self, name))
            if name == "depth":
                kept = np.broadcast_to(kept, self.speed.shape).copy()
            kept.setflags(write=False)
            object.__setattr__(self, name, kept)

    @property
    def time_step(self) -> float:
        """Time between samples [s]."""
        return float(self.time[1] - self.time[0])

    @property
    def beliefs(self) -> list[Belief]:
        """What is known of the AUVs at the mission's beginning, the current aside."""
        return self.beliefs_at(0)

    def beliefs_at(self, sample: int) -> list[Belief]:
        """The AUVs as filed for a sample, known as well as at the beginning."""
        known = zip(
            self.position[sample],
            self.heading[sample],
            self.speed[sample],
            self.covariance,
            self.process_noise,
            self.weights,
            self.depth[sample],
            strict=True,
        )
        return [
            Belief(
                mean=np.array([*place, heading, speed]),
                covariance=covariance,
                process_noise=(float(noise[0]), float(noise[2]), float(noise[3])),
                weight=float(weight),
                depth=float(depth),
            )
            for place, heading, speed, covariance, noise, weight, depth in known
        ]

    @cached_property
    def straying(self) -> Float[np.ndarray, "samples auvs"]:
        r"""Standard deviation [m] of how far each AUV has strayed from where it filed to be.

        It is that of the direction in which it is greatest. The AUV steers back to its heading
        and speed at every sample, but not to its line. So what moved it stays, and an error of
        heading or speed lasts a step. With the process noise's :math:`σ_p, σ_ψ, σ_V` and the
        speed V, the variance along or across its course is at most

        .. math:: σ^2(t) = \int_0^t σ_p^2 + Δt^2 \max(V^2 σ_ψ^2, σ_V^2) \, dt.
        """
        east, north, heading, speed = self.process_noise.T
        steered = self.time_step * np.maximum(self.speed[:-1] * heading, speed)
        variance = np.cumsum((np.maximum(east, north) ** 2 + steered**2) * self.time_step, axis=0)
        return np.sqrt(np.concatenate([np.zeros((1, variance.shape[1])), variance]))

    @cached_property
    def strides(self) -> Float[np.ndarray, "samples auvs"]:
        """How far [m] each AUV files to move in the step before or after a sample, at most."""
        moves = np.pad(np.linalg.norm(np.diff(self.position, axis=0), axis=-1), ((1, 1), (0, 0)))
        return np.maximum(moves[:-1], moves[1:])

    @cached_property
    def _key(self) -> tuple[bytes, ...]:
        return tuple(
            np.ascontiguousarray(getattr(self, name)).tobytes()
            for name in self.__dataclass_fields__
        )

    @cached_property
    def _hash(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Filed) and self._key == other._key

    def __hash__(self) -> int:
        return self._hash
