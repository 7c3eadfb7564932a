"""Parallel legs, there and back: the usual survey of an area."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float

from obsplan.quantities import LEGS, LENGTH, POSITION, check_quantities
from obsplan.surveys.reference import Reference


@dataclass(frozen=True, slots=True, kw_only=True)
class Lawnmower:
    """Parallel legs joined at right angles, each run against the one before it.

    Raises
    ------
    ValueError
        legs, length or spacing not positive, or a number that is not finite.
    """

    legs: Annotated[int, "number of parallel legs", LEGS]
    length: Annotated[float, "length of each leg [m]", LENGTH]
    spacing: Annotated[float, "distance between neighbouring legs [m]", LENGTH]
    heading: Annotated[float, "heading of the first leg [rad], counter-clockwise from east"] = 0.0
    x: Annotated[float, "start of the first leg, east [m]", POSITION] = 0.0
    y: Annotated[float, "start of the first leg, north [m]", POSITION] = 0.0
    side: Annotated[
        Literal["left", "right"], "side of the first leg on which the others are laid"
    ] = "left"

    def __post_init__(self):
        check_quantities(self)
        if not math.isfinite(self.heading):
            raise ValueError(f"heading must be finite [rad], got {self.heading}")

    def vertices(self) -> Float[np.ndarray, "n 2"]:
        """Both ends of every leg, in the order they are passed, east and north [m]."""
        leg, vertex = np.divmod(np.arange(2 * self.legs), 2)
        along = self.length * ((leg + vertex) % 2)  # even legs run out, odd legs come back
        across = self.spacing * leg * {"left": 1, "right": -1}[self.side]
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return np.column_stack(
            [self.x + cos * along - sin * across, self.y + sin * along + cos * across]
        )

    def reference(self, *, speed: float | None, current: Float[np.ndarray, " 2"]) -> Reference:
        """Motion along the legs at a speed through the water [m/s] in a current [m/s]."""
        return Reference(polyline=self.vertices(), speed=speed, current=current)
