"""Whole missions planned anew on the way: what that gains, when a plan stays, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from oracles import Silent, recording, scenario
from test_whole_mission import followed, mean_variance, mission

import obsplan as op
from formulations.solution import Status
from formulations.whole_mission import Turns, again, optimise
from obsplan.simulation.inputs import Streams

RNG = np.random.default_rng
HOLD = 4


def small(kind="rolling", **change):
    """A mission of 40 s, planned in a second."""
    planner = {"kind": kind, "interval": 1.0, "knowledge": "estimate", "starts": 3}
    return scenario(planner=planner, duration=40.0, **change)


@pytest.fixture(scope="module")
def planned():
    """A mission of one AUV, and the plan made of it beforehand."""
    m = mission(steps=80, auvs=1)
    return m, optimise(m, hold=HOLD, count=3, random=RNG(5))


def flown(m, x):
    """Mean variance of turns, by the filter sample by sample."""
    path = followed(m, x[0] / m.vehicles[0].max_turn_rate, HOLD)
    return mean_variance(m, path[:, :2])


def test_plan_made_anew_is_better_where_the_auv_is_elsewhere_and_known_otherwise(planned):
    m, plan = planned
    elsewhere = replace(
        m,
        position=m.position + np.array([25.0, -40.0]),
        covariance=np.diag([1.0, 30.0, 0.01, 0.04])[None],
    )
    few, many = (again(Turns(elsewhere, HOLD), plan.x, iterations=n) for n in (5, 100))
    assert flown(elsewhere, many.x) < 0.9 * flown(elsewhere, plan.x)
    assert flown(elsewhere, many.x) < flown(elsewhere, few.x) < flown(elsewhere, plan.x)
    assert np.abs(many.x).max() <= m.vehicles[0].max_turn_rate
    assert few.status == Status.INACCURATE


def test_plan_stays_where_all_is_as_it_expected(planned):
    m, plan = planned
    assert again(Turns(m, HOLD), plan.x, iterations=100) is None
    worse = 0.9 * plan.x
    assert flown(m, again(Turns(m, HOLD), worse, iterations=100).x) < flown(m, worse)


def test_rest_of_a_turn_that_has_begun_is_the_rest_of_the_path(planned):
    m, plan = planned
    w = plan.x[0] / m.vehicles[0].max_turn_rate
    whole, late = followed(m, w, HOLD), 10  # in the middle of the third turn
    vehicle = replace(m.vehicles[0], start=whole[late])
    rest = replace(
        m,
        position=m.position[late:],
        heading=m.heading[late:],
        speed=m.speed[late:],
        vehicles=(vehicle,),
    )
    turns = Turns(rest, HOLD, begun=late % HOLD)
    left = w[late // HOLD :]
    assert turns.count == left.size
    np.testing.assert_allclose(turns.poses(left)[0], whole[late:], atol=1e-11)
    some = turns.nodes
    np.testing.assert_allclose(turns.poses(left, some)[0], whole[late:][some], atol=1e-11)
    np.testing.assert_allclose(turns.of(np.repeat(w, HOLD)[late:] * 0.3, vehicle), left)
    slope = np.zeros((1, len(some), 2))
    slope[0, -1] = [0.6, -0.8]  # of where it ends
    step = 1e-6 * np.eye(left.size)
    ends = [[turns.poses(left + s * d)[0, -1, :2] for d in step] for s in (1, -1)]
    quotient = (np.array(ends[0]) - ends[1]) @ slope[0, -1] / 2e-6
    np.testing.assert_allclose(turns.gradient(left, slope, some), quotient, atol=1e-6)


@pytest.mark.parametrize("fault", ["raises", "nan"])
def test_plan_stays_where_the_minimiser_fails(fault, planned, monkeypatch):
    def fails(_, start, **__):
        if fault == "raises":
            raise RuntimeError("stumbled")
        return scipy.optimize.OptimizeResult(x=np.full(start.shape, np.nan), success=True)

    m, plan = planned
    monkeypatch.setattr(scipy.optimize, "minimize", fails)
    assert again(Turns(m, HOLD), 0.9 * plan.x, iterations=10) is None


@pytest.mark.slow
def test_mission_without_noise_is_flown_as_planned_beforehand(monkeypatch):
    monkeypatch.setattr(
        "obsplan.simulation.inputs.streams", lambda _: Streams(*(Silent() for _ in Streams._fields))
    )
    sure = {f"auv__{i}__first_estimate": {"sigma_position": 0.5} for i in range(2)}
    whole, rolling = (op.simulate(small(kind, **sure)) for kind in ("whole-mission", "rolling"))
    np.testing.assert_array_equal(rolling.turn_rate, whole.turn_rate)


@pytest.mark.slow
def test_noise_changes_the_path_and_the_same_noise_flies_it_again():
    mission = small()
    one, other, again = (op.simulate(mission, seed=seed) for seed in (1, 2, 1))
    assert not np.array_equal(one.turn_rate, other.turn_rate)
    assert recording(again) == recording(one)
    assert np.abs(one.turn_rate).max() <= mission.cna.max_turn_rate
    assert set(one.status_counts) <= {"optimal", "inaccurate"}


@pytest.mark.slow
def test_limits_are_kept_by_plans_made_anew():
    free = op.simulate(small())
    x, y = map(float, free.cna[len(free.cna) // 2, :2])  # where it would go
    limits = {"keep_out": ({"x": x, "y": y, "radius": 6.0},), "min_separation": 10.0}
    run = op.simulate(small(constraints=limits))
    assert run.violation.max() <= 0
    assert set(run.status_counts) <= {"optimal", "inaccurate", "best-manoeuvre"}


def test_vehicle_off_its_plan_goes_on_from_where_it_is():
    mission = small(ranging__interval=8.0)  # turns last 4 s, and no range comes meanwhile
    planner, pose = mission.planner(), mission.start
    auvs = planner.situation.filed.beliefs
    path = planner.plan(pose, auvs).path
    there = op.Pose(float(path[1, 0]) + 3.0, *map(float, path[1, 1:]))
    aside = planner.plan(there, auvs, time=1.0)
    np.testing.assert_array_equal(aside.path[0], [there.x, there.y, there.heading])
    x, y, heading = map(float, aside.path[1])
    onwards = planner.plan(op.Pose(x, y, heading), auvs, time=4.0)
    np.testing.assert_allclose(onwards.path, aside.path[1:], atol=1e-9)


def test_belief_whose_covariance_is_no_number_is_answered_straight_on():
    mission = small()
    good, bad = mission.planner().situation.filed.beliefs
    bad = replace(bad, covariance=np.full((4, 4), np.nan))
    decision = mission.planner().plan(mission.start, [good, bad])
    assert (decision.status, decision.turn_rate) == (Status.INVALID_INPUT, 0.0)


def test_several_aid_vehicles_planned_at_once_are_refused_by_name():
    settings = ["planner.starts=1", "duration=20"]
    both = op.load("systems/moving-long-baseline", planner="rolling", settings=settings)
    with pytest.raises(op.ObsplanError, match="rolling plans one aid vehicle, and there are 2"):
        op.simulate(both)
