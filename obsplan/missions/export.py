"""The simplest path that an autopilot takes: fewest waypoints, near the path in place and time."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Integer

from obsplan.constraints import UNLIMITED, Constraints
from obsplan.missions.flown_path import Allowance, FlownPath
from obsplan.missions.mission import Track
from obsplan.missions.writers.items import End, count_items

MOST_GROWTH = 2.0**30  # of the tolerances, by doubling, until the items fit
HALVINGS = 4  # of that doubling, in octaves: to 5 % of the least
WORTH = 4.0  # growth that legs within the limits are worth
LONGEST_HOLD = 32767  # [s], in the sixteen bits of ArduPilot's store
DECIMALS = range(2, 8)  # of a speed [m/s]: as few as keep the time


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Simplified:
    """A path for an autopilot, and how far it is from the one it was made of."""

    track: Track  # places, speeds, holds, and when the plan has the vehicle there
    items: int  # of the mission, as the vehicle's store counts
    deviation: float  # greatest distance between the two [m]
    timing: float  # greatest time that a vehicle at these speeds is ahead or behind [s]

    def fits(self, allowance: Allowance) -> bool:
        """Whether it is what was asked for."""
        near = self.deviation <= allowance.tolerance and self.timing <= allowance.timing
        return near and self.items <= allowance.items


def simplify(
    flown: Track, allowance: Allowance, *, end: End = "loiter", constraints: Constraints = UNLIMITED
) -> Simplified:
    """Choose the fewest samples of a path as waypoints, so that the legs between them stay near it.

    Of the missions of fewest waypoints it is that whose squared deviations are least. Where the
    items are too many, or no legs are long enough, both tolerances grow by the least factor that
    helps, to 5 %. Where none helps, because the path keeps within less than a leg, its last part is
    left out.

    A leg that would break a limit which the path keeps is not taken, if the tolerances need not
    grow by more than another factor of `WORTH` for that. Else legs break limits by their deviation
    at most.

    Speeds are commanded where the vehicle would otherwise be out of time: chords are shorter than
    arcs. Half of the time's tolerance is for that, half for what happens within a leg.

    Parameters
    ----------
    flown
        Samples in local metres with their times [s], so dense that the line through them is the
        path.
    end
        What happens at the last waypoint.
    """
    path = FlownPath.of(flown, UNLIMITED)
    far = path.far_apart(allowance.spacing)
    growth, mission = 1.0, None
    if far.size > 1:
        growth, mission = _least(path, allowance, end, 1.0, MOST_GROWTH)
    if mission is None:
        return _judged(path, far, allowance.timing, end)
    if constraints.keep_out or constraints.geofence is not None:
        limited = replace(path, constraints=constraints)
        _, kept = _least(limited, allowance, end, growth, WORTH * growth)
        return kept or mission
    return mission


def _least(
    path: FlownPath, allowance: Allowance, end: End, low: float, most: float
) -> tuple[float, Simplified | None]:
    """The least growth of the tolerances from ``low`` on that has a mission, and that mission.

    The mission is None if there is none up to ``most``.
    """
    mission = _fitted(path, allowance.times(low), end)
    if mission is not None:
        return low, mission
    high = low
    while mission is None and high < most:
        low, high = high, min(2 * high, most)
        mission = _fitted(path, allowance.times(high), end)
    for _ in range(HALVINGS if mission is not None else 0):
        middle = math.sqrt(low * high)
        nearer = _fitted(path, allowance.times(middle), end)
        low, high = (middle, high) if nearer is None else (low, middle)
        mission = nearer or mission
    return high, mission


def _fitted(path: FlownPath, allowance: Allowance, end: End) -> Simplified | None:
    """The mission within these tolerances; None where there is none."""
    chosen = path.waypoints(allowance)
    if chosen is None:
        return None
    mission = _judged(path, chosen, allowance.timing, end)
    return mission if mission.fits(allowance) else None


def _judged(
    path: FlownPath, chosen: Integer[np.ndarray, " k"], timing: float, end: End
) -> Simplified:
    """Give the legs between waypoints their speeds, and hold the mission against the path."""
    points = path.points[chosen]
    hold = np.minimum(np.round(path.depart - path.arrive), LONGEST_HOLD)[chosen]
    hold[-1] = 0.0  # the mission is over
    lengths = np.hypot(*np.diff(points, axis=0).T)
    speed = _speeds(lengths, path.arrive[chosen], hold, timing / 2, path.top_speed)
    track = Track(
        points=points,
        time=path.arrive[chosen],
        speed=speed if speed.size else None,
        hold=hold if hold.any() else None,
    )
    arrive, depart = times_of_arrival(lengths, speed, hold, start=float(path.arrive[0]))
    deviation, late = path.misfit_of(chosen, arrive, depart)
    return Simplified(
        track=track, items=count_items(track, end=end), deviation=deviation, timing=late
    )


def times_of_arrival(
    lengths: Float[np.ndarray, " legs"],
    speed: Float[np.ndarray, " legs"],
    hold: Float[np.ndarray, " k"],
    *,
    start: float = 0.0,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """When [s] a vehicle reaches and leaves each waypoint, at its legs' speeds, with its holds."""
    sailing = np.concatenate([[0.0], np.cumsum(lengths / speed)])
    waiting = np.cumsum(hold)
    return start + sailing + waiting - hold, start + sailing + waiting


def _speeds(
    lengths: Float[np.ndarray, " legs"],
    due: Float[np.ndarray, " k"],
    hold: Float[np.ndarray, " k"],
    timing: float,
    top: float,
) -> Float[np.ndarray, " legs"]:
    """Speed on each leg [m/s], changed only to keep within ``timing`` of the plan.

    From a waypoint on, each waypoint ahead narrows the interval of slownesses [s/m] that bring the
    vehicle there in time. The last slowness before none is left is the one that brings it to the
    last of these waypoints best.
    """
    speed = np.empty(lengths.size)
    now, first = float(due[0]), 0
    while first < lengths.size:
        now += float(hold[first])
        low, high = 1.0 / top, np.inf
        distance = waiting = aim = 0.0
        last = first
        for i in range(first, lengths.size):
            along = distance + lengths[i]
            left = due[i + 1] - waiting - now
            lower, upper = max(low, (left - timing) / along), min(high, (left + timing) / along)
            if i > first and lower > upper:
                break
            low, high, distance, last = lower, max(lower, upper), along, i
            aim = left / along
            waiting += hold[i + 1]
        speed[first : last + 1] = _round_speed(low, aim, high)
        now += distance / speed[first] + hold[first + 1 : last + 1].sum()
        first = last + 1
    return speed


def _round_speed(low: float, aim: float, high: float) -> float:
    """The speed [m/s] nearest to an aimed slowness [s/m], in as few decimals as two others allow.

    They keep it between the two.
    """
    slowness = min(max(aim, low), high)
    for decimals in DECIMALS:
        speed = round(1.0 / slowness, decimals)
        if speed > 0 and low <= 1.0 / speed <= high:
            return speed
    return 1.0 / slowness
