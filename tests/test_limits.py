"""How planners that know no limits are kept within them, and how much margin is left for AUVs whose places are not known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from oracles import Spy, arc, recording, scenario, told

import obsplan as op
from formulations.beam_search.limits import look_function
from formulations.beam_search.selection import Feasibility
from formulations.solution import Status
from obsplan.constraints import Constraints, Disc, Polygon
from obsplan.planners import PLANNERS
from obsplan.planning.limits import LimitsAhead, margins, within_limits

SQUARE = Polygon(points=((-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (-40.0, 40.0)))
CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)
HERE = op.Pose(0.0, 0.0, 0.0)
IGNORANT = [
    name
    for name in PLANNERS
    if name not in ("information", "gramian", "trajectory", "whole-mission", "rolling")
]


def kept(wanted, pose, auvs=(), **limits):
    """The manoeuvre flown in place of one that is wanted."""
    situation = op.Situation(CNA, decision_interval=2.0, constraints=Constraints(**limits))
    return within_limits(wanted, pose, list(auvs), situation)


def wanted(turn_rate=0.0, speed=2.0):
    """A decision that says no more."""
    return op.Decision(turn_rate=turn_rate, speed=speed)


def test_manoeuvre_that_breaks_nothing_is_flown_as_it_is():
    decision = wanted(0.123)
    assert kept(decision, HERE, geofence=SQUARE) is decision


def test_nearest_turn_that_breaks_nothing_is_flown_and_the_status_says_so():
    ahead = Disc(
        x=8.5, y=0.0, radius=2.0
    )  # straight on leads to 4 m, from where neither circle of 5 m clears it
    decision = kept(wanted(0.02), HERE, keep_out=(ahead,))
    assert decision.status == Status.LIMITED
    left = np.linspace(0.4, -0.4, 21)
    free = []
    for turn in left:
        x, y, heading = arc((0.0, 0.0, 0.0), turn, 2.0, 2.0)
        on_the_way = (
            min(
                math.dist(arc((0.0, 0.0, 0.0), turn, 2.0, t)[:2], (8.5, 0.0))
                for t in np.linspace(0.0, 2.0, 50)
            )
            > 2.0
        )
        sides = [
            (x - s * 5.0 * math.sin(heading), y + s * 5.0 * math.cos(heading)) for s in (1, -1)
        ]
        if on_the_way and max(math.dist(side, (8.5, 0.0)) for side in sides) > 7.0 + 0.5:
            free.append(turn)
    assert decision.turn_rate in left
    assert min(free, key=lambda turn: abs(turn - 0.02)) == pytest.approx(
        decision.turn_rate, abs=0.05
    )  # a candidate more or less: margins
    assert abs(decision.turn_rate) > 0.04
    np.testing.assert_allclose(decision.path[0], [0.0, 0.0, 0.0])
    assert (decision.path[1, 2] - decision.path[0, 2]) * decision.turn_rate > 0


def test_where_every_turn_breaks_a_limit_the_least_violating_is_flown_and_the_status_says_so():
    inside = Disc(x=15.0, y=6.0, radius=30.0)
    decision = kept(wanted(0.4), HERE, keep_out=(inside,))
    assert decision.status == Status.VIOLATED
    assert decision.turn_rate == -0.4  # away from the centre, which is to the left


@pytest.mark.slow
def test_a_keep_out_is_never_the_price_of_a_separation_that_cannot_be_kept():
    """A turn that keeps clear of the shoal is flown wherever there is one, though the AUV is nearer then."""
    rng, tempted = np.random.default_rng(7), 0
    for _ in range(200):
        shoal = Disc(x=float(rng.uniform(5, 15)), y=float(rng.uniform(-10, 10)), radius=5.0)
        auv = op.Belief.at(*map(float, rng.uniform(-8, 8, 2)))
        free = kept(wanted(), HERE, keep_out=(shoal,)).status != Status.VIOLATED
        decision = kept(wanted(), HERE, [auv], min_separation=20.0, keep_out=(shoal,))
        assert decision.status == Status.VIOLATED
        alone = kept(wanted(decision.turn_rate), HERE, keep_out=(shoal,))
        assert not free or alone.status == Status.OPTIMAL
        farthest = kept(wanted(), HERE, [auv], min_separation=20.0).turn_rate
        tempted += free and kept(wanted(farthest), HERE, keep_out=(shoal,)).status != Status.OPTIMAL
    assert tempted > 20


def test_numbers_that_are_none_and_no_auv_at_all_are_taken_as_they_come():
    nowhere = op.Belief.at(math.nan, 0.0)
    assert kept(wanted(), op.Pose(math.nan, 0.0, 0.0), geofence=SQUARE).status == Status.OPTIMAL
    assert (
        kept(wanted(), HERE, [nowhere], geofence=SQUARE, min_separation=5.0).status
        == Status.OPTIMAL
    )
    assert kept(wanted(), HERE, min_separation=5.0).status == Status.OPTIMAL
    unsure = op.Belief.at(0.0, 0.0, covariance=np.full((4, 4), math.nan))
    assert margins([unsure]) == [0.0]
    assert (
        kept(wanted(speed=0.0), HERE, [unsure], min_separation=5.0).status == Status.VIOLATED
    )  # on top of it


def test_room_is_three_standard_deviations_of_the_worst_direction():
    rng = np.random.default_rng(1)
    for _ in range(20):
        root = rng.normal(size=(4, 4))
        margin = margins([op.Belief.at(1.0, 2.0, covariance=root @ root.T)])
        assert margin[0] == pytest.approx(3.0 * np.linalg.svd(root[:2])[1][0])


def test_separation_is_kept_farther_from_an_auv_that_is_not_sure_of_its_place():
    near = op.Belief.at(13.2, -2.0, covariance=np.eye(4) * 0.01)
    assert kept(wanted(), HERE, [near], min_separation=5.0).status == Status.OPTIMAL
    unsure = replace(
        near, covariance=np.eye(4) * 1.5**2
    )  # 4 m straight on, 9.4 m are left of 5 + 4.5; on the left circle 9.9 m
    assert kept(wanted(), HERE, [unsure], min_separation=5.0).status == Status.LIMITED


@pytest.mark.slow
@pytest.mark.parametrize(
    "planner",
    [
        lambda **given: told(op.InformationHorizon, CNA, ping_interval=2.0, sigma=1.0, **given),
        lambda **given: told(op.GramianHorizon, CNA, **given),
        lambda **given: told(op.Trajectory, CNA, ping_interval=2.0, sigma=1.0, **given),
    ],
    ids=["information", "gramian", "trajectory"],
)
def test_planners_that_know_the_limits_leave_room_for_an_unsure_auv(planner):
    limited = planner(constraints=Constraints(min_separation=5.0), decision_interval=2.0)
    sure = op.Belief.at(13.2, 0.0, covariance=np.eye(4) * 0.01)
    assert limited.plan(HERE, [sure]).status == Status.OPTIMAL
    unsure = replace(sure, covariance=np.eye(4) * 9.0)  # 5 + 9 m are more than there is
    assert limited.plan(HERE, [unsure], time=50.0).status in (Status.VIOLATED, Status.SOFTENED)


@pytest.mark.parametrize("name", IGNORANT)
def test_planners_that_know_no_limits_are_kept_within_them_between_decisions_too(name):
    fence = [[60.0, -60.0], [110.0, -60.0], [110.0, -5.0], [60.0, -5.0]]
    limits = {"geofence": fence, "keep_out": [{"x": 95.0, "y": -15.0, "radius": 6.0}]}
    options = {"kind": name, **({"start_on_circle": False} if name == "circle" else {})}
    free, run = (
        op.simulate(scenario(planner=options, duration=60.0, **more))
        for more in ({}, {"constraints": limits})
    )

    def worst(run):
        steps = zip(run.cna[:-1], run.turn_rate, run.speed, strict=False)
        places = np.array(
            [
                arc(pose, turn, speed, t)[:2]
                for pose, turn, speed in steps
                for t in np.linspace(0.0, 0.5, 6)
            ]
        )
        x, y = places.T
        return max(
            (60 - x).max(),
            (x - 110).max(),
            (-60 - y).max(),
            (y + 5).max(),
            (6.0 - np.hypot(x - 95.0, y + 15.0)).max(),
        )

    assert worst(run) < 1e-3
    assert run.planner == name
    assert Status.VIOLATED.label not in run.status_counts
    if name != "stationary":
        assert worst(free) > 3.0  # the limits do limit
        assert run.status_counts[Status.LIMITED.label] > 0


def test_a_planner_made_without_the_scenarios_limits_is_kept_within_them_too():
    fence = [[60.0, -60.0], [110.0, -60.0], [110.0, -5.0], [60.0, -5.0]]
    mission = scenario(constraints={"geofence": fence}, duration=60.0)
    unaware = op.InformationHorizon(op.Situation(mission.cna, ping_interval=2.0))
    run = op.simulate(mission, planner=unaware)
    assert Status.LIMITED.label in run.status_counts
    assert run.violation.max() < 1e-3


def test_a_vehicle_at_rest_needs_no_circle_to_turn_on():
    pool = Polygon(
        points=((-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0))
    )  # too small for a circle of 5 m
    assert kept(wanted(speed=0.0), HERE, geofence=pool).status == Status.OPTIMAL
    assert kept(wanted(speed=0.1), HERE, geofence=pool).status == Status.VIOLATED


@pytest.mark.slow
def test_keep_outs_hold_even_where_auvs_come_too_near():
    run = op.simulate(op.load("suite/keep-outs", planner="centroid-orbit"), seed=3)
    assert run.status_counts["violated"] > 10  # for want of margin to an AUV
    assert run.scenario.constraints.fixed_violation(np.ascontiguousarray(run.cna[:, :2])).max() < 0


@pytest.mark.slow
def test_a_users_planner_is_kept_within_limits_and_one_that_knows_them_is_left_alone():
    class Straight:
        def plan(self, pose, auvs, *, time=0.0):
            return op.Decision(turn_rate=0.0, speed=2.0)

    mission = scenario(
        constraints={"keep_out": [{"x": 40.0, "y": 4.0, "radius": 10.0}]}, duration=30.0
    )
    assert Status.LIMITED.label in op.simulate(mission, planner=Straight()).status_counts
    aware = scenario(
        constraints={"keep_out": [{"x": 40.0, "y": 4.0, "radius": 10.0}]},
        planner={"kind": "gramian"},
        duration=30.0,
    )
    spy = Spy(aware.planner())
    run = op.simulate(aware)
    assert recording(op.simulate(aware, planner=spy)) == recording(
        run
    )  # kept, though it need not be
    assert Status.LIMITED.label not in run.status_counts


STAR = Polygon(
    points=tuple(
        (70.0 + r * math.cos(a), 30.0 + r * math.sin(a))
        for a, r in zip(np.linspace(0, 6, 24), np.tile([30.0, 12.0], 12), strict=True)
    )
)
FENCES = [
    None,
    Disc(x=20.0, y=0.0, radius=150.0),
    replace(SQUARE, points=3 * np.array(SQUARE.points)),
]


@pytest.mark.parametrize("fence", FENCES)
@pytest.mark.parametrize("apart", [{}, {"min_separation": 30.0}, {"max_separation": 150.0}])
@pytest.mark.parametrize("auvs", [0, 1, 3])
def test_machine_code_looks_at_branches_as_the_limits_say(fence, apart, auvs):
    if look_function() is None:
        pytest.skip("there is no C compiler")
    rng = np.random.default_rng(auvs)
    keep_out = (STAR, Disc(x=-60.0, y=-20.0, radius=25.0), SQUARE)[: 3 if auvs else 0]
    situation = op.Situation(
        CNA,
        constraints=Constraints(keep_out=keep_out, geofence=fence, **apart),
        current=(0.5, -0.7) if auvs == 1 else (0.0, 0.0),
    )
    beliefs = [
        op.Belief.at(*rng.uniform(-40, 40, 2), heading=0.3, speed=1.0, covariance=np.eye(4))
        for _ in range(auvs)
    ]
    ahead = LimitsAhead(situation, beliefs)
    pose = np.column_stack([rng.uniform(-200, 200, (500, 2)), rng.uniform(-3, 3, 500)])
    rates, branches = np.array([0.4, 0.0, -0.1]), rng.permutation(1500)
    looked = []
    for numbers in (ahead.numbers(), None):
        feasible = Feasibility(
            ahead.along,
            np.zeros(3),
            turn_rates=rates,
            speed=2.0,
            durations=np.array([9.0]),
            limits=numbers,
        )
        looked.append(feasible._look(ahead.along, pose)(branches))
    by_machine_code, by_arrays = looked
    np.testing.assert_allclose(by_machine_code, by_arrays, rtol=1e-12, atol=1e-12)
    limited = bool(situation.constraints) and (auvs or fence)
    assert (by_arrays > 0).any() == bool(limited)
    assert (by_arrays == 0).any()
