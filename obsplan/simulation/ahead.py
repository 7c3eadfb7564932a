"""Keeps the paths that planners had in mind while a mission was flown."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Integer

from formulations.model.arcs import path
from obsplan.planned import PATH, Planned
from obsplan.planning.answers import FAULTS, Answer
from obsplan.plugins import in_words
from obsplan.types import Decision

MOST = 20_000  # paths of a mission that are kept; of more, as many evenly apart
AHEAD = 300.0  # [s] after its decision; what comes later of a path is not kept
FINEST = 0.3  # [rad] that the vehicle turns between two places of a path, at most
SAGITTA = 0.05  # [m] between the path and the line through its places, at most
MOST_PARTS = 32  # places of one held turn
SAME = 1e-3  # [s], [m]; places that are nearer are the same
CIRCLES = 1e-6  # [-], of a chord to its arc: whole circles, which do not tell their speed


class Legs(NamedTuple):
    """Turns of one path, each held for a while."""

    pose: Float[np.ndarray, "legs 3"]  # at its beginning
    turned: Float[np.ndarray, " legs"]  # [rad]
    speed: Float[np.ndarray, " legs"]  # [m/s]
    begin: Float[np.ndarray, " legs"]  # [s] after the decision
    lasting: Float[np.ndarray, " legs"]  # [s]


class Ahead:
    """What the planner of one aid vehicle had in mind, collected as it is asked.

    A path that goes on as the one before had it is not kept once more.
    """

    def __init__(self, decisions: int) -> None:
        self._every = -(-decisions // MOST)
        self._asked = 0
        self._decided: list[float] = []
        self._legs: list[Legs] = []

    def keep(self, time: float, decision: Decision, faults: dict[str, str]) -> None:
        """Keep the path of a decision at a time [s], if it has one that can be read."""
        self._asked += 1
        if (self._asked - 1) % self._every:
            return
        try:
            legs = legs_of(decision)
        except FAULTS as error:  # of a user's planner
            faults.setdefault(PATH, f"first after {time:g} s: {in_words(error)}")
            return
        if legs is None or (self._legs and goes_on(self._legs[-1], legs, time - self._decided[-1])):
            return
        self._decided.append(time)
        self._legs.append(legs)

    def planned(self, current: tuple[float, float]) -> Planned | None:
        """All paths, over ground, in a current [m/s]; None where there was none."""
        if not self._legs:
            return None
        counts = np.array([legs.begin.size for legs in self._legs])
        legs = Legs(*(np.concatenate(part) for part in zip(*self._legs, strict=True)))
        parts = parts_of(legs)
        leg = np.repeat(np.arange(parts.size), parts)
        part = np.arange(leg.size) - np.repeat(parts.cumsum() - parts, parts)
        since = legs.lasting[leg] * (part + 1) / parts[leg]
        rate, speed = legs.turned / legs.lasting, legs.speed
        moved = path(legs.pose[leg], rate[leg, None], speed[leg, None], since[:, None])
        ahead = legs.begin[leg] + since
        decided = np.array(self._decided)
        of = np.repeat(np.arange(counts.size), counts)[leg]
        return Planned(
            decided=decided,
            ends=np.searchsorted(of, np.arange(counts.size), side="right"),
            time=decided[of] + ahead,
            place=moved[:, 1, :2] + ahead[:, None] * np.array(current),
        )


def keep_all(
    ahead: Sequence[Ahead], time: float, answers: Sequence[Answer], faults: dict[str, str]
) -> None:
    """Keep the paths of all aid vehicles' decisions at a time [s], where any are asked for."""
    for kept, answer in zip(ahead, answers, strict=False):
        kept.keep(time, answer.decision, faults)


def planned_of(
    ahead: Sequence[Ahead], currents: Sequence[tuple[float, float]]
) -> tuple[Planned | None, ...]:
    """All paths of each aid vehicle, in its current [m/s]."""
    return tuple(kept.planned(own) for kept, own in zip(ahead, currents, strict=False))


def legs_of(decision: Decision) -> Legs | None:
    """The first part of a decision's path, as turns held; None where there is none.

    Raises
    ------
    ValueError
        The path or its durations are no such numbers.
    """
    poses, told = (np.asarray(part, dtype=float) for part in (decision.path, decision.lasting))
    if poses.ndim != 2 or poses.shape[1] != 3 or not np.isfinite(poses).all():
        raise ValueError(f"path must be finite poses (steps x 3), got an array {poses.shape}")
    count = max(len(poses) - 1, 0)
    if told.shape not in ((0,), (count,)) or not ((told > 0) & (told < np.inf)).all():
        raise ValueError(f"lasting must be {count} positive times, one for each leg of path")
    found = _held(poses, told, decision.speed) if told.size else _straight(poses, decision.speed)
    near = found.begin < AHEAD
    return Legs(*(part[near] for part in found)) if near.any() else None


def parts_of(legs: Legs) -> Integer[np.ndarray, " legs"]:
    """How many places each leg needs, for the line through them to be near it.

    An arc of length L that turns by an angle θ bulges from its chord by L θ/8.
    """
    turned = abs(legs.turned)
    bulge = legs.speed * legs.lasting * turned / 8
    needed = np.maximum(turned / FINEST, np.sqrt(bulge / SAGITTA))
    return np.ceil(needed).clip(1, MOST_PARTS).astype(int)


def goes_on(before: Legs, legs: Legs, since: float) -> bool:
    """Whether legs pass where those of so many seconds ago did, which had enough of them left."""
    end = float(before.begin[-1] + before.lasting[-1])
    times = since + legs.begin[1:]
    times = times[times < end - SAME]
    reaches = end >= since + float(legs.begin[-1] + legs.lasting[-1]) - SAME
    if times.size == 0 or not (reaches or end - since > AHEAD / 2):
        return False
    nearest = np.abs(before.begin[:, None] - times).argmin(axis=0)
    away = before.pose[nearest] - legs.pose[1 : times.size + 1]
    return bool((abs(away[:, :2]) < SAME).all())


def _held(poses: Float[np.ndarray, "n 3"], lasting: Float[np.ndarray, " m"], speed: float) -> Legs:
    """Legs whose durations are told: each is an arc."""
    moved = poses[1:] - poses[:-1]
    turned = moved[:, 2]
    unit = path(np.zeros(3), turned[:, None], 1.0, 1.0)[:, 1, :2]  # of one metre, so curved
    straightness = np.hypot(unit[:, 0], unit[:, 1])  # of the chord to the arc
    known = straightness > CIRCLES
    way = np.full(turned.shape, speed) * lasting
    way[known] = np.hypot(moved[known, 0], moved[known, 1]) / straightness[known]
    return Legs(poses[:-1], turned, way / lasting, lasting.cumsum() - lasting, lasting)


def _straight(poses: Float[np.ndarray, "n 3"], speed: float) -> Legs:
    """Legs of which only the places are known: straight, at one speed."""
    moved = poses[1:] - poses[:-1]
    way = np.hypot(moved[:, 0], moved[:, 1])
    moves = (way > 0) & (speed > 0)
    way, moved, begins = way[moves], moved[moves], poses[:-1][moves]
    heading = np.arctan2(moved[:, 1], moved[:, 0])
    headed = np.column_stack([begins[:, :2], heading])
    lasting = way / speed if speed > 0 else way
    return Legs(headed, 0.0 * way, 0.0 * way + speed, lasting.cumsum() - lasting, lasting)
