"""AUVs as seen from the water that carries the aid vehicle, where it moves on its arcs.

Only the difference of the two vehicles' currents counts (thesis 3.7, 3.8), so a planner that is
told the AUVs so plans in a current as it does in still water.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from obsplan.types import Belief

Route = Callable[[np.ndarray], np.ndarray]


def in_the_water(auvs: Sequence[Belief], current: tuple[float, float]) -> list[Belief]:
    """What is known of AUVs, in water that moves with a current [m/s] and is here now.

    Their positions now are those over ground; their currents and routes are relative to it.
    """
    if not any(current):
        return [*auvs]
    east, north = current
    return [
        replace(
            auv,
            current=(auv.current[0] - east, auv.current[1] - north),
            route=None if auv.route is None else _relative(auv.route, current),
            checked=False,
        )
        for auv in auvs
    ]


def _relative(route: Route, current: tuple[float, float]) -> Route:
    """A route over ground as one in the water."""

    def ahead(times: Float[np.ndarray, " steps"]) -> Float[np.ndarray, "steps 2"]:
        return route(times) - np.asarray(times)[:, None] * np.array(current)

    return ahead
