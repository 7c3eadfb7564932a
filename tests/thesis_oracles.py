"""Path inertia about one AUV at rest, written apart from the library: the exact recurrence, and the continuous limit by integration."""

import math

import numpy as np
from scipy.integrate import solve_ivp


def recurrence(x, y, heading, *, gamma, min_radius, speed, dt, steps):
    """Distances at every step: each turn, clipped to the side of b, is held for dt on an exact arc."""
    s, b = (
        math.cos(heading) * x + math.sin(heading) * y,
        math.sin(heading) * x - math.cos(heading) * y,
    )
    distances = [math.hypot(s, b)]
    for _ in range(steps):
        r = max(abs(b) - gamma / (2 + 2 * gamma), min_radius)
        r = r if b >= 0 else -r
        angle, t = speed * dt / r, b - r
        s, b = (
            s * math.cos(angle) - t * math.sin(angle),
            r + s * math.sin(angle) + t * math.cos(angle),
        )
        distances.append(math.hypot(s, b))
    return np.array(distances)


def turned(x, y, heading, *, gamma, min_radius, speed):
    """(duration, farthest distance) of the leg outward by DOP853 on the unicycle, steering continuously."""

    def rate(_, state):
        px, py, psi = state
        b = math.sin(psi) * px - math.cos(psi) * py
        r = math.copysign(max(abs(b) - gamma / (2 + 2 * gamma), min_radius), b)
        return [speed * math.cos(psi), speed * math.sin(psi), speed / r]

    def away(_, state):
        return state[0] * math.cos(state[2]) + state[1] * math.sin(state[2])

    away.terminal, away.direction = True, -1
    flown = solve_ivp(
        rate, (0, 1e5), [x, y, heading], method="DOP853", rtol=1e-10, atol=1e-10, events=away
    )
    px, py, _ = flown.y_events[0][0]
    return float(flown.t_events[0][0]), math.hypot(px, py)
