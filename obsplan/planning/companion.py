"""What AUVs range to besides the vehicle planned for: moored beacons, other aid vehicles."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

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


@dataclass(frozen=True)
class Turns:
    """The route of an aid vehicle: turns one after the other, the last one held on."""

    pose: Pose
    turn_rates: tuple[float, ...]  # [rad/s]
    speed: float  # [m/s]
    durations: tuple[float, ...] = ()  # of all turns but the last, or of all [s]
    current: tuple[float, float] = (0.0, 0.0)  # that carries it, east and north [m/s]

    def __call__(self, times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 2"]:
        """Positions over ground [m] at times from now [s]."""
        begins, nodes = self._nodes
        turn = np.searchsorted(begins, times, side="right") - 1
        rates = np.array(self.turn_rates)[turn, None]
        since = (times - begins[turn])[:, None]
        moved = path(nodes[turn], rates, self.speed, since)[:, 1, :2]
        return moved + times[:, None] * np.array(self.current)

    @cached_property
    def _nodes(self) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, "N 3"]]:
        """When the turns begin [s], and the poses then."""
        start, rates = self.pose, np.array(self.turn_rates[:-1])
        lasting = np.array(self.durations[: rates.size])
        first = np.array([start.x, start.y, start.heading])
        return np.append(0.0, lasting.cumsum()), path(first, rates, self.speed, lasting)


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
        begin, end = float(ends[0]), float(ends[-1])
        times = [one.schedule.times(i, begin, end) for i in range(len(auvs))]
        places = [auv.ahead(of - time) for auv, of in zip(auvs, times, strict=True)]
        whose = np.repeat(np.arange(len(auvs)), [of.size for of in times])
        at = np.concatenate(times)
        ahead = at - time
        place = np.concatenate(places) + ahead[:, None] * np.array(current)
        height = np.array([auv.depth for auv in auvs])[whose] - one.depth
        each = ranging_information(one.route(ahead) - place, ranging, height, expected=True)
        stage = np.searchsorted(ends[1:-1], at - ROUNDING * one.schedule.interval)
        np.add.at(known, (stage, whose), each)
    return known
