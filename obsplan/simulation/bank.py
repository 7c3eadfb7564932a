"""The AUVs' hypotheses in a flight: tidied after ranges, and fewer where fewer are left."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Integer

from formulations.model.covariance import motions, predicted
from obsplan.estimators.hypotheses import places, room_for, tidied
from obsplan.scenario import Scenario
from obsplan.scenario.states import BASIC
from obsplan.simulation.step import Carry, Inputs, Log
from obsplan.types import Hypothesis


@dataclass(kw_only=True)
class Bank:
    """How many hypotheses there is room for, and how many positions fitted at each sample."""

    scenario: Scenario
    room: int = field(init=False)
    fitting: Float[np.ndarray, "auvs samples"] = field(init=False)
    living: Integer[np.ndarray, " auvs"] = field(init=False)
    # of each AUV, by the sample of a range, where there are several: what a report then says
    several: list[dict[int, list[Hypothesis]]] = field(init=False)

    def __post_init__(self) -> None:
        auvs = len(self.scenario.table.auv)
        self.room = self.scenario.hypotheses
        self.living = np.full(auvs, self.room)
        self.fitting = np.ones((auvs, self.scenario.time.size))
        self.several = [{} for _ in range(auvs)]

    def until(self, inputs: Inputs, k: int, n: int) -> int:
        """How many of the next n steps, from step k on, can be taken before it is tidied."""
        if self.room == 1:
            return n
        ranged = np.flatnonzero(inputs.ping[k : k + n].any(axis=(1, 2)))
        return int(ranged[0]) + 1 if ranged.size else n

    def tidy(self, carry: Carry, log: Log, k: int) -> None:
        """After the step before sample k: drop and merge hypotheses, and count them.

        Only those of AUVs to whom a range came: where none did nothing is known anew.
        """
        if self.room == 1:
            return
        states = carry.mean.shape[-1]
        size = self.scenario.filtering(self.room).rows
        banks = carry.bank[0][:, :size]
        came = np.isfinite(log.range[k - 1]).any(axis=1)
        for i in np.flatnonzero(came):
            if banks[i, 0]:  # no range yet
                continue
            banks[i], known = tidied(banks[i], states)
            self.living[i] = len(known)
            self.fitting[i, k:] = places(known)
            if len(known) > 1:
                self.several[i][k] = known
        self.room = room_for(int(self.living.max()), self.room)

    def reported(self, carry: Carry, log: Log, k: int) -> list[tuple[Hypothesis, ...]]:
        """Hypotheses of each AUV as last reported before sample k, as planners are told."""
        return [self._reported(carry, log, k, i) for i in range(len(self.several))]

    def _reported(self, carry: Carry, log: Log, k: int, i: int) -> tuple[Hypothesis, ...]:
        """Hypotheses of AUV i as last reported before sample k, and dead-reckoned since.

        There are none where one position was left. Their means have moved since as that of all
        together has been reckoned.
        """
        if not self.several[i]:
            return ()
        heard = np.flatnonzero(log.report[: max(k - self.scenario.late, 0), i, 0])
        made = int(heard[-1]) + 1 if heard.size else 0
        known = self.several[i].get(made, ())
        self.several[i] = {at: one for at, one in self.several[i].items() if at >= made}
        if not known:
            return ()
        moved = carry.reported[0, i, :BASIC] - carry.mean[made, i, :BASIC]
        before = np.array([one.mean[:BASIC] for one in known])
        P = np.array([one.covariance[:BASIC, :BASIC] for one in known])
        noise = self.scenario.process_noise(assumed=True)[i]
        since = (k - made) * self.scenario.table.time_step
        now = predicted(P, motions(before[:, 2], before[:, 3]), noise, since)
        shares = [one.share for one in known]
        return tuple(Hypothesis(*one) for one in zip(shares, before + moved, now, strict=True))
