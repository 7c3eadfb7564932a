"""What the trajectory planner does in a mission, and when nothing is as it should be."""

import pickle
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import shapely
from oracles import Spy, arc, recording, scenario, told
from test_planners import beliefs, rotation, world

import obsplan as op
from formulations.solution import Status
from formulations.trajectory.program import Answer, Program, program
from obsplan.constraints import Constraints, Disc, Polygon

TURN_TOLERANCE = (
    1e-6  # [rad/s]: solved to 1e-8 of the optimality conditions, to be divided by the curvature
)
CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)
RUNGS = {
    Status.OPTIMAL,
    Status.RESTARTED,
    Status.SECOND_SOLVER,
    Status.BEST_MANOEUVRE,
}  # all limits kept
SAID = {Status.SOFTENED, Status.VIOLATED}
OBJECTIVES = ["covariance", "log-det", "smallest-eigenvalue", "condition-number"]
NAN = float("nan")


def planner(**options):
    return told(op.Trajectory, CNA, **{"ping_interval": 2.0, "sigma": 1.0, **options})


every_objective = pytest.mark.parametrize("objective", OBJECTIVES)


# The contract of planners


@pytest.mark.slow
@every_objective
def test_decision_is_finite_within_the_limits_and_starts_where_the_vehicle_is(objective):
    rng = np.random.default_rng(1)
    for _ in range(10):
        pose, legs = world(rng)
        decision = planner(objective=objective).plan(pose, beliefs(legs), time=3.0)
        assert decision.status == Status.OPTIMAL
        assert abs(decision.turn_rate) <= 0.4 * (1 + 1e-15)
        assert decision.speed == 2.0
        assert np.isfinite(decision.score)
        np.testing.assert_array_equal(decision.path[0], [pose.x, pose.y, pose.heading])
        dt = 2.0 - 3.0 % 2.0  # 20 s in 12 stages of whole decisions: the rest of the second
        np.testing.assert_allclose(
            decision.path[1], arc(decision.path[0], decision.turn_rate, 2.0, dt), atol=1e-9
        )
        assert (
            np.isnan(decision.condition).all()
            if objective == "covariance"
            else np.all(decision.condition >= 1.0)
        )


@pytest.mark.slow
@every_objective
def test_planner_turns_with_the_world_and_the_other_way_in_the_mirror(objective):
    rng = np.random.default_rng(4)
    for _ in range(5):
        pose, legs = world(rng)
        R, shift = rotation(0.7), np.array([31.0, -17.0])
        there = op.Pose(
            *map(float, R @ [pose.x, pose.y] + shift), pose.heading + 0.7, pose.turn_rate
        )
        here, elsewhere, mirror = (
            planner(objective=objective).plan(p, beliefs(at))
            for p, at in (
                (pose, legs),
                (there, legs @ R.T + shift),
                (op.Pose(pose.x, -pose.y, -pose.heading, -pose.turn_rate), legs * [1.0, -1.0]),
            )
        )
        assert elsewhere.turn_rate == pytest.approx(
            here.turn_rate, abs=1e-6
        )  # tolerance 1e-8 over the curvature
        assert mirror.turn_rate == pytest.approx(-here.turn_rate, abs=1e-6)
        assert elsewhere.score == pytest.approx(here.score, rel=1e-9, abs=1e-9)


@pytest.mark.slow
def test_precise_squared_ranges_are_planned_for_by_optima():
    """Iterates whose covariances are far from what their turns lead to are indefinite: without a bound on that, most of these fail."""
    rng = np.random.default_rng(5)
    worlds = [world(rng) for _ in range(12)]
    said = Counter(
        planner(ranging_kind="squared-range").plan(pose, beliefs(legs)).status
        for pose, legs in worlds
    )
    assert said == {Status.OPTIMAL: 12}


@pytest.mark.slow
def test_memory_is_no_part_of_a_planner_and_two_missions_of_one_are_the_same():
    mission = scenario(planner={"kind": "information", "interval": 1.0})
    one, other = planner(), planner()
    runs = [op.simulate(mission, planner=p) for p in (one, one, other)]
    assert recording(runs[0]) == recording(runs[1]) == recording(runs[2])
    assert one == planner()
    assert hash(one) == hash(planner())
    assert pickle.loads(pickle.dumps(one)) == one
    assert repr(one) == repr(planner())


def test_asked_again_at_the_same_time_it_answers_the_same():
    pose, legs = world(np.random.default_rng(3))
    one = planner()
    first, again = (one.plan(pose, beliefs(legs), time=1.0) for _ in range(2))
    assert (first.turn_rate, first.score, first.status) == (
        again.turn_rate,
        again.score,
        again.status,
    )


@pytest.mark.slow
@every_objective
def test_auv_of_weight_zero_has_no_say_and_weights_count_relative_to_each_other(objective):
    pose, legs = world(np.random.default_rng(6))
    plan = lambda legs, weights: planner(objective=objective).plan(pose, beliefs(legs, weights))  # noqa: E731
    unheard, alone = plan(legs, (1.0, 0.0)), plan(legs[:1], (1.0,))
    assert unheard.turn_rate == pytest.approx(alone.turn_rate, abs=TURN_TOLERANCE)
    assert unheard.score == pytest.approx(alone.score, rel=1e-8)
    light, heavy = plan(legs, (0.5, 1.5)), plan(legs, (2.0, 6.0))
    assert heavy.turn_rate == pytest.approx(light.turn_rate, abs=TURN_TOLERANCE)


def test_but_it_is_kept_clear_of():
    near = [op.Belief.at(40.0, 0.0), op.Belief.at(14.0, 0.5, weight=0.0)]
    pose = op.Pose(0.0, 0.0, 0.0)
    options = {"objective": "log-det", "horizon": 12.0}
    kept = planner(
        constraints=Constraints(min_separation=4.0, max_separation=60.0), **options
    ).plan(pose, near)
    assert np.linalg.norm(kept.path[:, :2] - near[1].mean[:2], axis=1).min() > 4.0


# Whatever may be wrong


def test_nobody_to_plan_for_and_numbers_that_are_none_are_answered_with_the_reason():
    pose, legs = world(np.random.default_rng(8))
    good, other = beliefs(legs)
    asked = planner()
    assert asked.plan(pose, []).status == Status.NO_TARGETS
    assert asked.plan(pose, beliefs(legs, (0.0, 0.0))).status == Status.NO_TARGETS
    for bad in (
        replace(good, mean=np.array([NAN, 0.0, 0.0, 1.0])),
        replace(good, covariance=np.full((4, 4), NAN)),
        replace(good, route=lambda times: np.full((len(times), 2), NAN)),
        replace(good, process_noise=(NAN, 0.0, 0.0)),
    ):
        decision = asked.plan(pose, [bad, other])
        assert (decision.status, decision.turn_rate, decision.speed) == (
            Status.INVALID_INPUT,
            0.0,
            2.0,
        )
    assert asked.plan(op.Pose(0.0, NAN, 0.0), [good]).status == Status.INVALID_INPUT


@pytest.mark.slow
@every_objective
def test_on_top_of_an_auv_and_among_a_hundred_there_is_a_decision(objective):
    rng = np.random.default_rng(12)
    limits = Constraints(max_separation=200.0)
    crowd = [
        op.Belief.at(
            *map(float, rng.normal(0, 20, 2)),
            heading=1.0,
            speed=1.0,
            covariance=np.diag([4, 4, 0.1, 0.1]),
        )
        for _ in range(100)
    ]
    for auvs in ([op.Belief.at(3.0, 4.0)], crowd):
        decision = planner(objective=objective, constraints=limits, stages=8).plan(
            op.Pose(3.0, 4.0, 0.3), auvs
        )
        assert decision.status in RUNGS
        assert abs(decision.turn_rate) <= 0.4 * (1 + 1e-15)
        assert np.isfinite(decision.path).all()


@pytest.mark.slow
@every_objective
@pytest.mark.parametrize(
    "area",
    [
        Disc(x=1.0, y=0.0, radius=4.0),
        Polygon(points=((-4.0, -3.0), (5.0, -4.0), (3.0, 6.0), (-5.0, 4.0))),
    ],
)
def test_keep_out_around_its_own_position_is_left_and_the_status_says_that_limits_are_broken(
    objective, area
):
    decision = planner(objective=objective, constraints=Constraints(keep_out=(area,))).plan(
        op.Pose(0.0, 0.0, 0.3), [op.Belief.at(40.0, 3.0)]
    )
    assert decision.status in SAID
    assert (
        area.signed_distance(decision.path[5:, :2]).min() > -1e-3
    )  # 10 s at 2 m/s lead out of either


def test_deadline_leaves_the_best_manoeuvre_and_a_generous_one_changes_nothing():
    pose, legs = world(np.random.default_rng(3))
    hasty, patient, calm = (
        planner(deadline=d).plan(pose, beliefs(legs)) for d in (1e-3, 1e3, None)
    )
    assert hasty.status == Status.BEST_MANOEUVRE
    assert patient.turn_rate == calm.turn_rate
    assert calm.score <= hasty.score


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("ping_interval", 0.0, r"ping_interval must be positive and finite \[s\], got 0.0"),
        ("sigma", NAN, r"sigma must be positive and finite \[m\], got nan"),
        ("horizon", -1.0, r"horizon must be from 0.001 to 86400 s \(.*\), got -1.0"),
        ("decision_interval", 0.0, r"decision_interval must be positive and finite \[s\], got 0.0"),
        ("stages", 1, r"stages must be from 2 to 100 \(.*\), got 1"),
        ("max_iterations", 0, r"max_iterations must be from 1 to 100000 \(.*\), got 0"),
        (
            "max_turn_acceleration",
            0.0,
            r"max_turn_acceleration must be from 0.000001 to 100 rad/s\^2 \(.*\), got 0.0",
        ),
        ("deadline", -1.0, r"deadline must be from 0.001 to 86400 s \(.*\), got -1.0"),
        (
            "speed_range",
            (2.0, 1.0),
            r"speed_range must be 0 < least <= greatest \[m/s\], got \(2.0, 1.0\)",
        ),
    ],
)
def test_options_out_of_range_are_refused_by_name_and_value(option, value, message):
    with pytest.raises(ValueError, match=message):
        planner(**{option: value})


# Missions

FENCE = (
    (-60.0, -60.0),
    (100.0, -60.0),
    (100.0, 60.0),
    (30.0, 60.0),
    (20.0, 10.0),
    (10.0, 60.0),
    (-60.0, 60.0),
)
TRIANGLE = ((-25.0, -20.0), (0.0, -45.0), (15.0, -25.0))
LIMITS = Constraints(
    keep_out=(Disc(x=45.0, y=-5.0, radius=12.0), Polygon(points=TRIANGLE)),
    geofence=Polygon(points=FENCE),
    min_separation=3.0,  # and three standard deviations, 6 m at first
    max_separation=90.0,
)


def flown(run):
    """True positions of the aid vehicle and of the AUVs, eleven to a step."""
    fractions = np.linspace(0.0, 1.0, 11)
    for k in range(len(run.time) - 1):
        for f in fractions:
            at = arc(
                run.cna[k], run.turn_rate[k], run.speed[k], f * (run.time[k + 1] - run.time[k])
            )[:2]
            yield k, at, (1 - f) * run.truth[:, k, :2] + f * run.truth[:, k + 1, :2]


@pytest.mark.slow
@every_objective
def test_mission_breaks_no_limit_along_the_true_path_unless_the_status_said_so(objective):
    mission = scenario(
        planner={"kind": "information", "interval": 1.0, "knowledge": "truth"}, duration=90.0
    )
    spy = Spy(planner(objective=objective, constraints=LIMITS))
    run = op.simulate(mission, planner=spy)
    said = Counter(decision.status for *_, decision in spy.said)
    free = (
        shapely.Polygon(FENCE)
        .difference(shapely.Polygon(TRIANGLE))
        .difference(shapely.Point(45.0, -5.0).buffer(12.0, quad_segs=500))
    )
    close = np.inf
    for k, at, auvs in flown(run):
        distance = np.linalg.norm(at - auvs, axis=1)
        inside = shapely.contains(free, shapely.Point(at))
        margin = min(
            shapely.distance(free.boundary, shapely.Point(at)) * (1 if inside else -1),
            distance.min() - 3.0,
            90.0 - distance.max(),
        )
        assert margin > -1e-3 or run.status[2 * (k // 2)] in SAID, (k, margin)
        close = min(close, margin)
    assert said[Status.OPTIMAL] >= 80, said
    assert close < 3.0  # something was in the way


@pytest.mark.slow
def test_turns_of_a_mission_change_no_faster_than_the_vehicle_can():
    mission = scenario(
        planner={"kind": "information", "interval": 1.0, "knowledge": "truth"}, duration=40.0
    )
    run = op.simulate(mission, planner=planner(max_turn_acceleration=0.05, speed_range=(1.0, 2.0)))
    at_decisions = np.concatenate([[0.0], run.turn_rate[::2]])
    assert np.abs(np.diff(at_decisions)).max() <= 0.05 + 1e-9
    assert np.ptp(at_decisions) > 0.2
    assert np.all(np.abs(run.turn_rate) <= run.speed / 5.0 * (1 + 1e-12))


@pytest.mark.slow
@pytest.mark.parametrize("knowledge", ["estimate", "survey"])
def test_mission_under_what_is_known_of_the_auvs_is_flown_by_optima(knowledge):
    mission = scenario(
        planner={"kind": "information", "interval": 1.0, "knowledge": knowledge}, duration=40.0
    )
    spy = Spy(planner())
    run = op.simulate(mission, planner=spy)
    assert {decision.status for *_, decision in spy.said} <= {Status.OPTIMAL, Status.RESTARTED}
    still = op.simulate(mission, planner="stationary")
    assert run.rms_error < still.rms_error


def test_decisions_between_stage_ends_keep_to_the_trajectory():
    auvs = [op.Belief.at(0.0, 0.0)]
    asked = planner(
        objective="log-det",
        constraints=Constraints(max_separation=30.0),
        decision_interval=1.0,
        horizon=24.0,
        stages=6,
    )
    pose, scores = op.Pose(18.0, -3.0, 0.7), []
    for k in range(4):  # a stage lasts four decisions
        decision = asked.plan(pose, auvs, time=float(k))
        scores.append(decision.turn_rate)
        assert decision.status == Status.OPTIMAL
        assert len(decision.path) == 7
        x, y, heading = arc((pose.x, pose.y, pose.heading), decision.turn_rate, 2.0, 1.0)
        pose = op.Pose(float(x), float(y), float(heading), decision.turn_rate)
    assert np.ptp(scores) < 0.2


def test_decisions_of_a_mission_build_no_program():
    """All of them are built before it: a step of the mission never waits for that."""
    mission = scenario(planner={"kind": "trajectory", "stages": 3}, duration=4.0)
    planner = mission.planner()
    planner.prepare(mission.start, lambda _done, _total: None)
    built = program.cache_info().misses
    assert built > 0
    op.simulate(mission, planner=planner)
    assert program.cache_info().misses == built


@pytest.mark.parametrize("solver", ["fatrop", "ipopt"])
def test_no_decision_compiles_anything_after_a_build_for_as_many_auvs(solver, monkeypatch):
    """Nor where fatrop fails and IPOPT is asked, nor where time is short."""
    pose, legs = world(np.random.default_rng(3))
    asked = planner(objective="log-det", stages=4, deadline=60.0)
    for count in (1, 2):
        asked.build(pose, beliefs(legs)[:count])

    def compiled(*_):
        raise AssertionError

    solve = Program.solve

    def only(self, name, *given, **_):
        if name != solver:
            return Answer(None)
        rushed = [solve(self, name, *given, seconds=2.0**-k) for k in range(12)]
        return rushed[0]

    monkeypatch.setattr("formulations.trajectory.program.ca.nlpsol", compiled)
    monkeypatch.setattr(Program, "solve", only)
    for count in (1, 2):
        assert asked.plan(pose, beliefs(legs)[:count]).status in RUNGS
