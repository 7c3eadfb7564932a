r"""What can be seen of a box from a place, and the most that a range along it tells.

A range tells w u uᵀ, u its line of sight. With θ the direction of u,

.. math:: u u^\top = \tfrac{1}{2} \begin{pmatrix} 1 + \cos 2θ & \sin 2θ \\
          \sin 2θ & 1 - \cos 2θ \end{pmatrix},

so that lines are points on a circle, by the doubled angle φ = 2θ, and a scalar product with a
matrix is a cosine on it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .model.ranging import Ranging
from .model.worth import least_sigma


class Boxes(NamedTuple):
    """Rectangles of the plane, edges to the east and north."""

    low: Float[np.ndarray, "*batch 2"]  # [m]
    high: Float[np.ndarray, "*batch 2"]  # [m]


class Sight(NamedTuple):
    """Lines of sight, and the information that a range along each of them can carry."""

    middle: Float[np.ndarray, "*batch"]  # doubled angle [rad]
    half: Float[np.ndarray, "*batch"]  # of the doubled angles to either side [rad]; pi: all
    most: Float[np.ndarray, "*batch"]  # [1/m^2]


def sight_of(
    place: Float[np.ndarray, "*#batch 2"],
    boxes: Boxes,
    ranging: Ranging,
    height: float | Float[np.ndarray, "*#batch"] = 0.0,
) -> Sight:
    """Lines of sight from places [m] to all points of boxes, and the most a range there tells.

    ``height`` is that between both transducers [m]. From inside a box or its edge all lines are
    seen.
    """
    low, high = boxes.low - place, boxes.high - place
    outside = np.any((low > 0) | (high < 0), axis=-1)
    center = (low + high) / 2
    toward = np.arctan2(center[..., 1], center[..., 0])
    half = np.zeros(outside.shape)
    middle = np.zeros(outside.shape)
    first, last = np.full(outside.shape, np.inf), np.full(outside.shape, -np.inf)
    for east in (low[..., 0], high[..., 0]):
        for north in (low[..., 1], high[..., 1]):
            turn = wrapped(np.arctan2(north, east) - toward)
            first, last = np.minimum(first, turn), np.maximum(last, turn)
    middle = np.where(outside, 2 * toward + first + last, 0.0)
    half = np.where(outside, np.minimum(last - first, np.pi), np.pi)
    nearest, farthest = distances(place, boxes)
    sigma = least_sigma(ranging, nearest, farthest, height)
    return Sight(middle, half, np.broadcast_to(1 / sigma**2, outside.shape))


def distances(
    place: Float[np.ndarray, "*#batch 2"], boxes: Boxes
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """Least and greatest distance [m] of a place from the points of boxes."""
    low, high = boxes.low - place, boxes.high - place
    near = np.maximum(np.maximum(low, -high), 0.0)
    far = np.maximum(-low, high)
    return np.hypot(near[..., 0], near[..., 1]), np.hypot(far[..., 0], far[..., 1])


def gap(one: Boxes, other: Boxes) -> Float[np.ndarray, "*batch 2"]:
    """How far boxes are apart to the east and north [m], 0 where they overlap."""
    return np.maximum(np.maximum(one.low - other.high, other.low - one.high), 0.0)


def cheapest(
    cost: Float[np.ndarray, "*#batch 2 2"], sight: Sight
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    r"""Least of :math:`w \, u^\top G u` over a sight, and the doubled angle of its u.

    G is negative semidefinite, as that of a cost that information lowers; then the greatest w is
    best.
    """
    half = (cost[..., 0, 0] - cost[..., 1, 1]) / 2
    across = (cost[..., 0, 1] + cost[..., 1, 0]) / 2
    trace = cost[..., 0, 0] + cost[..., 1, 1]
    size = np.hypot(half, across)
    away = wrapped(np.arctan2(-across, -half) - sight.middle)
    beside = np.clip(away, -sight.half, sight.half)
    least = sight.most * (trace / 2 - size * np.cos(away - beside))
    return least, sight.middle + beside


def along(
    most: Float[np.ndarray, "*#batch"], doubled: Float[np.ndarray, "*#batch"]
) -> Float[np.ndarray, "*batch 2 2"]:
    """Information w u uᵀ of ranges along doubled angles."""
    cos, sin = np.cos(doubled), np.sin(doubled)
    unit = np.stack([1 + cos, sin, sin, 1 - cos], axis=-1) / 2
    told = most[..., None] * unit
    return told.reshape(*told.shape[:-1], 2, 2)


def wrapped(angle: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Angle [rad] from -pi to pi."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))
