"""The trajectory program under the whole ranging law: growing errors, heights, losses, reach and slots, against numpy written apart."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.optimize import minimize
from test_trajectory import LIMIT, RADIUS, positions, score_of, task_of

import obsplan as op
from formulations.beam_search import search_manoeuvres, turn_candidates
from formulations.model.covariance import Tracks
from formulations.model.ranging import AFAR, EDGE, Ranging
from formulations.model.schedule import Schedule, Stages, intervals
from formulations.solution import Status
from formulations.trajectory import Controls, optimise
from obsplan.planning.situation import Situation

HEIGHTS = (4.0, 7.0)  # [m]
LAWS = {
    "growing": Ranging(0.3, growth=0.2),
    "slant": Ranging(0.5, slant=True),
    "slant and growing": Ranging(0.5, growth=0.1, slant=True),
    "lossy": Ranging(0.5, loss=0.4),
    "half lost": Ranging(0.5, slant=True, loss=0.1, half_distance=6.0),
    "everything": Ranging(0.4, 0, 0.1, True, 0.2, 9.0, 8.0),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def arrives(law, r):
    """Probability that a range comes, as planners count on it."""
    near = 0.5 ** ((r / law.half_distance) ** 2)
    if law.reach < math.inf:
        near /= 1 + math.exp((r / law.reach - 1) / EDGE)
    beyond = AFAR * (1 - near) / (1 + r / law.half_distance + r / law.reach)
    return (1 - law.loss) * (near + beyond)


def after_range(P, x, height, law):
    """Joseph's form with the Jacobian of the range, and its second-order error by the Hessian."""
    h = height if law.slant else 0.0
    r = math.sqrt(x @ x + h**2)
    bent = (np.eye(2) - np.outer(x, x) / r**2) / r @ P[:2, :2]
    R = law.sigma**2 + (law.growth * r) ** 2 + np.trace(bent) ** 2 / 4 + np.trace(bent @ bent) / 2
    H = np.array([[*(x / r), 0.0, 0.0]])
    K = P @ H.T / (H @ P @ H.T + R)
    left = np.eye(4) - K @ H
    return left @ P @ left.T + K * R @ K.T


def after_stage(P, heading, speed, noise, h):
    """Prediction in closed form: the drift is nilpotent."""
    A = np.zeros((4, 4))
    A[:2, 2:] = np.array([[-speed * math.sin(heading), math.cos(heading)],
                          [speed * math.cos(heading), math.sin(heading)]])  # fmt: skip
    F = np.eye(4) + A * h
    Q = np.diag(noise**2 * [1, 1, 0, 1])
    # Simpson's rule is exact: the integrand is a parabola
    parts = [
        (np.eye(4) + A * t) @ Q @ (np.eye(4) + A * t).T * w
        for t, w in ((0.0, h / 6), (h / 2, 4 * h / 6), (h, h / 6))
    ]
    return F @ P @ F.T + sum(parts)


def score(task, rates, comes=arrives):
    """Time mean of the trace; a stage's one range comes with a probability, and the covariance is the mean of both outcomes."""
    total, ends = 0.0, np.cumsum(task.durations)
    law = task.ranging
    places = [positions(task, rates, end) for end in ends]
    for i, weight in enumerate(task.weights / task.weights.sum()):
        P = task.covariance[i]
        for k, h in enumerate(task.durations):
            P = after_stage(P, task.headings[k, i], task.speeds[k, i], task.process_noise[i], h)
            x, height = places[k] - task.positions[2 * k + 2, i], task.heights[2 * k + 2, i]
            if task.pings[k, i]:
                p = comes(law, math.hypot(*x, height if law.slant else 0.0))
                P = (1 - p) * P + p * after_range(P, x, height, law)
            total += weight * np.trace(P[:2, :2]) * h / ends[-1]
    return total


def two_auvs(law, *, N=6, dt=0.8, **change):
    """They move, at two heights that change, and are heard at different times."""
    pings = np.array([[1.0, 0.0, 1.0, 0.0, 1.0, 1.0], [0.0, 1.0, 0.0, 1.0, 0.0, 1.0]]).T[:N]
    task = task_of(
        (2.0, -3.0, 0.7),
        [(0.0, 0.0), (4.0, 1.0)],
        velocities=[[0.3, 0.2], [-0.4, 0.3]],
        N=N,
        dt=dt,
        noise=0.1,
        pings=pings,
        weights=np.array([1.0, 3.0]),
        ranging=law,
        **change,
    )
    return task._replace(heights=HEIGHTS + 0.1 * np.arange(2 * N + 1)[:, None])


@every_law
def test_score_is_that_of_a_filter_under_the_law_at_each_auvs_height_and_pings(law):
    task = two_auvs(law)
    found = optimise(task, "covariance")
    assert found.status == Status.OPTIMAL
    assert found.objective == pytest.approx(score(task, found.x[:, 0]), rel=1e-9)


@every_law
def test_three_turns_are_the_best_of_a_grid_polished_by_slsqp_under_the_law(law):
    task = two_auvs(law, N=3)
    found = optimise(task, "covariance")
    rates = np.linspace(-LIMIT, LIMIT, 5)
    grid = np.array(np.meshgrid(rates, rates, rates)).reshape(3, -1).T
    values = np.array([score(task, u) for u in grid])
    options = {"bounds": [(-LIMIT, LIMIT)] * 3, "method": "SLSQP", "options": {"ftol": 1e-12}}
    polished = (
        minimize(lambda u: score(task, u), grid[k], **options) for k in values.argsort()[:4]
    )
    assert found.objective <= min(best.fun for best in polished) + 1e-6


@pytest.mark.parametrize("law", [LAWS["slant and growing"], Ranging(1.0, growth=0.01, slant=True)])
def test_trajectory_about_an_auv_at_rest_is_no_worse_than_the_beam_searchs_manoeuvre(law):
    N = 8
    task = task_of((9.0, 0.0, 1.0), [(0.0, 0.0)], N=N, dt=1.0, noise=0.05, ranging=law)
    task = task._replace(heights=np.full((2 * N + 1, 1), 5.0))
    searched = search_manoeuvres(
        task.pose,
        task.covariance,
        tracks=Tracks(task.positions[2::2], task.headings, task.speeds, task.heights[2::2]),
        process_noise=task.process_noise,
        weights=task.weights,
        stages=Stages(task.durations, task.pings),
        turn_rates=turn_candidates(1.0 / RADIUS, 7),
        speed=1.0,
        ranging=law,
    )
    found = optimise(task, "covariance")
    assert found.objective == pytest.approx(score(task, found.x[:, 0]), rel=1e-9)
    assert searched.objective == pytest.approx(score(task, searched.x), rel=1e-9)
    assert found.objective < searched.objective  # whose turns are seven


def test_score_under_loss_is_the_average_over_whether_the_one_range_comes():
    law = LAWS["half lost"]
    pings = np.zeros((6, 2))
    pings[3, 1] = 1.0
    task = two_auvs(law)._replace(pings=pings)
    found = optimise(task, "covariance")
    rates = found.x[:, 0]
    lost, come = (score(task, rates, lambda *_, p=p: p) for p in (0.0, 1.0))
    x = positions(task, rates, task.durations[:4].sum()) - task.positions[8, 1]
    p = arrives(law, math.hypot(*x, task.heights[8, 1]))
    assert 0.2 < p < 0.8
    assert found.objective == pytest.approx((1 - p) * lost + p * come, rel=1e-9)
    assert come < 0.95 * lost


def test_law_whose_ranges_always_come_is_that_of_none_that_is_lost():
    sure = two_auvs(Ranging(0.5, half_distance=1e9))
    found, plain = (
        optimise(sure._replace(ranging=r), "covariance") for r in (sure.ranging, Ranging(0.5))
    )
    np.testing.assert_allclose(found.x, plain.x, atol=1e-6)
    assert found.objective == pytest.approx(plain.objective, rel=1e-9)


def weighted_gramians(task, rates):
    """By adaptive quadrature, each range counting as often and as much as the law says."""
    law = task.ranging
    velocity = (task.positions[-1] - task.positions[0]) / task.durations.sum()
    total = task.durations.sum()

    def integrand(t):
        p = positions(task, rates, t) - task.positions[0] - t * velocity
        height = task.heights[0] + t / total * (task.heights[-1] - task.heights[0])
        r = np.sqrt((p**2).sum(axis=1) + (height**2 if law.slant else 0.0))
        w = [arrives(law, each) for each in r] / (1 + (law.growth * r / law.sigma) ** 2)
        return 4 * w[:, None, None] * p[:, :, None] * p[:, None, :]

    ends = np.concatenate([[0.0], np.cumsum(task.durations)])
    return sum(quad_vec(integrand, a, b, epsrel=1e-10)[0] for a, b in pairwise(ends))


@pytest.mark.parametrize("objective", ["log-det", "smallest-eigenvalue", "condition-number"])
def test_gramians_count_ranges_as_the_law_makes_them_less_sure(objective):
    task = two_auvs(LAWS["everything"], dt=0.4, least=0.1)
    found = optimise(task, objective)
    W = weighted_gramians(task, found.x[:, 0])
    expected = task.weights / 4 @ [score_of(objective, each[None]) for each in W]
    assert found.status == Status.OPTIMAL
    assert found.objective == pytest.approx(expected, abs=2e-3)  # Simpson's rule
    plain = optimise(task._replace(ranging=Ranging(0.4)), objective)
    assert abs(found.objective - plain.objective) > 0.05


def test_gramians_of_auvs_at_rest_count_ranges_too():
    law = Ranging(0.3, growth=0.2)
    task = task_of((6.0, 0.0, 1.6), [(0.0, 0.0)], N=6, dt=0.4, ranging=law)
    found = optimise(task, "log-det")
    assert found.status == Status.OPTIMAL
    expected = score_of("log-det", weighted_gramians(task, found.x[:, 0]))
    assert found.objective == pytest.approx(expected, abs=1e-4)


# The planner

CNA = op.Unicycle(speed=2.0, min_turn_radius=10.0)


def believed(x, y, depth=0.0):
    covariance = np.diag([40.0, 30.0, 0.01, 0.01])
    return op.Belief(
        mean=np.array([x, y, 0.3, 1.0]),
        covariance=covariance,
        process_noise=(0.1, 0.01, 0.02),
        depth=depth,
    )


BEYOND = {"reach": Ranging(1.0, reach=300.0), "half distance": Ranging(1.0, half_distance=300.0)}


@pytest.mark.parametrize("ranging", BEYOND.values(), ids=BEYOND)
@pytest.mark.parametrize("kind", [op.Trajectory, op.InformationHorizon])
@pytest.mark.parametrize("distance", [600.0, 6000.0])
def test_vehicle_comes_nearer_from_far_beyond_where_ranges_come(kind, ranging, distance):
    planner = kind(Situation(CNA, ranging=ranging))
    path = planner.plan(op.Pose(0.0, 0.0, 1.5), [believed(distance, 0.0)]).path
    lengths = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    way = lengths.sum() - 10.0 * math.pi  # less the turn at first
    assert path[-1, 0] > 0.8 * way


def test_ranges_are_counted_on_in_each_auvs_slot_where_it_is_not_silent():
    slots, silent = (0.0, 4.0), ((20.0, 33.0),)
    ranging = Ranging(0.7, growth=0.02, slant=True)
    situation = Situation(
        CNA, ranging=ranging, ping_interval=10.0, slots=slots, silent=silent, transducer_depth=3.0
    )
    auvs = [believed(60.0, 10.0, depth=40.0), believed(-20.0, 50.0, depth=25.0)]
    found = op.Trajectory(situation).plan(op.Pose(0.0, 0.0, 0.4), auvs, time=4.0)
    # six intervals and the 13 s of silence in them: 12 stages of 6 s, the first the rest of one
    ends = np.array([2.0, *(2.0 + 6.0 * np.arange(1, 12))])
    total = 0.0
    for auv, slot in zip(auvs, slots, strict=True):
        P, begin = auv.covariance, 0.0
        comes = [t for t in slot + 10.0 * np.arange(1, 12) if not 20.0 <= t <= 33.0]
        for end, pose in zip(ends, found.path[1:], strict=True):
            P = after_stage(P, 0.3, 1.0, np.array([0.1, 0.1, 0.01, 0.02]), end - begin)
            x = pose[:2] - auv.mean[:2] - end * np.array([math.cos(0.3), math.sin(0.3)])
            count = sum(4.0 + begin < t <= 4.0 + end for t in comes)
            assert count <= 1
            if count:
                P = after_range(P, x, auv.depth - 3.0, ranging)
            total += np.trace(P[:2, :2]) * (end - begin) / ends[-1] / 2
            begin = end
    assert found.score == pytest.approx(total, rel=1e-9)


def test_pings_of_a_plain_schedule_are_the_multiples_of_its_interval():
    rng = np.random.default_rng(3)
    for _ in range(50):
        ends = rng.uniform(0, 100) + np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 9.0, 7))])
        interval = rng.uniform(0.5, 20.0)
        counted = Schedule(interval=interval).pings(ends, 2)
        np.testing.assert_array_equal(counted, np.diff(intervals(ends, interval))[:, None] * [1, 1])


def test_silences_put_off_the_horizons_end():
    schedule = Schedule(interval=10.0, silent=((25.0, 40.0), (70.0, 100.0), (500.0, 600.0)))
    assert schedule.span(0.0, 20.0) == 20.0
    assert schedule.span(0.0, 60.0) == 105.0  # both silences
    assert schedule.span(30.0, 20.0) == 30.0  # the rest of one


def test_last_trajectory_is_taken_up_again_under_the_law():
    task = two_auvs(LAWS["everything"])
    first = optimise(task, "covariance")
    again = optimise(task, "covariance", last=Controls(*first.x.T))
    assert again.status == Status.OPTIMAL
    assert again.objective == pytest.approx(first.objective, rel=1e-6)


def test_depth_that_is_no_number_is_said_to_be_invalid():
    planner = op.Trajectory(Situation(CNA, ranging=Ranging(1.0, slant=True)))
    said = planner.plan(op.Pose(0.0, 0.0, 0.4), [believed(60.0, 10.0, depth=math.nan)])
    assert said.status == Status.INVALID_INPUT
