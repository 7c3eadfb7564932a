"""What each planner chooses, against brute force, closed forms and arcs in complex numbers."""

import math
import re
import subprocess
import sys

import numpy as np
import pytest
from oracles import AGGREGATES, METRICS, arc, horizon_totals, scenario, told
from scipy.integrate import trapezoid
from scipy.optimize import minimize

import obsplan as op
from formulations.solution import Status

CNA = op.Unicycle(speed=1.0, min_turn_radius=0.5)
HORIZON = 2 * np.pi / 3
NAN, INF = float("nan"), float("inf")


# Path inertia


@pytest.mark.parametrize("gamma", [-0.1, NAN, INF])
def test_path_inertia_refuses_a_gamma_below_zero(gamma):
    with pytest.raises(ValueError, match=f"gamma must be from 0 to 1000000 .*, got {gamma}"):
        op.PathInertia(op.Situation(CNA), gamma=gamma)


MISSPELT = {
    'op.PathInertia(op.Situation(op.Unicycle(speed=1.0, min_turn_radius=0.5)), solver="oqsp")': (
        'solver must be one of closed-form, osqp, .*, got "oqsp"'
    ),
    'from obsplan.sensors.dvl import GroundSpeed; GroundSpeed(direction="up", sigma=0.1)': (
        'direction must be one of forward, left, got "up"'
    ),
    'from obsplan.smoothing.loss import Loss; Loss(kind="hubert")': (
        'kind must be one of geman-mcclure, huber, squares, got "hubert"'
    ),
    'op.Lawnmower(legs=2, length=9.0, spacing=1.0, side="up")': (
        'side must be one of left, right, got "up"'
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("made", MISSPELT)
def test_a_misspelt_choice_given_from_python_is_refused_by_name(made):
    """In a process of its own: here types are checked, and would say it first."""
    line = [sys.executable, "-c", f"import obsplan as op; {made}"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert re.search(f"ValueError: {MISSPELT[made]}", done.stderr)


def test_path_inertia_scores_with_the_condition_number_of_the_inertia_of_its_circle():
    rng = np.random.default_rng(14)
    for objective in ("difference", "condition-number"):
        pose, places = op.Pose(*map(float, rng.uniform(-3, 3, 3))), rng.uniform(-12, 12, (2, 2))
        auvs = [
            op.Belief.at(*map(float, place), weight=weight)
            for place, weight in zip(places, (1.0, 2.0), strict=True)
        ]
        decision = op.PathInertia(op.Situation(CNA), gamma=0.5, objective=objective).plan(
            pose, auvs
        )
        turn = np.linspace(0, 2 * np.pi, 360, endpoint=False)
        r = decision.radius
        circle = np.array([pose.x, pose.y]) + r * np.array(
            [-np.sin(pose.heading), np.cos(pose.heading)]
        )
        circle = circle + abs(r) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        inertia = [
            np.einsum("ti,tj->ij", circle - place, circle - place) for place in places
        ]  # equally spaced: exact
        conditions = [np.linalg.cond(J) for J in inertia]
        np.testing.assert_allclose(decision.condition, conditions, rtol=1e-10)
        assert decision.score == pytest.approx(np.array([1 / 3, 2 / 3]) @ conditions, rel=1e-10)


def test_path_inertia_on_its_limit_says_so_and_turns_to_the_side_of_the_auv():
    near = op.PathInertia(op.Situation(CNA), gamma=0.0)
    left = near.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(3.0, 0.2)])
    right = near.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(3.0, -0.2)])
    ahead = near.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(3.0, 0.0)])
    assert [d.turn_rate for d in (left, right, ahead)] == [2.0, -2.0, 2.0]
    assert {d.status for d in (left, right, ahead)} == {Status.CLIPPED}
    assert near.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(3.0, 4.0)]).status == Status.OPTIMAL


# Gramian horizon


def one_auv(**options):
    """Decision about one AUV at the origin from (1, 0), heading north: the reference of the literature."""
    return told(op.GramianHorizon, CNA, **options).plan(
        op.Pose(1.0, 0.0, np.pi / 2), [op.Belief.at(0.0, 0.0)]
    )


def test_reference_decision_is_1_4_of_21_with_condition_number_8_879():
    decision = one_auv()
    assert decision.turn_rate == pytest.approx(1.4, abs=1e-12)
    assert decision.score == pytest.approx(8.879, abs=5e-4)
    assert decision.condition == pytest.approx(np.array([decision.score]))
    rates = np.linspace(-2, 2, 21)
    totals = horizon_totals(
        [(-1.0, 0.0)], [1.0], rates, speed=1.0, horizon=HORIZON, heading=np.pi / 2
    )
    assert rates[totals.argmin()] == pytest.approx(1.4)
    assert decision.score == pytest.approx(totals.min(), rel=1e-9)


def test_reference_decision_by_the_smallest_eigenvalue_is_0_6():
    assert one_auv(metric="smallest-eigenvalue").turn_rate == pytest.approx(0.6, abs=1e-12)


PLACES, WEIGHTS = np.array([(3.0, 1.5), (-1.0, -2.5), (0.5, 4.0)]), (1.0, 0.0, 2.5)


@pytest.mark.parametrize("aggregate", AGGREGATES)
@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("gramian", ["exact", "thesis", "degrees"])
def test_gramian_horizon_takes_the_best_candidate_of_brute_force(gramian, metric, aggregate):
    planner = op.GramianHorizon(
        op.Situation(CNA),
        gramian=gramian,
        metric=metric,
        aggregate=aggregate,
        turn_rates=9,
        horizon=1.7,
    )
    auvs = [op.Belief.at(*map(float, p), weight=w) for p, w in zip(PLACES, WEIGHTS, strict=True)]
    rates = np.linspace(2, -2, 9)
    brute = {"speed": 1.0, "horizon": 1.7, "variant": gramian, "heading": 0.4}
    totals = horizon_totals(PLACES, WEIGHTS, rates, metric=metric, aggregate=aggregate, **brute)
    decision = planner.plan(op.Pose(0.0, 0.0, 0.4), auvs)
    assert decision.turn_rate == rates[totals.argmin()]
    assert decision.score == pytest.approx(totals.min(), rel=1e-8)
    conditions = [horizon_totals([p], [1.0], [decision.turn_rate], **brute)[0] for p in PLACES]
    np.testing.assert_allclose(decision.condition, conditions, rtol=1e-8)


@pytest.mark.parametrize("weight", [0.0, 0.3, 8.0])
def test_blend_weighs_the_index_beside_the_condition_number(weight):
    planner = op.GramianHorizon(op.Situation(CNA), metric="blend", blend_weight=weight)
    auvs = [op.Belief.at(*map(float, p), weight=w) for p, w in zip(PLACES, WEIGHTS, strict=True)]
    brute = {"speed": 1.0, "horizon": HORIZON, "heading": 0.4}
    of_metric = {
        m: [horizon_totals([p], [1.0], planner.candidates, metric=m, **brute) for p in PLACES]
        for m in ("condition-number", "unobservability-index")
    }
    logs = [np.log(of_metric[m]).T @ WEIGHTS / np.sum(WEIGHTS) for m in of_metric]
    totals = logs[0] + weight * logs[1]
    decision = planner.plan(op.Pose(0.0, 0.0, 0.4), auvs)
    assert decision.turn_rate == planner.candidates[totals.argmin()]
    assert decision.score == pytest.approx(totals.min(), rel=1e-8)


@pytest.mark.slow
def test_metric_and_aggregate_matter_among_those_candidates():
    rates = np.linspace(2, -2, 9)
    chosen = {
        (m, a): rates[
            horizon_totals(
                PLACES, WEIGHTS, rates, speed=1.0, horizon=1.7, heading=0.4, metric=m, aggregate=a
            ).argmin()
        ]
        for m in METRICS
        for a in AGGREGATES
    }
    assert len({chosen[m, "mean"] for m in METRICS}) > 1
    assert any(chosen[m, "mean"] != chosen[m, "max"] for m in METRICS)


def test_empirical_gramian_agrees_with_the_exact_one_to_the_error_of_the_trapezoid_rule():
    exact, empirical = one_auv(), one_auv(gramian="empirical")
    assert empirical.turn_rate == exact.turn_rate
    assert empirical.score != exact.score
    assert empirical.score == pytest.approx(
        exact.score, rel=4e-3
    )  # 6e-4 of the largest entry, times the few that make up σ_min


def test_empirical_gramian_by_name_is_the_trapezoid_sum_of_the_exact_integrand():
    t, u = np.linspace(0.0, HORIZON, 22), 1.4
    poses = np.array([arc((1.0, 0.0, np.pi / 2), u, 1.0, each) for each in t])
    x1, x2 = poses[:, 0], poses[:, 1]
    ranged = 2 * np.stack([x1, x2, x2 * (x1 - 1.0) - x1 * x2], axis=-1)
    W = trapezoid(np.einsum("ti,tj->tij", ranged, ranged), t, axis=0) + np.diag([0.0, 0.0, HORIZON])
    assert one_auv(gramian="empirical").score == pytest.approx(
        np.linalg.cond(W), rel=1e-8
    )  # central differences: about 1e-10


def test_thesis_variant_leaves_the_heading_out_of_the_range_and_decides_otherwise():
    exact, thesis = one_auv(), one_auv(gramian="thesis")
    rates = np.linspace(2, -2, 21)
    totals = horizon_totals(
        [(-1.0, 0.0)], [1.0], rates, speed=1.0, horizon=HORIZON, heading=np.pi / 2, variant="thesis"
    )
    assert thesis.turn_rate == rates[totals.argmin()]
    assert thesis.score == pytest.approx(totals.min(), rel=1e-9)
    assert thesis.score < exact.score / 2


@pytest.mark.parametrize("gramian", ["exact", "thesis", "empirical"])
def test_of_equals_the_leftmost_is_taken(gramian):
    ahead = op.GramianHorizon(op.Situation(CNA), gramian=gramian).plan(
        op.Pose(0.0, 0.0, 0.0), [op.Belief.at(5.0, 0.0)]
    )
    assert ahead.turn_rate > 0
    nudged = op.GramianHorizon(op.Situation(CNA), gramian=gramian).plan(
        op.Pose(0.0, 0.0, 0.0), [op.Belief.at(5.0, -0.1)]
    )
    assert nudged.turn_rate != 0


def test_where_no_candidate_observes_every_auv_it_goes_straight_on_and_says_so():
    far = op.GramianHorizon(op.Situation(CNA)).plan(
        op.Pose(0.0, 0.0, 0.0), [op.Belief.at(1e9, 0.0)]
    )  # the condition number grows as d⁴
    assert far.status == Status.UNOBSERVABLE
    assert far.turn_rate == 0.0


def test_gramian_horizon_looks_two_thirds_of_the_smallest_circle_ahead():
    slow = op.Unicycle(speed=0.7, min_turn_radius=3.0)
    pose, auvs = op.Pose(1.0, 2.0, 0.3), [op.Belief.at(4.0, -3.0)]
    stated = op.GramianHorizon(op.Situation(slow), horizon=2 / 3 * 2 * np.pi * 3.0 / 0.7).plan(
        pose, auvs
    )
    assert op.GramianHorizon(op.Situation(slow)).plan(pose, auvs).score == pytest.approx(
        stated.score, rel=1e-12
    )
    assert op.GramianHorizon(op.Situation(slow)).candidates[[0, -1]] == pytest.approx(
        np.array([0.7 / 3, -0.7 / 3])
    )


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("turn_rates", 1, r"turn_rates must be from 2 to 1001 .*, got 1"),
        ("horizon", 0.0, r"horizon must be from 0.001 to 86400 s .*, got 0.0"),
        ("horizon", NAN, r"horizon must be from 0.001 to 86400 s .*, got nan"),
        ("horizon", INF, r"horizon must be from 0.001 to 86400 s .*, got inf"),
    ],
)
def test_gramian_horizon_refuses_by_name_and_value(option, value, message):
    with pytest.raises(ValueError, match=message):
        told(op.GramianHorizon, CNA, **{option: value})


# Circle


def flown(planner, pose, steps, dt):
    """Poses under a planner asked every dt, on arcs in complex numbers."""
    poses = [np.array([pose.x, pose.y, pose.heading])]
    for _ in range(steps):
        decision = planner.plan(op.Pose(*map(float, poses[-1])), [])
        poses.append(arc(poses[-1], decision.turn_rate, decision.speed, dt))
    return np.array(poses)


@pytest.mark.parametrize("radius", [0.5, 3.0])
def test_circle_starts_on_itself_and_stays_there_over_ten_turns(radius):
    planner = op.Circle(op.Situation(CNA), center=(3.0, -2.0), radius=radius)
    start = planner.initial_pose(op.Pose(10.0, 4.0, 1.0))
    poses = flown(planner, start, 400, 2 * np.pi * radius / 40)
    off = np.hypot(poses[:, 0] - 3.0, poses[:, 1] + 2.0) - radius
    assert np.abs(off).max() < 1e-6
    assert poses[-1, 2] - poses[0, 2] == pytest.approx(20 * np.pi, abs=1e-6)  # counter-clockwise


def test_circle_starts_at_its_point_nearest_to_the_vehicle_on_the_tangent():
    start = op.Circle(op.Situation(CNA), center=(3.0, -2.0), radius=2.0).initial_pose(
        op.Pose(9.0, 6.0, 1.0)
    )  # a 3-4-5 triangle
    assert (start.x, start.y) == pytest.approx((3.0 + 1.2, -2.0 + 1.6))
    assert complex(math.cos(start.heading), math.sin(start.heading)) == pytest.approx(
        complex(-0.8, 0.6)
    )
    there = op.Pose(9.0, 6.0, 1.0)
    assert (
        op.Circle(
            op.Situation(CNA), center=(3.0, -2.0), radius=2.0, start_on_circle=False
        ).initial_pose(there)
        == there
    )


@pytest.mark.parametrize(
    "start", [(40.0, 0.0, 0.0), (-30.0, 30.0, -120.0), (3.0, -2.0, 0.0), (3.5, -2.0, 170.0)]
)
def test_circle_is_reached_from_far_away_and_from_inside(start):
    x, y, heading_deg = start
    circle = {"kind": "circle", "center": (3.0, -2.0), "radius": 4.0, "start_on_circle": False}
    cna = {
        "speed": 1.0,
        "min_turn_radius": 0.5,
        "start": {"x": x, "y": y, "heading_deg": heading_deg},
    }
    run = op.simulate(scenario(planner=circle, cna=cna, time_step=0.1, duration=150.0))
    np.testing.assert_array_equal(run.cna[0, :2], [x, y])
    off = np.hypot(run.cna[-100:, 0] - 3.0, run.cna[-100:, 1] + 2.0) - 4.0
    assert np.abs(off).max() < 0.01


def test_circle_tighter_than_the_vehicle_turns_is_refused():
    with pytest.raises(
        ValueError,
        match=r"radius of the circle must be at least the turning radius 0\.5 m, got 0\.4",
    ):
        op.Circle(op.Situation(CNA), center=(0.0, 0.0), radius=0.4)
    with pytest.raises(
        ValueError,
        match=r"radius must be from 0.001 to 100000 m .*, got nan",
    ):
        op.Circle(op.Situation(CNA), center=(0.0, 0.0), radius=NAN)
    with pytest.raises(
        ValueError, match=r"center of the circle must be finite \[m\], got \(nan, 0\.0\)"
    ):
        op.Circle(op.Situation(CNA), center=(NAN, 0.0), radius=1.0)


def test_circle_of_a_scenario_just_encloses_the_survey_unless_it_is_given():
    mission = scenario(planner={"kind": "circle"})
    points = np.concatenate([reference.polyline for reference in mission.references])
    farthest = lambda center: np.hypot(*(points - center).T).max()  # noqa: E731
    best = minimize(
        farthest,
        points.mean(axis=0),
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 2000},
    )
    circle = mission.planner().circle
    assert circle.radius == pytest.approx(best.fun, rel=1e-6)
    assert farthest((circle.x, circle.y)) == pytest.approx(circle.radius, rel=1e-12)
    assert scenario(planner={"kind": "circle", "radius": 77.0}).planner().circle.radius == 77.0
    moved = scenario(planner={"kind": "circle", "center": (1.0, 2.0)}).planner().circle
    assert (moved.x, moved.y) == (1.0, 2.0)
    with pytest.raises(
        ValueError, match="give center and radius of the circle: no survey is known"
    ):
        op.Circle(op.Situation(CNA), radius=1.0)


# Stationary


def test_stationary_stays():
    decision = op.Stationary().plan(op.Pose(1.0, 2.0, 0.5), [op.Belief.at(0.0, 0.0)])
    assert (decision.turn_rate, decision.speed, decision.status) == (0.0, 0.0, Status.OPTIMAL)
    run = op.simulate(scenario(planner={"kind": "stationary"}))
    assert (run.cna == run.cna[0]).all()
