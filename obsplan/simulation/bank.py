"""The AUVs' hypotheses in a flight: tidied after ranges, and fewer where fewer are left."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Integer

from obsplan.estimators.hypotheses import places, room_for, tidied
from obsplan.scenario import Scenario
from obsplan.simulation.step import Carry, Inputs


@dataclass(kw_only=True)
class Bank:
    """How many hypotheses there is room for, and how many positions fitted at each sample."""

    scenario: Scenario
    room: int = field(init=False)
    fitting: Float[np.ndarray, "auvs samples"] = field(init=False)
    living: Integer[np.ndarray, " auvs"] = field(init=False)

    def __post_init__(self) -> None:
        self.room = self.scenario.hypotheses
        self.living = np.full(len(self.scenario.table.auv), self.room)
        self.fitting = np.ones((len(self.scenario.table.auv), self.scenario.time.size))

    def until(self, inputs: Inputs, k: int, n: int) -> int:
        """How many of the next n steps, from step k on, can be taken before it is tidied."""
        if self.room == 1:
            return n
        ranged = np.flatnonzero(inputs.ping[k : k + n].any(axis=(1, 2)))
        return int(ranged[0]) + 1 if ranged.size else n

    def tidy(self, carry: Carry, k: int, came: Bool[np.ndarray, "auvs beacons"]) -> None:
        """After the step before sample k: drop and merge hypotheses, and count them.

        Only those of AUVs to whom a range came: where none did nothing is known anew.
        """
        if self.room == 1:
            return
        states = carry.mean.shape[-1]
        size = self.scenario.filtering(self.room).rows
        banks = carry.bank[0][:, :size]
        for i in np.flatnonzero(came.any(axis=1)):
            if banks[i, 0]:  # no range yet
                continue
            banks[i], known = tidied(banks[i], states)
            self.living[i] = len(known)
            self.fitting[i, k:] = places(known)
        self.room = room_for(int(self.living.max()), self.room)
