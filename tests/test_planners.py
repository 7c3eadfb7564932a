"""One contract over every planner and every choice it offers, so that a new file is tested at once; then each one's own claims."""

import math
from dataclasses import fields, replace
from typing import Literal, get_args, get_origin, get_type_hints

import casadi as ca
import numpy as np
import pytest
from oracles import AGGREGATES, METRICS, Spy, arc, horizon_totals, recording, scenario

import obsplan as op
from formulations.solution import Status
from obsplan.planners import DEFAULT_PLANNER, PLANNERS, name_of, planner_class
from obsplan.planners.protocol import columns, compiled, expression_of

ONE_SIDED = {"circle"}  # goes round counter-clockwise, so its mirror image is another planner
CNA = op.Unicycle(speed=1.0, min_turn_radius=0.5)
HORIZON = 2 * np.pi / 3


BESIDES = [("path-inertia", {"gamma": 0.0}), ("path-inertia", {"change_weight": 0.5}), ("path-inertia", {"max_radius": 8.0})]


def variants():
    """Every planner as it comes, and with each of its named choices."""
    yield from BESIDES
    for name in PLANNERS:
        cls = planner_class(name)
        defaults = {f.name: f.default for f in fields(cls)}
        yield name, {}
        for option, hint in get_type_hints(cls).items():
            choices = get_args(hint) if get_origin(hint) is Literal else ()
            yield from ((name, {option: choice}) for choice in choices if choice != defaults[option])


every_planner = pytest.mark.parametrize(
    ("name", "options"), [pytest.param(*v, id="-".join(map(str, [v[0], *v[1].values()]))) for v in variants()]
)
every_plain_planner = pytest.mark.parametrize("name", PLANNERS)


def world(rng):
    """Two AUVs on courses of their own, some metres from the aid vehicle."""
    legs = rng.uniform(-12, 12, (2, 2, 2))
    pose = op.Pose(*map(float, (*rng.uniform(-12, 12, 2), rng.uniform(-3, 3))), float(rng.uniform(-0.3, 0.3)))
    return pose, legs


def built(name, options, legs):
    """The planner as a scenario with these surveys builds it."""
    mission = scenario(
        planner={"kind": name, **options},
        auv__0__survey={"kind": "waypoints", "points": legs[0].tolist()},
        auv__1__survey={"kind": "waypoints", "points": legs[1].tolist()},
    )
    return mission.planner()


def beliefs(legs, weights=(1.0, 2.0)):
    """Each AUV at the first point of its leg, sailing along it, twice as sure of its place across as along."""
    believed = []
    for leg, weight in zip(legs, weights, strict=True):
        heading = math.atan2(*(leg[1] - leg[0])[::-1])
        turn = np.eye(4)
        turn[:2, :2] = rotation(heading)
        covariance = turn @ np.diag([4.0, 1.0, 0.01, 0.04]) @ turn.T
        believed.append(op.Belief.at(*map(float, leg[0]), heading=heading, speed=1.0, covariance=covariance, weight=weight))
    return believed


def rotation(angle):
    """Turn a vector counter-clockwise."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def turned(pose, legs, angle, shift):
    """The same world seen from axes turned and moved."""
    R = rotation(angle)
    x, y = R @ [pose.x, pose.y] + shift
    return op.Pose(float(x), float(y), pose.heading + angle, pose.turn_rate), legs @ R.T + shift


def mirrored(pose, legs):
    """The same world in a mirror along the east axis."""
    return op.Pose(pose.x, -pose.y, -pose.heading, -pose.turn_rate), legs * [1.0, -1.0]


def same(a, b):
    """Whether two decisions are the same to the last bit."""
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=True) for f in fields(op.Decision))


@every_planner
def test_decision_is_finite_within_the_limits_and_starts_where_the_vehicle_is(name, options):
    rng = np.random.default_rng(1)
    limit = 2.0 / 5.0  # of the scenario's vehicle
    for _ in range(20):
        pose, legs = world(rng)
        planner = built(name, options, legs)
        decision = planner.plan(pose, beliefs(legs), time=3.0)
        assert isinstance(decision, op.Decision)
        assert isinstance(planner, op.planners.protocol.Planner)
        assert abs(decision.turn_rate) <= limit * (1 + 1e-15)
        assert 0.0 <= decision.speed < np.inf
        assert decision.status in (Status.OPTIMAL, Status.CLIPPED)
        assert np.isfinite([decision.turn_rate, decision.speed, decision.score]).all()
        assert np.isfinite(decision.path).all()
        assert decision.condition.shape == (2,)
        np.testing.assert_array_equal(decision.path[0], [pose.x, pose.y, pose.heading])


@every_planner
def test_predicted_path_begins_on_the_arc_of_the_decision(name, options):
    rng = np.random.default_rng(2)
    for _ in range(5):
        pose, legs = world(rng)
        decision = built(name, options, legs).plan(pose, beliefs(legs))
        if decision.speed == 0:
            continue  # it stays where it is
        chord = math.dist(decision.path[1, :2], decision.path[0, :2])
        turned = decision.path[1, 2] - pose.heading
        dt = turned / decision.turn_rate if decision.turn_rate else chord / decision.speed
        assert 0 < dt < np.inf
        np.testing.assert_allclose(decision.path[1], arc((pose.x, pose.y, pose.heading), decision.turn_rate, decision.speed, dt), atol=1e-9)


@every_planner
def test_same_question_gets_the_same_answer_also_from_an_equal_planner(name, options):
    pose, legs = world(np.random.default_rng(3))
    one, other = built(name, options, legs), built(name, options, legs)
    assert one == other
    assert hash(one) == hash(other)
    asked = [planner.plan(pose, beliefs(legs), time=1.0) for planner in (one, other, one)]
    assert same(asked[0], asked[1])
    assert same(asked[0], asked[2])


@every_planner
def test_planner_turns_with_the_world(name, options):
    rng = np.random.default_rng(4)
    for _ in range(10):
        pose, legs = world(rng)
        there, moved = turned(pose, legs, 0.7, np.array([31.0, -17.0]))
        here = built(name, options, legs).plan(pose, beliefs(legs))
        elsewhere = built(name, options, moved).plan(there, beliefs(moved))
        assert elsewhere.turn_rate == pytest.approx(here.turn_rate, abs=1e-9)
        assert elsewhere.speed == pytest.approx(here.speed, abs=1e-9)
        np.testing.assert_allclose(elsewhere.condition, here.condition, rtol=1e-3)  # empirical: 1e-10 / epsilon, times the condition


@every_planner
def test_planner_turns_the_other_way_in_the_mirror(name, options):
    if name in ONE_SIDED:
        return
    rng = np.random.default_rng(5)
    for _ in range(10):
        pose, legs = world(rng)
        there, moved = mirrored(pose, legs)
        here, mirror = (built(name, options, at).plan(p, beliefs(at)) for p, at in ((pose, legs), (there, moved)))
        assert mirror.turn_rate == pytest.approx(-here.turn_rate, abs=1e-9)


@every_planner
def test_auv_of_weight_zero_has_no_say(name, options):
    pose, legs = world(np.random.default_rng(6))
    planner = built(name, options, legs)
    unheard, alone = planner.plan(pose, beliefs(legs, (1.0, 0.0))), planner.plan(pose, beliefs(legs[:1], (1.0,)))
    assert unheard.turn_rate == pytest.approx(alone.turn_rate, abs=1e-12)
    assert unheard.score == pytest.approx(alone.score, rel=1e-12)
    assert unheard.condition.shape == (2,)


@every_planner
def test_weights_count_relative_to_each_other(name, options):
    pose, legs = world(np.random.default_rng(7))
    planner = built(name, options, legs)
    light, heavy = (planner.plan(pose, beliefs(legs, w)) for w in ((0.5, 1.5), (2.0, 6.0)))
    assert heavy.turn_rate == pytest.approx(light.turn_rate, abs=1e-12)
    assert heavy.score == pytest.approx(light.score, rel=1e-12)


NAN, INF = float("nan"), float("inf")
BAD_POSES = [op.Pose(NAN, 0.0, 0.0), op.Pose(0.0, INF, 0.0), op.Pose(0.0, 0.0, NAN)]


@every_planner
@pytest.mark.parametrize("pose", BAD_POSES, ids=["nan", "inf", "nan-heading"])
def test_pose_that_is_no_number_is_answered_straight_on_with_the_reason(name, options, pose):
    _, legs = world(np.random.default_rng(8))
    decision = built(name, options, legs).plan(pose, beliefs(legs))
    assert decision.status == Status.INVALID_INPUT
    assert decision.turn_rate == 0.0
    assert np.isfinite(decision.speed)


@every_planner
@pytest.mark.parametrize("entry", [0, 1, 2, 3])
def test_belief_that_is_no_number_never_raises_nor_turns_into_a_command(name, options, entry):
    pose, legs = world(np.random.default_rng(9))
    good, bad = beliefs(legs)
    mean = bad.mean.copy()
    mean[entry] = NAN
    decision = built(name, options, legs).plan(pose, [good, replace(bad, mean=mean)])
    blind = built(name, options, legs).plan(pose, [])
    assert decision.turn_rate == blind.turn_rate  # as if there were no AUV: straight on, unless the planner looks at none
    assert decision.status == (Status.INVALID_INPUT if blind.status == Status.NO_TARGETS else Status.OPTIMAL)


@every_planner
def test_without_an_auv_to_plan_for_there_is_a_decision_that_says_so(name, options):
    pose, legs = world(np.random.default_rng(10))
    planner = built(name, options, legs)
    nobody, unwanted = planner.plan(pose, []), planner.plan(pose, beliefs(legs, (0.0, 0.0)))
    assert nobody.status == unwanted.status
    assert nobody.status in (Status.NO_TARGETS, Status.OPTIMAL)
    assert nobody.turn_rate == unwanted.turn_rate
    assert np.isfinite(nobody.path).all()
    if nobody.status == Status.NO_TARGETS:
        assert nobody.turn_rate == 0.0


@every_planner
def test_on_top_of_an_auv_there_is_a_decision(name, options):
    _, legs = world(np.random.default_rng(11))
    pose = op.Pose(*map(float, legs[0, 0]), 0.3)
    decision = built(name, options, legs).plan(pose, beliefs(legs[:1], (1.0,)))
    assert np.isfinite([decision.turn_rate, decision.speed]).all()
    assert abs(decision.turn_rate) <= 0.4 * (1 + 1e-15)
    assert isinstance(decision.status, Status)


@every_planner
def test_folded_expression_guards_itself_as_plan_does(name, options):
    pose, legs = world(np.random.default_rng(16))
    planner, (good, bad) = built(name, options, legs), beliefs(legs)
    if expression_of(planner) is None:
        return  # it is never folded
    cases = [(pose, [good, replace(bad, weight=weight)], 0.0) for weight in (0.0, 2.0)]
    cases += [(worse, [good, bad], 0.0) for worse in BAD_POSES]
    cases += [(pose, [replace(good, weight=0.0), replace(bad, weight=0.0)], 0.0)]
    cases += [(pose, [good, replace(bad, mean=np.where(np.arange(4) == k, NAN, bad.mean))], 0.0) for k in range(4)]
    for pose, auvs, time in cases:
        decision = planner.plan(pose, auvs, time=time)
        state = [pose.x, pose.y, pose.heading, pose.turn_rate]
        answer = compiled(planner, 2).call([ca.DM(time), ca.DM(state), *columns(auvs)])
        turn_rate, speed, score, condition, status = (v.full().ravel() for v in answer)
        assert (turn_rate[0], speed[0], status[0]) == (decision.turn_rate, decision.speed, decision.status)
        if np.isfinite(state).all():
            np.testing.assert_array_equal(score, decision.score)
            np.testing.assert_array_equal(condition, decision.condition)


@every_plain_planner
def test_a_hundred_auvs_are_no_obstacle(name):
    rng = np.random.default_rng(12)
    pose, legs = world(rng)
    crowd = [op.Belief.at(*map(float, rng.normal(0, 20, 2)), heading=1.0, speed=1.0) for _ in range(100)]
    decision = built(name, {}, legs).plan(pose, crowd)
    assert decision.status in (Status.OPTIMAL, Status.CLIPPED)
    assert decision.condition.shape == (100,)
    assert np.isfinite(decision.turn_rate)


@every_planner
@pytest.mark.parametrize("knowledge", ["truth", "estimate", "survey"])
def test_folded_into_the_step_or_called_between_steps_the_run_is_the_same_to_the_last_bit(name, options, knowledge):
    mission = scenario(planner={"kind": name, "interval": 1.0, "knowledge": knowledge, **options})
    spy = Spy(mission.planner())
    folded, walked = op.simulate(mission), op.simulate(mission, planner=spy)
    assert recording(walked) == recording(folded)
    assert [time for time, *_ in spy.said] == [0.0 + k for k in range(20)]
    for k, (_, pose, auvs, decision) in enumerate(spy.said):
        np.testing.assert_array_equal([pose.x, pose.y, pose.heading], folded.cna[2 * k])
        assert pose.turn_rate == (folded.turn_rate[2 * k - 1] if k else 0.0)
        assert decision.turn_rate == folded.turn_rate[2 * k] == folded.turn_rate[2 * k + 1]
        assert decision.speed == folded.speed[2 * k] == folded.speed[2 * k + 1]
        if knowledge == "truth":
            np.testing.assert_array_equal([auv.mean for auv in auvs], folded.truth[:, 2 * k])


@every_planner
def test_closed_loop_without_a_weight_says_there_are_no_targets(name, options):
    mission = scenario(planner={"kind": name, **options}, auv__0__weight=0.0, auv__1__weight=0.0, duration=3.0)
    folded, walked = op.simulate(mission), op.simulate(mission, planner=Spy(mission.planner()))
    np.testing.assert_array_equal(folded.turn_rate, walked.turn_rate)
    np.testing.assert_array_equal(folded.status, walked.status)
    np.testing.assert_array_equal(folded.score, walked.score)


@every_plain_planner
def test_name_in_files_is_the_planners_own(name):
    _, legs = world(np.random.default_rng(13))
    assert name_of(built(name, {}, legs)) == name


def test_default_planner_is_one_of_them_and_a_users_planner_has_its_classs_name():
    assert planner_class("default") is planner_class(DEFAULT_PLANNER)
    assert name_of(Spy(None)) == "Spy"


# Path inertia


@pytest.mark.parametrize("gamma", [-0.1, NAN, INF])
def test_path_inertia_refuses_a_gamma_below_zero(gamma):
    with pytest.raises(ValueError, match=f"gamma must be zero or positive and finite, got {gamma}"):
        op.PathInertia(CNA, gamma=gamma)


def test_path_inertia_scores_with_the_condition_number_of_the_inertia_of_its_circle():
    rng = np.random.default_rng(14)
    for objective in ("difference", "condition-number"):
        pose, legs = world(rng)
        decision = op.PathInertia(CNA, gamma=0.5, objective=objective).plan(pose, beliefs(legs))
        turn = np.linspace(0, 2 * np.pi, 360, endpoint=False)
        r = decision.radius
        circle = np.array([pose.x, pose.y]) + r * np.array([-np.sin(pose.heading), np.cos(pose.heading)])
        circle = circle + abs(r) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        inertia = [np.einsum("ti,tj->ij", circle - leg[0], circle - leg[0]) for leg in legs]  # equally spaced: exact
        conditions = [np.linalg.cond(J) for J in inertia]
        np.testing.assert_allclose(decision.condition, conditions, rtol=1e-10)
        assert decision.score == pytest.approx(np.array([1 / 3, 2 / 3]) @ conditions, rel=1e-10)


def test_path_inertia_on_its_limit_says_so_and_turns_to_the_side_of_the_auv():
    near = op.PathInertia(CNA, gamma=0.0)
    left = near.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(3.0, 0.2)])
    right = near.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(3.0, -0.2)])
    ahead = near.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(3.0, 0.0)])
    assert [d.turn_rate for d in (left, right, ahead)] == [2.0, -2.0, 2.0]
    assert {d.status for d in (left, right, ahead)} == {Status.CLIPPED}
    assert near.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(3.0, 4.0)]).status == Status.OPTIMAL


# Gramian horizon


def one_auv(**options):
    """Decision about one AUV at the origin from (1, 0), heading north: the reference of the literature."""
    return op.GramianHorizon(CNA, **options).plan(op.Pose(1.0, 0.0, np.pi / 2), [op.Belief.at(0.0, 0.0)])


def test_reference_decision_is_1_4_of_21_with_condition_number_8_879():
    decision = one_auv()
    assert decision.turn_rate == pytest.approx(1.4, abs=1e-12)
    assert decision.score == pytest.approx(8.879, abs=5e-4)
    assert decision.condition == pytest.approx(np.array([decision.score]))
    rates = np.linspace(-2, 2, 21)
    totals = horizon_totals([(-1.0, 0.0)], [1.0], rates, speed=1.0, horizon=HORIZON, heading=np.pi / 2)
    assert rates[totals.argmin()] == pytest.approx(1.4)
    assert decision.score == pytest.approx(totals.min(), rel=1e-9)


def test_reference_decision_by_the_smallest_eigenvalue_is_0_6():
    assert one_auv(metric="smallest-eigenvalue").turn_rate == pytest.approx(0.6, abs=1e-12)


PLACES, WEIGHTS = np.array([(3.0, 1.5), (-1.0, -2.5), (0.5, 4.0)]), (1.0, 0.0, 2.5)


@pytest.mark.parametrize("aggregate", AGGREGATES)
@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("gramian", ["exact", "thesis"])
def test_gramian_horizon_takes_the_best_candidate_of_brute_force(gramian, metric, aggregate):
    planner = op.GramianHorizon(CNA, gramian=gramian, metric=metric, aggregate=aggregate, turn_rates=9, horizon=1.7)
    auvs = [op.Belief.at(*map(float, p), weight=w) for p, w in zip(PLACES, WEIGHTS, strict=True)]
    rates = np.linspace(2, -2, 9)
    brute = {"speed": 1.0, "horizon": 1.7, "variant": gramian, "heading": 0.4}
    totals = horizon_totals(PLACES, WEIGHTS, rates, metric=metric, aggregate=aggregate, **brute)
    decision = planner.plan(op.Pose(0.0, 0.0, 0.4), auvs)
    assert decision.turn_rate == rates[totals.argmin()]
    assert decision.score == pytest.approx(totals.min(), rel=1e-8)
    conditions = [horizon_totals([p], [1.0], [decision.turn_rate], **brute)[0] for p in PLACES]
    np.testing.assert_allclose(decision.condition, conditions, rtol=1e-8)


def test_metric_and_aggregate_matter_among_those_candidates():
    rates = np.linspace(2, -2, 9)
    chosen = {
        (m, a): rates[horizon_totals(PLACES, WEIGHTS, rates, speed=1.0, horizon=1.7, heading=0.4, metric=m, aggregate=a).argmin()]
        for m in METRICS
        for a in AGGREGATES
    }
    assert len({chosen[m, "mean"] for m in METRICS}) > 1
    assert any(chosen[m, "mean"] != chosen[m, "max"] for m in METRICS)


def test_empirical_gramian_agrees_with_the_exact_one_to_the_error_of_the_trapezoid_rule():
    exact, empirical = one_auv(), one_auv(gramian="empirical")
    assert empirical.turn_rate == exact.turn_rate
    assert empirical.score != exact.score
    assert empirical.score == pytest.approx(exact.score, rel=4e-3)  # 6e-4 of the largest entry, times the few that make up σ_min


def test_empirical_gramian_by_name_is_the_trapezoid_sum_of_the_exact_integrand():
    t, u = np.linspace(0.0, HORIZON, 22), 1.4
    poses = np.array([arc((1.0, 0.0, np.pi / 2), u, 1.0, each) for each in t])
    x1, x2 = poses[:, 0], poses[:, 1]
    ranged = 2 * np.stack([x1, x2, x2 * (x1 - 1.0) - x1 * x2], axis=-1)
    W = np.trapezoid(np.einsum("ti,tj->tij", ranged, ranged), t, axis=0) + np.diag([0.0, 0.0, HORIZON])
    assert one_auv(gramian="empirical").score == pytest.approx(np.linalg.cond(W), rel=1e-8)  # central differences: about 1e-10


def test_thesis_variant_leaves_the_heading_out_of_the_range_and_decides_otherwise():
    exact, thesis = one_auv(), one_auv(gramian="thesis")
    rates = np.linspace(2, -2, 21)
    totals = horizon_totals([(-1.0, 0.0)], [1.0], rates, speed=1.0, horizon=HORIZON, heading=np.pi / 2, variant="thesis")
    assert thesis.turn_rate == rates[totals.argmin()]
    assert thesis.score == pytest.approx(totals.min(), rel=1e-9)
    assert thesis.score < exact.score / 2


@pytest.mark.parametrize("gramian", ["exact", "thesis", "empirical"])
def test_of_equals_the_leftmost_is_taken(gramian):
    ahead = op.GramianHorizon(CNA, gramian=gramian).plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(5.0, 0.0)])
    assert ahead.turn_rate > 0
    nudged = op.GramianHorizon(CNA, gramian=gramian).plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(5.0, -0.1)])
    assert nudged.turn_rate != 0


def test_where_no_candidate_observes_every_auv_it_goes_straight_on_and_says_so():
    far = op.GramianHorizon(CNA).plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(1e9, 0.0)])  # the condition number grows as d⁴
    assert far.status == Status.UNOBSERVABLE
    assert far.turn_rate == 0.0


def test_gramian_horizon_looks_two_thirds_of_the_smallest_circle_ahead():
    slow = op.Unicycle(speed=0.7, min_turn_radius=3.0)
    pose, auvs = op.Pose(1.0, 2.0, 0.3), [op.Belief.at(4.0, -3.0)]
    stated = op.GramianHorizon(slow, horizon=2 / 3 * 2 * np.pi * 3.0 / 0.7).plan(pose, auvs)
    assert op.GramianHorizon(slow).plan(pose, auvs).score == pytest.approx(stated.score, rel=1e-12)
    assert op.GramianHorizon(slow).candidates[[0, -1]] == pytest.approx(np.array([0.7 / 3, -0.7 / 3]))


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("turn_rates", 1, "turn_rates must be at least 2 candidates, got 1"),
        ("horizon", 0.0, r"horizon must be positive and finite \[s\], got 0.0"),
        ("horizon", NAN, r"horizon must be positive and finite \[s\], got nan"),
        ("horizon", INF, r"horizon must be positive and finite \[s\], got inf"),
    ],
)
def test_gramian_horizon_refuses_by_name_and_value(option, value, message):
    with pytest.raises(ValueError, match=message):
        op.GramianHorizon(CNA, **{option: value})


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
    planner = op.Circle(CNA, center=(3.0, -2.0), radius=radius)
    start = planner.initial_pose(op.Pose(10.0, 4.0, 1.0))
    poses = flown(planner, start, 400, 2 * np.pi * radius / 40)
    off = np.hypot(poses[:, 0] - 3.0, poses[:, 1] + 2.0) - radius
    assert np.abs(off).max() < 1e-6
    assert poses[-1, 2] - poses[0, 2] == pytest.approx(20 * np.pi, abs=1e-6)  # counter-clockwise


def test_circle_starts_at_its_point_nearest_to_the_vehicle_on_the_tangent():
    start = op.Circle(CNA, center=(3.0, -2.0), radius=2.0).initial_pose(op.Pose(9.0, 6.0, 1.0))  # a 3-4-5 triangle
    assert (start.x, start.y) == pytest.approx((3.0 + 1.2, -2.0 + 1.6))
    assert complex(math.cos(start.heading), math.sin(start.heading)) == pytest.approx(complex(-0.8, 0.6))
    there = op.Pose(9.0, 6.0, 1.0)
    assert op.Circle(CNA, center=(3.0, -2.0), radius=2.0, start_on_circle=False).initial_pose(there) == there


@pytest.mark.parametrize("start", [(40.0, 0.0, 0.0), (-30.0, 30.0, -2.0), (3.0, -2.0, 0.0), (3.5, -2.0, 3.0)])
def test_circle_is_reached_from_far_away_and_from_inside(start):
    planner = op.Circle(CNA, center=(3.0, -2.0), radius=4.0, start_on_circle=False)
    poses = flown(planner, op.Pose(*start), 1500, 0.1)
    off = np.hypot(poses[-100:, 0] - 3.0, poses[-100:, 1] + 2.0) - 4.0
    assert np.abs(off).max() < 0.01


def test_circle_tighter_than_the_vehicle_turns_is_refused():
    with pytest.raises(ValueError, match=r"radius of the circle must be at least the turning radius 0\.5 m, got 0\.4"):
        op.Circle(CNA, center=(0.0, 0.0), radius=0.4)
    with pytest.raises(ValueError, match=r"radius of the circle must be at least the turning radius 0\.5 m, got nan"):
        op.Circle(CNA, center=(0.0, 0.0), radius=NAN)
    with pytest.raises(ValueError, match=r"center of the circle must be finite \[m\], got \(nan, 0\.0\)"):
        op.Circle(CNA, center=(NAN, 0.0), radius=1.0)


def test_circle_of_a_scenario_just_encloses_the_survey():
    _, legs = world(np.random.default_rng(15))
    planner = built("circle", {}, legs)
    points = legs.reshape(-1, 2)
    distance = np.hypot(*(points - planner.center).T)
    assert planner.radius == pytest.approx(distance.max(), rel=1e-9)
    assert (np.isclose(distance, planner.radius, rtol=1e-9)).sum() >= 2  # it touches them: none smaller encloses
    assert built("circle", {"radius": 77.0}, legs).radius == 77.0
    assert built("circle", {"center": (1.0, 2.0)}, legs).center == (1.0, 2.0)


# Stationary


def test_stationary_stays():
    decision = op.Stationary().plan(op.Pose(1.0, 2.0, 0.5), [op.Belief.at(0.0, 0.0)])
    assert (decision.turn_rate, decision.speed, decision.status) == (0.0, 0.0, Status.OPTIMAL)
    run = op.simulate(scenario(planner={"kind": "stationary"}))
    assert (run.cna == run.cna[0]).all()
