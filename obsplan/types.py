"""What passes between the simulator and a planner: Pose, Belief, Decision; and the one error that users see."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from formulations.solution import Status


class ObsplanError(Exception):
    """What the user gave cannot be used; the message is one sentence with the place, the value and the remedy."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the aid vehicle is: local east/north [m], heading [rad] counter-clockwise from east, present turn rate [rad/s]."""

    x: float
    y: float
    heading: float
    turn_rate: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """What the planner knows of one AUV; never the truth, unless the scenario says ``knowledge = "truth"``.

    ``mean`` is (east [m], north [m], heading [rad], speed through the water [m/s]); ``covariance`` (4 x 4) the AUV's own, as last reported
    and predicted since, wherever the mean comes from; ``process_noise`` the standard deviations per square root of a second of position
    [m], heading [rad] and speed [m/s]; ``drift`` the current [m/s] it is carried by; ``course`` its planned positions as a function of time
    from now [s], where they are known.
    """

    mean: Float[np.ndarray, "4"]
    covariance: Float[np.ndarray, "4 4"]
    process_noise: tuple[float, float, float] = (0.0, 0.0, 0.0)
    weight: float = 1.0
    drift: tuple[float, float] = (0.0, 0.0)
    course: Callable[[np.ndarray], np.ndarray] | None = None

    def __post_init__(self) -> None:
        if not self.weight >= 0:
            raise ValueError(f"weight of an AUV must be at least 0, got {self.weight}")

    @classmethod
    def at(
        cls,
        x: float,
        y: float,
        *,
        heading: float = 0.0,
        speed: float = 0.0,
        covariance: np.ndarray | None = None,
        weight: float = 1.0,
    ) -> "Belief":
        """Believe in a position [m], heading [rad] and speed [m/s]; the covariance is zero unless given (4 x 4)."""
        mean = np.array([x, y, heading, speed], dtype=float)
        return cls(
            mean=mean,
            covariance=np.zeros((4, 4))
            if covariance is None
            else np.asarray(covariance, dtype=float),
            weight=weight,
        )

    def ahead(self, times: Float[np.ndarray, " steps"]) -> Float[np.ndarray, "steps 2"]:
        """Predict positions [m] at times from now [s]: along the course where it is known, else at constant velocity."""
        if self.course is not None:
            return self.course(times)
        x, y, heading, speed = self.mean
        velocity = speed * np.array([np.cos(heading), np.sin(heading)]) + self.drift
        return np.array([x, y]) + np.asarray(times)[:, None] * velocity


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """The manoeuvre a planner chose: turn rate and speed to hold until the next decision.

    ``path`` holds the predicted poses (east, north, heading), the current one first, or none; ``score`` is the planner's own objective in
    its own unit; ``condition`` the predicted condition number per AUV, nan where the planner has none.
    """

    turn_rate: float  # [rad/s], positive to the left
    speed: float  # [m/s]
    path: Float[np.ndarray, "steps 3"] = field(default_factory=lambda: np.empty((0, 3)))
    score: float = float("nan")
    status: Status = Status.OPTIMAL
    condition: Float[np.ndarray, " auvs"] = field(default_factory=lambda: np.empty(0))

    @property
    def radius(self) -> float:
        """Turning radius [m], positive to the left; inf when straight or stopped."""
        return self.speed / self.turn_rate if self.turn_rate and self.speed else float("inf")
