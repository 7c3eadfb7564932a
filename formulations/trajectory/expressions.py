r"""One stage of the program as CasADi expressions: arcs, the objective's states, the limits.

States are the pose, the turn rate held before where its change is limited, and what the objective
accumulates:

- AUVs at rest: the moments ∫(p, p pᵀ) of the aid vehicle's own position, which every AUV's Gramian
  is a polynomial of;
- AUVs that move, or whose ranges count the less the farther they are: ∫ w p pᵀ of the position
  relative to each (`.share`);
- ``covariance``: the packed lower triangle of each AUV's 4 x 4 covariance.

Controls are the turn rate, the speed where it is free, and the slack by which the limits are
softened. Parameters are named blocks: of the whole task (``g``) and of each stage (``s``).
"""

from typing import NamedTuple

import casadi as ca
import numpy as np

from ..metrics import EPS
from ..model.arcs import arc
from ..model.casadi import SX, symbol
from ..model.covariance import condition_on_range, pack, predict, unpack
from ..model.quadrature import MIDDLE
from ..model.ranging import NUMBERS, Form, law
from .share import counts, share

EIGENVALUE_GAP = 1e-3  # relative; rounds off the smallest eigenvalue where both are equal
PACKED = 10  # entries of a packed covariance


class Shape(NamedTuple):
    """What a compiled program depends on; numbers of things."""

    objective: str
    stages: int
    auvs: int  # in the objective
    moving: bool  # AUVs that a Gramian is of, or all whose ranges count by distance
    form: Form  # of ranges
    neighbours: int  # AUVs to keep a distance from
    least: bool
    greatest: bool
    discs: int
    keep_outs: tuple[int, ...]  # edges of each
    fence: int  # edges
    slew: bool
    free_speed: bool
    carried: bool = False  # past areas, by water that flows

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
    """Rows and columns of the parameters of the whole task; what a shape does not have has none.

    ``side`` is that of the terminal safe set: 1 loiters to the left, -1 to the right.
    """
    gramian = shape.objective != "covariance"
    predicted = 0 if gramian else shape.auvs
    scored = shape.auvs if gramian else 0
    lines = sum(shape.keep_outs) + shape.fence
    blocks = {
        "weight": (1, shape.auvs),
        "start": (shape.accumulated, 1),
        "last_rate": (1, int(shape.slew)),
        "radius": (1, 1),  # smallest, of a turn
        "slack_weight": (1, int(shape.limited)),
        "noise": (4, predicted),  # standard deviations
        "law": (NUMBERS, int(not gramian or counts(shape.form))),  # numbers of the ranging's
        "unit": (1, int(not gramian)),  # of covariance
        "at_rest": (2, 0 if shape.moving else scored),
        "time": (1, int(gramian)),
        "floor": (2, scored),  # of determinant and trace
    }
    of_limits = {
        "disc": (3, shape.discs),
        "line": (3, lines),
        "sharpness": (1, len(shape.keep_outs)),
        "side": (1, int(shape.discs + lines > 0)),
        "loiter": (1, int(shape.carried)),  # radius, about the last turn's centre
        "least": (1, int(shape.least)),
        "greatest": (1, int(shape.greatest)),
    }
    return blocks | of_limits


def stage_blocks(shape: Shape) -> dict[str, tuple[int, int]]:
    """Rows and columns of the parameters of each stage.

    The limits are looked at once within the stage, ``look`` after its beginning, and at its end.
    ``margin`` is for what lies between these: of areas, least and greatest separation. ``there`` is
    where AUVs are at the end, or those that a Gramian is of at start, middle and end, and
    ``height`` how far the aid vehicle is above them then.
    """
    covariance = shape.objective == "covariance"
    if covariance:
        places = 1
    else:
        places = 3 if shape.moving else 0
    return {
        "duration": (1, 1),
        "reach": (1, int(shape.slew)),
        "look": (1, int(shape.limited)),
        "margin": (3, int(shape.limited)),
        "pings": (1, shape.auvs if covariance else 0),
        "motion": (3, shape.auvs if covariance else 0),  # cos and sin of the heading, speed
        "there": (2, places * shape.auvs),
        "height": (1, places * shape.auvs if shape.form.slant else 0),
        "neighbour": (2, 2 * shape.neighbours),  # at the look and the end
        "drift": (2, 2 * shape.carried),  # of the water since now, then
    }


def symbols(blocks: dict[str, tuple[int, int]], name: str) -> tuple[SX, dict[str, SX]]:
    """One column of symbols, and the blocks it is made of."""
    sizes = [rows * cols for rows, cols in blocks.values()]
    column = symbol(name, sum(sizes))
    parts = ca.vertsplit(column, [0, *np.cumsum(sizes).tolist()])
    named = {}
    for (key, (rows, cols)), part in zip(blocks.items(), parts, strict=True):
        named[key] = ca.reshape(part, rows, cols)
    return column, named


def moved(x: SX, u: SX, shape: Shape, duration: SX) -> SX:
    """Pose after a time of a stage."""
    return arc(x[:3], u[0], u[1] if shape.free_speed else 1.0, duration)


def dynamics(x: SX, u: SX, s: dict[str, SX], g: dict[str, SX], shape: Shape) -> SX:
    """State at the end of a stage."""
    end = moved(x, u, shape, s["duration"])
    held = [u[0]] if shape.slew else []
    z = x[3 + len(held) :]
    if shape.objective == "covariance":
        return ca.vertcat(end, *held, _covariances(z, end, s, g, shape))
    middle = moved(x, u, shape, s["duration"] / 2)
    return ca.vertcat(end, *held, _moments(z, (x[:3], middle, end), s, g, shape))


def _moments(
    z: SX, poses: tuple[SX, SX, SX], s: dict[str, SX], g: dict[str, SX], shape: Shape
) -> SX:
    """Add a stage's integrals by Simpson's rule."""
    if shape.moving:
        places = ca.horzsplit(s["there"], shape.auvs)
        heights = ca.horzsplit(s["height"], shape.auvs) if shape.form.slant else [0.0] * 3
        at = zip(poses, places, heights, strict=True)
        f0, f1, f2 = (_relative_products(*each, g, shape) for each in at)
    else:
        f0, f1, f2 = (_own_products(pose) for pose in poses)
    first, middle, last = MIDDLE.tolist()
    return z + s["duration"] * (first * f0 + middle * f1 + last * f2)


def _own_products(pose: SX) -> SX:
    """The aid vehicle's position and its products: what Gramians of AUVs at rest are made of."""
    east, north = pose[0], pose[1]
    return ca.vertcat(east, north, east**2, east * north, north**2)


def _relative_products(
    pose: SX, there: SX, height: SX | float, g: dict[str, SX], shape: Shape
) -> SX:
    """Products of the position relative to each AUV, as far as its ranges count."""
    p = ca.repmat(pose[:2], 1, there.shape[1]) - there
    east, north = p[0, :], p[1, :]
    products = ca.vertcat(east**2, east * north, north**2)
    if counts(shape.form):
        counted = share(law(shape.form, g["law"]), east**2 + north**2 + height**2)
        products *= ca.repmat(counted, 3, 1)
    return ca.vec(products)


def _covariances(z: SX, end: SX, s: dict[str, SX], g: dict[str, SX], shape: Shape) -> SX:
    """Predict each AUV's covariance over a stage and condition it on the ranges at its end.

    Covariances are in units of ``unit``.
    """
    after = []
    ranging = law(shape.form, g["law"])
    for i, packed in enumerate(ca.vertsplit(z, PACKED)):
        P = predict(unpack(packed), s["motion"][:, i], g["noise"][:, i], s["duration"])
        x = end[:2] - s["there"][:, i]
        height = s["height"][i] if shape.form.slant else 0.0
        known = condition_on_range(
            g["unit"] * P, x, law=ranging, pings=s["pings"][i], height=height
        )
        after.append(pack(known) / g["unit"])
    return ca.vertcat(*after)


def running_cost(x: SX, share: SX, g: dict[str, SX], shape: Shape) -> SX:
    """What the state at a stage's end costs; ``share`` is the stage's of the horizon."""
    if shape.objective != "covariance":
        return ca.SX(0.0)
    parts = ca.vertsplit(x[3 + shape.slew :], PACKED)
    mean = 0
    for i, packed in enumerate(parts):
        mean += g["weight"][i] * ca.trace(unpack(packed)[:2, :2])
    return share * mean


def final_cost(x: SX, g: dict[str, SX], shape: Shape) -> SX:
    """What the Gramians at the horizon's end cost: the weighted mean of the AUVs' scores.

    -log det, log((κ + 1)² / 4κ) = log(tr² / 4 det), or -log λmin by λmin = 2 det / (tr + gap).
    """
    if shape.objective == "covariance":
        return ca.SX(0.0)
    w11, w12, w22 = _gramians(x[3 + shape.slew :], g, shape)
    det = w11 * w22 - w12**2
    trace = w11 + w22
    det_floor, trace_floor = g["floor"][0, :], g["floor"][1, :]
    log_det = _log_above(det, det_floor)
    if shape.objective == "log-det":
        score = -log_det
    elif shape.objective == "condition-number":
        score = 2 * _log_above(trace, trace_floor) - log_det - np.log(4.0)
    else:
        gap = ca.sqrt((w11 - w22) ** 2 + 4 * w12**2 + (EIGENVALUE_GAP * trace) ** 2 + EPS)
        score = _log_above(trace + gap, trace_floor) - log_det - np.log(2.0)
    return ca.dot(g["weight"], score)


def _gramians(z: SX, g: dict[str, SX], shape: Shape) -> tuple[SX, SX, SX]:
    """W11, W12, W22 over 4 of each AUV, from what was accumulated."""
    if shape.moving:
        W = ca.reshape(z, 3, shape.auvs)
        return W[0, :], W[1, :], W[2, :]
    T = g["time"]
    a1, a2 = g["at_rest"][0, :], g["at_rest"][1, :]
    w11 = z[2] - 2 * a1 * z[0] + a1**2 * T
    w12 = z[3] - a1 * z[1] - a2 * z[0] + a1 * a2 * T
    w22 = z[4] - 2 * a2 * z[1] + a2**2 * T
    return w11, w12, w22


def _log_above(z: SX, floor: SX) -> SX:
    """Logarithm, continued below the floor by its parabola.

    An infeasible iterate's determinant may be negative.
    """
    r = z / floor - 1
    below = ca.log(floor) + r - r**2 / 2
    return ca.if_else(z > floor, ca.log(ca.fmax(z, floor)), below)


def limits(
    x: SX, u: SX, s: dict[str, SX], g: dict[str, SX], shape: Shape, *, last: bool
) -> tuple[list[SX], list[SX]]:
    """What has to be at least 0 in a stage.

    First what may be softened [lengths], then the vehicle's own limits.
    """
    soft = []
    if shape.limited:
        for at, time in enumerate((s["look"], s["duration"])):
            p = moved(x, u, shape, time)[:2]
            there = p + s["drift"][:, at] if shape.carried else p
            soft += [c - s["margin"][0] for c in _clearances(there, g, shape, ca.SX(0.0))]
            first = at * shape.neighbours
            soft += _separations(
                p, s["neighbour"][:, first : first + shape.neighbours], s, g, shape
            )
    if last and not g["side"].is_empty():
        end = moved(x, u, shape, s["duration"])
        abeam = ca.vertcat(-ca.sin(end[2]), ca.cos(end[2]))
        center = end[:2] + g["side"] * g["radius"] * abeam
        loiter = g["radius"]
        if shape.carried:
            center, loiter = center + s["drift"][:, 1], g["loiter"]
        soft += [c - s["margin"][0] for c in _clearances(center, g, shape, loiter)]
    hard = []
    if shape.slew:
        hard += [s["reach"] - u[0] + x[3], s["reach"] + u[0] - x[3]]
    if shape.free_speed:
        hard += [u[1] - g["radius"] * u[0], u[1] + g["radius"] * u[0]]
    return soft, hard


def _separations(p: SX, there: SX, s: dict[str, SX], g: dict[str, SX], shape: Shape) -> list[SX]:
    """How far a point is within the separations from neighbours, along the boundary exactly."""
    found = []
    for k in range(shape.neighbours):
        d2 = ca.sumsqr(p - there[:, k])
        if shape.least:
            least = g["least"]
            found.append((d2 - least**2) / (2 * least) - s["margin"][1])
        if shape.greatest:
            greatest = g["greatest"]
            found.append((greatest**2 - d2) / (2 * greatest) - s["margin"][2])
    return found


def _clearances(p: SX, g: dict[str, SX], shape: Shape, radius: SX) -> list[SX]:
    """How far a disc about a point is from each area, along the boundary exactly or less.

    The greatest of the distances to a keep-out's lines is softened to a log-sum-exp less its
    largest error.
    """
    found = []
    for k in range(shape.discs):
        R = g["disc"][2, k] + radius
        found.append((ca.sumsqr(p - g["disc"][:2, k]) - R**2) / (2 * R))
    first = 0
    for k, edges in enumerate(shape.keep_outs):
        lines = g["line"][:, first : first + edges]
        off = lines[:2, :].T @ p - lines[2, :].T
        top = ca.mmax(off)
        sharpness = g["sharpness"][k]
        mean = ca.sum1(ca.exp(sharpness * (off - top))) / edges
        found.append(top + ca.log(mean) / sharpness - radius)
        first += edges
    fence = g["line"][:, first:]
    for j in range(shape.fence):
        found.append(fence[2, j] - ca.dot(fence[:2, j], p) - radius)
    return found
