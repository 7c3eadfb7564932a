"""The AUVs' mean predicted position variance, a function of where aid vehicles are at ranges."""

from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..model.casadi import SX, symbol
from ..model.covariance import condition_on_range, pack, pack_array, propagate, symmetric, unpack
from ..model.ranging import NUMBERS, Form, law
from ..model.recursion import Recursion
from .problem import HEADING, Maps, Problem

PACKED = 10  # entries of a packed covariance
FREE = ((0, 2), (1, 2), (2, 2), (3, 2), (0, 3), (1, 3), (2, 3))  # of a transition: not 0 or 1
ROWS = {  # of what a stage is told of an AUV
    "position": 2,  # of the AUV at the end [m]
    "first": 33,  # maps of the first half: transition, noise, heading
    "second": 33,  # and of the second
    "share": 3,  # of the mission's time: of the beginning, the middle and the end
    "weight": 1,
}
AT_RANGES = {  # and of its ranges to each other transducer
    "height": 1,  # of that above the AUV's at the end [m]
    "pings": 1,  # number of ranges at the end
    "numbers": NUMBERS,  # of the ranging's law
}
HALF = (16, 16, 1)  # rows of the parts of a half's maps
Forms = tuple[Form, ...]  # of the ranges to each of `Problem.ranged`


class PredictedVariance:
    """Weighted position variance over the mission's time [m^2], and its gradient by positions [m].

    The variances of a stage's beginning, middle and end count as `MissionStages.share` says. Each
    AUV's covariances are followed through the stages, and the gradient backwards.
    """

    def __init__(self, problem: Problem) -> None:
        stages = problem.stages
        self._told = np.moveaxis(told(problem), 1, 0)
        self._first = pack_array(problem.covariance)
        self._sweeps = sweeps(tuple(other.ranging.form for other in problem.ranged))
        vehicles, beacons = len(problem.vehicles), problem.beacons
        self._x = np.zeros((len(stages.end), vehicles + len(beacons), 2))
        for k, beacon in enumerate(beacons, start=vehicles):
            self._x[:, k] = beacon.position[stages.end]
        self._vehicles = vehicles

    def value(self, x: Float[np.ndarray, "S vehicles 2"]) -> float:
        """The mean variance with the aid vehicles at x at the stages' ends."""
        return mean_variance(self._followed(self._with_beacons(x)))

    def __call__(
        self, x: Float[np.ndarray, "S vehicles 2"]
    ) -> tuple[float, Float[np.ndarray, "S vehicles 2"]]:
        """The mean variance, and its gradient."""
        there = self._with_beacons(x)
        states = self._followed(there)
        gradient = np.zeros_like(there)
        slopes = np.zeros((len(there) + 1, PACKED + there.shape[1]))
        for auv in reversed(range(len(states))):
            before = states[auv, :-1]
            self._sweeps.backward(slopes, before[::-1], there[::-1], self._told[auv, ::-1])
            gradient += slopes[:0:-1, PACKED:]
        return mean_variance(states), gradient.reshape(len(x), -1, 2)[:, : self._vehicles]

    def _with_beacons(self, x: Float[np.ndarray, "S vehicles 2"]) -> Float[np.ndarray, "S places"]:
        """Where all are that are ranged to, side by side."""
        there = self._x.copy()
        there[:, : self._vehicles] = x
        return there.reshape(len(x), -1)

    def _followed(self, x: Float[np.ndarray, "S places"]) -> Float[np.ndarray, "M stages n"]:
        """Each AUV's covariance and share of the mean variance, before and after each stage."""
        states = np.zeros((len(self._told), len(x) + 1, PACKED + 1))
        states[:, 0, :PACKED] = self._first
        for auv, told in zip(states, self._told, strict=True):
            self._sweeps.forward(auv, x, told)
        return states


def told(problem: Problem) -> Float[np.ndarray, "S M rows"]:
    """What stages are told of each AUV: `ROWS`, then `AT_RANGES` for each that is ranged to."""
    stages = problem.stages
    S, M = len(stages.end), len(problem.weights)
    of_stages = [
        problem.position[stages.end],
        *columns(stages.halves[0]),
        *columns(stages.halves[1]),
        np.tile(stages.share[:, None], (M, 1)),
        np.tile(problem.weights, (S, 1)),
    ]
    for k, other in enumerate(problem.ranged):
        numbers = np.tile(other.ranging.numbers, (S, M, 1))
        of_stages += [problem.height(other)[stages.end], stages.pings[:, k], numbers]
    return np.concatenate([part.reshape(S, M, -1) for part in of_stages], axis=-1)


def mean_variance(states: Float[np.ndarray, "M stages n"]) -> float:
    """The sum of all shares, stage by stage in the order of the AUVs."""
    shares = states[:, 1:, PACKED].T
    return float(np.cumsum(shares)[-1])


def columns(maps: Maps) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Maps as CasADi stores matrices, by columns; the noise is symmetric."""
    return maps.transition.swapaxes(-1, -2), maps.noise, maps.heading


class Sweeps(NamedTuple):
    """Through the stages of one AUV and back.

    ``forward`` carries the covariance and the stage's share of the mean variance, given positions
    of all that are ranged to and what stages are told. ``backward`` carries the gradients of the
    mean variance by the covariance and by the positions, given states, positions and the same.
    """

    forward: Recursion
    backward: Recursion


@lru_cache(maxsize=16)
def sweeps(forms: Forms) -> Sweeps:
    """The sweeps for ranges of these forms."""
    stage = stage_function(forms)
    state, x = symbol("state", PACKED + 1), symbol("x", 2 * len(forms))
    told = symbol("told", rows_of(forms))
    P = state[:PACKED]
    after, share = stage(P, x, told)
    forward = ca.Function("followed", [state, x, told], [ca.vertcat(after, share)])
    slope = symbol("slope", PACKED + 2 * len(forms))
    by_P, by_x, _ = stage.reverse(1)(P, x, told, after, share, slope[:PACKED], 1)
    given = [slope, state, x, told]
    backward = ca.Function("returned", given, [ca.densify(ca.vertcat(by_P, by_x))])
    return Sweeps(Recursion(forward), Recursion(backward))


def rows_of(forms: Forms) -> int:
    """How much a stage is told of an AUV; see `told`."""
    return sum(ROWS.values()) + len(forms) * sum(AT_RANGES.values())


def stage_function(forms: Forms) -> ca.Function:
    """One stage of one AUV: (covariance, positions, told) -> (covariance, share).

    Positions are of all that are ranged to, side by side. The share is the AUV's in the mean
    variance. For ``told`` see the function of that name.
    """
    P, x = symbol("P", PACKED), symbol("x", 2 * len(forms))
    told = symbol("told", rows_of(forms))
    sizes = [*ROWS.values(), *len(forms) * [sum(AT_RANGES.values())]]
    parts = ca.vertsplit(told, np.cumsum([0, *sizes]).tolist())
    position, first, second, share, weight = parts[: len(ROWS)]
    begin = unpack(P)
    middle = advanced(begin, first)
    end = advanced(middle, second)
    variances = [covariance[0, 0] + covariance[1, 1] for covariance in (begin, middle, end)]
    counted = weight * ca.dot(share, ca.vertcat(*variances))
    ranged = end
    places = ca.vertsplit(x, 2)
    for place, form, there in zip(places, forms, parts[len(ROWS) :], strict=True):
        height, pings, numbers = ca.vertsplit(there, np.cumsum([0, *AT_RANGES.values()]).tolist())
        away, ranging = place - position, law(form, numbers)
        ranged = condition_on_range(ranged, away, law=ranging, pings=pings, height=height)
    return ca.Function("stage", [P, x, told], [pack(ranged), counted])


def advanced(P: SX, maps: SX) -> SX:
    """`problem.advance` of one AUV as an expression; of the transition only `FREE` is read."""
    T, Q, h = ca.vertsplit(maps, np.cumsum([0, *HALF]).tolist())
    F = ca.SX.eye(4)
    for row, column in FREE:
        F[row, column] = T[row + 4 * column]
    heading = P[:, HEADING]
    known = P - h / (1 + h * heading[HEADING]) * heading @ heading.T
    return propagate(symmetric(known), F, ca.reshape(Q, 4, 4))
