r"""One stage of the program as CasADi expressions: exact arcs, the objective's states, and the limits.

States are the pose, the turn rate held before where its change is limited, and what the objective accumulates:

- AUVs at rest: the moments ∫(p, p pᵀ) of the aid vehicle's own position, which every AUV's Gramian is a polynomial of;
- AUVs that move: ∫ p pᵀ of the position relative to each;
- ``covariance``: the packed lower triangle of each AUV's 4 x 4 covariance.

Controls are the turn rate, the speed where it is free, and the slack by which the limits are softened. Parameters are named blocks: of the
whole task (``g``) and of each stage (``s``).
"""

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..metrics import EPS
from ..model.arcs import arc
from ..model.casadi import SX, symbol
from ..model.covariance import condition_on_range, pack, predict, unpack
from ..model.quadrature import MIDDLE

EIGENVALUE_GAP = 1e-3  # relative; rounds off the smallest eigenvalue where both are equal
PACKED = 10  # entries of a packed covariance


class Shape(NamedTuple):
    """What a compiled program depends on; numbers of things."""

    objective: str
    stages: int
    auvs: int  # in the objective
    moving: bool
    squared: bool  # ranges
    neighbours: int  # AUVs to keep a distance from
    least: bool
    greatest: bool
    discs: int
    keep_outs: tuple[int, ...]  # edges of each
    fence: int  # edges
    slew: bool
    free_speed: bool

    @property
    def limited(self) -> bool:
        """Whether there are limits that can be softened."""
        return bool(self.neighbours or self.discs or self.keep_outs or self.fence)

    @property
    def accumulated(self) -> int:
        """Number of the objective's states."""
        if self.objective == "covariance":
            return PACKED * self.auvs
        return 3 * self.auvs if self.moving else 5


def task_blocks(shape: Shape) -> dict[str, tuple[int, int]]:
    """Parameters of the whole task."""
    covariance = shape.objective == "covariance"
    return {
        "weight": (1, shape.auvs),
        "start": (shape.accumulated, 1),
        "last_rate": (1, int(shape.slew)),
        "radius": (1, 1),  # smallest, of a turn
        "slack_weight": (1, int(shape.limited)),
        "noise": (4, shape.auvs if covariance else 0),  # standard deviations
        "sigma": (1, int(covariance)),  # of a range
        "unit": (1, int(covariance)),  # of covariance
        "at_rest": (2, 0 if covariance or shape.moving else shape.auvs),
        "time": (1, int(not covariance)),
        "floor": (2, 0 if covariance else shape.auvs),  # of determinant and trace
        "disc": (3, shape.discs),
        "line": (3, sum(shape.keep_outs) + shape.fence),
        "sharpness": (1, len(shape.keep_outs)),
        "side": (
            1,
            int(bool(shape.discs or shape.keep_outs or shape.fence)),
        ),  # 1: loiter to the left, -1: to the right
        "least": (1, int(shape.least)),
        "greatest": (1, int(shape.greatest)),
    }


def stage_blocks(shape: Shape) -> dict[str, tuple[int, int]]:
    """Parameters of each stage."""
    covariance, moving = (
        shape.objective == "covariance",
        shape.moving and shape.objective != "covariance",
    )
    return {
        "duration": (1, 1),
        "reach": (1, int(shape.slew)),
        "look": (
            1,
            int(shape.limited),
        ),  # time from the stage's beginning at which the limits are looked at beside its end
        "margin": (
            3,
            int(shape.limited),
        ),  # of areas, least and greatest separation, for what lies between the points looked at
        "pings": (1, int(covariance)),
        "course": (3, shape.auvs if covariance else 0),  # cos and sin of the heading, speed
        "there": (
            2,
            shape.auvs * (1 if covariance else 3 if moving else 0),
        ),  # AUVs at the end; or at start, middle and end
        "neighbour": (2, 2 * shape.neighbours),  # at the look and the end
    }


def symbols(blocks: dict[str, tuple[int, int]], name: str) -> tuple[SX, dict[str, SX]]:
    """One column of symbols, and the blocks it is made of."""
    sizes = [rows * cols for rows, cols in blocks.values()]
    column = symbol(name, sum(sizes))
    parts = ca.vertsplit(column, [0, *np.cumsum(sizes).tolist()])
    return column, {
        key: ca.reshape(part, *size)
        for (key, size), part in zip(blocks.items(), parts, strict=True)
    }


def moved(x: SX, u: SX, shape: Shape, duration: SX) -> tuple[SX, SX, SX]:
    """Pose at the beginning, in the middle and at the end of a stage."""
    speed = u[1] if shape.free_speed else 1.0
    return x[:3], arc(x[:3], u[0], speed, duration / 2), arc(x[:3], u[0], speed, duration)


def dynamics(x: SX, u: SX, s: dict[str, SX], g: dict[str, SX], shape: Shape) -> SX:
    """State at the end of a stage."""
    poses = moved(x, u, shape, s["duration"])
    held = [u[0]] if shape.slew else []
    z = x[3 + len(held) :]
    advance: Callable[..., SX] = _covariances if shape.objective == "covariance" else _moments
    return ca.vertcat(poses[2], *held, advance(z, poses, s, g, shape))


def _moments(
    z: SX, poses: tuple[SX, SX, SX], s: dict[str, SX], _: dict[str, SX], shape: Shape
) -> SX:
    """Add a stage's integrals by Simpson's rule."""
    n = shape.auvs

    def integrand(pose: SX, at: int) -> SX:
        if not shape.moving:
            return ca.vertcat(pose[0], pose[1], pose[0] ** 2, pose[0] * pose[1], pose[1] ** 2)
        p = ca.repmat(pose[:2], 1, n) - s["there"][:, at * n : (at + 1) * n]
        return ca.vec(ca.vertcat(p[0, :] ** 2, p[0, :] * p[1, :], p[1, :] ** 2))

    f0, f1, f2 = (integrand(pose, at) for at, pose in enumerate(poses))
    first, middle, last = MIDDLE.tolist()
    return z + s["duration"] * (first * f0 + middle * f1 + last * f2)


def _covariances(
    z: SX, poses: tuple[SX, SX, SX], s: dict[str, SX], g: dict[str, SX], shape: Shape
) -> SX:
    """Predict each AUV's covariance over a stage and condition it on the ranges at its end; in units of ``unit``."""
    after = []
    for i, packed in enumerate(ca.vertsplit(z, PACKED)):
        P = predict(unpack(packed), s["course"][:, i], g["noise"][:, i], s["duration"])
        x = poses[2][:2] - s["there"][:, i]
        known = condition_on_range(
            g["unit"] * P, x, sigma=g["sigma"], pings=s["pings"], squared=shape.squared
        )
        after.append(pack(known) / g["unit"])
    return ca.vertcat(*after)


def running_cost(x: SX, share: SX, g: dict[str, SX], shape: Shape) -> SX:
    """What the state at a stage's end costs; ``share`` is the stage's of the horizon."""
    if shape.objective != "covariance":
        return ca.SX(0.0)
    parts = ca.vertsplit(x[3 + shape.slew :], PACKED)
    traces = [ca.trace(unpack(packed)[:2, :2]) for packed in parts]
    return share * sum(g["weight"][i] * trace for i, trace in enumerate(traces))


def final_cost(x: SX, g: dict[str, SX], shape: Shape) -> SX:
    """What the Gramians at the horizon's end cost: the weighted mean of the AUVs' scores."""
    if shape.objective == "covariance":
        return ca.SX(0.0)
    z, T = x[3 + shape.slew :], g["time"]
    if shape.moving:
        W = ca.reshape(z, 3, shape.auvs)
        w11, w12, w22 = W[0, :], W[1, :], W[2, :]
    else:
        a1, a2 = g["at_rest"][0, :], g["at_rest"][1, :]
        w11 = z[2] - 2 * a1 * z[0] + a1**2 * T
        w12 = z[3] - a1 * z[1] - a2 * z[0] + a1 * a2 * T
        w22 = z[4] - 2 * a2 * z[1] + a2**2 * T
    det, trace = w11 * w22 - w12**2, w11 + w22
    logs = _log_above(det, g["floor"][0, :]), _log_above(trace, g["floor"][1, :])
    gap = ca.sqrt((w11 - w22) ** 2 + 4 * w12**2 + (EIGENVALUE_GAP * trace) ** 2 + EPS)
    score = {
        "log-det": lambda: -logs[0],
        "condition-number": lambda: 2 * logs[1] - logs[0] - np.log(4.0),
        "smallest-eigenvalue": lambda: (
            _log_above(trace + gap, g["floor"][1, :]) - logs[0] - np.log(2.0)
        ),
    }[shape.objective]()
    return ca.dot(g["weight"], score)


def _log_above(z: SX, floor: SX) -> SX:
    """Logarithm, continued below the floor by its parabola: an infeasible iterate's determinant may be negative."""
    r = z / floor - 1
    return ca.if_else(z > floor, ca.log(ca.fmax(z, floor)), ca.log(floor) + r - r**2 / 2)


def limits(
    x: SX, u: SX, s: dict[str, SX], g: dict[str, SX], shape: Shape, *, last: bool
) -> tuple[list[SX], list[SX]]:
    """What has to be at least 0 in a stage: what may be softened [lengths], and the vehicle's own limits."""
    soft, hard, end = [], [], arc(x[:3], u[0], u[1] if shape.free_speed else 1.0, s["duration"])
    for at, time in enumerate((s["look"], s["duration"]) if shape.limited else ()):
        p = arc(x[:3], u[0], u[1] if shape.free_speed else 1.0, time)[:2]
        soft += [c - s["margin"][0] for c in _clearances(p, g, shape, ca.SX(0.0))]
        there = s["neighbour"][:, at * shape.neighbours : (at + 1) * shape.neighbours]
        for k in range(shape.neighbours):
            d2 = ca.sumsqr(p - there[:, k])
            soft += (
                [(d2 - g["least"] ** 2) / (2 * g["least"]) - s["margin"][1]] if shape.least else []
            )
            soft += (
                [(g["greatest"] ** 2 - d2) / (2 * g["greatest"]) - s["margin"][2]]
                if shape.greatest
                else []
            )
    if last and not g["side"].is_empty():
        center = end[:2] + g["side"] * g["radius"] * ca.vertcat(-ca.sin(end[2]), ca.cos(end[2]))
        soft += [c - s["margin"][0] for c in _clearances(center, g, shape, g["radius"])]
    if shape.slew:
        hard += [s["reach"] - u[0] + x[3], s["reach"] + u[0] - x[3]]
    if shape.free_speed:
        hard += [u[1] - g["radius"] * u[0], u[1] + g["radius"] * u[0]]
    return soft, hard


def _clearances(p: SX, g: dict[str, SX], shape: Shape, radius: SX) -> list[SX]:
    """How far a disc about a point is from each area, along the boundary exactly or less.

    The greatest of the distances to a keep-out's lines is softened to a log-sum-exp less its largest error.
    """
    found = []
    for k in range(shape.discs):
        R = g["disc"][2, k] + radius
        found.append((ca.sumsqr(p - g["disc"][:2, k]) - R**2) / (2 * R))
    first = 0
    for k, edges in enumerate(shape.keep_outs):
        off = g["line"][:2, first : first + edges].T @ p - g["line"][2, first : first + edges].T
        top = ca.mmax(off)
        found.append(
            top
            + ca.log(ca.sum1(ca.exp(g["sharpness"][k] * (off - top))) / edges) / g["sharpness"][k]
            - radius
        )
        first += edges
    lines = g["line"][:, first:]
    return found + [lines[2, j] - ca.dot(lines[:2, j], p) - radius for j in range(shape.fence)]
