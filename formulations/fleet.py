"""Several AUVs that measure ranges to several aid vehicles, as bounds over all paths take them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .allocation import Allocation, check_pings, normalized


@dataclass(frozen=True, slots=True, kw_only=True)
class RangedAuv:
    """An AUV, its model along its own trajectory, and its ranges.

    States one and two are east and north [m]. ``P0``, ``F``, ``Q`` and ``J_other`` as for
    `information_bound`. Range j comes at the end of step ``pings[j]``, to the aid vehicle
    ``aids[j]``, while the AUV is at ``places[j]`` [m] and the transducers ``heights[j]`` [m] apart
    (it counts where ranges are slant). ``weight`` is that of its mean square error.
    """

    P0: Float[np.ndarray, "n n"]
    F: Float[np.ndarray, "steps n n"]
    Q: Float[np.ndarray, "*steps_or_none n n"]
    J_other: Float[np.ndarray, "steps n n"]
    pings: Int[np.ndarray, " pings"]
    places: Float[np.ndarray, "pings 2"]
    aids: Int[np.ndarray, " _pings"]
    heights: Float[np.ndarray, " pings"] | float = 0.0
    weight: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class AidVehicle:
    """An aid vehicle that goes anywhere at up to a speed over ground [m/s] from a start [m].

    ``swing`` [m] is how far its transducer moves besides, at most, as the vehicle turns.
    """

    start: Float[np.ndarray, "2"]
    speed: float
    swing: float = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that make no sense."""
        numbers = np.array([*self.start, self.speed, self.swing])
        if not (np.isfinite(numbers).all() and self.speed >= 0 and self.swing >= 0):
            raise ValueError(
                "an aid vehicle's start must be finite, its speed and swing finite and at least 0, "
                f"got {self.start}, {self.speed} and {self.swing}"
            )

    def reach(self, duration: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """How far its transducer gets in a time [m]."""
        return self.speed * duration + self.swing


class Fleet:
    """Weighted mean square position error of all AUVs, by the information of each range.

    Ranges are numbered through all AUVs; those of one aid vehicle at one time are of one stage.
    """

    def __init__(
        self,
        auvs: Sequence[RangedAuv],
        aids: Sequence[AidVehicle],
        time: Float[np.ndarray, " samples"],
        weights: Float[np.ndarray, " _samples"] | None,
    ) -> None:
        _check(auvs, aids, time)
        samples = len(time)
        self.weights = normalized(np.ones(samples) if weights is None else weights, samples)
        self.share = normalized(np.array([auv.weight for auv in auvs]), len(auvs))
        self.aids = aids
        counts = [len(auv.pings) for auv in auvs]
        self.auv = np.repeat(np.arange(len(auvs)), counts)
        self.aid = np.concatenate([auv.aids for auv in auvs])
        self.places = np.concatenate([auv.places for auv in auvs])
        self.heights = np.concatenate([np.broadcast_to(a.heights, len(a.pings)) for a in auvs])
        self.time = np.concatenate([time[auv.pings + 1] - time[0] for auv in auvs])
        self.problems, self.stops = [], np.cumsum(counts)[:-1]
        self._of_step = []
        for auv in auvs:
            steps, of_step = np.unique(auv.pings, return_inverse=True)
            self._of_step.append(of_step)
            problem = Allocation(
                P0=auv.P0,
                F=auv.F,
                Q=auv.Q,
                J_other=auv.J_other,
                pings=steps,
                precision=np.ones(len(steps)),
                weights=self.weights,
            )
            self.problems.append(problem)

    def evaluate(self, told: np.ndarray) -> tuple[float, list[np.ndarray], list[np.ndarray]]:
        """Mean square where ranges tell these matrices, and the information and covariances."""
        value, Js, Ps = 0.0, [], []
        of_each = np.split(told, self.stops)
        for problem, share, own, step in zip(
            self.problems, self.share, of_each, self._of_step, strict=True
        ):
            together = np.zeros((len(problem.pings), 2, 2))
            np.add.at(together, step, own)
            one, J, P = problem.evaluate(together)
            value += share * one
            Js.append(J)
            Ps.append(P)
        return float(value), Js, Ps

    def gradient(self, Js: list[np.ndarray], Ps: list[np.ndarray]) -> np.ndarray:
        """Derivative of the mean square by the information of each range."""
        slopes = []
        for problem, share, J, P, step in zip(
            self.problems, self.share, Js, Ps, self._of_step, strict=True
        ):
            slope = problem.gradient(J, P) if len(problem.pings) else np.zeros((0, 2, 2))
            slopes.append(share * slope[step])
        return np.concatenate(slopes)

    def stages(self, aid: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times [s] of an aid vehicle's ranges, which ranges are its, and the stage of each."""
        own = np.flatnonzero(self.aid == aid)
        times, stage = np.unique(self.time[own], return_inverse=True)
        return times, own, stage


def _check(auvs: Sequence[RangedAuv], aids: Sequence[AidVehicle], time: np.ndarray) -> None:
    """Raise ValueError for what makes no sense."""
    if not auvs:
        raise ValueError("give at least one AUV: without one there is no error to bound")
    if not (np.isfinite(time).all() and np.all(np.diff(time) >= 0)):
        raise ValueError("times must be finite and not fall")
    for i, auv in enumerate(auvs):
        check_pings(auv.pings, len(auv.F))
        if len(time) != len(auv.F) + 1:
            raise ValueError(
                f"AUV {i} must have a step between each two samples: {len(time)} samples, "
                f"got {len(auv.F)} steps"
            )
        if not (len(auv.pings) == len(auv.places) == len(auv.aids)):
            raise ValueError(
                f"AUV {i} must have a place and an aid vehicle for each of {len(auv.pings)} pings, "
                f"got {len(auv.places)} and {len(auv.aids)}"
            )
        if len(auv.aids) and not (auv.aids.min() >= 0 and auv.aids.max() < len(aids)):
            raise ValueError(
                f"aid vehicles of AUV {i} must be 0 to {len(aids) - 1}, "
                f"got {auv.aids.min()} to {auv.aids.max()}"
            )
        if not (np.isfinite(auv.places).all() and np.isfinite(auv.heights).all()):
            raise ValueError(f"places and heights of AUV {i} must be finite")
