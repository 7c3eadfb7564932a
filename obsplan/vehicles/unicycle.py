"""The aid vehicle: a planar unicycle on exact arcs."""

from dataclasses import dataclass

import casadi as ca

from formulations.model.arcs import arc


@dataclass(frozen=True, slots=True, kw_only=True)
class Unicycle:
    """Planar vehicle at constant speed, steered by its turn rate; exact arcs (thesis 3.1, 4.1).

    State x = (east [m], north [m], heading [rad], counter-clockwise from east); control
    u = (turn rate [rad/s], speed [m/s]).
    """

    speed: float  # [m/s]
    min_turn_radius: float  # [m]

    def __post_init__(self) -> None:
        for name, unit in (("speed", "m/s"), ("min_turn_radius", "m")):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise ValueError(f"{name} must be positive and finite [{unit}], got {value}")

    @property
    def max_turn_rate(self) -> float:
        """Largest turn rate [rad/s]."""
        return self.speed / self.min_turn_radius

    @staticmethod
    def step(x: ca.SX, u: ca.SX, dt: ca.SX | float) -> ca.SX:
        """State after dt seconds at a constant turn rate and speed, as a CasADi expression."""
        return arc(x, u[0], u[1], dt)
