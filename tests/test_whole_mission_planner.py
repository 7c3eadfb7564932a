"""The planner of whole missions: what is flown, within which limits, and what it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest
from oracles import Silent, arc, recording, scenario

import obsplan as op
from formulations.model.ranging import Ranging
from obsplan.constraints import Constraints, Disc
from obsplan.planning.limits import SURE
from obsplan.planning.rest import Known, Limits, frame_at
from obsplan.simulation.inputs import Streams

RNG = np.random.default_rng


def small(starts=10, **change):
    """A mission short enough to plan in a second, its AUVs as the planner expects them."""
    planner = {"kind": "whole-mission", "interval": 1.0, "knowledge": "truth", "starts": starts}
    return scenario(planner=planner, duration=40.0, **change)


def silent(monkeypatch):
    """Missions without noise."""
    monkeypatch.setattr(
        "obsplan.simulation.inputs.streams", lambda _: Streams(*(Silent() for _ in Streams._fields))
    )


def predicted(run):
    """Time mean of the filters' own position variance [m^2], over the weights."""
    return float(np.mean(run.covariance[..., 0, 0] + run.covariance[..., 1, 1]))


@pytest.mark.slow
def test_score_is_what_the_filters_say_where_nothing_is_disturbed(monkeypatch):
    silent(monkeypatch)
    run = op.simulate(
        small(
            auv__0__first_estimate={"sigma_position": 0.5},
            auv__1__first_estimate={"sigma_position": 0.5},
        )
    )
    # the filters leave out the second-order error, here about (0.4^2 / 30)^2 of sigma^2; their samples come after the ranges
    assert predicted(run) == pytest.approx(run.score[0], rel=0.1)
    assert predicted(run) < run.score[0]


@pytest.mark.slow
def test_mission_known_beforehand_goes_no_worse_than_with_the_receding_horizon(monkeypatch):
    silent(monkeypatch)
    for change in (
        {"ranging__interval": 6.0},
        {"cna__start": {"x": -30.0, "y": 30.0, "heading_deg": 0.0}},
    ):
        whole = op.simulate(small(**change))
        receding = op.simulate(small(**change), planner="information")
        assert (
            predicted(whole) <= predicted(receding) * 1.005
        )  # 0.005: what the filters leave out and the score counts


@pytest.mark.slow
def test_plan_depends_on_no_noise_and_is_flown_to_the_letter():
    mission = small()
    one, other = (op.simulate(mission, seed=seed) for seed in (1, 2))
    np.testing.assert_array_equal(one.turn_rate, other.turn_rate)
    np.testing.assert_array_equal(one.cna, other.cna)
    assert not np.array_equal(one.mean, other.mean)
    assert np.abs(one.turn_rate).max() <= mission.cna.max_turn_rate
    assert len(set(one.score[:-1:2])) == 1  # one plan, from the first decision to the last
    again = op.simulate(small(), seed=1)
    assert recording(again) == recording(one)


@pytest.mark.slow
def test_vehicle_off_its_plan_gets_one_for_the_rest_of_the_mission():
    mission = small(starts=2)
    planner, pose = mission.planner(), mission.start
    whole = planner.open_loop(pose)
    along = whole.poses(pose, 0.0, 20.0)[-1]
    assert planner.open_loop(op.Pose(*map(float, along)), time=20.0) is whole
    rest = planner.open_loop(op.Pose(float(along[0]) + 3.0, *map(float, along[1:])), time=20.0)
    assert rest is not whole
    assert rest.turn_rates.size == whole.turn_rates.size - 20
    assert planner.open_loop(pose) is whole


@pytest.mark.slow
def test_path_of_a_decision_leads_to_the_missions_end():
    mission = small()
    planner = mission.planner()
    decision = planner.plan(mission.start, [op.Belief.at(0.0, 0.0)])
    pose, turns = (
        (mission.start.x, mission.start.y, mission.start.heading),
        planner.open_loop(mission.start).turn_rates,
    )
    for turn in turns:
        pose = arc(pose, turn, 2.0, planner.turn_duration)
    np.testing.assert_allclose(decision.path[-1], pose, atol=1e-9)
    after = planner.plan(
        op.Pose(*map(float, decision.path[-1])), [op.Belief.at(0.0, 0.0)], time=100.0
    )
    assert math.isfinite(after.turn_rate)


@pytest.mark.slow
def test_limits_are_kept_along_the_surveys_as_filed(monkeypatch):
    silent(monkeypatch)
    free = op.simulate(small())
    x, y = map(float, free.cna[len(free.cna) // 2, :2])  # where it would go
    disc = {"x": x, "y": y, "radius": 6.0}
    for limits in ({"keep_out": (disc,)}, {"keep_out": (disc,), "min_separation": 10.0}):
        run = op.simulate(small(starts=4, constraints=limits))
        assert free.scenario.constraints.keep_out == ()
        assert Disc(**disc).signed_distance(free.cna[:, :2]).min() < 0
        assert run.violation.max() <= 0
        assert set(run.status_counts) <= {"optimal", "inaccurate", "best-manoeuvre"}
        assert predicted(run) >= predicted(free) * 0.995


def test_auvs_stray_from_their_filed_tracks_as_far_as_expected():
    noise = {"position": 0.05, "heading_deg": 5.0, "speed": 0.02}
    straight = {"kind": "waypoints", "points": [[0.0, 0.0], [48.0, 64.0]]}
    filed = small(auv__0__survey=straight, auv__0__process_noise=noise).planner().filed
    rng, dt, copies = RNG(8), 0.5, 5000
    x, course, speed = (
        np.zeros(copies, dtype=complex),
        np.full(copies, math.atan2(64, 48)),
        np.full(copies, 1.5),
    )
    for _ in filed.time[1:]:  # from the survey's heading and speed at every sample, disturbed
        moved = speed * np.exp(1j * course) * dt
        x += moved + 0.05 * math.sqrt(dt) * (rng.normal(size=copies) + 1j * rng.normal(size=copies))
        course = math.atan2(64, 48) + math.radians(5.0) * math.sqrt(dt) * rng.normal(size=copies)
        speed = 1.5 + 0.02 * math.sqrt(dt) * rng.normal(size=copies)
    largest = np.linalg.eigvalsh(np.cov(x.real, x.imag))[-1]
    assert filed.straying[-1, 0] == pytest.approx(
        math.sqrt(largest), rel=0.04
    )  # four times 1 / sqrt(2 x 5000)
    assert filed.straying[0, 0] == 0.0


@pytest.mark.slow
def test_separations_are_kept_from_auvs_that_stray():
    noise = {"position": 0.3, "heading_deg": 0.5, "speed": 0.02}
    near = {
        "cna__start": {"x": -30.0, "y": 30.0, "heading_deg": 0.0},
        "constraints": {"min_separation": 20.0},
    }
    disturbed = small(starts=3, auv__0__process_noise=noise, auv__1__process_noise=noise, **near)
    runs = [op.simulate(disturbed, seed=seed) for seed in range(20)]
    planned = np.linalg.norm(runs[0].cna[:, None, :2] - disturbed.planner().filed.position, axis=-1)
    assert planned.min() < 30.0  # it comes near enough for the limit to bind
    assert {status for run in runs for status in run.status_counts} <= {
        "optimal",
        "inaccurate",
        "best-manoeuvre",
    }
    beyond = (
        2 * 0.5 * math.erfc(SURE / math.sqrt(2))
    )  # of the time, were it always at the limit: two AUVs, either too near
    assert np.mean([run.violation > 0 for run in runs]) <= beyond


def limits_of(constraints, **filed):
    """What the planner takes for a violation, in the vehicle's frame at the origin; no AUV strays."""
    planner = small().planner()
    known = replace(planner.filed, process_noise=np.zeros((2, 4)), **filed)
    frame = frame_at(op.Pose(0.0, 0.0, 0.0), known)
    situation = replace(planner.situation, filed=known, constraints=constraints)
    return frame, Limits(situation, Known.as_filed(known, 0), frame)


def told_otherwise(planner, **known):
    """A planner in another situation."""
    return replace(planner, situation=replace(planner.situation, **known))


def test_greatest_separation_alone_is_kept_on_top_of_an_auv():
    at_one_place = np.broadcast_to([3.0, 4.0], (81, 2, 2))
    _, violation = limits_of(Constraints(max_separation=50.0), position=at_one_place)
    there, time = np.array([[3.0, 4.0], [53.0, 4.0], [63.0, 4.0]]), np.full(3, 10.0)
    np.testing.assert_allclose(
        violation(there, time), np.array([-50.0, 0.0, 10.0]) + 0.5, atol=1e-9
    )  # half a step of 2 m/s x 0.5 s


def test_vehicles_that_pass_each_other_between_samples_are_noticed():
    time = 0.5 * np.arange(81.0)
    eastward = np.stack([1.5 * (time - 10.25), np.zeros(81)], axis=-1)
    frame, violation = limits_of(
        Constraints(min_separation=1.3), position=np.stack([eastward, eastward], axis=1)
    )
    westward = np.stack(
        [-2.0 * (time - 10.25), np.zeros(81)], axis=-1
    )  # both at the origin at 10.25 s
    assert violation(frame.directions(westward), time).max() >= 1.3 - 1e-9


def seen_from(filed, pose, angle, mirror):
    """The same world from axes turned, after a mirror along the east axis where that is -1."""
    R = np.array(
        [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    ) @ np.diag([1.0, mirror])
    turn = np.eye(4)
    turn[:2, :2], turn[2, 2] = R, mirror
    x, y = R @ [pose.x, pose.y]
    there = replace(
        filed,
        position=filed.position @ R.T,
        heading=mirror * filed.heading + angle,
        covariance=turn @ filed.covariance @ turn.T,
    )
    return there, op.Pose(float(x), float(y), mirror * pose.heading + angle)


@pytest.mark.slow
@pytest.mark.parametrize(("angle", "mirror"), [(0.7, 1.0), (0.0, -1.0), (-2.0, -1.0)])
def test_turned_or_mirrored_world_is_the_same_problem_whatever_the_first_covariance(angle, mirror):
    planner, pose = small(starts=2).planner(), small().start
    uneven = np.array(
        [
            [9.0, 3.0, 0.02, 0.1],
            [3.0, 2.0, -0.01, 0.05],
            [0.02, -0.01, 0.01, 0.0],
            [0.1, 0.05, 0.0, 0.04],
        ]
    )
    filed = replace(planner.filed, covariance=np.stack([uneven, 0.5 * uneven]))
    there, start = seen_from(filed, pose, angle, mirror)
    one, other = (
        told_otherwise(planner, filed=filed).open_loop(pose),
        told_otherwise(planner, filed=there).open_loop(start),
    )
    assert other.plan.objective == pytest.approx(one.plan.objective, rel=1e-9)
    np.testing.assert_allclose(other.turn_rates, mirror * one.turn_rates, atol=1e-9)


def test_plan_made_near_the_end_expects_no_ranges_but_the_missions(monkeypatch):
    asked = []
    monkeypatch.setattr(
        "obsplan.planners.whole_mission.optimise", lambda known, **_: asked.append(known)
    )
    planner = small(ranging__interval=7.0).planner()
    with pytest.raises(AttributeError):
        planner.open_loop(op.Pose(1.0, 2.0, 3.0), time=33.0)
    assert [list(pings) for pings in asked[0].pings[0]] == [[4], [4]]  # at 35 s


def test_search_is_told_of_depths_slots_silences_and_how_ranges_err(monkeypatch):
    asked = []
    monkeypatch.setattr(
        "obsplan.planners.whole_mission.optimise", lambda known, **_: asked.append(known)
    )
    planner = small(ranging__interval=8.0).planner()
    law = Ranging(1.0, growth=0.01, slant=True, loss=0.1, reach=500.0)
    planner = told_otherwise(
        planner,
        ranging=law,
        slots=(0.0, 3.0),
        silent=((20.0, 30.0),),
        transducer_depth=2.0,
        filed=replace(planner.filed, depth=np.array([[20.0, 50.0]])),
    )
    with pytest.raises(AttributeError):
        planner.open_loop(op.Pose(1.0, 2.0, 3.0), time=5.0)
    (vehicle,) = asked[0].vehicles
    assert vehicle.ranging == law
    assert [list(pings) for pings in asked[0].pings[0]] == [[6, 22, 54, 70], [12, 28, 60]]
    np.testing.assert_array_equal(asked[0].height(vehicle)[3], [18.0, 48.0])
    assert [belief.depth for belief in planner.filed.beliefs] == [20.0, 50.0]


@pytest.mark.slow
def test_limits_that_cannot_be_kept_are_said_to_be_violated():
    run = op.simulate(small(starts=2, constraints={"max_separation": 20.0}))  # it starts 80 m away
    assert run.status_counts == {"violated": 40}
    assert np.abs(run.turn_rate).max() <= 0.4


def test_options_out_of_range_are_refused_by_name_value_and_remedy():
    planner = small().planner()
    for change, words in (
        ({"starts": 0}, "starts must be from 1 to 10000 .*, got 0"),
        ({"search_seed": -1}, "search_seed must be from 0 to .*, got -1"),
        (
            {"segment": 1.5},
            r"segment must be a whole multiple of the time between decisions, 1.0 s, got 1.5 s",
        ),
        ({"segment": 0.0}, r"segment must be from 0.001 to 86400 s .*, got 0.0"),
    ):
        with pytest.raises(ValueError, match=words):
            replace(planner, **change)
    for interval in (0.01, 0.7):
        words = f"ping_interval must be a whole multiple of the time step, 0.5 s, got {interval} s"
        with pytest.raises(ValueError, match=words):
            told_otherwise(planner, ping_interval=interval)
    with pytest.raises(ValueError, match="planned from filed surveys: give them, as a Filed"):
        told_otherwise(planner, filed=None)
    with pytest.raises(
        op.ObsplanError,
        match=r"planner: segment must be at least 2 s in a mission of this length, got 1.0 s",
    ):
        scenario(planner={"kind": "whole-mission", "interval": 1.0, "segment": 1.0}, duration=500.0)


def test_turns_last_half_the_time_between_ranges_and_are_bounded_in_number():
    assert small().planner().turn_duration == 1.0
    assert small(ranging__interval=7.0).planner().turn_duration == 3.0
    long = scenario(
        planner={"kind": "whole-mission", "interval": 1.0},
        duration=4000.0,
        ranging={"interval": 4.0},
    )
    assert long.planner().turn_duration == 10.0
    planner = {"kind": "whole-mission", "interval": 1.0, "segment": 5.0, "starts": 2}
    asked = scenario(planner=planner, duration=60.0)
    assert asked.planner().turn_duration == 5.0
    assert asked.planner().open_loop(asked.start).turn_rates.size == 12


@pytest.mark.slow
def test_more_freedom_in_the_turns_and_other_random_ones_are_other_plans():
    coarse, fine = (
        small().planner().open_loop(small().start),
        replace(small().planner(), segment=5.0).open_loop(small().start),
    )
    assert coarse.plan.objective < fine.plan.objective
    other = replace(small().planner(), search_seed=2)
    assert other.open_loop(small().start).plan.objective == pytest.approx(
        coarse.plan.objective, rel=0.02
    )
