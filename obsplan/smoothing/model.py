"""All AUVs of a tape as one state: how it moves from sample to sample, as CasADi expressions."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.casadi import symbol
from obsplan.smoothing.constants import CURRENT, Constants
from obsplan.vehicles import Vehicle

CONTROLS = 3  # turn [rad], change of speed [m/s], sway [m]


@dataclass(frozen=True, kw_only=True)
class Model:
    """The states of all AUVs, one after the other, then the hidden constants."""

    vehicles: tuple[Vehicle, ...]
    constants: Constants

    @property
    def own(self) -> int:
        """Number of components of one AUV's state."""
        return len(self.vehicles[0].states)

    @property
    def of_auvs(self) -> int:
        """Number of components of all AUVs' states."""
        return self.own * len(self.vehicles)

    @property
    def size(self) -> int:
        """Number of components in all."""
        return self.of_auvs + len(self.constants)

    def of(self, auv: int) -> slice:
        """Where an AUV's state is."""
        return slice(auv * self.own, (auv + 1) * self.own)

    def step(self, x: ca.SX, u: ca.SX, dt: ca.SX) -> ca.SX:
        """State a sample later; u holds the three controls of each AUV in turn."""
        hidden, currents = x[self.of_auvs :], self.constants.at(CURRENT)
        moved: list[ca.SX] = []
        for i, vehicle in enumerate(self.vehicles):
            control = u[i * CONTROLS : (i + 1) * CONTROLS]
            after = vehicle.step(x[self.of(i)], control, dt)
            if currents:
                drift = ca.vertcat(*(hidden[c] for c in currents)) * dt
                after = ca.vertcat(after[:2] + drift, after[2:])
            moved.append(after)
        return ca.vertcat(*moved, hidden)

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """A state, controls and a duration."""
        return symbol("x", self.size), symbol("u", CONTROLS * len(self.vehicles)), symbol("dt")


def joined(
    states: Float[np.ndarray, "auvs samples n"], constants: Float[np.ndarray, " constants"]
) -> Float[np.ndarray, "samples all"]:
    """States of AUVs beside each other, then the constants."""
    auvs, samples, n = states.shape
    beside = states.swapaxes(0, 1).reshape(samples, auvs * n)
    return np.hstack([beside, np.tile(constants, (samples, 1))])


def apart(
    x: Float[np.ndarray, "samples all"], auvs: int, n: int
) -> Float[np.ndarray, "auvs samples n"]:
    """States of each AUV from `joined` ones."""
    return x[:, : auvs * n].reshape(len(x), auvs, n).swapaxes(0, 1)
