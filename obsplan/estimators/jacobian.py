"""Jacobians of models by differentiation: as expressions for a filter, as arrays along a path."""

from collections.abc import Callable
from functools import lru_cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.casadi import of_each, symbol
from obsplan.estimators.estimator import Estimator, Process
from obsplan.sensors import BEACON, Sensor
from obsplan.vehicles import Vehicle


def jacobian(f: Callable[[ca.SX], ca.SX], x: ca.SX) -> ca.SX:
    """Jacobian of f at the expression x (which need not be a bare symbol)."""
    s = symbol("s", x.numel())
    return ca.substitute(ca.jacobian(f(s), s), s, x)


def transitions(
    vehicle: Vehicle, states: Float[np.ndarray, "steps n"], dt: float
) -> Float[np.ndarray, "steps n n"]:
    """Jacobian of a vehicle's step at each state of a trajectory, without control."""
    return of_each(_transition(vehicle, states.shape[1], dt), states)[0]


def predictions(
    estimator: Estimator, process: Process, means: Float[np.ndarray, "steps n"]
) -> Float[np.ndarray, "steps n n"]:
    """Jacobian of a filter's prediction with respect to its mean at each mean, without control."""
    nothing = np.zeros((means.shape[1], means.shape[1]))
    return of_each(_prediction(estimator, process), means, nothing)[0]


def informations(
    sensor: Sensor,
    states: Float[np.ndarray, "*#batch n"],
    beacons: Float[np.ndarray, "*#batch 10"],
) -> Float[np.ndarray, "*batch n n"]:
    r"""Fisher information of a measurement whose deviation may depend on the state.

    .. math:: J = (h^\top h + 2 s^\top s) / \sigma^2, \quad
              h = \partial z / \partial x, \; s = \partial \sigma / \partial x

    (Kay 1993, eq. 3.31.)
    """
    return of_each(_information(sensor, states.shape[-1]), states, beacons)[0]


@lru_cache(maxsize=16)
def _transition(vehicle: Vehicle, n: int, dt: float) -> ca.Function:
    """State -> Jacobian, transposed: the memory of a row-major array."""
    x = symbol("x", n)
    F = ca.densify(ca.jacobian(vehicle.step(x, ca.SX.zeros(2), dt), x))
    return ca.Function("F", [x], [F.T])


@lru_cache(maxsize=16)
def _prediction(estimator: Estimator, process: Process) -> ca.Function:
    """Mean -> Jacobian of the next, transposed."""
    n = len(process.noise)
    x, P = symbol("x", n), symbol("P", n, n)
    after, _ = estimator.predict(x, P, ca.SX.zeros(2), process)
    F = ca.densify(ca.jacobian(after, x))
    return ca.Function("F", [x, P], [F.T])


@lru_cache(maxsize=16)
def _information(sensor: Sensor, n: int) -> ca.Function:
    """State, beacon -> information."""
    x, beacon = symbol("x", n), symbol("beacon", len(BEACON))
    sigma = ca.SX(sensor.deviation(x, beacon))
    h, s = ca.jacobian(sensor.measure(x, beacon), x), ca.jacobian(sigma, x)
    J = (h.T @ h + 2 * s.T @ s) / sigma**2
    return ca.Function("J", [x, beacon], [ca.densify(J)])
