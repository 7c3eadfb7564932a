"""A survey given point by point."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from obsplan.surveys.reference import Reference, check_polyline
from obsplan.types import Points, as_points


@dataclass(frozen=True, slots=True, kw_only=True)
class Waypoints:
    """Straight legs from point to point.

    Raises
    ------
    ValueError
        Fewer than two points, one that is not two finite numbers, or two identical consecutive points.
    """

    points: Annotated[Points, "points to pass, in order, each [east, north] [m]"]

    def __post_init__(self):
        object.__setattr__(self, "points", as_points(self.points))
        if len(self.points) < 2:
            got = "none" if len(self.points) == 0 else f"only {list(self.points)}"
            raise ValueError(
                f'a survey of waypoints needs at least two points, got {got}: add one, or use kind "static" to stay at a point'
            )
        check_polyline(self.vertices())

    def vertices(self) -> Float[np.ndarray, "n 2"]:
        """The points, east and north [m]."""
        return np.array(self.points, dtype=float)

    def reference(self, *, speed: float, current: Float[np.ndarray, " 2"]) -> Reference:
        """Motion from point to point at a speed through the water [m/s] in a current [m/s]."""
        return Reference(polyline=self.vertices(), speed=speed, current=current)
