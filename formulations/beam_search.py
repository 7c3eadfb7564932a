r"""Search for the manoeuvre after which AUVs know best where they are: beam search over constant turns, covariances predicted.

State of an AUV: (east, north [m], heading [rad], speed through the water [m/s]). Over a stage of h seconds at heading ψ and speed V

.. math:: P \leftarrow F P F^\top + Q h + (A Q + Q A^\top) \tfrac{h^2}{2} + A Q A^\top \tfrac{h^3}{3}, \quad F = I + A h,

A having the columns (-V sin ψ, V cos ψ) and (cos ψ, sin ψ) of the heading and the speed; A² = 0 makes it exact. The heading's own variance
stays as it is: the compass makes up for its drift. At the stage's end n ranges of variance σ² bring, along the line of sight u with
v normal to it and d the distance,

.. math:: P \leftarrow (P^{-1} + u u^\top / R)^{-1}, \quad R = \sigma^2 / n + \tfrac{3}{4} (v^\top P v / d)^2.

The second term is the mean square of the range's second-order error, which the filter neglects and which repeated ranges share; it keeps
the aid vehicle away from an AUV that is closer than it is sure of. (Jazwinski 1970, section 9.3: second-order filters.)
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

CRITERIA = ("trace", "log-det")
LOOKS = np.arange(1, 9) / 8  # parts of a stage after which it is held against the constraints
TINY = 1e-30  # [m^4]; a position known exactly has no logarithm

Look = Callable[[Int[np.ndarray, " n"]], Float[np.ndarray, " n"]]
Violation = Callable[
    [Float[np.ndarray, "*batch T 2"], Float[np.ndarray, " T"]], Float[np.ndarray, "*batch T"]
]


class Stages(NamedTuple):
    """The horizon cut into stages, ranges coming at the end of each."""

    duration: Float[np.ndarray, " S"]  # [s]
    pings: Float[np.ndarray, " S"]  # number of ranges to each AUV


class Tracks(NamedTuple):
    """Where M AUVs are expected at the end of each stage, and how they move during it."""

    position: Float[np.ndarray, "S M 2"]  # [m]
    heading: Float[np.ndarray, "S M"]  # [rad]
    speed: Float[np.ndarray, "S M"]  # through the water [m/s]


class Manoeuvre(NamedTuple):
    """The best sequence of turns found."""

    turn_rates: Float[np.ndarray, " S"]  # [rad/s]
    score: float  # the criterion [m^2], or [-] for log-det
    first_violation: float  # how far its first turn breaks a limit [m], at least 0
    violation: float  # how far the sequence does, at the points looked at [m], at least 0


class Ranging(NamedTuple):
    """How ranges err."""

    sigma: float  # [m], of a squared range [m^2]
    squared: bool = False


def ping_stages(time: float, interval: float, horizon: float, count: int) -> Stages:
    """Cut a horizon [s] into stages that end at pings, which come every ``interval`` [s] counted from time 0.

    Pings farther apart than horizon / count make a stage each, the first one shorter; closer ones are counted together.
    """
    length = horizon / count
    if interval <= length:
        return Stages(np.full(count, length), np.full(count, length / interval))
    first = interval - time % interval
    first = (
        interval if first < 1e-6 * interval else first
    )  # rounding of a time that is itself a ping's
    return Stages(np.concatenate([[first], np.full(count - 1, interval)]), np.ones(count))


def turn_candidates(max_turn_rate: float, count: int) -> Float[np.ndarray, " K"]:
    """Turn rates to try at each stage [rad/s], from left to right: straight on, and pairs that fall off threefold from the limit."""
    side = max_turn_rate / 3.0 ** np.arange(count // 2)
    return np.concatenate([side, [0.0], -side[::-1]])


class _Beam(NamedTuple):
    """Sequences of turns under consideration."""

    pose: np.ndarray  # B x 3
    covariance: np.ndarray  # B x M x 4 x 4
    cost: np.ndarray  # B
    first: np.ndarray  # B, how far the first turn itself breaks a limit [m]
    violation: np.ndarray  # B, how far the sequence does [m]
    turns: np.ndarray  # B x stages so far


def search_manoeuvres(
    pose: Float[np.ndarray, "3"],
    covariance: Float[np.ndarray, "M 4 4"],
    *,
    tracks: Tracks,
    process_noise: Float[np.ndarray, "M 4"],
    weights: Float[np.ndarray, " M"],
    stages: Stages,
    turn_rates: Float[np.ndarray, " K"],
    speed: float,
    ranging: Ranging,
    criterion: str = "trace",
    beam_width: int = 32,
    violation: Violation | None = None,
    first_violation: Float[np.ndarray, " K"] | None = None,
) -> Manoeuvre:
    """Find the turns, one a stage, that make the AUVs' position covariances smallest over the horizon.

    Parameters
    ----------
    pose
        Of the aid vehicle: east, north [m], heading [rad].
    covariance, process_noise
        Of each AUV's state now; standard deviations of its random walk per square root of a second.
    tracks, weights
        Where the AUVs are expected, and what each counts.
    stages, turn_rates, speed, ranging
        Of the aid vehicle's horizon, its candidates at each stage [rad/s], its speed [m/s]; how ranges err.
    criterion
        ``trace`` [m²] or ``log-det`` [-] of the position covariance after each stage, weighted by the AUVs and averaged over time.
    beam_width
        Sequences kept after each stage: those whose first turn breaks limits least, of these those that break them least later, of these
        the cheapest.
    violation
        How far [m] positions (..., T, 2) at times from now [s] are on the wrong side of a limit, at most 0 where they are right.
    first_violation
        How far [m] each turn breaks a limit as the first one.

    Returns
    -------
    The best sequence of the last beam; of equals the one that comes first, turning left.
    """
    beam = _Beam(
        pose[None], covariance[None], np.zeros(1), np.zeros(1), np.zeros(1), np.empty((1, 0))
    )
    weights, elapsed, total = weights / weights.sum(), 0.0, stages.duration.sum()
    for s, (duration, pings) in enumerate(zip(*stages, strict=True)):
        now = Tracks(*(part[s] for part in tracks))
        predicted = predict_covariance(beam.covariance, now, process_noise, float(duration))
        poses = arcs(beam.pose[:, None], turn_rates, speed, np.array([duration]))[..., 0, :]
        x = poses[..., None, :2] - now.position
        known = _criterion(
            range_update(predicted[:, None, :, :2, :2], x, ranging, float(pings)), criterion
        )
        cost = beam.cost[:, None] + known @ weights * (duration / total)
        first, worst = (
            np.broadcast_to(broken[:, None], cost.shape).ravel()
            for broken in (beam.first, beam.violation)
        )
        if s == 0 and first_violation is not None:
            first = np.maximum(first_violation, 0.0)
        look = (
            None
            if violation is None
            else partial(_broken, violation, beam.pose, turn_rates, speed, elapsed, float(duration))
        )
        keep, worst = _best(first, worst, cost.ravel(), beam_width, look)
        parent, turn = np.divmod(keep, len(turn_rates))
        turns = np.column_stack([beam.turns[parent], turn_rates[turn]])
        updated = range_update(predicted[parent], x[parent, turn], ranging, float(pings))
        beam = _Beam(
            poses[parent, turn], updated, cost.ravel()[keep], first[keep], worst[keep], turns
        )
        elapsed += float(duration)
    return Manoeuvre(
        beam.turns[0], float(beam.cost[0]), float(beam.first[0]), float(beam.violation[0])
    )


def predict_covariance(
    P: Float[np.ndarray, "B M 4 4"],
    track: Tracks,
    process_noise: Float[np.ndarray, "M 4"],
    duration: float,
) -> Float[np.ndarray, "B M 4 4"]:
    """Covariances after a stage without ranges; see the module."""
    A = np.zeros((len(process_noise), 4, 4))
    cos, sin = np.cos(track.heading), np.sin(track.heading)
    A[:, 0, 2], A[:, 1, 2], A[:, 0, 3], A[:, 1, 3] = -track.speed * sin, track.speed * cos, cos, sin
    variance = process_noise**2 * [1.0, 1.0, 0.0, 1.0]
    Q, At = variance[:, :, None] * np.eye(4), A.swapaxes(-1, -2)
    F = np.eye(4) + A * duration
    grown = Q * duration + (A @ Q + Q @ At) * (duration**2 / 2) + A @ Q @ At * (duration**3 / 3)
    return F @ P @ F.swapaxes(-1, -2) + grown


def range_update(
    P: Float[np.ndarray, "*#batch n n"],
    x: Float[np.ndarray, "*#batch 2"],
    ranging: Ranging,
    pings: float,
) -> np.ndarray:
    """Covariances after ranges from relative positions x [m]; a range from on top of an AUV tells nothing.

    P may hold the whole state or, for what becomes of the position alone, its first two components.
    """
    d2 = np.sum(x**2, axis=-1)
    apart = d2 > 0
    safe = np.where(apart, d2, 1.0)
    u1, u2 = x[..., 0] / np.sqrt(safe), x[..., 1] / np.sqrt(safe)
    Pu = P[..., 0] * u1[..., None] + P[..., 1] * u2[..., None]
    trace, along = P[..., 0, 0] + P[..., 1, 1], u1 * Pu[..., 0] + u2 * Pu[..., 1]
    if ranging.squared:  # the error left out is the squared length of a Gaussian vector, (tr P)^2 + 2 tr P^2 in the mean of its square
        second = trace**2 + 2 * (P[..., 0, 0] ** 2 + 2 * P[..., 0, 1] ** 2 + P[..., 1, 1] ** 2)
        R = (ranging.sigma**2 / pings + second) / (4 * safe)
    else:
        R = (
            ranging.sigma**2 / pings + 0.75 * (trace - along) ** 2 / safe
        )  # trace - along: the variance across
    gain = np.where(apart, 1.0 / (R + along), 0.0)
    return P - gain[..., None, None] * Pu[..., :, None] * Pu[..., None, :]


def _best(
    first: Float[np.ndarray, " n"],
    worst: Float[np.ndarray, " n"],
    cost: Float[np.ndarray, " n"],
    count: int,
    look: Look | None,
) -> tuple[Int[np.ndarray, " count"], Float[np.ndarray, " n"]]:
    """The best sequences, and how far each breaks a limit; looked at are no more than it takes to know the best."""
    order = np.lexsort((cost, worst, first))
    if look is None:
        return order[:count], worst
    worst, seen = worst.copy(), order[:0]
    for end in range(count, len(order) + count, count):
        these, seen = order[end - count : end], order[:end]
        worst[these] = np.maximum(worst[these], look(these))
        if np.sum((first[seen] == first[order[0]]) & (worst[seen] == 0)) >= count:
            break  # whatever comes later costs more, or breaks more
    return seen[np.lexsort((cost[seen], worst[seen], first[seen]))[:count]], worst


def _broken(
    violation: Violation,
    pose: Float[np.ndarray, "B 3"],
    turn_rates: Float[np.ndarray, " K"],
    speed: float,
    elapsed: float,
    duration: float,
    these: Int[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """How far the stage of some sequences breaks a limit, at the points looked at."""
    parent, turn = np.divmod(these, len(turn_rates))
    along = arcs(pose[parent], turn_rates[turn], speed, duration * LOOKS)
    return violation(along[..., :2], elapsed + duration * LOOKS).max(axis=-1)


def arcs(
    pose: Float[np.ndarray, "*#batch 3"],
    turn_rates: Float[np.ndarray, "*#batch"],
    speed: float,
    times: Float[np.ndarray, " T"],
) -> Float[np.ndarray, "*batch T 3"]:
    """Poses (east, north [m], heading [rad]) after turns [rad/s] were held at a speed [m/s] for times [s]."""
    half = 0.5 * turn_rates[..., None] * times
    heading = pose[..., None, 2] + half
    chord = speed * times * np.sinc(half / np.pi)
    steps = np.stack([chord * np.cos(heading), chord * np.sin(heading)], axis=-1)
    return np.concatenate([pose[..., None, :2] + steps, (heading + half)[..., None]], axis=-1)


def _criterion(P: np.ndarray, name: str) -> np.ndarray:
    """Trace or log det of the position covariance."""
    if name == "trace":
        return P[..., 0, 0] + P[..., 1, 1]
    return np.log(np.maximum(P[..., 0, 0] * P[..., 1, 1] - P[..., 0, 1] ** 2, TINY))
