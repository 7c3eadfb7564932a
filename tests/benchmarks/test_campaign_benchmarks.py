"""One mission of survey-slow, some 3280 steps of 21 candidate turns: in plain numpy as a user would write it, interpreted, and compiled.

Times are recorded, never asserted; every result is checked against the plain one. Compare within one run only:
``pytest tests/benchmarks/test_campaign_benchmarks.py --benchmark-sort=mean``.
"""

from functools import cache

import numpy as np
import pytest

from obsplan.campaign import plan_cells
from obsplan.campaign.worker import Batch, fly_batch
from obsplan.scenario import load
from obsplan.simulation import ClosedLoop

SCENARIO, SEED = "survey-slow", 1
QUADRATURE = (
    16  # points over a horizon in which the integrand turns by at most 8.4 rad: exact to rounding
)
mission = pytest.mark.benchmark(group="one mission of survey-slow")


def plain_numpy(seed):
    """Fly the mission with arrays and loops; return the root mean square and the greatest position error [m]."""
    survey = load(SCENARIO).motions[
        0
    ]  # the track to follow: position, heading and speed at each sample
    dt, speed, limit = 0.1, 1.0, 1.0 / 0.5
    sigma_range, sigma_heading = 2.0, np.deg2rad(1.0)
    noise = np.array([0.02, 0.02, np.deg2rad(0.1), 0.005])  # per square root of a second
    process, measurement, _ = (
        np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)
    )
    steps = len(survey.time) - 1
    first = measurement.standard_normal(4)
    heading_error = measurement.standard_normal(steps) * sigma_heading
    range_error = measurement.standard_normal(steps) * sigma_range
    disturbance = process.standard_normal((steps, 4)) * noise * np.sqrt(dt)

    cna = np.array([1.0, 0.0, np.pi / 2])
    truth = np.array([*survey.position[0], survey.heading[0], survey.speed[0]])
    sigma = np.array([2.0, 2.0, np.deg2rad(1.0), 1.0])
    x, P, Q = (
        np.array([0.0, 0.0, truth[2] + sigma[2] * first[2], 0.0]),
        np.diag(sigma**2),
        np.diag(noise**2 * dt),
    )
    errors = [np.hypot(*(x - truth)[:2])]
    turns = np.linspace(limit, -limit, 21)
    for k in range(steps):
        u = best_turn(cna, truth, turns, speed, horizon=2 / 3 * 2 * np.pi / limit)
        cna = arc(cna, u, speed, dt)
        steer = np.array([survey.heading[k + 1], survey.speed[k + 1]]) - truth[2:]
        F = np.eye(4)
        F[:2, 2], F[:2, 3] = (
            x[3] * dt * np.array([-np.sin(x[2]), np.cos(x[2])]),
            dt * np.array([np.cos(x[2]), np.sin(x[2])]),
        )
        truth = dead_reckoned(truth, steer, dt) + disturbance[k]
        x, P = dead_reckoned(x, steer, dt), F @ P @ F.T + Q
        turned = truth[2] + heading_error[k] - x[2]
        x, P = updated(
            x,
            P,
            np.array([0.0, 0.0, 1.0, 0.0]),
            np.arctan2(np.sin(turned), np.cos(turned)),
            sigma_heading,
        )
        away = x[:2] - cna[:2]
        innovation = np.sum((truth[:2] - cna[:2]) ** 2) + range_error[k] - away @ away
        x, P = updated(x, P, np.array([*(2 * away), 0.0, 0.0]), innovation, sigma_range)
        errors.append(np.hypot(*(x - truth)[:2]))
    return np.sqrt(np.mean(np.square(errors))), np.max(errors)


def dead_reckoned(x, u, dt):
    return np.array(
        [x[0] + x[3] * np.cos(x[2]) * dt, x[1] + x[3] * np.sin(x[2]) * dt, x[2] + u[0], x[3] + u[1]]
    )


def arc(pose, turn, speed, dt):
    chord, course = speed * dt * np.sinc(turn * dt / 2 / np.pi), pose[2] + turn * dt / 2
    return np.array(
        [pose[0] + chord * np.cos(course), pose[1] + chord * np.sin(course), pose[2] + turn * dt]
    )


def updated(x, P, h, innovation, sigma):
    """The Kalman filter's update by one number, Joseph form."""
    K = P @ h / (h @ P @ h + sigma**2)
    A = np.eye(4) - np.outer(K, h)
    return x + K * innovation, A @ P @ A.T + sigma**2 * np.outer(K, K)


def best_turn(cna, auv, turns, speed, horizon):
    """The turn rate whose Gramian of (heading, squared range) over (east, north, heading) has the least condition number."""
    t, weights = unit_quadrature()
    t, weights = t * horizon, weights * horizon
    half = turns[:, None] * t / 2
    chord = speed * t * np.sinc(half / np.pi)
    moved = np.stack([chord * np.cos(cna[2] + half), chord * np.sin(cna[2] + half)])
    at = (cna[:2] - auv[:2])[:, None, None] + moved
    C = 2 * np.stack(
        [at[0], at[1], at[1] * moved[0] - at[0] * moved[1]], axis=-1
    )  # turns, instants, states
    W = np.einsum("t,kti,ktj->kij", weights, C, C)
    W[:, 2, 2] += horizon  # the heading itself
    eigenvalues = np.linalg.eigvalsh(W)
    return turns[np.argmin(eigenvalues[:, -1] / eigenvalues[:, 0])]


@cache
def unit_quadrature():
    points, weights = np.polynomial.legendre.leggauss(QUADRATURE)
    return (points + 1) / 2, weights / 2


@cache
def plain_figures():
    return plain_numpy(SEED)


def agree(run):
    """Equal but for rounding: 3280 steps of 1e-16 each, and a margin of thirty."""
    np.testing.assert_allclose((run.rms_error, run.max_error), plain_figures(), rtol=1e-11)


@mission
def test_plain_numpy(benchmark):
    assert benchmark.pedantic(plain_numpy, args=(SEED,), rounds=2) == plain_figures()


@mission
@pytest.mark.parametrize("compiled", [False, True], ids=["interpreted", "compiled"])
def test_closed_loop(benchmark, compiled):
    scenario = load(SCENARIO)
    loop = ClosedLoop(scenario=scenario, planner=scenario.planner(), compiled=compiled)
    agree(benchmark.pedantic(loop.fly, args=(SEED,), rounds=10, warmup_rounds=1))


@mission
@pytest.mark.parametrize("compiled", [False, True], ids=["interpreted", "compiled"])
def test_mission_of_a_campaign_with_its_figures(benchmark, compiled):
    (cell,) = plan_cells([SCENARIO])
    batch = Batch(1, cell.content, (SEED,), compiled)
    (outcome,) = benchmark.pedantic(fly_batch, args=(batch,), rounds=10, warmup_rounds=1).outcomes
    np.testing.assert_allclose(
        (outcome.figures["rms_error_m"], outcome.figures["max_error_m"]),
        plain_figures(),
        rtol=1e-11,
    )


@pytest.mark.benchmark(group="plan of a campaign")
def test_plan_of_a_grid_of_a_hundred_cells(benchmark):
    values = ",".join(f"{0.5 + 0.1 * k:.1f}" for k in range(10))
    vary = [f"ranging.sigma={values}", f"cna.speed={values}"]
    cells = benchmark.pedantic(
        plan_cells, args=([SCENARIO],), kwargs={"vary": vary, "runs": 1000}, rounds=2
    )
    assert len(cells) == 100
