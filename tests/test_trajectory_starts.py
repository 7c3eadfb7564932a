"""Whether the trajectory program finds the best optimum there is, judged by many starts of IPOPT on the turns alone."""

import casadi as ca
import numpy as np
import pytest
from test_trajectory import DISC, LIMIT, RADIUS, task_of

from formulations.solution import Status
from formulations.trajectory import PathLimits, optimise

STAGES, STEP = 20, 0.25
LEAST, GREATEST = 0.5, 8.0
BULGE = (
    STEP / 2
) ** 2 / 8  # of an arc over its chord between the points looked at, times its curvature
MARGIN = {
    "greatest": BULGE / RADIUS,
    "least": BULGE * (1 / RADIUS + 1 / LEAST),
    "disc": BULGE * (1 / RADIUS + 1 / DISC[2]),
}
STARTS, SAME = 50, 1e-4  # of the score; different optima are 1e-2 apart and more


def poses(rng):
    """Random poses from where one can turn clear of the disc, whatever the heading."""
    while True:
        d, bearing, heading = rng.uniform(1.0, 7.0), *rng.uniform(-np.pi, np.pi, 2)
        x, y = d * np.cos(bearing), d * np.sin(bearing)
        if np.hypot(x - DISC[0], y - DISC[1]) > DISC[2] + 2 * RADIUS + 0.2:
            yield np.array([x, y, heading])


def disc_limits():
    """The true limits: least and greatest distance from the origin, the disc."""

    def off(points, radius):
        return radius - np.hypot(points[..., 0] - DISC[0], points[..., 1] - DISC[1])

    def along(points, _):
        d = np.hypot(points[..., 0], points[..., 1])
        return np.maximum.reduce([off(points, DISC[2]), LEAST - d, d - GREATEST])

    def after(ends):
        left = RADIUS * np.stack([-np.sin(ends[:, 2]), np.cos(ends[:, 2])], axis=-1)
        return np.stack(
            [off(ends[:, :2] + side * left, DISC[2] + RADIUS) for side in (1, -1)], axis=-1
        )

    return PathLimits(along, after)


def single_shooting():
    """IPOPT on the turns alone: (turns, (pose, side)) -> -log det of the Gramian by Simpson's rule, distances as they are."""
    u, given = ca.SX.sym("u", STAGES), ca.SX.sym("given", 4)
    x, y, h, h11, h12, h22, rows = given[0], given[1], given[2], 0.0, 0.0, 0.0, []
    for k in range(STAGES):
        path = [(x, y)]
        for _ in range(2):
            half = u[k] * STEP / 4
            small = ca.fabs(half) < 1e-3
            chord = (
                STEP
                / 2
                * ca.if_else(
                    small,
                    1 - half**2 / 6 + half**4 / 120,
                    ca.sin(half) / ca.if_else(small, 1.0, half),
                )
            )
            x, y, h = x + chord * ca.cos(h + half), y + chord * ca.sin(h + half), h + 2 * half
            path.append((x, y))
            d, off = (
                ca.sqrt(x**2 + y**2 + 1e-12),
                ca.sqrt((x - DISC[0]) ** 2 + (y - DISC[1]) ** 2 + 1e-12),
            )
            rows += [
                d - LEAST - MARGIN["least"],
                GREATEST - MARGIN["greatest"] - d,
                off - DISC[2] - MARGIN["disc"],
            ]
        for (px, py), w in zip(path, np.array([1, 4, 1]) * 4 * STEP / 6, strict=True):
            h11, h12, h22 = h11 + w * px**2, h12 + w * px * py, h22 + w * py**2
    cx, cy = x - given[3] * RADIUS * ca.sin(h), y + given[3] * RADIUS * ca.cos(h)
    rows.append(
        ca.sqrt((cx - DISC[0]) ** 2 + (cy - DISC[1]) ** 2) - DISC[2] - RADIUS - MARGIN["disc"]
    )
    cost = -ca.log(ca.fmax(h11 * h22 - h12**2, 1e-6))
    options = {
        "print_time": False,
        "show_eval_warnings": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 150},
    }
    return ca.nlpsol(
        "turns", "ipopt", {"x": u, "p": given, "f": cost, "g": ca.vertcat(*rows)}, options
    )


def best_known(solver, pose, guesses):
    """Least score of all starts, either circle free at the end."""
    found = []
    for side in (1.0, -1.0):
        for guess in guesses:
            answer = solver(x0=guess, p=[*pose, side], lbx=-LIMIT, ubx=LIMIT, lbg=0.0, ubg=np.inf)
            found += [float(answer["f"])] if solver.stats()["success"] else []
    return min(found)


@pytest.mark.slow
def test_nearly_every_start_is_accepted_at_once_and_ends_at_the_best_known_optimum():
    rng = np.random.default_rng(7)
    solver, asked = single_shooting(), poses(rng)
    guesses = [np.full(STAGES, u) for u in (-2.0, -1.0, 0.0, 1.0, 2.0)] + [
        np.repeat(rng.uniform(-2, 2, 4), 5) for _ in range(7)
    ]
    accepted, best = 0, 0
    for _ in range(STARTS):
        pose = next(asked)
        task = task_of(pose, [(0.0, 0.0)], discs=[DISC], least=LEAST, greatest=GREATEST)
        found = optimise(task, "log-det", limits=disc_limits())
        assert found.status in {Status.OPTIMAL, Status.SECOND_SOLVER, Status.BEST_MANOEUVRE}
        accepted += found.status == Status.OPTIMAL
        best += found.objective <= best_known(solver, pose, [*guesses, found.x[:, 0]]) + SAME
    assert accepted >= 48
    assert best >= 45
