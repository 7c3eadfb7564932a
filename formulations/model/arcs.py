r"""Exact arcs: how a unicycle moves at a constant turn rate u and speed V (thesis 3.1, 4.1).

.. math:: p(t) = p(0) + V t \, \mathrm{sinc}(u t / 2) \, (\cos, \sin)(\psi + u t / 2), \quad
          \psi(t) = \psi + u t

Poses are (east, north [m], heading [rad], counter-clockwise from east), or the same in any frame
and unit of length.
"""

from functools import cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from .casadi import SX, Elementwise, evaluate

SERIES_TERMS = 9  # of sinc below 1: the last is 1/17! = 3e-15


def sinc(z: SX) -> SX:
    """Return sin(z)/z with derivatives that keep their digits at 0."""
    short, series = ca.fabs(z) < 1.0, 1.0
    for n in range(SERIES_TERMS - 1, 0, -1):  # Horner: each operation is differentiated twice
        series = 1 - z**2 / (2 * n * (2 * n + 1)) * series
    far = ca.if_else(short, 1.0, z)
    return ca.if_else(short, series, ca.sin(far) / far)


def arc(pose: SX, turn_rate: SX, speed: SX, duration: SX) -> SX:
    """Pose after an exact arc; or poses, each a column, where all are rows."""
    half = 0.5 * turn_rate * duration
    chord = speed * duration * sinc(half)
    direction = pose[2, :] + half
    east = pose[0, :] + chord * ca.cos(direction)
    north = pose[1, :] + chord * ca.sin(direction)
    return ca.vertcat(east, north, pose[2, :] + 2 * half)


def compose(pose: SX, moves: SX) -> SX:
    """Poses, each a column, of moves that begin at a pose.

    An arc's move is the arc from the origin.
    """
    cos, sin = ca.cos(pose[2]), ca.sin(pose[2])
    ahead, left, turned = moves[0, :], moves[1, :], moves[2, :]
    east = pose[0] + cos * ahead - sin * left
    north = pose[1] + sin * ahead + cos * left
    return ca.vertcat(east, north, pose[2] + turned)


def _from(heading: SX, turn_rate: SX, speed: SX, duration: SX) -> SX:
    """Move of an arc: a pose relative to where it begins, but for the heading."""
    nowhere = 0.0 * heading
    return arc(ca.vertcat(nowhere, nowhere, heading), turn_rate, speed, duration)


@Elementwise
def _moves(heading, turn_rate, speed, duration):
    """Way to the east and to the north."""
    moved = _from(heading, turn_rate, speed, duration)
    return moved[0, :], moved[1, :]


def arcs(
    pose: Float[np.ndarray, "*#batch 3"],
    turn_rates: Float[np.ndarray, "*#batch"],
    speed: Float[np.ndarray, "*#batch"] | float,
    times: Float[np.ndarray, " T"],
) -> Float[np.ndarray, "*batch T 3"]:
    """Poses after turns [rad/s] were held at speeds [m/s] for times [s]."""
    rates, heading = turn_rates[..., None], pose[..., None, 2]
    east, north = _moves(heading, rates, np.asarray(speed)[..., None], times)
    poses = np.empty((*east.shape, 3))
    poses[..., 0] = pose[..., None, 0] + east
    poses[..., 1] = pose[..., None, 1] + north
    poses[..., 2] = heading + rates * times
    return poses


@cache
def _one_arc() -> ca.Function:
    given = ca.SX.sym("given", 6)  # pose, turn rate, speed, duration
    return ca.Function("one_arc", [given], [arc(given[:3], given[3], given[4], given[5])])


def one_arc(
    pose: tuple[float, float, float], turn_rate: float, speed: float, duration: float
) -> tuple[float, float, float]:
    """Pose after one turn [rad/s] at a speed [m/s] for a time [s]."""
    given = np.array([*pose, turn_rate, speed, duration], dtype=float)
    end = np.empty(3)
    evaluate(_one_arc(), [given], [end])
    x, y, heading = end.tolist()
    return x, y, heading


def path(
    pose: Float[np.ndarray, "*#batch 3"],
    turn_rates: Float[np.ndarray, "*#batch N"],
    speeds: Float[np.ndarray, "*#batch N"] | float,
    durations: Float[np.ndarray, "*#batch N"] | float,
) -> Float[np.ndarray, "*batch nodes 3"]:
    """Poses at the beginning and the ends of arcs one after the other."""
    heading = _headings(pose, turn_rates, durations)
    moves = _moves(heading[..., :-1], turn_rates, speeds, durations)
    east, north = (_summed(pose[..., [i]], move) for i, move in enumerate(moves))
    return np.stack([east, north, heading], axis=-1)


def _headings(pose: np.ndarray, turn_rates: np.ndarray, durations: np.ndarray | float):
    """Headings at the beginning and the ends of arcs."""
    return _summed(pose[..., [2]], turn_rates * durations)


def _summed(first: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """First value, and what it is after each step."""
    start = np.broadcast_to(first, (*steps.shape[:-1], 1))
    return np.concatenate([start, first + np.cumsum(steps, axis=-1)], axis=-1)
