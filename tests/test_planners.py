"""One contract over every planner and every choice it offers, so that a new file is tested at once."""

import math
from dataclasses import fields, replace
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from oracles import Spy, arc, recording, scenario, told

import obsplan as op
from formulations.solution import Status
from obsplan.planners import DEFAULT_PLANNER, PLANNERS, name_of, planner_class
from obsplan.planning.fallback import unusable
from obsplan.planning.interface import Planner, expression_of

TURN_TOLERANCE = {
    "trajectory": 1e-6
}  # [rad/s]: its solvers stop at 1e-8 of the optimality conditions, to be divided by the curvature
SCORE_TOLERANCE = 1e-8  # relative: of second order in the turn, and what those solvers stop at
ONE_SIDED = {
    "circle",
    "random",
}  # go their way in a mirror, too: the mirror image is another planner
COSTLY = {
    "trajectory",
    "whole-mission",
    "rolling",
    "empirical",
    "cvxpy-osqp",
}  # planners and choices that take a second or so to build or to decide
FEW = {"whole-mission": {"starts": 2}, "rolling": {"starts": 2}}  # options that make searches short
WORLDS = 3  # that a costly one is asked of
LASTS = {"trajectory": 6.0, "whole-mission": 6.0, "rolling": 6.0}  # flights of a search [s]
BESIDES = [
    ("path-inertia", {"gamma": 0.0}),
    ("path-inertia", {"change_weight": 0.5}),
    ("path-inertia", {"max_radius": 8.0}),
]


def variants():
    """Every planner as it comes, and with each of its named choices."""
    yield from BESIDES
    for name in PLANNERS:
        cls = planner_class(name)
        defaults = {f.name: f.default for f in fields(cls)}
        yield name, {}
        for option, hint in get_type_hints(cls).items():
            choices = get_args(hint) if get_origin(hint) is Literal else ()
            yield from (
                (name, {option: choice}) for choice in choices if choice != defaults[option]
            )


def costly(name, options):
    return not COSTLY.isdisjoint([name, *options.values()])


def marks(name, options):
    return [pytest.mark.slow] if costly(name, options) else []


def worlds(name, options, usual):
    """How many worlds a planner is asked of."""
    return WORLDS if costly(name, options) else usual


every_planner = pytest.mark.parametrize(
    ("name", "options"),
    [
        pytest.param(*v, id="-".join(map(str, [v[0], *v[1].values()])), marks=marks(*v))
        for v in variants()
    ],
)
every_plain_planner = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=marks(name, {})) for name in PLANNERS]
)


def world(rng):
    """Two AUVs on courses of their own, some metres from the aid vehicle."""
    legs = rng.uniform(-12, 12, (2, 2, 2))
    pose = op.Pose(
        *map(float, (*rng.uniform(-12, 12, 2), rng.uniform(-3, 3))), float(rng.uniform(-0.3, 0.3))
    )
    return pose, legs


def built(name, options, legs):
    """The planner as a scenario with these surveys builds it."""
    mission = scenario(
        planner={"kind": name} | FEW.get(name, {}) | options,
        auv__0__survey={"kind": "waypoints", "points": legs[0].tolist()},
        auv__1__survey={"kind": "waypoints", "points": legs[1].tolist()},
    )
    planner = mission.planner()
    if name in ("whole-mission", "rolling", "trajectory", "stationary", "circle"):
        return planner
    # the others look at no surveys: without these, planners of other worlds are equal, and their
    # expressions are built once
    situation = replace(planner.situation, filed=None, survey_circle=None)
    return replace(planner, situation=situation)


def beliefs(legs, weights=(1.0, 2.0)):
    """Each AUV at the first point of its leg, sailing along it, twice as sure of its place across as along."""
    believed = []
    for leg, weight in zip(legs, weights, strict=True):
        heading = math.atan2(*(leg[1] - leg[0])[::-1])
        turn = np.eye(4)
        turn[:2, :2] = rotation(heading)
        covariance = turn @ np.diag([4.0, 1.0, 0.01, 0.04]) @ turn.T
        believed.append(
            op.Belief.at(
                *map(float, leg[0]),
                heading=heading,
                speed=1.0,
                covariance=covariance,
                weight=weight,
            )
        )
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
    return all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True)
        for name in ("turn_rate", "speed", "path", "score", "status", "condition")
    )


@every_planner
def test_depth_that_an_auv_estimates_changes_no_decision_by_horizontal_ranges(name, options):
    rng = np.random.default_rng(15)
    pose, legs = world(rng)
    flat, deep = beliefs(legs), []
    for auv in flat:
        P = np.diag([0.0, 0.0, 0.0, 0.0, 9.0])
        P[:4, :4] = auv.covariance
        deep.append(replace(auv, covariance=P))
    planner = built(name, options, legs)
    expected, found = planner.plan(pose, flat), planner.plan(pose, deep)
    assert (found.turn_rate, found.speed) == (expected.turn_rate, expected.speed)
    assert found.status == expected.status


@every_planner
def test_decision_is_finite_within_the_limits_and_starts_where_the_vehicle_is(name, options):
    rng = np.random.default_rng(1)
    limit = 2.0 / 5.0  # of the scenario's vehicle
    for _ in range(worlds(name, options, 8)):
        pose, legs = world(rng)
        planner = built(name, options, legs)
        decision = planner.plan(pose, beliefs(legs), time=3.0)
        assert isinstance(decision, op.Decision)
        assert isinstance(planner, Planner)
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
    for _ in range(worlds(name, options, 5)):
        pose, legs = world(rng)
        decision = built(name, options, legs).plan(pose, beliefs(legs))
        if decision.speed == 0:
            continue  # it stays where it is
        chord = math.dist(decision.path[1, :2], decision.path[0, :2])
        turned = decision.path[1, 2] - pose.heading
        dt = turned / decision.turn_rate if decision.turn_rate else chord / decision.speed
        assert 0 < dt < np.inf
        np.testing.assert_allclose(
            decision.path[1],
            arc((pose.x, pose.y, pose.heading), decision.turn_rate, decision.speed, dt),
            atol=1e-9,
        )


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
    for _ in range(worlds(name, options, 5)):
        pose, legs = world(rng)
        there, moved = turned(pose, legs, 0.7, np.array([31.0, -17.0]))
        here = built(name, options, legs).plan(pose, beliefs(legs))
        elsewhere = built(name, options, moved).plan(there, beliefs(moved))
        assert elsewhere.turn_rate == pytest.approx(
            here.turn_rate, abs=TURN_TOLERANCE.get(name, 1e-9)
        )
        assert elsewhere.speed == pytest.approx(here.speed, abs=1e-9)
        np.testing.assert_allclose(
            elsewhere.condition, here.condition, rtol=1e-3
        )  # empirical: 1e-10 / epsilon, times the condition


# Worlds that are their own mirror image, or have no direction at all: the aid vehicle's place, on its
# way east, and each AUV's place, heading [rad] and speed [m/s].
TIES = {
    "away from it": ((60.0, 0.0), [(0.0, 0.0, 0.0, 0.0)]),
    "towards it": ((-20.0, 0.0), [(0.0, 0.0, 0.0, 1.0)]),
    "far away": ((300.0, 0.0), [(0.0, 0.0, 0.0, 0.0)]),
    "on top": ((0.0, 0.0), [(0.0, 0.0, 0.0, 0.0)]),
    "between two": ((0.0, 0.0), [(10.0, 6.0, 0.0, 1.0), (10.0, -6.0, 0.0, 1.0)]),
    "beside two that part": ((0.0, 0.0), [(10.0, 6.0, 0.0, 1.0), (10.0, 6.0, math.pi, 1.0)]),
}
ANGLES = 2.0 * math.pi * np.arange(24) / 24
UNTURNED = {"random", "stationary", "whole-mission", "rolling"}  # by the surveys, or not by AUVs


def turned_tie(place, auvs, angle):
    """A world of ``TIES`` seen from axes that are turned."""
    R, believed = rotation(angle), []
    for *at, heading, speed in auvs:
        covariance = np.diag([4.0, 4.0, 0.01, 0.04])
        x, y = (R @ at).tolist()
        believed.append(
            op.Belief.at(x, y, heading=heading + angle, speed=speed, covariance=covariance)
        )
    x, y = (R @ place).tolist()
    return op.Pose(x, y, angle), believed


@every_planner
def test_ties_are_decided_alike_wherever_north_is(name, options):
    if name in UNTURNED:
        return
    cna = op.Unicycle(speed=2.0, min_turn_radius=5.0)
    given = {"center": (0.0, 0.0), "radius": 20.0} if name == "circle" else options
    planner = told(planner_class(name), cna, ping_interval=2.0, sigma=1.0, **given)
    angles = ANGLES[:: 4 if costly(name, options) else 1]
    for which, tie in TIES.items():
        decisions = [planner.plan(*turned_tie(*tie, angle)) for angle in angles]
        turns = [decision.turn_rate for decision in decisions]
        close = {"atol": TURN_TOLERANCE.get(name, 1e-9), "err_msg": which}
        np.testing.assert_allclose(turns, turns[0], **close)
        assert len({decision.status for decision in decisions}) == 1, which


@pytest.mark.parametrize("solver", ["closed-form", "osqp", "clarabel"])
def test_path_inertia_turns_left_on_a_tie_and_right_a_hair_beside_it(solver):
    cna = op.Unicycle(speed=1.0, min_turn_radius=0.5)
    planner = op.PathInertia(op.Situation(cna), solver=solver)
    for angle in ANGLES:
        for beside, turn in ((0.0, 2.0), (1e-6, 2.0), (-1e-6, -2.0)):
            pose, believed = turned_tie((2.0, 0.0), [(0.0, 0.0, 0.0, 0.0)], angle)
            pose = replace(pose, heading=pose.heading + beside)
            assert planner.plan(pose, believed).turn_rate == pytest.approx(turn)


@every_planner
def test_planner_turns_the_other_way_in_the_mirror(name, options):
    if name in ONE_SIDED:
        return
    rng = np.random.default_rng(5)
    for _ in range(worlds(name, options, 5)):
        pose, legs = world(rng)
        there, moved = mirrored(pose, legs)
        here, mirror = (
            built(name, options, at).plan(p, beliefs(at))
            for p, at in ((pose, legs), (there, moved))
        )
        assert mirror.turn_rate == pytest.approx(
            -here.turn_rate, abs=TURN_TOLERANCE.get(name, 1e-9)
        )


@every_planner
def test_auv_of_weight_zero_has_no_say(name, options):
    pose, legs = world(np.random.default_rng(6))
    planner = built(name, options, legs)
    unheard, alone = (
        planner.plan(pose, beliefs(legs, (1.0, 0.0))),
        planner.plan(pose, beliefs(legs[:1], (1.0,))),
    )
    assert unheard.turn_rate == pytest.approx(alone.turn_rate, abs=TURN_TOLERANCE.get(name, 1e-9))
    assert unheard.score == pytest.approx(alone.score, rel=SCORE_TOLERANCE)
    assert unheard.condition.shape == (2,)


@every_planner
def test_weights_count_relative_to_each_other(name, options):
    pose, legs = world(np.random.default_rng(7))
    planner = built(name, options, legs)
    light, heavy = (planner.plan(pose, beliefs(legs, w)) for w in ((0.5, 1.5), (2.0, 6.0)))
    assert heavy.turn_rate == pytest.approx(light.turn_rate, abs=TURN_TOLERANCE.get(name, 1e-9))
    assert heavy.score == pytest.approx(light.score, rel=SCORE_TOLERANCE)


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
    assert (
        decision.turn_rate == blind.turn_rate
    )  # as if there were no AUV: straight on, unless the planner looks at none
    assert decision.status == (
        Status.INVALID_INPUT if blind.status == Status.NO_TARGETS else Status.OPTIMAL
    )


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
def test_expression_guards_itself_where_there_is_nothing_to_plan_for(name, options):
    pose, legs = world(np.random.default_rng(16))
    planner, (good, bad) = built(name, options, legs), beliefs(legs)
    if expression_of(planner) is None:
        return  # it is never folded
    cases = [(pose, [good, replace(bad, weight=weight)], 0.0) for weight in (0.0, 2.0)]
    cases += [(worse, [good, bad], 0.0) for worse in BAD_POSES]
    cases += [(pose, [replace(good, weight=0.0), replace(bad, weight=0.0)], 0.0)]
    cases += [
        (pose, [good, replace(bad, mean=np.where(np.arange(4) == k, NAN, bad.mean))], 0.0)
        for k in range(4)
    ]
    for pose, auvs, time in cases:
        decision = planner.plan(pose, auvs, time=time)
        expected = unusable(op.Unicycle(speed=2.0, min_turn_radius=5.0), pose, auvs)
        looks_at_auvs = name not in ("circle", "stationary")
        if expected is None or not (looks_at_auvs or expected.status == Status.INVALID_INPUT):
            assert decision.status not in (Status.NO_TARGETS, Status.INVALID_INPUT)
        elif looks_at_auvs:
            assert same(decision, expected)
        elif pose in BAD_POSES:
            assert (decision.status, decision.turn_rate) == (Status.INVALID_INPUT, 0.0)


@every_plain_planner
def test_a_hundred_auvs_are_no_obstacle(name):
    rng = np.random.default_rng(12)
    pose, legs = world(rng)
    crowd = [
        op.Belief.at(*map(float, rng.normal(0, 20, 2)), heading=1.0, speed=1.0) for _ in range(100)
    ]
    decision = built(name, {}, legs).plan(pose, crowd)
    assert decision.status in (Status.OPTIMAL, Status.CLIPPED)
    assert decision.condition.shape == (100,)
    assert np.isfinite(decision.turn_rate)


@every_planner
@pytest.mark.parametrize("knowledge", ["truth", "estimate", "survey"])
def test_folded_into_the_step_or_called_between_steps_the_run_is_the_same_to_the_last_bit(
    name, options, knowledge
):
    planner = {"kind": name, "interval": 1.0, "knowledge": knowledge} | FEW.get(name, {}) | options
    mission = scenario(planner=planner, duration=LASTS.get(name, 20.0))
    spy = Spy(mission.planner())
    folded, walked = op.simulate(mission), op.simulate(mission, planner=spy)
    assert recording(walked) == recording(folded)
    assert [time for time, *_ in spy.said] == list(np.arange(0.0, LASTS.get(name, 20.0)))
    for k, (_, pose, auvs, decision) in enumerate(spy.said):
        np.testing.assert_array_equal([pose.x, pose.y, pose.heading], folded.cna[2 * k])
        assert pose.turn_rate == (folded.turn_rate[2 * k - 1] if k else 0.0)
        assert decision.turn_rate == folded.turn_rate[2 * k] == folded.turn_rate[2 * k + 1]
        assert decision.speed == folded.speed[2 * k] == folded.speed[2 * k + 1]
        if knowledge == "truth":
            np.testing.assert_array_equal([auv.mean for auv in auvs], folded.truth[:, 2 * k])


@every_planner
def test_closed_loop_without_a_weight_says_there_are_no_targets(name, options):
    mission = scenario(
        planner={"kind": name} | FEW.get(name, {}) | options,
        auv__0__weight=0.0,
        auv__1__weight=0.0,
        duration=3.0,
    )
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
