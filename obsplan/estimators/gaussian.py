"""What Gaussian filters have in common; they differ in how they take functions for linear ones."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple

import casadi as ca

from formulations.model.casadi import symbol
from formulations.model.covariance import propagate, symmetric
from obsplan.estimators.estimator import Process
from obsplan.estimators.jacobian import jacobian
from obsplan.sensors import Sensor, residual
from obsplan.vehicles import States, Vehicle

Function = Callable[[ca.SX], ca.SX]


class Linear(NamedTuple):
    """A function of a Gaussian state as a filter takes it: mean + H (x - mean of x) + error."""

    mean: ca.SX
    H: ca.SX
    error: ca.SX  # covariance of the error, which is taken to be independent of x


class GaussianFilter(ABC):
    r"""Filter for :math:`x^+ = f(x, u) + w` and scalar :math:`z = h(x) + v` with a Gaussian belief.

    A filter is how it makes f and h linear, `linearize`; the rest is the Kalman filter's, with the
    covariance in Joseph form. f is the vehicle's own model. A subclass with more states gives
    `states` and `step`; `predict`, `innovation` and `update` follow.
    """

    @abstractmethod
    def linearize(self, f: Function, x: ca.SX, P: ca.SX) -> Linear:
        """What is taken for f where the state has mean x and covariance P."""
        ...

    def states(self, model: Vehicle) -> States:
        """Components of x: the model's."""
        return model.states

    def step(self, x: ca.SX, u: ca.SX, process: Process) -> ca.SX:
        """State one sample later, f(x, u)."""
        return process.model.step(x, u, process.dt)

    def predict(self, x: ca.SX, P: ca.SX, u: ca.SX, process: Process) -> tuple[ca.SX, ca.SX]:
        """Mean and covariance one sample later."""
        after = self.linearize(lambda s: self.step(s, u, process), x, P)
        Q = process.covariance(x)
        return after.mean, propagate(P, after.H, Q + after.error)

    def innovation(
        self, x: ca.SX, P: ca.SX, z: ca.SX, sensor: Sensor, beacon: ca.SX
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Innovation of the scalar measurement z, its variance, and how it depends on the state."""
        seen = self.expected(x, P, sensor, beacon)
        return residual(sensor, z, seen.mean), _variance(P, seen), seen.H

    def update(
        self, x: ca.SX, P: ca.SX, z: ca.SX, sensor: Sensor, beacon: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Mean and covariance after the scalar measurement z."""
        seen = self.expected(x, P, sensor, beacon)
        K, after = corrected(P, seen)
        return x + K * residual(sensor, z, seen.mean), after

    def expected(self, x: ca.SX, P: ca.SX, sensor: Sensor, beacon: ca.SX) -> Linear:
        """The measurement, its own error counted; that is of the standard deviation at the mean."""
        seen = self.linearize(lambda s: sensor.measure(s, beacon), x, P)
        return seen._replace(error=sensor.deviation(x, beacon) ** 2 + seen.error)


def tangent(f: Function, x: ca.SX) -> Linear:
    """What is taken for f where its curvature is neglected."""
    mean = f(x)
    return Linear(mean, jacobian(f, x), ca.SX(mean.numel(), mean.numel()))


def hessians(f: Function, x: ca.SX) -> list[ca.SX]:
    """Hessian of each component of f at the expression x."""
    s = symbol("s", x.numel())
    components = ca.vertsplit(f(s))
    return [ca.substitute(ca.hessian(each, s)[0], s, x) for each in components]


def states_of(f: Function, n: int) -> list[int]:
    """States, of n, that f depends on, by its expression."""
    return _that_matter(f, n, order=1)


def bends(f: Function, n: int) -> list[int]:
    """States, of n, in which f is not linear, by its expression."""
    return _that_matter(f, n, order=2)


def _that_matter(f: Function, n: int, *, order: int) -> list[int]:
    s = symbol("s", n)
    matter = ca.which_depends(f(s), s, order, False)  # to any component
    return [i for i, does in enumerate(matter) if does]


def corrected(P: ca.SX, seen: Linear) -> tuple[ca.SX, ca.SX]:
    """Gain of a scalar measurement, and the covariance after it, in Joseph form."""
    K = P @ seen.H.T / _variance(P, seen)
    A = ca.SX.eye(P.shape[0]) - K @ seen.H
    joseph = A @ P @ A.T + seen.error * K @ K.T  # P stays positive semidefinite
    return K, symmetric(joseph)


def _variance(P: ca.SX, seen: Linear) -> ca.SX:
    """Variance of the innovation of a scalar measurement."""
    return seen.H @ P @ seen.H.T + seen.error
