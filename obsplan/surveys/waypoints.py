"""A survey given point by point."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from obsplan.quantities import AUV_SPEED, HOLD
from obsplan.surveys.reference import Reference, check_holds, check_polyline, check_speeds
from obsplan.types import Points, as_points


@dataclass(frozen=True, slots=True, kw_only=True)
class Waypoints:
    """Straight legs from point to point.

    Raises
    ------
    ValueError
        Fewer than two points, one that is not two finite numbers, two identical consecutive
        points, or speeds or holds out of their bounds.
    """

    points: Annotated[Points, "points to pass, in order, each [east, north] [m]"]
    speeds: Annotated[
        tuple[Annotated[float, AUV_SPEED], ...] | None,
        (
            "speed through the water on each leg [m/s]; default: the AUV's, which holds on every "
            "leg where it is given"
        ),
    ] = None
    holds: Annotated[
        tuple[Annotated[float, HOLD], ...] | None,
        "time to keep station at each point [s]; default: none",
    ] = None

    def __post_init__(self):
        object.__setattr__(self, "points", as_points(self.points))
        if len(self.points) < 2:
            got = "none" if len(self.points) == 0 else f"only {list(self.points)}"
            raise ValueError(
                f"a survey of waypoints needs at least two points, got {got}: "
                'add one, or use kind "static" to stay at a point'
            )
        check_polyline(self.vertices())
        if self.speeds is not None:
            check_speeds(self.speeds, len(self.points) - 1)
        if self.holds is not None:
            check_holds(self.holds, len(self.points))

    def vertices(self) -> Float[np.ndarray, "n 2"]:
        """The points, east and north [m]."""
        return np.array(self.points, dtype=float)

    def reference(self, *, speed: float | None, current: Float[np.ndarray, " 2"]) -> Reference:
        """Motion from point to point in a current [m/s], at a speed through the water [m/s].

        Without a speed it moves at `speeds`.
        """
        own = None if self.speeds is None else np.array(self.speeds, dtype=float)
        return Reference(
            polyline=self.vertices(),
            speed=own if speed is None else speed,
            hold=None if self.holds is None else np.array(self.holds, dtype=float),
            current=current,
        )
