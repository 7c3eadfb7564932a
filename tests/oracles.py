"""Plain Python and numpy written apart from the library, and scenarios small enough to run by the hundred."""

import cmath
import math
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import quad_vec

from formulations.model.ranging import Ranging
from obsplan.planning.situation import Situation
from obsplan.scenario import from_dict


def scenario(**change):
    """A short mission of two AUVs, 80 m from the aid vehicle; keys with __ reach into tables, a number being an AUV's."""
    auv = {
        "first_estimate": {"sigma_position": 2.0},
        "process_noise": {"position": 0.05, "heading_deg": 0.5, "speed": 0.02},
    }
    data = {
        "time_step": 0.5,
        "duration": 20.0,
        "origin": {"lat": 47.6, "lon": -122.3},
        "cna": {
            "speed": 2.0,
            "min_turn_radius": 5.0,
            "start": {"x": 80.0, "y": -30.0, "heading_deg": 140.0},
        },
        "auv": [
            {
                "name": "a",
                "speed": 1.5,
                "survey": {"kind": "waypoints", "points": [[0.0, 0.0], [9.0, 4.0], [9.0, 30.0]]},
                **auv,
            },
            {
                "name": "b",
                "speed": 1.0,
                "survey": {"kind": "waypoints", "points": [[5.0, -20.0], [-30.0, -25.0]]},
                **auv,
            },
        ],
        "ranging": {"interval": 2.0, "sigma": 1.0, "heading_sigma_deg": 1.0},
        "planner": {"kind": "path-inertia", "interval": 1.0, "knowledge": "truth"},
    }
    for key, value in change.items():
        *path, last = key.split("__")
        table = data
        for name in path:
            table = table[int(name)] if name.isdigit() else table.setdefault(name, {})
        table[int(last) if last.isdigit() else last] = value
    return from_dict(data)


@dataclass
class Spy:
    """A user's planner that is no expression: asks another one, and remembers what was said."""

    planner: object
    said: list = field(default_factory=list)

    def plan(self, pose, auvs, *, time=0.0):
        decision = self.planner.plan(pose, auvs, time=time)
        self.said.append((time, pose, auvs, decision))
        return decision

    def initial_pose(self, pose):
        return self.planner.initial_pose(pose) if hasattr(self.planner, "initial_pose") else pose

    def for_mission(self, seed):
        self.planner = (
            self.planner.for_mission(seed) if hasattr(self.planner, "for_mission") else self.planner
        )
        return self


class Silent:
    """In place of the random generators: no noise at all."""

    @staticmethod
    def standard_normal(shape):
        return np.zeros(shape)


def recording(run):
    """Every number of a run, as bytes."""
    names = (
        "time",
        "cna",
        "turn_rate",
        "speed",
        "truth",
        "mean",
        "covariance",
        "range",
        "condition",
        "score",
        "status",
    )
    return {name: getattr(run, name).tobytes() for name in names}


def arc(pose, turn_rate, speed, dt):
    """Pose after dt on a circle, in complex numbers."""
    x, y, heading = pose
    turned = turn_rate * dt
    along = speed * dt if turned == 0 else speed / (1j * turn_rate) * (cmath.exp(1j * turned) - 1)
    place = complex(x, y) + along * cmath.exp(1j * heading)
    return np.array([place.real, place.imag, heading + turned])


def inertia_recurrence(s, b, *, gamma, r_min, speed, dt, steps):
    """(s, b) of path inertia about one AUV at rest, each turn held for dt: shrink, clip to the side of b, turn on the circle."""
    states = [(s, b)]
    for _ in range(steps):
        shrunk = abs(b) - gamma / (2.0 * (1.0 + gamma))
        r = math.copysign(max(shrunk, r_min), 1.0 if b >= 0 else -1.0)
        theta, t = speed * dt / r, b - r
        s, b = (
            s * math.cos(theta) - t * math.sin(theta),
            r + s * math.sin(theta) + t * math.cos(theta),
        )
        states.append((s, b))
    return np.array(states)


def offsets(pose, auv):
    """(s, b): how far the AUV lies behind and to the left of poses (n x 3), by turning the world until the vehicle heads east."""
    seen = [(complex(*auv) - complex(x, y)) * cmath.exp(-1j * heading) for x, y, heading in pose]
    return np.array([(-z.real, z.imag) for z in seen])


def gramian(x, heading, turn_rate, speed, horizon, variant="exact"):
    """Gramian of (ψ, x1² + x2²) over (x1, x2, ψ) by adaptive quadrature; the thesis lets ψ move no later position."""

    def integrand(t):
        px, py, _ = arc((*x, heading), turn_rate, speed, t)
        by_heading = 0.0 if variant == "thesis" else 2 * (py * (px - x[0]) - px * (py - x[1]))
        unit = np.pi / 180 if variant == "degrees" else 1.0  # a degree in radians
        J = np.array([[0.0, 0.0, 1.0], [2 * px, 2 * py, by_heading * unit]])
        return J.T @ J

    return quad_vec(integrand, 0.0, horizon, epsabs=1e-13, epsrel=1e-13)[0]


METRICS = {
    "condition-number": lambda e: e[-1] / e[0],
    "unobservability-index": lambda e: 1 / e[0],
    "smallest-eigenvalue": lambda e: -e[0],
    "log-det": lambda e: -np.log(e).sum(),
    "trace-inverse": lambda e: (1 / e).sum(),
    "blend": lambda e: np.log(e[-1] / e[0]) + np.log(1 / e[0]),
}

AGGREGATES = {
    "mean": lambda scores, share: share @ scores,
    "rms": lambda scores, share: np.sqrt(share @ scores**2),
    "max": lambda scores, share: scores[share > 0].max(),
}


def horizon_totals(
    positions,
    weights,
    rates,
    *,
    speed,
    horizon,
    metric="condition-number",
    aggregate="mean",
    variant="exact",
    heading=0.0,
):
    """Score of each candidate turn rate from an aid vehicle at the origin; lower is better."""
    totals = []
    for u in rates:
        eigenvalues = [
            np.linalg.eigvalsh(gramian((-x, -y), heading, u, speed, horizon, variant))
            for x, y in positions
        ]
        scores = np.array([METRICS[metric](e) for e in eigenvalues])
        totals.append(AGGREGATES[aggregate](scores, np.asarray(weights) / np.sum(weights)))
    return np.array(totals)


@dataclass
class NumpyEkf:
    """The AUV's filter with Jacobians by hand: state (x, y, ψ, V), turn and change of speed measured."""

    x: np.ndarray
    P: np.ndarray
    Q: np.ndarray
    dt: float
    current: tuple

    def predict(self, turn, faster):
        _, _, psi, v = self.x
        c, s = math.cos(psi), math.sin(psi)
        moved = np.array([v * c + self.current[0], v * s + self.current[1]]) * self.dt
        F = np.eye(4)
        F[:2, 2:] = self.dt * np.array([[-v * s, c], [v * c, s]])
        self.x = self.x + np.array([*moved, turn, faster])
        self.P = F @ self.P @ F.T + self.Q

    def heading(self, z, sigma):
        self._correct(
            np.array([0.0, 0.0, 1.0, 0.0]), math.remainder(z - self.x[2], 2 * math.pi), sigma
        )

    def range(self, z, beacon, sigma, squared):
        away = self.x[:2] - beacon
        d = math.hypot(*away)
        H, h = (2 * away, d * d) if squared else (away / d, d)
        self._correct(np.array([*H, 0.0, 0.0]), z - h, sigma)

    def _correct(self, H, innovation, sigma):
        gain = self.P @ H / (H @ self.P @ H + sigma**2)
        self.x = self.x + gain * innovation
        self.P = self.P - np.outer(gain, H @ self.P)


def told(planner, cna, *, sigma=1.0, ranging_kind="range", **given):
    """A planner of a class: what is its situation's goes there, the rest is its options."""
    names = ("ping_interval", "heading_sigma", "decision_interval", "constraints", "filed")
    known = {name: given.pop(name) for name in names if name in given}
    ranging = Ranging(sigma, squared=ranging_kind == "squared-range")
    return planner(Situation(cna, ranging=ranging, **known), **given)
