"""What AUVs range to besides the vehicle planned for: moored beacons, other aid vehicles."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from formulations.cramer_rao import ranging_information
from formulations.model.arcs import path
from formulations.model.ranging import Ranging
from formulations.model.schedule import ROUNDING, Schedule, Stages
from obsplan.types import Belief, Pose

Route = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, slots=True)
class Moored:
    """The route of what stays where it is."""

    x: float  # east [m]
    y: float  # north [m]

    def __call__(self, times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 2"]:
        """Positions [m] at times from now [s]."""
        return np.broadcast_to([self.x, self.y], (times.size, 2))


@dataclass(frozen=True, slots=True)
class Turns:
    """The route of an aid vehicle: turns one after the other, the last one held on."""

    pose: Pose
    turn_rates: tuple[float, ...]  # [rad/s]
    speed: float  # [m/s]
    durations: tuple[float, ...] = ()  # of all turns but the last, or of all [s]
    current: tuple[float, float] = (0.0, 0.0)  # that carries it, east and north [m/s]

    def __call__(self, times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 2"]:
        """Positions over ground [m] at times from now [s]."""
        rates, start = np.array(self.turn_rates), self.pose
        lasting = np.array(self.durations)[: rates.size - 1]
        begins = np.append(0.0, lasting.cumsum())
        first = np.array([start.x, start.y, start.heading])
        nodes = path(first, rates[:-1], self.speed, lasting)
        turn = np.searchsorted(begins, times, side="right") - 1
        since = (times - begins[turn])[:, None]
        moved = path(nodes[turn], rates[turn, None], self.speed, since)[:, 1, :2]
        return moved + times[:, None] * np.array(self.current)


@dataclass(frozen=True, kw_only=True)
class Companion:
    """What AUVs range to besides, or what an aid vehicle keeps away from, as planners know it.

    ``route`` gives positions over ground [m] at times from now [s].
    """

    route: Route
    ranging: Ranging | None  # how ranges to it err; None: there are none, or planners know of none
    schedule: Schedule
    depth: float = 0.0  # of its transducer [m]
    steered: bool = False  # whether it is an aid vehicle, from which others keep a distance


def told(
    companions: Sequence[Companion],
    auvs: Sequence[Belief],
    time: float,
    stages: Stages,
    current: tuple[float, float] = (0.0, 0.0),
) -> Float[np.ndarray, "S M 2 2"] | None:
    """What ranges to companions are expected to tell of AUVs' positions in each stage [1/m^2].

    Each is taken from where both are expected as it comes, and counts as the stage ends. What is
    known of AUVs is in the water of a current [m/s] (`obsplan.planning.water`). None where AUVs
    range to none of them.
    """
    ranged = [(one, one.ranging) for one in companions if one.ranging is not None]
    if not ranged:
        return None
    ends = time + np.append(0.0, stages.duration.cumsum())
    known = np.zeros((len(stages.duration), len(auvs), 2, 2))
    for one, ranging in ranged:
        for i, auv in enumerate(auvs):
            times = one.schedule.times(i, float(ends[0]), float(ends[-1]))
            ahead = times - time
            place = auv.ahead(ahead) + ahead[:, None] * np.array(current)
            x, height = one.route(ahead) - place, auv.depth - one.depth
            each = ranging_information(x, ranging, height, expected=True)
            stage = np.searchsorted(ends[1:-1], times - ROUNDING * one.schedule.interval)
            np.add.at(known[:, i], stage, each)
    return known
