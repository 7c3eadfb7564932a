"""A user's classes tried once, when the scenario is read, before anything runs."""

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

from formulations.model.casadi import symbol
from obsplan.estimators import Estimator, Process
from obsplan.sensors import BEACON, Sensor
from obsplan.vehicles import Vehicle, check_states


def try_vehicle(vehicle: Vehicle) -> None:
    """Raise ValueError unless the states are named and one step returns as many."""
    _frozen(vehicle)
    _called("states", lambda: check_states(vehicle.states))
    x, u = symbol("x", len(vehicle.states)), symbol("u", 2)
    _shaped("step", lambda: [vehicle.step(x, u, 0.1)], [x.shape])


def try_sensor(sensor: Sensor, n: int) -> None:
    """Raise ValueError unless measurement and deviation are scalars of a state of n components."""
    _frozen(sensor)
    x, beacon = symbol("x", n), symbol("beacon", len(BEACON))
    _shaped("measure", lambda: [sensor.measure(x, beacon)], [(1, 1)])
    _shaped("deviation", lambda: [sensor.deviation(x, beacon)], [(1, 1)])
    if not (isinstance(sensor.sigma, int | float) and 0 < sensor.sigma < float("inf")):
        raise ValueError(f"sigma must be positive and finite, got {sensor.sigma}")


def try_estimator(estimator: Estimator, vehicle: Vehicle, sensor: Sensor) -> None:
    """Raise ValueError unless what the filter returns is of the shapes its states ask for."""
    _frozen(estimator)
    _called("states", lambda: check_states(estimator.states(vehicle)))
    n = len(estimator.states(vehicle))
    x, P, u = symbol("x", n), symbol("P", n, n), symbol("u", 2)
    process = Process(model=vehicle, noise=(1.0,) * n, dt=0.1)
    whole = [x.shape, P.shape]
    _shaped("predict", lambda: estimator.predict(x, P, u, process), whole)
    z, beacon = symbol("z"), symbol("beacon", len(BEACON))
    scalars = [(1, 1), (1, 1), (1, n)]
    _shaped("innovation", lambda: estimator.innovation(x, P, z, sensor, beacon), scalars)
    _shaped("update", lambda: estimator.update(x, P, z, sensor, beacon), whole)


def _frozen(built: object) -> None:
    """Raise ValueError unless what is compiled of an object can be kept under it."""
    if type(built).__hash__ is None:
        raise ValueError("can change while it is used; write @dataclass(frozen=True) above it")


def _shaped(
    method: str, call: Callable[[], Sequence[Any]], shapes: Sequence[tuple[int, int]]
) -> None:
    """Raise ValueError unless a method returns expressions of these shapes."""
    found = _called(method, lambda: [ca.SX(result).shape for result in call()])
    if found != [*shapes]:
        raise ValueError(
            f"{method} must return {_said(shapes)}, got {_said(found)}; correct the class"
        )


def _called(method: str, call: Callable[[], Any]) -> Any:
    try:
        return call()
    except Exception as error:  # whatever a user's class raises
        said = f"{type(error).__name__}: {error}"
        raise ValueError(f"{method} fails: {' '.join(said.split())}; correct the class") from error


def _said(shapes: Sequence[tuple[int, int]]) -> str:
    return " and ".join(f"{rows} x {columns}" for rows, columns in shapes)
