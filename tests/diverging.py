"""A filter that loses itself, for missions that fail."""

from dataclasses import dataclass
from typing import Annotated

import obsplan as op


@dataclass(frozen=True, kw_only=True)
class Diverging(op.Ekf):
    """EKF whose estimate runs away by what no number can square."""

    drift: Annotated[float, "of each state in a step"] = 0.0

    def step(self, x, u, process):
        return super().step(x, u, process) + self.drift
