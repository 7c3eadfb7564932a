"""What path inertia does about one AUV at rest, and the numbers that claims are about.

The closed forms hold as the time step goes to 0. Notation of thesis chapter 3: s is how far [m] the
AUV is behind the aid vehicle and b how far [m] it is to the left of its heading line, d² = s² + b².
τ = γ / (2(1 + γ)) is what the penalty takes off the radius [m], r the smallest radius [m] and V the
speed [m/s].
"""

import math
from typing import Literal

import numpy as np
from jaxtyping import Float

from formulations.path_inertia import lateral_offset, longitudinal_offset, radius_threshold

RIGHT_ANGLE = 1e-9  # [m]; |s| below it is rounding of a right angle

Class = Literal["outward", "right", "inward"]


def offsets(
    pose: Float[np.ndarray, "*batch 3"],
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """Return (s, b) about an AUV at the origin."""
    x, y, heading = np.moveaxis(np.asarray(pose), -1, 0)
    return longitudinal_offset(x, y, heading), lateral_offset(x, y, heading)


def initial_class(s: float) -> Class:
    """Return the thesis's class: the AUV behind, abeam or ahead.

    The angle between the heading and the ray to the AUV is then obtuse, right or acute.
    """
    return "right" if abs(s) < RIGHT_ANGLE else "outward" if s > 0 else "inward"


def is_monotone(distance: Float[np.ndarray, " samples"], s: float, slack: float) -> bool:
    """Whether the distance only grows (s > 0), or falls and then only grows (s < 0).

    This is the claim of section 5.1.1 on Figure 5.3. ``slack`` [m] is what a single step may go
    the other way.
    """
    turn = 0 if s > 0 else int(distance.argmin())
    change = np.diff(distance)
    return bool((change[:turn] <= slack).all() and (change[turn:] >= -slack).all())


def involute_distance(
    time: Float[np.ndarray, " samples"], s: float, b: float, speed: float
) -> Float[np.ndarray, " samples"]:
    """Return d(t) for γ = 0 and no clip, d² = d0² + 2 V s t.

    The path is the involute of the circle of radius |s|.
    """
    return np.sqrt(np.maximum(s**2 + b**2 + 2.0 * speed * s * np.asarray(time), 0.0))


def unclipped(s: float, b: float, min_radius: float, speed: float) -> float:
    """Return the time [s] until |b| has fallen to the smallest radius, for γ = 0.

    The closed form ends there. An outward start never gets there.
    """
    return (b**2 - min_radius**2) / (2.0 * speed * -s) if s < 0 else math.inf


def nearest_pass(s: float, b: float, min_radius: float) -> float:
    """Return the distance [m] at which an inward start (s < 0) passes the AUV, for γ = 0.

    It is 0 unless the pass lies inside the smallest circle. From |b| = r on, the distance of the
    AUV from that circle's centre does not change; it is |s| if the start was outside the clip. A
    distance of r leads straight to the AUV, a smaller one past it.
    """
    return max(0.0, min_radius - math.hypot(s, min(abs(b) - min_radius, 0.0)))


def outward_leg(s: float, b: float, *, gamma: float, speed: float) -> tuple[float, float]:
    r"""Return duration [s] and farthest distance [m] of the first leg outward.

    For γ > 0 and s > 0, from outside the clip.

    .. math:: T = \frac{\rho s + s^3 / (3\tau)}{V \tau}, \quad
              d = \rho + \frac{s^2}{2\tau} + \tau, \quad \rho = |b| - \tau

    As γ → 0 the duration grows as 4s³/(3Vγ²), without bound. As γ → ∞ it falls to
    (2(|b| - ½)s + 4s³/3)/V, not to 0.
    """
    tau = radius_threshold(gamma)
    rho = abs(b) - tau
    duration = (rho * s + s**3 / (3.0 * tau)) / (speed * tau)
    farthest = rho + s**2 / (2.0 * tau) + tau
    return duration, farthest


def orbit_bound(gamma: float, min_radius: float) -> float:
    r"""Return how far [m] any start ends up orbiting at most, for γ > 0.

    .. math:: (r + \tau)^2 / (2\tau)

    The distance of the AUV from the centre of the smallest circle survives each turn. If it is
    above r, the aid vehicle comes to head at the AUV, passes it, and has it at exactly r from
    then on. It leaves the clip at s² = r² - τ², goes to r + τ + s²/(2τ) and comes back. The bound
    is 9/8 m for the thesis's γ = 1 and r = 0.5 m.
    """
    tau = radius_threshold(gamma)
    return (min_radius + tau) ** 2 / (2.0 * tau)


def capture_time(s: float, b: float, *, gamma: float, min_radius: float, speed: float) -> float:
    """Return the time [s] until the aid vehicle is in its last orbit, γ > 0: see `orbit_bound`."""
    tau, t, path = radius_threshold(gamma), abs(b) - min_radius, 0.0
    # on the smallest circle until the AUV is r + τ abeam
    if s > 0 and t < tau and math.hypot(s, t) > min_radius:
        away = math.hypot(s, t)
        path += min_radius * (math.asin(tau / away) - math.asin(t / away))
        s, t = math.sqrt(away**2 - tau**2), tau
    if t >= tau:  # ds/dt = -Vτ/ρ and s² + 2τρ constant, until ρ = r
        constant = s**2 + 2.0 * tau * (t + min_radius - tau)
        end = math.sqrt(constant - 2.0 * tau * min_radius)
        path += (constant * (s + end) - (s**3 + end**3) / 3.0) / (2.0 * tau**2)
        s, t = -end, tau
    away = math.hypot(s, t)
    if away <= min_radius:
        return path / speed
    straight = math.sqrt(away**2 - min_radius**2)
    # on the smallest circle until the AUV is ahead
    path += min_radius * (math.asin(t / away) + math.asin(min_radius / away))
    return (path + straight) / speed


def first_turn(distance: Float[np.ndarray, " samples"]) -> int:
    """Return the sample at which the distance first stops growing; the last if it never does."""
    change = np.diff(distance)
    turned = np.flatnonzero((change[:-1] > 0) & (change[1:] <= 0))
    return int(turned[0]) + 1 if turned.size else len(distance) - 1


def fit_circle(
    position: Float[np.ndarray, "samples 2"],
) -> tuple[Float[np.ndarray, " 2"], float, float]:
    """Return centre, radius and root mean square misfit [m] of the circle that fits best.

    Least squares of ‖p‖² = 2 p·c + (R² - ‖c‖²).
    """
    middle = position.mean(axis=0)
    p = position - middle
    solution = np.linalg.lstsq(
        np.column_stack([2.0 * p, np.ones(len(p))]), (p**2).sum(axis=1), rcond=None
    )[0]
    center, radius = solution[:2], math.sqrt(solution[2] + solution[:2] @ solution[:2])
    misfit = np.hypot(*(p - center).T) - radius
    return center + middle, radius, float(np.sqrt(np.mean(misfit**2)))
