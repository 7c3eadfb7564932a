"""The world as the aid vehicle sees it: ahead and abeam, in a unit of length, or mirrored."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float


def to_body(cosine: Any, sine: Any, east: Any, north: Any) -> tuple[Any, Any]:
    """Components ahead and to the left of a heading with that cosine and sine.

    Of numbers, arrays or expressions.
    """
    return cosine * east + sine * north, cosine * north - sine * east


def turn_matrix(heading: float) -> Float[np.ndarray, "2 2"]:
    """Rows: the directions ahead and to the left of a heading [rad]."""
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, s], [-s, c]])


class Frame(NamedTuple):
    """A frame whose first axis is a heading and whose second axis is to the left of it.

    Where it is mirrored, the second axis is to the right.
    """

    origin: Float[np.ndarray, "2"]  # [m]
    heading: float  # [rad]
    length: float = 1.0  # unit of length [m]
    mirror: float = 1.0  # -1 where the second axis is to the right

    @property
    def axes(self) -> Float[np.ndarray, "2 2"]:
        """Its axes in the world, as rows."""
        return turn_matrix(self.heading) * np.array([[1.0], [self.mirror]])

    def directions(self, vectors: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Directions of the world in this frame; lengths stay."""
        return vectors @ self.axes.T

    def positions(self, points: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Positions of the world in this frame."""
        return self.directions(points - self.origin) / self.length

    def world(self, points: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Positions in this frame in the world."""
        return self.origin + self.length * points @ self.axes

    def covariances(self, P: Float[np.ndarray, "M 4 4"], time: float = 1.0) -> np.ndarray:
        """Covariances of (east, north, heading, speed) in this frame.

        ``time`` is its unit of time [s].
        """
        T = np.diag([1.0, 1.0, self.mirror, time / self.length])
        T[:2, :2] = self.axes / self.length
        return T @ P @ T.T
