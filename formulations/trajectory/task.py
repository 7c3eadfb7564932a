"""What a trajectory is planned for: vehicle, horizon, AUVs and limits, as plain numbers."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.frames import Frame
from ..model.ranging import Ranging
from .areas import Areas, in_frame

OBJECTIVES = ("covariance", "log-det", "smallest-eigenvalue", "condition-number")


class Task(NamedTuple):
    """One planning problem of N stages and M AUVs; ``None`` where something is not limited.

    Positions and heights of AUVs are given at the 2N + 1 ends and middles of the stages. AUVs of
    weight 0 count for separations alone. ``reach`` is the largest change of turn rate at the
    beginning of each stage, ``spread`` how far an AUV may stray from its expected position before
    the path can answer.
    """

    pose: Float[np.ndarray, "3"]  # of the aid vehicle: east, north [m], heading [rad]
    turn_rate: float  # it is still at [rad/s]
    speed: tuple[float, float]  # least and greatest [m/s]
    min_turn_radius: float  # [m]
    durations: Float[np.ndarray, " N"]  # of the stages [s]
    reach: Float[np.ndarray, " N"] | None  # [rad/s]
    pings: Float[np.ndarray, "N M"]  # number of ranges to each AUV at the end of each stage
    positions: Float[np.ndarray, "T M 2"]  # of the AUVs [m]
    # from each AUV's transducer up to the aid vehicle's [m]; counts where ranges are slant
    heights: Float[np.ndarray, "T M"]
    headings: Float[np.ndarray, "N M"]  # of the AUVs during each stage [rad]
    speeds: Float[np.ndarray, "N M"]  # of the AUVs through the water [m/s]
    covariance: Float[np.ndarray, "M 4 4"]  # of each AUV's state now
    process_noise: Float[np.ndarray, "M 4"]  # standard deviations per square root of a second
    spread: Float[np.ndarray, " M"]  # [m]
    weights: Float[np.ndarray, " M"]
    ranging: Ranging
    areas: Areas
    least: float  # separation from each AUV [m]; 0: not limited
    greatest: float  # [m]; inf: not limited
    # of the water that all but the areas is in: east, north [m/s]
    current: tuple[float, float] = (0.0, 0.0)

    @property
    def length(self) -> float:
        """Unit of length: the way made in the unit of time at full speed [m]."""
        return self.speed[1] * self.time

    @property
    def time(self) -> float:
        """Unit of time: the longest stage [s]."""
        return float(self.durations.max())


def frame_of(task: Task) -> Frame:
    """The aid vehicle's frame, in the task's unit of length."""
    return Frame(task.pose[:2], float(task.pose[2]), task.length)


def _seen(current: tuple[float, float], frame: Frame, time: float) -> tuple[float, float]:
    """A current in a frame, in its unit of length and in a unit of time."""
    if not any(current):
        return current
    east, north = frame.directions(np.array(current)) * time / frame.length
    return float(east), float(north)


def in_body_frame(task: Task) -> Task:
    """The same task seen from the aid vehicle, in its own units of length and time.

    Its pose is 0, its speed and its longest stage 1.
    """
    frame, length, time = frame_of(task), task.length, task.time
    vehicle = task._replace(
        pose=np.zeros(3),
        turn_rate=task.turn_rate * time,
        speed=(task.speed[0] / task.speed[1], 1.0),
        min_turn_radius=task.min_turn_radius / length,
        durations=task.durations / time,
        reach=None if task.reach is None else task.reach * time,
        areas=in_frame(task.areas, frame),
        least=task.least / length,
        greatest=task.greatest / length,
        current=_seen(task.current, frame, time),
    )
    unit = np.array([1 / length, 1 / length, 1.0, time / length])  # of the state
    return vehicle._replace(
        positions=frame.positions(task.positions),
        heights=task.heights / length,
        headings=task.headings - task.pose[2],
        speeds=task.speeds * time / length,
        covariance=frame.covariances(task.covariance, time),
        process_noise=task.process_noise * unit * np.sqrt(time),
        spread=task.spread / length,
        weights=task.weights / task.weights.sum(),
        ranging=task.ranging.scaled(length),
    )
