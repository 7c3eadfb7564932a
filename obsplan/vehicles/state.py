"""States of an AUV: named components with units."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

import casadi as ca


class State(NamedTuple):
    """One component of a state, and what a component of one's own begins with.

    Of the four in `STATES` the scenario says the rest: their true values the survey, ``sigma`` the
    first estimate, ``walk`` the process noise.
    """

    unit: str  # as udunits writes it: "m s-1"
    start: float = 0.0  # value at time 0; where only the filter has the state, its first mean
    sigma: float = 0.0  # standard deviation of the filter's first estimate
    walk: float = 0.0  # of its random walk, per square root of a second
    walk_per_meter: float = 0.0  # besides, per square root of a metre travelled


States = Mapping[str, State]

# what every AUV's state begins with: what surveys prescribe, planners are told and sensors measure
STATES: dict[str, State] = {
    "east": State("m"),
    "north": State("m"),
    "heading": State("rad"),  # counter-clockwise from east
    "speed": State("m s-1"),  # through the water
}


@runtime_checkable
class Vehicle(Protocol):
    """Motion of an AUV; a dataclass whose fields are the keys of its table.

    A field ``current``, east and north [m/s], is no key: the scenario fills it.
    """

    @property
    def states(self) -> States:
        """Components of the state by name: `STATES`, then its own."""
        ...

    def step(self, x: ca.SX, u: ca.SX, dt: float | ca.SX) -> ca.SX:
        """State after dt seconds; u = (turn [rad], change of speed [m/s]) at the sample's end."""
        ...


def check_states(states: States) -> None:
    """Refuse a state that does not begin as every AUV's.

    Raises
    ------
    ValueError
        One sentence with what is there.
    """
    first = [*states][: len(STATES)]
    if first != [*STATES]:
        raise ValueError(
            f"states must begin with {', '.join(STATES)}, got {', '.join(first) or 'none'}"
        )
    for name, state in states.items():
        if not name.isidentifier():
            raise ValueError(f'states are named like variables, got "{name}"')
        if not (0 <= state.sigma < float("inf") and 0 <= state.walk < float("inf")):
            raise ValueError(
                f"sigma and walk of {name} must be at least 0 and finite [{state.unit}], "
                f"got {state.sigma} and {state.walk}"
            )
        if not abs(state.start) < float("inf"):
            raise ValueError(f"start of {name} must be finite [{state.unit}], got {state.start}")
