"""The information horizon: within its limits in closed loop, away from AUVs that are not sure of their place, and better for it."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from oracles import Spy, arc, scenario, told
from scipy.stats import ttest_rel

import obsplan as op
from formulations.beam_search import ToGo, branching, compiled, search_manoeuvres, turn_candidates
from formulations.beam_search.search import beam_of
from formulations.model import compiler
from formulations.model.covariance import condition_on_range
from formulations.model.ranging import Ranging
from formulations.model.schedule import Stages, ping_stages
from formulations.solution import Status
from obsplan.planners import information
from obsplan.planners.information import predicted_tracks

CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)


def planner(**options):
    return told(op.InformationHorizon, CNA, **{"ping_interval": 2.0, "sigma": 1.0} | options)


def belief(x, y, sigma=2.0, **change):
    return op.Belief(
        mean=np.array([x, y, 0.3, 0.0]),
        covariance=np.diag([sigma**2, sigma**2, 1e-4, 1e-4]),
        **change,
    )


# What it searches


def test_tracks_follow_the_course_where_it_is_known_and_else_the_velocity():
    def corner(t):
        return np.stack(
            [np.minimum(t, 4.0), np.maximum(t - 4.0, 0.0)], axis=-1
        )  # east for 4 s, then north, 1 m/s

    known = belief(0.0, 0.0, route=corner, current=(0.2, 0.0))
    guessed = op.Belief(
        mean=np.array([5.0, 1.0, 0.3, 1.5]), covariance=np.eye(4), current=(0.0, -0.1)
    )
    tracks = predicted_tracks([known, guessed], Stages(np.array([3.0, 2.0, 5.0]), np.ones(3)))
    np.testing.assert_allclose(tracks.position[:, 0], [[3, 0], [4, 1], [4, 6]])
    velocity = np.array([1.5 * math.cos(0.3), 1.5 * math.sin(0.3) - 0.1])
    np.testing.assert_allclose(
        tracks.position[:, 1], [5, 1] + np.array([[3.0], [5.0], [10.0]]) * velocity
    )
    np.testing.assert_allclose(tracks.speed[:, 1], 1.5)
    np.testing.assert_allclose(tracks.heading[:, 1], 0.3)
    np.testing.assert_allclose(
        tracks.speed[:, 0], [0.8, math.hypot(0.3, 0.5), math.hypot(0.2, 1.0)]
    )  # through the water
    np.testing.assert_allclose(
        tracks.heading[:, 0], [0.0, math.atan2(0.5, 0.3), math.atan2(1.0, -0.2)]
    )


def test_decision_is_the_first_turn_of_the_search_it_describes():
    pose, auvs = (
        op.Pose(10.0, -4.0, 0.8),
        [
            belief(0.0, 0.0, 2.0, process_noise=(0.1, 0.02, 0.03)),
            belief(25.0, 6.0, 1.0, weight=3.0),
        ],
    )
    mine = planner(
        horizon=12.0,
        stages=4,
        turn_rates=5,
        beam_width=9,
        criterion="log-det",
        ranging_kind="squared-range",
        sigma=7.0,
    )
    stages = ping_stages(5.0, 2.0, 12.0, 4)
    found = search_manoeuvres(
        np.array([10.0, -4.0, 0.8]),
        np.array([auv.covariance for auv in auvs]),
        tracks=predicted_tracks(auvs, stages),
        process_noise=np.array([[0.1, 0.1, 0.02, 0.03], [0.0, 0.0, 0.0, 0.0]]),
        weights=np.array([1.0, 3.0]),
        stages=stages,
        turn_rates=turn_candidates(0.4, 5),
        speed=2.0,
        ranging=Ranging(7.0, squared=True),
        criterion="log-det",
        beam_width=9,
        # two dimensions, speed and horizon of the vehicle; an error of 7 m^2 is one of d / 20 there
        to_go=ToGo(0.1 * 2 / (2.0 * 12.0), math.sqrt(70.0)),
    )
    decision = mine.plan(pose, auvs, time=5.0)
    assert (decision.turn_rate, decision.score, decision.status) == (
        found.x[0],
        found.objective,
        Status.OPTIMAL,
    )
    flown = [np.array([10.0, -4.0, 0.8])]
    for turn, duration in zip(found.x, stages.duration, strict=True):
        flown.append(arc(flown[-1], turn, 2.0, duration))
    np.testing.assert_allclose(decision.path, flown, atol=1e-9)


def test_survey_known_ahead_is_planned_for():
    mission = scenario(planner={"kind": "information", "interval": 1.0, "knowledge": "survey"})
    spy = Spy(mission.planner())
    op.simulate(mission, planner=spy)
    ahead = np.array([0.0, 5.0, 30.0])
    for time, _, auvs, _ in spy.said:
        for auv, reference in zip(auvs, mission.references, strict=True):
            np.testing.assert_allclose(
                auv.ahead(ahead), reference.position(time + ahead), atol=1e-9
            )
    _, pose, auvs, decision = spy.said[5]  # one second before the corner
    straight = [
        op.Belief(mean=auv.mean, covariance=auv.covariance, process_noise=auv.process_noise)
        for auv in auvs
    ]
    assert mission.planner().plan(pose, straight, time=5.0).score != decision.score


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("ping_interval", 0.0, r"ping_interval must be positive and finite \[s\], got 0.0"),
        ("sigma", math.nan, r"sigma must be positive and finite \[m\], got nan"),
        ("horizon", math.inf, r"horizon must be from 0.001 to 86400 s .*, got inf"),
        (
            "decision_interval",
            -1.0,
            r"decision_interval must be positive and finite \[s\], got -1.0",
        ),
        ("turn_rates", 6, "turn_rates must be odd and at least 3, straight on and pairs, got 6"),
        ("turn_rates", 1, "turn_rates must be from 3 to 201 .*, got 1"),
        ("stages", 0, "stages must be from 1 to 200 .*, got 0"),
        ("beam_width", 0, "beam_width must be from 1 to 10000 .*, got 0"),
    ],
)
def test_options_out_of_range_are_refused_by_name_and_value(option, value, message):
    with pytest.raises(ValueError, match=message):
        planner(**{option: value})


# Its distance


def team(*, length=1.0, time=1.0):
    """Four AUVs at rest in a line, in units that are so many times smaller."""
    sigma = np.array([length, length, 0.02, 0.03 * length / time])
    walks = np.array([0.05 * length, 0.002, 0.01 * length / time]) / math.sqrt(time)
    return [
        op.Belief(
            mean=np.array([20.0 * i * length, 0.0, 0.0, 0.0]),
            covariance=np.diag(sigma**2),
            process_noise=tuple(walks.tolist()),
        )
        for i in range(4)
    ]


def from_afar(steps):
    """Distance [m] from a team's middle at last, from 400 m away and on the way out."""
    mine = planner(horizon=30.0, stages=5, turn_rates=5, beam_width=32, ping_interval=5.0)
    pose, auvs = np.array([300.0, 300.0, 0.8]), team()
    for k in range(steps):
        decision = mine.plan(op.Pose(*map(float, pose)), auvs, time=2.0 * k)
        pose = arc(pose, decision.turn_rate, decision.speed, 2.0)
    return math.dist(pose[:2], (30.0, 0.0))


def test_comes_back_from_afar_because_of_what_its_distance_will_cost(monkeypatch):
    assert from_afar(100) < 150.0
    monkeypatch.setattr(information, "cost_to_go", lambda *_, **__: ToGo())
    assert from_afar(100) > 300.0


@pytest.mark.parametrize("criterion", ["trace", "log-det"])
def test_decides_the_same_in_other_units_of_length_and_time(criterion):
    turns = []
    for length, time in [(1.0, 1.0), (2.0**-8, 1.0), (2.0**5, 2.0**6)]:
        cna = op.Unicycle(speed=2.0 * length / time, min_turn_radius=5.0 * length)
        mine = told(
            op.InformationHorizon,
            cna,
            ping_interval=5.0 * time,
            sigma=length,
            horizon=30.0 * time,
            criterion=criterion,
            stages=4,
            turn_rates=5,
            beam_width=16,
        )
        auvs, found = team(length=length, time=time), []
        for x, y, heading in [(150.0, 80.0, 0.8), (-60.0, 20.0, 2.0), (30.0, -40.0, -1.0)]:
            decision = mine.plan(op.Pose(x * length, y * length, heading), auvs)
            found.append(decision.turn_rate * time)
        turns.append(found)
    np.testing.assert_allclose(turns[1:], [turns[0]] * 2, rtol=1e-12)


def first_order_update(P, x, *, law, pings, height, doubt):  # noqa: ARG001 - as the other takes
    """Update by the range's first-order error alone, as the filter sees it."""
    assert not any(law.form)
    u = x / ca.sqrt(ca.fmax(ca.sumsqr(x), 1e-12))
    Pu = P[:, :2] @ u
    return P - pings * Pu @ Pu.T / (pings * ca.dot(Pu[:2], u) + law.sigma**2)


def closest(auv, start, steps=60):
    """Least distance from an AUV at rest that stays as uncertain as it is, over a flight by the planner's decisions."""
    mine, pose, distances = planner(sigma=0.3), start, []
    for k in range(steps):
        decision = mine.plan(op.Pose(*map(float, pose)), [auv], time=float(k))
        pose = arc(pose, decision.turn_rate, decision.speed, 1.0)
        distances.append(math.dist(pose[:2], auv.mean[:2]))
    return min(distances[10:])


def forget_the_search():
    for kept in (beam_of, compiled.machine_code, branching.branching, branching.of_one):
        kept.cache_clear()


@pytest.mark.slow
def test_keeps_its_distance_from_an_auv_that_is_not_sure_of_its_place(monkeypatch):
    starts = [(30.0, 0.0, 2.5), (0.0, -25.0, 0.5), (-20.0, 15.0, -0.5)]
    sure, unsure = (
        [closest(belief(0.0, 0.0, sigma), np.array(start)) for start in starts]
        for sigma in (0.1, 6.0)
    )
    assert np.median(unsure) > np.median(sure) + 2.0
    assert min(unsure) > 6.0  # one standard deviation
    assert condition_on_range is branching.condition_on_range
    monkeypatch.setattr(branching, "condition_on_range", first_order_update)
    forget_the_search()
    blind = [closest(belief(0.0, 0.0, 6.0), np.array(start)) for start in starts]
    forget_the_search()
    assert min(blind) < 6.0  # negative control: as a filter that neglects the error, it goes closer
    assert np.median(blind) < np.median(unsure) - 2.0


@pytest.mark.parametrize(
    "change",
    [
        {"current": (math.nan, 0.0)},
        {"process_noise": (math.nan, 0.0, 0.0)},
        {"covariance": np.full((4, 4), np.nan)},
    ],
)
def test_beliefs_that_are_no_numbers_are_said_to_be_so(change):
    cna = op.Unicycle(speed=2.0, min_turn_radius=5.0)
    auv = replace(op.Belief.at(30.0, 0.0, speed=1.0, covariance=np.eye(4)), **change)
    decision = op.InformationHorizon(op.Situation(cna, ping_interval=2.0)).plan(
        op.Pose(0.0, 0.0, 0.0), [auv]
    )
    assert decision.status == Status.INVALID_INPUT
    assert decision.turn_rate == 0.0


# Its limits


def between(run, points=11):
    """Time and position on the arcs of every step, in complex numbers."""
    for k, (pose, turn, speed) in enumerate(
        zip(run.cna[:-1], run.turn_rate, run.speed, strict=False)
    ):
        yield from (
            (run.time[k] + t, arc(pose, turn, speed, t)[:2])
            for t in np.linspace(0.0, run.time[k + 1] - run.time[k], points)
        )


@pytest.mark.slow
@pytest.mark.parametrize(("knowledge", "interval"), [("estimate", 1.0), ("survey", 2.0)])
def test_keeps_out_and_within_the_fence_also_between_decisions(knowledge, interval):
    options = {"kind": "information", "interval": interval, "knowledge": knowledge}
    free = op.simulate(scenario(planner=options, duration=80.0))
    (x, y), square = (
        free.cna[80, :2],
        np.array([[0, 0], [9, 0], [9, 9], [0, 9]]),
    )  # where it would like to be after 40 s
    corner, west = free.cna[120, :2] - 4.0, float(free.cna[:, 0].min()) + 5.0
    fence = [[west, -90.0], [95.0, -90.0], [95.0, 90.0], [west, 90.0]]
    keep_out = [
        {"x": float(x), "y": float(y), "radius": 8.0},
        {"points": (corner + square).tolist()},
    ]
    run = op.simulate(
        scenario(
            planner=options, constraints={"keep_out": keep_out, "geofence": fence}, duration=80.0
        )
    )

    def violation(place):
        return max(
            8.0 - math.dist(place, (x, y)),
            min(*(place - corner), *(corner + 9.0 - place)),
            west - place[0],
        )

    assert max(violation(place) for _, place in between(run)) < 1e-3
    assert not (run.status == Status.VIOLATED).any()
    assert max(violation(place) for _, place in between(free)) > 3.0  # the limits do limit


@pytest.mark.slow
def test_keeps_its_separation_from_auvs_whose_survey_it_knows():
    quiet = {
        f"auv__{i}__process_noise": {"position": 0.0, "heading_deg": 0.0, "speed": 0.0}
        for i in (0, 1)
    }
    quiet |= {
        f"auv__{i}__first_estimate": {
            "sigma_position": 1e-3,
            "sigma_heading_deg": 1e-3,
            "sigma_speed": 1e-4,
        }
        for i in (0, 1)
    }
    start = {
        "speed": 2.0,
        "min_turn_radius": 5.0,
        "start": {"x": 30.0, "y": -30.0, "heading_deg": 140.0},
    }
    common = {
        "planner": {"kind": "information", "interval": 1.0, "knowledge": "survey"},
        "cna": start,
        "duration": 60.0,
        **quiet,
    }
    limited = scenario(constraints={"min_separation": 20.0, "max_separation": 60.0}, **common)
    runs = [op.simulate(mission) for mission in (limited, scenario(**common))]
    distances, free = (
        [
            math.dist(place, auv.position(np.array([time]))[0])
            for time, place in between(run)
            for auv in limited.references
        ]
        for run in runs
    )
    assert min(distances) >= 20.0 - 1e-3
    assert max(distances) <= 60.0 + 1e-3
    assert min(free) < 19.0
    assert not (runs[0].status == Status.VIOLATED).any()


@pytest.mark.slow
def test_from_within_a_keep_out_it_says_so_and_leaves():
    mission = scenario(
        planner={"kind": "information", "interval": 1.0, "knowledge": "survey"},
        constraints={"keep_out": [{"x": 80.0, "y": -30.0, "radius": 12.0}]},
        duration=40.0,
    )
    run = op.simulate(mission)
    distance = np.hypot(run.cna[:, 0] - 80.0, run.cna[:, 1] + 30.0)
    assert run.status[0] == Status.VIOLATED
    left = np.flatnonzero(distance > 12.0)[0]
    assert run.time[left] < 15.0
    assert (distance[left:] > 12.0 - 1e-3).all()
    assert Status.VIOLATED not in run.status[left + 20 :]  # ten seconds later


@pytest.mark.slow
def test_beats_path_inertia_in_the_harbour_under_the_same_noise():
    rms = {
        kind: [
            op.simulate("harbor-survey", planner=kind, seed=seed).rms_error for seed in range(1, 6)
        ]
        for kind in ("information", "path-inertia")
    }
    assert (
        ttest_rel(
            np.log(rms["information"]), np.log(rms["path-inertia"]), alternative="less"
        ).pvalue
        < 0.05
    )


@pytest.mark.slow
@pytest.mark.skipif(compiler.find_compiler() is None, reason="no C compiler")
def test_decisions_of_a_mission_compile_nothing(monkeypatch, tmp_path):
    """The search is compiled before, so that a vehicle's first decision does not wait for it."""
    monkeypatch.setenv("OBSPLAN_CACHE", str(tmp_path))
    for kept in (beam_of, compiled.machine_code):
        kept.cache_clear()
    mission = op.load("harbor-survey", settings=["duration=30.0"])
    asked = mission.planner()
    asked.prepare(mission.start, lambda *_: None)
    monkeypatch.setattr(compiler, "_built", None)
    run = op.simulate(mission, planner=mission.planner())
    assert set(run.status_counts) == {"optimal"}
