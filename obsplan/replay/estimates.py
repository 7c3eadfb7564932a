"""What filters make of a tape, at every time at which anything was measured."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Integer


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimates:
    """Estimates at the times of a tape, and what became of its measurements, in its order."""

    time: Float[np.ndarray, " samples"]  # of the tape [s]
    mean: Float[np.ndarray, "auvs samples m"]
    covariance: Float[np.ndarray, "auvs samples m m"]
    fate: Integer[np.ndarray, " n"]  # codes of `Fate`
    # measured less expected, and its variance; nan of what no filter looked at
    innovation: Float[np.ndarray, " n"]
    innovation_variance: Float[np.ndarray, " n"]
    hypotheses: Float[np.ndarray, "auvs samples"]  # how many positions fit
