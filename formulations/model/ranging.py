r"""What a range is: its geometry, the travel times it is made of, how it errs, how often it comes.

Two vehicles are a horizontal distance d and a height h apart. A horizontal range measures d, a
slant range :math:`r = \sqrt{d^2 + h^2}`. Its standard deviation and the probability that it arrives
are

.. math:: σ^2(r) = a^2 + (b r)^2, \quad
          p(r) = (1 - l) \, 2^{-(r / r_{1/2})^2} \text{ within reach, else } 0.

Times of flight count from sending to receiving (thesis 2.2). Vehicles move meanwhile: the one that
measures along a straight line, the other on an arc.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

from .casadi import SX

# Of the reach: planners do not know ranges to better than that, so theirs fades out.
EDGE = 0.05
# Of the ranges that are lost by distance, the share that planners count on at least, less and less
# of it as the distance grows: from afar every way would be as good as another, and so nearer is
# better.
AFAR = 0.01
SAME_DEPTH = 1e-6  # [m]; less apart, the speed of sound is that of one depth
NUMBERS = 5  # of a law
LEAST_LOSS = 1e-20  # far below rounding; without it the slope of no ranges at all is 0 * inf


class Form(NamedTuple):
    """What an expression of ranges depends on besides numbers."""

    squared: bool = False
    growing: bool = False  # the error, with distance
    lossy: bool = False
    slant: bool = False


class Ranging(NamedTuple):
    """How ranges err, and which of them come."""

    sigma: float  # a [m]; of a squared range [m^2]
    squared: bool = False
    growth: float = 0.0  # b [m/m]
    slant: bool = False  # heights count
    loss: float = 0.0  # l, the share lost at any distance
    half_distance: float = np.inf  # at which half of the others are lost [m]
    reach: float = np.inf  # [m]

    @property
    def form(self) -> Form:
        """What is there of growth, loss and height."""
        far = self.half_distance < np.inf or self.reach < np.inf
        return Form(self.squared, self.growth > 0, far or self.loss > 0, self.slant)

    @property
    def numbers(self) -> tuple[float, float, float, float, float]:
        """What `law` takes."""
        return self.sigma, self.growth, self.loss, 1 / self.half_distance, 1 / self.reach

    def scaled(self, length: float) -> "Ranging":
        """The same in another unit of length [m]."""
        return self._replace(
            sigma=self.sigma / (length**2 if self.squared else length),
            half_distance=self.half_distance / length,
            reach=self.reach / length,
        )


class Law(NamedTuple):
    """A `Ranging` as an expression, or as numbers or arrays."""

    form: Form
    sigma: Any
    growth: Any = 0.0
    loss: Any = 0.0
    per_half_distance: Any = 0.0
    per_reach: Any = 0.0


def law(form: Form, numbers: SX) -> Law:
    """The law of a column of `NUMBERS`."""
    return Law(form, *ca.vertsplit(numbers))


def law_of(ranging: Ranging) -> Law:
    """The law in numbers."""
    return Law(ranging.form, *ranging.numbers)


def variance(law: Law, r2: Any) -> Any:
    """Variance of a range, or squared range, by the squared range r2: a² + b² r²."""
    if not law.form.growing:
        return law.sigma**2
    return law.sigma**2 + law.growth**2 * r2


def arrival(law: Law, r2: Any, *, edge: float = 0.0) -> Any:
    """Probability that a range arrives, by the squared range r2.

    With an ``edge`` (of the reach) the reach fades out, as planners count on it, and a small share
    (`AFAR`) comes from beyond, so that nearer is better from any distance.
    """
    if not law.form.lossy:
        return 1.0
    near = near_share(law, r2, edge=edge)
    if not edge:
        return (1 - law.loss) * near
    far = AFAR * (1 - near) / (1 + ca.sqrt(r2) * (law.per_half_distance + law.per_reach))
    return (1 - law.loss) * (near + far)


def throughput(r2: Any, per_half_distance: Any, per_reach: Any = 0.0, *, edge: float = 0.0) -> Any:
    """Share of the throughput at no distance that is left: 2^-(r / h)² within reach, as ranges.

    Distances squared are r2 [m^2]; the other two are reciprocals [1/m] of the distance h at which
    half is left, and of the reach. ``edge`` as in `arrival`.
    """
    link = Law(Form(lossy=True), 0.0, per_half_distance=per_half_distance, per_reach=per_reach)
    return arrival(link, r2, edge=edge)


def near_share(law: Law, r2: Any, *, edge: float) -> Any:
    """Share that is not lost by distance, fading out at the reach with an ``edge`` (of it)."""
    within = r2 * law.per_reach**2
    near = ca.exp(-np.log(2.0) * r2 * law.per_half_distance**2)
    if not edge:
        return near * ca.if_else(within <= 1, 1.0, 0.0)
    reached = 1 / (1 + ca.exp(ca.fmin((ca.sqrt(within) - 1) / edge, 500.0)))
    return near * ca.if_else(law.per_reach > 0, reached, 1.0)


def expected_ranges(law: Law, r2: Any, pings: Any) -> tuple[Any, Any]:
    """Probability that any of a number of ranges comes, and how many come then on average.

    The covariance after one range that may be lost is on average the mixture of both outcomes; of
    many ranges nearly the expected number counts.
    """
    if not law.form.lossy:
        return 1.0, pings
    p = arrival(law, r2, edge=EDGE)
    some = 1 - ca.fmax(1 - p, LEAST_LOSS) ** pings
    return some, ca.if_else(some > 0, pings * p / ca.if_else(some > 0, some, 1.0), 0.0)


def one_way_travel_time(flight: Any, turn_around: Any) -> Any:
    """Time of travel one way [s] of a ping and its reply (2.10)."""
    return (flight - turn_around) / 2


def travelled(sound_speed: Any, time: Any) -> Any:
    """Range [m] by the speed of sound and the one-way travel time (2.11)."""
    return sound_speed * time


class Ends(NamedTuple):
    """Where two vehicles are as one of them hears the other, and how they move: expressions.

    Depths are of the transducers; velocities are over ground. The sender may be on an arc.
    """

    receiver: Any  # east, north [m]
    receiver_velocity: Any  # [m/s]
    receiver_depth: Any  # [m]
    sender: Any
    sender_velocity: Any
    sender_turn_rate: Any  # [rad/s]
    sender_depth: Any


def one_way_time(ends: Ends, sound_speed: Any) -> Any:
    r"""Time [s] that a message travelled which arrives now.

    With a the receiver, b the sender now, v its mean velocity meanwhile,

    .. math:: |a - (b - v τ)| = c τ.
    """
    apart, down = ends.receiver - ends.sender, ends.receiver_depth - ends.sender_depth
    away2 = ca.sumsqr(apart) + down**2
    about = _root(away2) / sound_speed
    velocity = mean_velocity(ends.sender_velocity, ends.sender_turn_rate, about)
    return _meeting(apart, away2, velocity, sound_speed)


def two_way_time(ends: Ends, sound_speed: Any, turn_around: Any) -> Any:
    """Half of the time [s] that question and reply travelled; the reply arrives now.

    The vehicle that hears the reply has asked. The other replies a turn-around time [s] after it
    was asked. Both move all the while.
    """
    reply = one_way_time(ends, sound_speed)
    since = reply + turn_around
    moved = mean_velocity(ends.sender_velocity, ends.sender_turn_rate, since) * since
    asked = ends.sender - moved  # where the sender was as the question reached it
    hearer = ends.receiver - ends.receiver_velocity * since  # and the other then
    down = ends.receiver_depth - ends.sender_depth
    apart = asked - hearer
    away2 = ca.sumsqr(apart) + down**2
    question = _meeting(apart, away2, ends.receiver_velocity, sound_speed)
    flight = question + turn_around + reply
    return one_way_travel_time(flight, turn_around)


def mean_velocity(velocity: Any, turn_rate: Any, since: Any) -> Any:
    """Mean velocity [m/s] on an arc that ends at ``velocity``, over the time [s] before."""
    half = turn_rate * since / 2
    small = ca.fabs(half) < 1e-4
    sinc = ca.if_else(small, 1 - half**2 / 6, ca.sin(half) / ca.if_else(small, 1.0, half))
    cos, sin = ca.cos(half), ca.sin(half)
    east, north = velocity[0], velocity[1]
    return sinc * ca.vertcat(cos * east + sin * north, cos * north - sin * east)


def _meeting(apart: Any, away2: Any, velocity: Any, sound_speed: Any) -> Any:
    """Time of a message whose sender moves: the root of |apart + v τ| = c τ."""
    along = ca.dot(apart, velocity)
    rest = sound_speed**2 - ca.sumsqr(velocity)
    return (along + _root(along**2 + rest * away2)) / rest


def _root(squared: Any) -> Any:
    """Square root whose derivative at 0 is 0: there is no direction, and no information."""
    positive = squared > 0
    return ca.if_else(positive, ca.sqrt(ca.if_else(positive, squared, 1.0)), 0.0)


def slant(horizontal2: Any, height: Any) -> Any:
    """Slant range [m] by the squared horizontal distance and the height."""
    return _root(horizontal2 + height**2)


def mean_sound_speed(profile: tuple[tuple[float, float], ...], top: Any, bottom: Any) -> Any:
    """Harmonic mean of the speed of sound [m/s] between two depths [m], as straight rays see it.

    ``profile`` has depths, increasing, and speeds; between them the speed is linear, beyond them it
    stays.
    """
    if len(profile) == 1:
        return profile[0][1]
    span = bottom - top
    apart = ca.fabs(span) > SAME_DEPTH
    slowness = (slow_depth(profile, bottom) - slow_depth(profile, top)) / ca.if_else(
        apart, span, 1.0
    )
    depths, speeds = np.array(profile).T
    return ca.if_else(apart, 1 / ca.if_else(apart, slowness, 1.0), at_depth(depths, speeds, top))


def slow_depth(profile: tuple[tuple[float, float], ...], depth: Any) -> Any:
    """Time [s] that sound takes straight down from the surface to a depth [m]."""
    (first, top_speed), (last, bottom_speed) = profile[0], profile[-1]
    total = ca.fmin(depth, first) / top_speed + ca.fmax(depth - last, 0.0) / bottom_speed
    for (above, upper), (below, lower) in pairwise(profile):
        inside = ca.fmin(ca.fmax(depth, above), below) - above
        slope = (lower - upper) / (below - above)
        total += ca.log1p(slope * inside / upper) / slope if slope else inside / upper
    return total


def at_depth(depths: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], depth: Any) -> Any:
    """A quantity at a depth [m]: linear between ``depths``, constant beyond."""
    value = values[0]
    for k in range(len(depths) - 1):
        inside = ca.fmin(ca.fmax(depth, depths[k]), depths[k + 1]) - depths[k]
        value = value + inside * (values[k + 1] - values[k]) / (depths[k + 1] - depths[k])
    return value
