r"""What is still to come where a sequence of turns ends: the cost of being far from the AUVs.

Within a horizon a vehicle that is far away gains little by coming nearer, for bearings turn only
slowly: by a quarter in :math:`(\pi / 2) \, d / V` at a distance d and a speed V. Who looks no
farther stays far away. Coming back takes d / V. Meanwhile the AUV's position is known worse than
now, by a share β of its covariance P, and the criterion J is a mean over the horizon T. So

.. math:: \frac{d / V}{T} \, β \left. \frac{\partial J(s P)}{\partial s} \right|_{s = 1}
          = β \, \frac{d}{V T} \cdot
          \begin{cases} \operatorname{tr} P & \text{trace} \\ n & \text{log det of } n \times n
          \end{cases}

is to come. β has no unit; its value is from experiments (docs/information.md). Of the distance
only what is beyond `near_enough` counts.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.covariance import DEPTH
from ..model.ranging import Ranging

# β: the share of its covariance by which an AUV is known worse while the vehicle comes back
WORSE = 0.1
# standard deviations of a range; its value is from experiments, too
ERRORS = 20.0


class ToGo(NamedTuple):
    """What is to come by the distance from each AUV: so much a metre, beyond a distance."""

    per_metre: Float[np.ndarray, " M"] | float = 0.0  # in the criterion's unit [m^2/m or 1/m]
    near: float = 0.0  # [m]


NOTHING = ToGo()


def cost_to_go(
    covariance: Float[np.ndarray, "M n n"],
    *,
    ranging: Ranging,
    speed: float,
    horizon: float,
    criterion: str,
) -> ToGo:
    """What each metre between the aid vehicle and an AUV costs beyond the horizon.

    Where errors grow with the distance, what ranges tell keeps the vehicle where they tell most:
    there is nothing to add.

    Parameters
    ----------
    covariance
        Of each AUV's state now (`formulations.model.covariance`).
    ranging
        How ranges err.
    speed, horizon
        Of the aid vehicle [m/s]; over which the criterion is averaged [s].
    criterion
        ``trace`` [m^2] or ``log-det`` [-] of the position covariance, the depth's with it where it
        is a state.
    """
    if ranging.growth > 0:
        return NOTHING
    position = [0, 1, *range(DEPTH, covariance.shape[-1])]
    if criterion == "trace":
        grows = covariance[:, position, position].sum(axis=-1)
    else:
        grows = np.full(len(covariance), float(len(position)))
    return ToGo(WORSE * grows / (speed * horizon), near_enough(ranging))


def near_enough(ranging: Ranging) -> float:
    """How near [m] an AUV the aid vehicle need not come nearer.

    There a range's error is a twentieth of the distance. Nearer, the filter's linearisation, of
    which covariances know nothing, costs more than faster bearings gain.
    """
    if ranging.squared:  # an error of s in the square is one of s / (2 d) in the range
        return math.sqrt(ERRORS * ranging.sigma / 2)
    return ERRORS * ranging.sigma
