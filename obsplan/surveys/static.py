"""An AUV that stays where it is."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from obsplan.quantities import POSITION, check_quantities
from obsplan.surveys.reference import Reference


@dataclass(frozen=True, slots=True, kw_only=True)
class Static:
    """Station kept at one point; in a current, by heading into it.

    Raises
    ------
    ValueError
        A number that is not finite.
    """

    x: Annotated[float, "east [m]", POSITION] = 0.0
    y: Annotated[float, "north [m]", POSITION] = 0.0
    heading: Annotated[
        float, "heading while there is no current [rad], counter-clockwise from east"
    ] = 0.0

    def __post_init__(self):
        check_quantities(self)
        if not math.isfinite(self.heading):
            raise ValueError(f"heading must be finite [rad], got {self.heading}")

    def vertices(self) -> Float[np.ndarray, "n 2"]:
        """The one point, east and north [m]."""
        return np.array([[self.x, self.y]], dtype=float)

    def reference(self, *, speed: float | None, current: Float[np.ndarray, " 2"]) -> Reference:
        """Station kept in a current [m/s].

        The speed through the water is the current's, whatever speed is given [m/s].
        """
        return Reference(
            polyline=self.vertices(),
            speed=speed,
            current=current,
            initial_heading=float(self.heading),
        )
