"""What passes between simulator and planner: Pose, Belief, Decision; and the error users see."""

import reprlib
import traceback
from collections.abc import Callable, Sequence
from dataclasses import InitVar, dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from formulations.solution import Status

Point = Sequence[float] | np.ndarray  # east and north [m], as they may be given; kept as a tuple
Points = Sequence[Point] | np.ndarray  # n x 2; kept as tuples

ROUNDING = 1e-8  # of a covariance, relative: the square root of what a double resolves


# what numbers raise that no computer can go on with, whoever computes
UNCOMPUTABLE = (ArithmeticError, MemoryError, RecursionError, np.linalg.LinAlgError)


class ObsplanError(Exception):
    """What the user gave cannot be used; one sentence with the place, the value and the remedy."""


def uncomputable(error: BaseException) -> str:
    """Say in words what `UNCOMPUTABLE` numbers have raised, where, and what to do."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    what = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    return (
        f"its numbers cannot be computed with ({what}, in {Path(where.filename).name}, line "
        f"{where.lineno}): look for one that is far too large, or too small"
    )


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the aid vehicle is: local east/north [m], heading [rad], present turn rate [rad/s].

    The heading is counter-clockwise from east.
    """

    x: float
    y: float
    heading: float
    turn_rate: float = 0.0


class Hypothesis(NamedTuple):
    """One of the places where an AUV may be: a Gaussian of a sum of them."""

    share: float  # its probability
    mean: Float[np.ndarray, " m"]  # east, north [m], heading [rad], speed [m/s], and what follows
    covariance: Float[np.ndarray, "m m"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """What the planner knows of one AUV; the truth only under ``knowledge = "truth"``.

    ``mean`` is (east [m], north [m], heading [rad], speed through the water [m/s]); ``covariance``
    the AUV's own, as last reported and predicted since, wherever the mean comes from: 4 x 4, or
    5 x 5 where the AUV has to estimate its depth [m] as well; ``process_noise`` the standard
    deviations per square root of a second of position [m], heading [rad] and speed [m/s], and
    ``depth_noise`` that of a depth that is estimated [m]; ``current`` the water's velocity [m/s],
    by which it is carried; ``depth`` that of its transducer [m], which counts where ranges are
    slant; ``doubt`` a standard deviation [m] of each coordinate by which it may be elsewhere,
    besides what the covariance says; ``route`` its planned positions as a function of time from now
    [s], where they are known.

    ``hypotheses`` are all of the estimate where its ranges fit several positions, and none where
    there is one: mean and covariance are theirs together. They are as of the last report that was
    heard, and dead-reckoned since. Where ``knowledge`` is ``"survey"`` or ``"truth"``, and of
    planners that are expressions (`obsplan.planning.expressions`), they are not told.

    ``checked=False`` keeps the arrays themselves, whatever they hold. The simulator asks for it: a
    filter that has failed is for the planner to answer, with a status.

    Raises
    ------
    ValueError
        A negative weight or doubt, hypotheses whose shares do not add up to 1, a mean that is not 4
        numbers, or a covariance that is not 4 x 4 or 5 x 5, symmetric and positive semidefinite
        within rounding. One that is not finite is accepted, and planners answer it with a status.
    """

    mean: Float[np.ndarray, "4"]
    covariance: Float[np.ndarray, "4 4"] | Float[np.ndarray, "5 5"]
    process_noise: tuple[float, float, float] = (0.0, 0.0, 0.0)
    depth_noise: float = 0.0
    weight: float = 1.0
    current: tuple[float, float] = (0.0, 0.0)
    depth: float = 0.0
    doubt: float = 0.0
    route: Callable[[np.ndarray], np.ndarray] | None = None
    hypotheses: tuple[Hypothesis, ...] = ()
    checked: InitVar[bool] = True

    def __post_init__(self, checked: bool) -> None:
        if not self.weight >= 0:
            raise ValueError(f"weight of an AUV must be at least 0, got {self.weight}")
        if checked and not self.doubt >= 0:
            raise ValueError(f"doubt of an AUV must be at least 0 m, got {self.doubt}")
        if checked and self.hypotheses:
            _check_shares([one.share for one in self.hypotheses])
        if checked:
            object.__setattr__(self, "mean", _checked_mean(self.mean))
            object.__setattr__(self, "covariance", _checked_covariance(self.covariance))

    @classmethod
    def at(
        cls,
        x: float,
        y: float,
        *,
        heading: float = 0.0,
        speed: float = 0.0,
        covariance: np.ndarray | None = None,
        weight: float = 1.0,
    ) -> "Belief":
        """Believe in a position [m], heading [rad] and speed [m/s]; no covariance (4 x 4) is 0."""
        return cls(
            mean=np.array([x, y, heading, speed], dtype=float),
            covariance=np.zeros((4, 4)) if covariance is None else covariance,
            weight=weight,
        )

    @property
    def horizontal_covariance(self) -> Float[np.ndarray, "4 4"]:
        """Covariance of what the mean has: that of the depth is left out."""
        return self.covariance[:4, :4]

    def ahead(self, times: Float[np.ndarray, " steps"]) -> Float[np.ndarray, "steps 2"]:
        """Predict positions [m] at times from now [s], on the route or at constant velocity."""
        if self.route is not None:
            return self.route(times)
        x, y, heading, speed = self.mean
        velocity = speed * np.array([np.cos(heading), np.sin(heading)]) + self.current
        return np.array([x, y]) + np.asarray(times)[:, None] * velocity


def no_poses() -> Float[np.ndarray, "0 3"]:
    """Predict nothing."""
    return np.empty((0, 3))


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """The manoeuvre a planner chose: turn rate and speed to hold until the next decision.

    ``predict`` makes the predicted poses, which are `path`; default: none. ``score`` is the
    planner's own objective in its own unit; ``condition`` the predicted condition number per AUV,
    nan where the planner has none. ``lasting`` says how long each leg of the path lasts, a turn
    held; without it legs are taken to be straight, at ``speed``. ``route`` gives planned positions
    over ground [m] as a function of time from now [s], for other aid vehicles; without one the turn
    is taken to be held.
    """

    turn_rate: float  # [rad/s], positive to the left
    speed: float  # [m/s]
    predict: Callable[[], np.ndarray] = field(default=no_poses, repr=False, compare=False)
    score: float = float("nan")
    status: Status = Status.OPTIMAL
    condition: Float[np.ndarray, " auvs"] = field(default_factory=lambda: np.empty(0))
    lasting: Float[np.ndarray, " legs"] = field(
        default_factory=lambda: np.empty(0), repr=False, compare=False
    )  # [s]
    route: Callable[[np.ndarray], np.ndarray] | None = field(
        default=None, repr=False, compare=False
    )

    @property
    def path(self) -> Float[np.ndarray, "steps 3"]:
        """Predicted poses (east [m], north [m], heading [rad]), the current one first."""
        return self.predict()

    @property
    def radius(self) -> float:
        """Turning radius [m], positive to the left; inf when straight or stopped."""
        return self.speed / self.turn_rate if self.turn_rate and self.speed else float("inf")


def as_point(point: Point) -> tuple[float, float]:
    """A point (east, north [m]) as a tuple.

    Raises
    ------
    ValueError
        Anything but two numbers.
    """
    pair = _floats(point)
    if pair is None or pair.shape != (2,):
        raise ValueError(f"a point must be two numbers, east and north [m], got {_short(point)}")
    east, north = pair.tolist()
    return east, north


def as_points(points: Points) -> tuple[tuple[float, float], ...]:
    """Points (east, north [m]) as tuples, from tuples, lists or an array (n x 2).

    Raises
    ------
    ValueError
        Anything but pairs of numbers.
    """
    pairs = _floats(points)
    if pairs is None or (pairs.size and pairs.shape[1:] != (2,)):
        raise ValueError(
            f"points must be pairs of numbers, east and north [m], got {_short(points)}"
        )
    return tuple((east, north) for east, north in pairs.tolist())


def _check_shares(shares: Sequence[float]) -> None:
    """Refuse shares that are no probabilities."""
    if not (min(shares) >= 0 and abs(sum(shares) - 1) <= ROUNDING):
        raise ValueError(
            "shares of an AUV's hypotheses must be at least 0 and add up to 1, "
            f"got {reprlib.repr([*shares])}"
        )


def _checked_mean(mean: np.ndarray) -> Float[np.ndarray, "4"]:
    """A copy of a mean."""
    x = _floats(mean)
    if x is None or x.shape != (4,):
        raise ValueError(
            "mean of an AUV must be 4 numbers, east [m], north [m], heading [rad] and speed [m/s], "
            f"got {_short(mean)}"
        )
    return x


def _checked_covariance(covariance: np.ndarray) -> Float[np.ndarray, "n n"]:
    """A copy of a covariance."""
    P = _floats(covariance)
    if P is None or P.shape not in ((4, 4), (5, 5)):
        raise ValueError(
            "covariance of an AUV must be 4 x 4, of east [m], north [m], heading [rad] and speed "
            f"[m/s], or 5 x 5, with the depth [m] after them, got {_short(covariance)}"
        )
    if not P.any() or _definite(P) or not np.isfinite(P).all():
        return P
    # in units of the standard deviations, so that metres do not hide radians
    variance = np.maximum(np.abs(np.diagonal(P)), np.finfo(float).eps * np.abs(P).max())
    sigma = np.sqrt(variance)
    correlation = P / sigma[:, None] / sigma
    lopsided = np.abs(correlation - correlation.T)
    if lopsided.max() > ROUNDING:
        i, j = np.unravel_index(lopsided.argmax(), P.shape)
        raise ValueError(
            f"covariance of an AUV must be symmetric, got {P[i, j]:g} at [{i}, {j}] and "
            f"{P[j, i]:g} at [{j}, {i}]"
        )
    if np.linalg.eigvalsh(correlation)[0] < -ROUNDING:
        raise ValueError(
            "covariance of an AUV must be positive semidefinite, that is, give no direction a "
            f"negative variance, got {_short(P)}"
        )
    return P


def _definite(P: Float[np.ndarray, "n n"]) -> bool:
    """Whether a matrix is symmetric and positive definite beyond doubt.

    That is the usual case, and this test the fast one.
    """
    if not (P == P.T).all():
        return False
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        return False
    return True


def _floats(values: object) -> np.ndarray | None:
    """A copy as an array of floats; None where it cannot be one."""
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        return None


def _short(values: object) -> str:
    """What was given, on one line and not too long."""
    return reprlib.repr(values.tolist() if isinstance(values, np.ndarray) else values)
