"""How far an AUV's position is doubted: as far as its ranges differ from what its filter expects.

A filter that is wrong about ranges, currents or compass is sure of itself all the same. Its squared
innovations then exceed their variance. The mean excess over the last ranges, a variance [m^2] along
lines of sight, is reported with the estimate, and its root is `Belief.doubt`.
"""

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.casadi import SX
from obsplan.estimators import Estimator
from obsplan.sensors import Sensor

NEWEST = 0.25  # weight of the newest range in the running mean, which so remembers some four


def unexplained(estimator: Estimator, x: SX, P: SX, z: SX, sensor: Sensor, beacon: SX) -> SX:
    """By how much a squared innovation exceeds what the filter expects [m^2]; 0 in the mean.

    It is the innovation that the filter neglects, as in covariance matching (Mehra 1972), in metres
    along the line of sight.
    """
    innovation, expected, H = estimator.innovation(x, P, z, sensor, beacon)
    # a squared range's unit per metre; a slant range from above tells of no place: at least 1
    per_square_metre = ca.fmax(1.0, ca.sumsqr(H[:2]))
    return (innovation**2 - expected) / per_square_metre


def doubts(excess: Float[np.ndarray, "auvs some"]) -> Float[np.ndarray, " auvs"]:
    """Doubts [m] of positions, by what AUVs reported; 0 where nothing is doubted."""
    return np.sqrt(np.maximum(excess, 0.0)).sum(axis=1)
