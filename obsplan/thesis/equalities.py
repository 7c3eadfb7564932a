"""Equalities of Gramians in the thesis: (3.4) = (3.11), and (4.6) = (4.9) up to signs."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from formulations import empirical_gramian
from formulations.model.arcs import path

# between the AUV's pose and its state relative to a moving aid vehicle: a position turned round
SIGNS = np.diag([-1.0, -1.0, 1.0])
INTERVALS = 60  # of the horizon; even
HORIZON = 3.0  # [s]
SPREAD = 3.0  # standard deviation of first positions [m] and headings [rad]
CURRENT = 0.3  # standard deviation of currents [m/s]

Turns = Float[np.ndarray, " intervals"]


class Equality(NamedTuple):
    """Greatest relative difference between the Gramians of fixed CNA and fixed AUV.

    The greatest is over random trajectories.
    """

    current: float  # state (position, current), output squared range: (3.4) and (3.11)
    # state (position, heading), outputs heading and squared range: (4.6) and (4.9), up to signs
    heading: float


def gramian_equalities(trajectories: int, seed: int) -> Equality:
    """Compare either pair of Gramians on paths of random turn rates.

    The Gramians are central differences of the simulated systems.
    """
    rng = np.random.default_rng(seed)
    differences = np.array(
        [(current_difference(rng), heading_difference(rng)) for _ in range(trajectories)]
    )
    return Equality(*(float(value) for value in differences.max(axis=0)))


def current_difference(rng: np.random.Generator) -> float:
    """Fixed CNA: x = (AUV, its current). Fixed AUV: r = -x, ṙ = -u + ΔW, the CNA moving by u."""
    moved = displacement(SPREAD * rng.normal(), rng.uniform(-2.0, 2.0, INTERVALS))
    x = rng.normal(size=4) * [SPREAD, SPREAD, CURRENT, CURRENT]
    time = np.linspace(0.0, HORIZON, INTERVALS + 1)[:, None]

    def square(p: np.ndarray) -> np.ndarray:
        return (p**2).sum(axis=1, keepdims=True)

    fixed_cna = empirical_gramian(
        lambda x: square(x[:2] + moved + x[2:] * time), x, horizon=HORIZON
    )
    fixed_auv = empirical_gramian(
        lambda r: square(r[:2] - moved + r[2:] * time), -x, horizon=HORIZON
    )
    return relative(fixed_cna, fixed_auv)


def heading_difference(rng: np.random.Generator) -> float:
    """Compare the Gramians of thesis (4.6) and (4.9).

    Fixed CNA: x = the moving AUV's pose. Fixed AUV: r = (-x1, -x2, ψ + π) of the moving CNA, as
    in (4.7).
    """
    x, turns = rng.normal(size=3) * SPREAD, rng.uniform(-2.0, 2.0, INTERVALS)
    fixed_cna = empirical_gramian(outputs(lambda x: x, turns), x, horizon=HORIZON)

    def of_cna(r: np.ndarray) -> np.ndarray:
        return np.array([-r[0], -r[1], r[2] - np.pi])

    fixed_auv = empirical_gramian(
        outputs(of_cna, turns), np.array([-x[0], -x[1], x[2] + np.pi]), horizon=HORIZON
    )
    return relative(fixed_cna, SIGNS @ fixed_auv @ SIGNS)


def outputs(
    pose: Callable[[np.ndarray], np.ndarray], turns: Turns
) -> Callable[[np.ndarray], np.ndarray]:
    """Heading and squared range over time, from a state by the pose it stands for."""

    def simulate(state: np.ndarray) -> np.ndarray:
        x, y, heading = pose(state)
        p = np.array([x, y]) + displacement(heading, turns)
        return np.column_stack([headings(heading, turns), (p**2).sum(axis=1)])

    return simulate


def headings(heading: float, turns: Turns) -> Float[np.ndarray, " samples"]:
    """Headings [rad] at the ends of the intervals."""
    return heading + np.concatenate([[0.0], np.cumsum(turns)]) * HORIZON / INTERVALS


def displacement(heading: float, turns: Turns) -> Float[np.ndarray, "samples 2"]:
    """Where a unicycle of 1 m/s is, less where it began [m]: exact arcs."""
    start = np.array([0.0, 0.0, heading])
    return path(start, turns, 1.0, HORIZON / INTERVALS)[:, :2]


def relative(W: Float[np.ndarray, "n n"], other: Float[np.ndarray, "n n"]) -> float:
    """Greatest difference of two matrices over the greatest entry."""
    return float(np.abs(W - other).max() / np.abs(W).max())
