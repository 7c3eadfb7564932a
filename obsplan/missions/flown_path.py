"""A path as it was flown, and the fewest of its samples that do as waypoints."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Integer

from obsplan.constraints import Constraints
from obsplan.missions.mission import Track

STANDING = 1e-6  # [m] from sample to sample; a vehicle that moves less stands
COARSE = 0.02  # share of the tolerances for what lies between the samples that may be waypoints
# legs end at each of the next possible waypoints, then at every tenth farther
EVERY = 64
STRIDE = 1.1
LOOKED_AT = 64  # possible waypoints between the ends of a leg, where there are more
MOST_COARSE = 20  # of these for each item: with more, the items are not enough by far


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowance:
    """What an autopilot takes, and how near to the path it has to stay.

    Raises
    ------
    ValueError
        A number out of its range.
    """

    items: int = 500  # home, speeds and the end's command included
    spacing: float = 2.0  # least length of a leg [m]: nearer waypoints are passed over
    tolerance: float = 0.5  # greatest distance from the path [m]
    timing: float = 1.0  # greatest time ahead of the plan or behind it [s]

    def __post_init__(self) -> None:
        if self.items < 8:
            raise ValueError(f"a mission needs room for at least 8 items, got {self.items}")
        if not 0 <= self.spacing < np.inf:
            raise ValueError(f"spacing must be at least 0 [m] and finite, got {self.spacing}")
        for name, unit in (("tolerance", "m"), ("timing", "s")):
            if not 0 < (value := getattr(self, name)) < np.inf:
                raise ValueError(f"{name} must be positive and finite [{unit}], got {value}")

    def times(self, factor: float) -> "Allowance":
        """The same with larger tolerances."""
        return replace(self, tolerance=self.tolerance * factor, timing=self.timing * factor)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlownPath:
    """A path as flown: places, none like the one before, and the times of coming and leaving."""

    points: Float[np.ndarray, "n 2"]
    arrive: Float[np.ndarray, " n"]
    depart: Float[np.ndarray, " n"]
    constraints: Constraints

    @classmethod
    def of(cls, flown: Track, constraints: Constraints) -> "FlownPath":
        """Join the samples between which the vehicle stood.

        Raises
        ------
        ValueError
            A track without times.
        """
        if flown.time is None:
            raise ValueError("a path to simplify needs a time at each sample")
        moved = np.hypot(*np.diff(flown.points, axis=0).T) > STANDING
        first = np.flatnonzero(np.append(True, moved))
        last = np.append(first[1:], len(flown.points)) - 1
        return cls(
            points=flown.points[first],
            arrive=flown.time[first],
            depart=flown.time[last],
            constraints=constraints,
        )

    @property
    def top_speed(self) -> float:
        """Greatest speed between two samples [m/s]."""
        moved = np.hypot(*np.diff(self.points, axis=0).T)
        return float(np.max(moved / (self.arrive[1:] - self.depart[:-1]), initial=0.0))

    def misfit(self, i: np.ndarray, j: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance [m] of samples k from the legs i to j, and how far off [s] a vehicle is."""
        share, distance = self._beside(i, j, k)
        due = self.depart[i] + share * (self.arrive[j] - self.depart[i])
        return distance, np.maximum(abs(self.arrive[k] - due), abs(self.depart[k] - due))

    def _beside(self, i: np.ndarray, j: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where on the legs i to j the samples k are nearest, as a share, and how far [m] off."""
        leg = self.points[j] - self.points[i]
        off = self.points[k] - self.points[i]
        square = np.maximum((leg**2).sum(axis=-1), np.finfo(float).tiny)
        share = np.clip((off * leg).sum(axis=-1) / square, 0.0, 1.0)
        return share, np.hypot(*np.moveaxis(off - share[..., None] * leg, -1, 0))

    def misfit_of(
        self,
        chosen: Integer[np.ndarray, " k"],
        arrive: Float[np.ndarray, " k"],
        depart: Float[np.ndarray, " k"],
    ) -> tuple[float, float]:
        """Greatest distance [m] and time [s] of a mission on its samples from the path."""
        k = np.arange(len(self.points))
        legs = len(chosen) - 1
        leg = np.clip(np.searchsorted(chosen, k, side="right") - 1, 0, max(legs - 1, 0))
        i, j = chosen[leg], chosen[np.minimum(leg + 1, legs)]
        share, distance = self._beside(i, j, k)
        due = depart[leg] + share * (arrive[np.minimum(leg + 1, legs)] - depart[leg])
        off = np.maximum(abs(self.arrive - due), abs(self.depart - due))
        off[chosen] = np.maximum(
            abs(self.arrive[chosen] - arrive), abs(self.depart[chosen] - depart)
        )
        off[chosen[-1] :] = abs(self.arrive[chosen[-1]] - arrive[-1])  # the mission is over
        return float(distance.max()), float(off.max())

    def far_apart(self, spacing: float) -> Integer[np.ndarray, " k"]:
        """The first sample, and the last one that is a leg away from it, if there is one."""
        away = np.hypot(*(self.points - self.points[0]).T) >= max(spacing, STANDING)
        return np.array([0, *np.flatnonzero(away)[-1:]])

    def waypoints(self, allowance: Allowance) -> Integer[np.ndarray, " k"] | None:
        """The fewest samples whose legs fit, from the first to the last; None if there are none."""
        possible = self._possible(allowance)
        if possible is None:
            return None
        i, j, cost = self._legs(possible, allowance)
        return _shortest(possible, i, j, cost)

    def _possible(self, allowance: Allowance) -> Integer[np.ndarray, " m"] | None:
        """Samples that may be waypoints; None where they are too many for the items.

        The line through them is the path to a `COARSE` share of the tolerances.
        """
        chosen, reach = [0], 1
        while chosen[-1] < len(self.points) - 1:
            reach = self._reach(chosen[-1], reach, allowance.times(COARSE))
            chosen.append(chosen[-1] + reach)
            if len(chosen) > MOST_COARSE * allowance.items:
                return None
        return np.array(chosen)

    def _reach(self, i: int, guess: int, allowance: Allowance) -> int:
        """How many samples fit on a leg from sample i, at most, by doubling and halving."""
        most = len(self.points) - 1 - i
        low, high = 1, min(guess, most) + 1
        while high <= most and self._fits(i, i + high, allowance):
            low, high = high, min(2 * high, most + 1)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self._fits(i, i + middle, allowance) else (low, middle)
        return low

    def _fits(self, i: int, j: int, allowance: Allowance) -> bool:
        """Whether all samples on the way are within the tolerances of a leg, half of the time's."""
        distance, late = self.misfit(np.array(i), np.array(j), np.arange(i + 1, j))
        near = (distance <= allowance.tolerance).all()
        in_time = (late <= allowance.timing / 2).all()
        return bool(near and in_time)

    def _legs(
        self, possible: Integer[np.ndarray, " m"], allowance: Allowance
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Legs that fit: where they begin and end, and their squared deviations.

        Begin and end are indices of possible waypoints. A path near a leg is near its parts, to
        twice the tolerance (Agarwal et al., Algorithmica 42, 2005, lemma 3.3): beyond that no
        farther end is looked at. Of what lies between the ends of long legs only a part is looked
        at: whether a mission fits is measured in the end.
        """
        allowance = allowance.times(1.0 - COARSE)
        found = []
        begin = np.arange(len(possible) - 1)
        for ahead in _aheads(len(possible)):
            begin = begin[begin + ahead < len(possible)]
            if not begin.size:
                break
            i, j = possible[begin], possible[begin + ahead]
            inner = np.linspace(1, ahead - 1, min(ahead - 1, LOOKED_AT)).round().astype(int)
            between = possible[begin[:, None] + inner]
            distance, late = self.misfit(i[:, None], j[:, None], between)
            distance, late = distance.max(axis=1, initial=0.0), late.max(axis=1, initial=0.0)
            long = np.hypot(*(self.points[j] - self.points[i]).T) >= allowance.spacing
            fits = long & (distance <= allowance.tolerance) & (late <= allowance.timing / 2)
            fits[fits] = self._permitted(i[fits], j[fits])
            found.append(np.array([begin, begin + ahead, distance**2])[:, fits])
            near = (distance <= 2 * allowance.tolerance) & (late <= allowance.timing)
            begin = begin[near | ~long]
        i, j, cost = np.concatenate(found, axis=1)
        return i.astype(int), j.astype(int), cost / allowance.tolerance**2

    def _permitted(
        self, i: Integer[np.ndarray, " legs"], j: Integer[np.ndarray, " legs"]
    ) -> Bool[np.ndarray, " legs"]:
        """Whether legs keep within the fixed limits, as far as the path itself does from i to j."""
        if not (self.constraints.keep_out or self.constraints.geofence is not None):
            return np.ones(i.size, dtype=bool)
        legs = np.stack([self.points[i], self.points[j]], axis=1)
        kept = self._broken[j + 1] == self._broken[i]
        return self.constraints.keeps_legs(legs) | ~kept

    @cached_property
    def _broken(self) -> Integer[np.ndarray, " _"]:
        """How many samples before each one are outside the fixed limits."""
        outside = self.constraints.fixed_violation(self.points) > 0
        return np.append(0, np.cumsum(outside))


def _aheads(count: int) -> Iterator[int]:
    """How far ahead legs may end, among so many places."""
    ahead = 1
    while ahead < count:
        yield ahead
        ahead = max(ahead + 1, int(STRIDE * ahead) if ahead >= EVERY else 0)


def _shortest(
    possible: Integer[np.ndarray, " m"], i: np.ndarray, j: np.ndarray, cost: np.ndarray
) -> Integer[np.ndarray, " k"] | None:
    """The way of fewest legs from the first to the last waypoint, of these that of least cost."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    size = len(possible)
    weights = 1.0 + cost / (size + 1)  # all costs together are less than one leg
    graph = csr_array((weights, (i, j)), shape=(size, size))
    _, before = dijkstra(graph, indices=0, return_predecessors=True)
    way = [size - 1]
    while way[-1] > 0:
        way.append(int(before[way[-1]]))
    return possible[way[::-1]] if way[-1] == 0 else None
