r"""Follow sequences of turns and say what they are worth: many at once, in the units of the task.

Gramian objectives are of the position block of the squared range's Gramian (thesis 4.1), the aid
vehicle's own heading being known,

.. math:: W_i = 4 \int_0^T w(r_i) \, p_i p_i^\top dt, \qquad
          p_i(t) = \text{aid vehicle} - \text{AUV } i,

by Simpson's rule on each stage. The share w is that of `formulations.trajectory.share`: where the
error does not grow with distance and no range is lost it is 1, and W grows with distance: give
these objectives a greatest separation then. Of heights the squared range's gradient knows nothing:
they count in the share alone. W counts time, and neither the standard deviation at no distance nor
intervals, slots or silences: the schedule does not enter.

The ``covariance`` objective is the time mean of the trace of each AUV's predicted position
covariance, ranges coming at the pings of each AUV and erring, coming over a height and being lost
as the task's ranging says (`formulations.model.covariance`). A depth counts as known.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..metrics import EPS
from ..model import arcs as exact
from ..model.covariance import conditioned, motions, predicted
from ..model.quadrature import MIDDLE
from .share import counts, shares
from .task import Task


class Path(NamedTuple):
    """Where K sequences lead."""

    poses: Float[np.ndarray, "K T 3"]  # at times within the stages
    times: Float[np.ndarray, " T"]  # from now


def rollout(
    task: Task,
    turn_rates: Float[np.ndarray, "K N"],
    speeds: Float[np.ndarray, "K N"],
    points: int = 2,
) -> Path:
    """Poses now and at ``points`` equal fractions of each stage, on exact arcs."""
    d = task.durations
    fraction = np.arange(1, points + 1) / points
    nodes = exact.path(task.pose, turn_rates, speeds, d)
    # a stage is the unit of time
    within = exact.arcs(nodes[:, :-1], turn_rates * d, speeds * d, fraction)
    poses = within.reshape(len(turn_rates), -1, 3)
    times = (np.cumsum(d)[:, None] - d[:, None] * (1 - fraction)).ravel()
    return Path(np.concatenate([nodes[:, :1], poses], axis=1), np.concatenate([[0.0], times]))


def simpson_weights(durations: Float[np.ndarray, " N"]) -> Float[np.ndarray, " T"]:
    """Weights of the ends and middles of the stages."""
    weights = np.zeros(2 * len(durations) + 1)
    weights[:-1:2] += MIDDLE[0] * durations
    weights[1::2] += MIDDLE[1] * durations
    weights[2::2] += MIDDLE[2] * durations
    return weights


def gramians(task: Task, path: Path) -> Float[np.ndarray, "K M 2 2"]:
    """Position blocks W / 4 from each sequence to each AUV."""
    x = path.poses[:, :, 0, None] - task.positions[..., 0]
    y = path.poses[:, :, 1, None] - task.positions[..., 1]
    weights = simpson_weights(task.durations)
    W = np.empty((len(x), x.shape[-1], 2, 2))
    counted_x, counted_y = x, y
    if counts(task.ranging.form):
        share = _shares(task, x**2 + y**2)
        counted_x, counted_y = share * x, share * y
    W[..., 0, 0] = np.tensordot(weights, counted_x * x, axes=(0, 1))
    W[..., 0, 1] = W[..., 1, 0] = np.tensordot(weights, counted_x * y, axes=(0, 1))
    W[..., 1, 1] = np.tensordot(weights, counted_y * y, axes=(0, 1))
    return W


def _shares(task: Task, horizontal2: Float[np.ndarray, "K T M"]) -> Float[np.ndarray, "K T M"]:
    """What counts of ranges, by their squared horizontal distances."""
    if not task.ranging.slant:
        return shares(task.ranging, horizontal2)
    return shares(task.ranging, horizontal2 + task.heights**2)


def gramian_scores(W: Float[np.ndarray, "K M 2 2"], objective: str) -> Float[np.ndarray, "K M"]:
    """Each Gramian's score, lower is better; inf where it is singular.

    -log det, -log λmin, or log((κ + 1)² / 4κ) = log(tr² / 4 det) for the condition number κ.
    """
    w11, w12, w22 = W[..., 0, 0], W[..., 0, 1], W[..., 1, 1]
    trace = w11 + w22
    det = w11 * w22 - w12**2
    with np.errstate(divide="ignore", invalid="ignore"):
        if objective == "log-det":
            scores = -np.log(det)
        elif objective == "smallest-eigenvalue":
            spread = np.hypot(w11 - w22, 2 * w12)
            scores = -np.log(2 * det / (trace + spread))
        else:
            scores = np.log(trace**2 / (4 * det))
    return np.where(det > EPS * trace**2, scores, np.inf)


def condition_numbers(W: Float[np.ndarray, "K M 2 2"]) -> Float[np.ndarray, "K M"]:
    """Of each Gramian; inf where it is singular."""
    with np.errstate(over="ignore"):
        cosh = np.exp(gramian_scores(W, "condition-number"))  # (κ + 1)² / 4κ
    return 2 * cosh - 1 + 2 * np.sqrt(cosh * np.maximum(cosh - 1, 0.0))


def traces(task: Task, path: Path) -> Float[np.ndarray, "K M"]:
    """Time mean of the trace of each AUV's predicted position covariance."""
    P = np.broadcast_to(task.covariance, (len(path.poses), *task.covariance.shape))
    total = np.zeros(P.shape[:2])
    ends = path.poses[:, 2::2, :2]
    for k, (duration, pings) in enumerate(zip(task.durations, task.pings, strict=True)):
        there, height = task.positions[2 * k + 2], task.heights[2 * k + 2]
        motion = motions(task.headings[k], task.speeds[k])
        P = predicted(P, motion, task.process_noise, float(duration))
        P = conditioned(P, ends[:, k, None] - there, task.ranging, pings, height)
        total += (P[..., 0, 0] + P[..., 1, 1]) * (duration / task.durations.sum())
    return total


def scores(task: Task, path: Path, objective: str) -> Float[np.ndarray, "K M"]:
    """Each AUV's score under each sequence, lower is better; all AUVs must have a weight."""
    if objective == "covariance":
        return traces(task, path)
    return gramian_scores(gramians(task, path), objective)


def ramped(
    task: Task, turn_rates: Float[np.ndarray, "K N"], speeds: Float[np.ndarray, "K N"]
) -> Float[np.ndarray, "K N"]:
    """The nearest sequences that the vehicle can follow: within its turning limit and reach."""
    limit = speeds / task.min_turn_radius
    rates = np.clip(turn_rates, -limit, limit)
    if task.reach is None:
        return rates
    last = np.full(len(rates), task.turn_rate)
    for k, reach in enumerate(task.reach):
        last = np.clip(rates[:, k], last - reach, last + reach)
        rates[:, k] = last
    return rates
