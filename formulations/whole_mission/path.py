"""Paths of piecewise constant turns, and the gradient by the turns of functions of positions."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float, Integer

from ..model.arcs import arc
from ..model.casadi import symbol
from ..model.recursion import Recursion
from .problem import AidVehicle, Problem

POSE = 3  # east, north [m], heading [rad]


@dataclass(frozen=True, eq=False)
class Turns:
    """Turns of all aid vehicles, each held for ``hold`` samples, one vehicle's after another's.

    They are in units of the vehicle's limit, from -1 to 1. Of the first one ``begun`` samples are
    over already.
    """

    problem: Problem
    hold: int
    begun: int = 0

    @property
    def count(self) -> int:
        """Number of turns of each vehicle."""
        return -(-(self.problem.steps + self.begun) // self.hold)

    @property
    def size(self) -> int:
        """Number of turns of all."""
        return self.count * len(self.problem.vehicles)

    @cached_property
    def _first(self) -> Integer[np.ndarray, " n"]:
        """Step at which each turn of a vehicle begins."""
        return np.maximum(np.arange(self.count) * self.hold - self.begun, 0)

    @cached_property
    def samples(self) -> Integer[np.ndarray, " samples"]:
        """All samples."""
        return np.arange(self.problem.steps + 1)

    @cached_property
    def nodes(self) -> Integer[np.ndarray, " nodes"]:
        """Samples at which turns begin or ranges come; the first and the last are among them."""
        return np.union1d(self._first, self.problem.stages.end)

    def of_each(self, w: Float[np.ndarray, " n"]) -> Float[np.ndarray, "vehicles count"]:
        """Each vehicle's turns."""
        return w.reshape(-1, self.count)

    def poses(
        self, w: Float[np.ndarray, " n"], at: Integer[np.ndarray, " some"] | None = None
    ) -> Float[np.ndarray, "vehicles some 3"]:
        """Poses of the aid vehicles at all samples, or at some that have all `nodes`.

        They are on exact arcs.
        """
        samples = self.samples if at is None else at
        found = np.empty((len(self.problem.vehicles), len(samples), POSE))
        for k, own in enumerate(self.of_each(w)):
            self._follow(found[k], own, samples, k)
        return found

    def gradient(
        self,
        w: Float[np.ndarray, " n"],
        by_position: Float[np.ndarray, "vehicles some 2"],
        at: Integer[np.ndarray, " some"] | None = None,
    ) -> Float[np.ndarray, " n"]:
        """Gradient by the turns of what has the gradient ``by_position``: reverses `poses`."""
        samples = self.samples if at is None else at
        first = np.searchsorted(samples, self._first)
        gradient = np.empty((len(by_position), self.count))
        for k, own in enumerate(self.of_each(w)):
            poses, slopes = np.empty((len(samples), POSE)), np.zeros((len(samples), POSE + 1))
            arcs = self._follow(poses, own, samples, k)
            backward = by_position[k, :0:-1]
            sweeps().backward(slopes, poses[-2::-1], arcs[::-1], backward)
            by_rate = slopes[:0:-1, POSE]
            limit = self.problem.vehicles[k].max_turn_rate
            gradient[k] = np.add.reduceat(by_rate, first) * limit
        return gradient.ravel()

    def _follow(
        self,
        poses: Float[np.ndarray, "some 3"],
        w: Float[np.ndarray, " count"],
        samples: Integer[np.ndarray, " some"],
        k: int,
    ) -> Float[np.ndarray, "arcs 3"]:
        """Fill in the poses of a vehicle at some samples; the arcs that lead from one to another.

        An arc is a turn rate [rad/s], a speed [m/s] and a duration [s].
        """
        vehicle = self.problem.vehicles[k]
        turn = (samples[:-1] + self.begun) // self.hold
        arcs = np.empty((len(samples) - 1, 3))
        arcs[:, 0] = w[turn] * vehicle.max_turn_rate
        arcs[:, 1] = vehicle.speed
        arcs[:, 2] = np.diff(samples) * self.problem.time_step
        poses[0] = vehicle.start
        sweeps().forward(poses, arcs)
        return arcs

    def of(
        self, turn_rate: Float[np.ndarray, " steps"], vehicle: AidVehicle
    ) -> Float[np.ndarray, " count"]:
        """Turns that keep the headings of turn rates [rad/s] given at each step."""
        end = np.append(self._first[1:], self.problem.steps)
        mean = np.add.reduceat(turn_rate, self._first) / (end - self._first)
        return np.clip(mean / vehicle.max_turn_rate, -1.0, 1.0)


class Sweeps(NamedTuple):
    """Along a path and back.

    ``forward`` carries the pose, given arcs. ``backward`` carries the gradient by the pose, and
    gives that by the turn rate, given poses, arcs and the gradient by the position after each.
    """

    forward: Recursion
    backward: Recursion


@cache
def sweeps() -> Sweeps:
    """The sweeps of every path."""
    pose, turn = symbol("pose", POSE), symbol("turn", 3)
    rate, speed, duration = ca.vertsplit(turn)
    end = arc(pose, rate, speed, duration)
    forward = ca.Function("along", [pose, turn], [end])
    slope, by_position = symbol("slope", POSE + 1), symbol("by_position", 2)
    by_end = slope[:POSE] + ca.vertcat(by_position, 0)
    by_pose = ca.jtimes(end, pose, by_end, True)
    by_rate = ca.jtimes(end, rate, by_end, True)
    given = [slope, pose, turn, by_position]
    backward = ca.Function("back", given, [ca.densify(ca.vertcat(by_pose, by_rate))])
    return Sweeps(Recursion(forward), Recursion(backward))
