"""An AUV that keeps its place beside another one."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from obsplan.quantities import POSITION, check_quantities
from obsplan.surveys.reference import Reference


@dataclass(frozen=True, slots=True, kw_only=True)
class Formation:
    """Track of a leader, shifted by a constant offset: same velocity at every instant.

    Raises
    ------
    ValueError
        No leader named, or an offset that is not finite.
    """

    leader: Annotated[str, "name of the AUV to stay beside"]
    east: Annotated[float, "offset from the leader, east [m]", POSITION] = 0.0
    north: Annotated[float, "offset from the leader, north [m]", POSITION] = 0.0

    def __post_init__(self):
        if not self.leader:
            raise ValueError("leader is empty: give the name of the AUV to stay beside")
        check_quantities(self)

    def follow(
        self, leader: Reference, current: Float[np.ndarray, " 2"] | None = None
    ) -> Reference:
        """Motion beside the leader's, at its speeds over ground and holds.

        In a ``current`` [m/s] of its own, by default the leader's.
        """
        polyline = leader.polyline + np.array([self.east, self.north])
        return replace(leader, polyline=polyline, own_current=current)
