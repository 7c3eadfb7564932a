"""The survey vehicle, as it and its filter see it: dead reckoning between ranges."""

from dataclasses import dataclass

import casadi as ca

from obsplan.vehicles.state import STATES, States

TURN_AND_SPEED = 2  # what a control without sway is


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadReckoning:
    """AUV that holds heading and speed through the water over a sample (thesis 5.3).

    A uniform current carries it. State x = (east [m], north [m], heading [rad], speed through the
    water [m/s]); control u = (turn [rad], change of speed [m/s]), the increments at the end of the
    sample, which the vehicle measures, and, from a recording, how far it moved to its left over the
    sample [m]. Holding the heading (instead of the arc) lets a sampled vehicle follow a polyline
    exactly.
    """

    current: tuple[float, float] = (0.0, 0.0)  # east, north [m/s]

    @property
    def states(self) -> States:
        """East, north, heading and speed."""
        return STATES

    def step(self, x: ca.SX, u: ca.SX, dt: ca.SX | float) -> ca.SX:
        """State after dt seconds, as a CasADi expression."""
        east, north, heading, speed = ca.vertsplit(x)
        cos, sin = ca.cos(heading), ca.sin(heading)
        east += (speed * cos + self.current[0]) * dt
        north += (speed * sin + self.current[1]) * dt
        if u.numel() > TURN_AND_SPEED:
            east -= u[2] * sin
            north += u[2] * cos
        return ca.vertcat(east, north, heading + u[0], speed + u[1])
