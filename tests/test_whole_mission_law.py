"""Whole missions under the whole law of ranges: growing errors, heights, losses, slots, beacons, and several aid vehicles."""

import math
from dataclasses import replace

import numpy as np
import pytest
from oracles import arc
from test_whole_mission import mission

from formulations.beam_search import search_manoeuvres
from formulations.model.ranging import Ranging
from formulations.model.schedule import Schedule
from formulations.solution import Status
from formulations.whole_mission import AidVehicle, Beacon, Problem, optimise
from formulations.whole_mission.aided import information
from formulations.whole_mission.covariance import PredictedVariance
from formulations.whole_mission.path import Turns
from formulations.whole_mission.search import Objective
from formulations.whole_mission.starts import receding_horizon
from formulations.whole_mission.team import in_turn

RNG = np.random.default_rng
EVERYTHING = Ranging(sigma=0.8, growth=0.03, slant=True, loss=0.2, half_distance=50.0, reach=70.0)
LEVEL = Ranging(sigma=1.2, growth=0.02, loss=0.1)


def at_sea(**change):
    """AUVs at depths that change, two aid vehicles and a beacon, ranges in slots and silences."""
    m = mission(steps=64, every=8)
    deep = np.linspace([10.0, 30.0], [25.0, 20.0], 65)
    first = AidVehicle(
        start=np.array([-30.0, 5.0, 0.3]),
        speed=2.0,
        max_turn_rate=0.3,
        ranging=EVERYTHING,
        schedule=Schedule(interval=4.0, offsets=(0.0, 1.5), silent=((11.0, 14.0),)),
        depth=1.0,
    )
    second = replace(
        first,
        start=np.array([25.0, -20.0, 2.0]),
        speed=1.5,
        max_turn_rate=0.2,
        ranging=LEVEL,
        schedule=Schedule(interval=6.0, offsets=(2.2, 0.0)),
        depth=3.0,
    )
    moored = Beacon(
        position=np.tile([20.0, 35.0], (65, 1)),
        ranging=EVERYTHING,
        schedule=Schedule(interval=8.0, offsets=(2.0, 4.5)),
        depth=40.0,
    )
    return replace(
        m, **{"depth": deep, "vehicles": (first, second), "beacons": (moored,), **change}
    )


def paths(m, w, hold):
    """Positions of all vehicles, arc by arc in complex numbers."""
    found = []
    for vehicle, own in zip(m.vehicles, w, strict=True):
        poses = [vehicle.start]
        for k in range(m.steps):
            turn = own[k // hold] * vehicle.max_turn_rate
            poses.append(arc(poses[-1], turn, vehicle.speed, m.time_step))
        found.append(np.array(poses)[:, :2])
    return np.array(found)


def due(schedule, auv, time, step):
    """Whether a range has come due since the sample before: round by round, in plain numbers."""
    for k in range(1, 1000):
        at = k * schedule.interval + (schedule.offsets[auv] if schedule.offsets else 0.0)
        quiet = any(start <= at <= stop for start, stop in schedule.silent)
        if not quiet and -1e-9 < time - at < step - 1e-9:
            return True
    return False


def ranged(P, x, ranging, height):
    """Covariance after one range that may be lost: the mixture of both outcomes, the one that it comes in information form."""
    r = math.sqrt(x @ x + (height**2 if ranging.slant else 0.0))
    within = 1 / (1 + math.exp((r / ranging.reach - 1) / 0.05)) if ranging.reach < math.inf else 1.0
    near = 0.5 ** ((r / ranging.half_distance) ** 2) * within
    afar = 0.01 * (1 - near) / (1 + r / ranging.half_distance + r / ranging.reach)
    p = (1 - ranging.loss) * (near + afar)
    bend = (np.eye(2) - np.outer(x, x) / r**2) / r @ P[:2, :2]  # Hessian of the range, times P
    second = (np.trace(bend) ** 2 + 2 * np.trace(bend @ bend)) / 4
    R = ranging.sigma**2 + (ranging.growth * r) ** 2 + second
    H = np.array([*x, 0.0, 0.0]) / r
    came = np.linalg.inv(np.linalg.inv(P) + np.outer(H, H) / R)
    return p * came + (1 - p) * P


def before_ranges(m, x):
    """Each AUV's position variance before the ranges of each sample: the filter sample by sample."""
    P, dt, found = m.covariance.copy(), m.time_step, []
    everyone = [*zip(m.vehicles, x, strict=True), *((b, b.position) for b in m.beacons)]
    for k in range(1, m.steps + 1):
        for i in range(len(P)):
            (c, s), v = m.heading[k - 1, i], m.speed[k - 1, i]
            F = np.eye(4)
            F[:2, 2:] = dt * np.array([[-v * s, c], [v * c, s]])
            P[i] = F @ P[i] @ F.T + np.diag(m.process_noise[i] ** 2 * dt)
            P[i] = np.linalg.inv(np.linalg.inv(P[i]) + np.diag([0, 0, m.compass**-2, 0]))
        found.append(np.trace(P[:, :2, :2], axis1=1, axis2=2))
        for other, place in everyone:
            for i in range(len(P)):
                if due(other.schedule, i, k * dt, dt):
                    away = place[k] - m.position[k, i]
                    P[i] = ranged(P[i], away, other.ranging, m.depth[k, i] - other.depth)
    return np.array(found)


@pytest.mark.parametrize("stage", [3, 9, -1])
def test_covariance_is_that_of_the_filter_sample_by_sample(stage):
    m = at_sea()
    moment = np.zeros_like(m.stages.share)
    moment[stage, 2] = 1.0  # nothing counts but the end of one stage
    m.__dict__["stages"] = m.stages._replace(share=moment)
    x = paths(m, RNG(1).uniform(-1, 1, (2, 32)), 2)
    ends = m.stages.end
    value = PredictedVariance(m).value(x[:, ends].swapaxes(0, 1))
    expected = before_ranges(m, x)[ends[stage] - 1] @ m.weights
    assert value == pytest.approx(expected, rel=1e-9)


def test_ranges_count_in_their_slots_and_none_in_silences():
    first, second, moored = at_sea().pings
    assert [list(pings) for pings in first] == [
        [8, 16, 32, 40, 48, 56, 64],
        [11, 19, 35, 43, 51, 59],
    ]
    assert [list(pings) for pings in second] == [[17, 29, 41, 53], [12, 24, 36, 48, 60]]
    assert [list(pings) for pings in moored] == [[20, 36, 52], [25, 41, 57]]
    late = replace(at_sea(), begin=5.0, beacons=())  # 10 samples later
    assert list(late.pings[0][0]) == [6, 22, 30, 38, 46, 54, 62]


@pytest.mark.parametrize("beginning", [0.0, 5.0])
def test_gradient_is_the_difference_quotient_with_everything_on(beginning):
    def shore(x, _):
        return 20.0 - np.hypot(x[..., 0], x[..., 1])

    m = at_sea(separation=(30.0, 60.0), begin=beginning)
    m = replace(m, vehicles=(replace(m.vehicles[0], violation=shore, margin=5.0), m.vehicles[1]))
    objective = Objective(Turns(m, 4))
    w = RNG(4).uniform(-1, 1, 32) * (np.arange(32) % 3 > 0)
    _, gradient = objective.penalised(w, 10.0)
    step = 1e-5  # error of the quotient: step^2, and 1e-15 / step of rounding
    ahead, behind = (
        [objective.penalised(w + sign * step * e, 10.0)[0] for e in np.eye(w.size)]
        for sign in (1, -1)
    )
    quotient = (np.array(ahead) - behind) / (2 * step)
    np.testing.assert_allclose(gradient, quotient, rtol=1e-5, atol=1e-5)
    assert np.abs(gradient).min() > 0


def test_gradient_is_finite_on_top_of_an_auv_where_no_range_is_due():
    m = mission(steps=12, auvs=1, every=20, ranging=Ranging(1.0, half_distance=1e4))
    there = m.position[m.stages.end, :1]
    value, gradient = PredictedVariance(m)(there)
    assert math.isfinite(value)
    np.testing.assert_array_equal(gradient, 0.0)


def test_information_of_a_beacon_is_that_of_its_ranges_one_by_one():
    m = at_sea()
    told = information(m)
    assert np.flatnonzero(told.any(axis=(1, 2, 3))).tolist() == [20, 25, 36, 41, 52, 57]
    (beacon,) = m.beacons
    x, h = beacon.position[25] - m.position[25, 1], m.depth[25, 1] - 40.0
    r = math.sqrt(x @ x + h**2)
    assert r < 70.0  # within reach
    p, sigma = 0.8 * 0.5 ** ((r / 50) ** 2), math.hypot(0.8, 0.03 * r)
    slope = 0.03**2 * r / sigma  # the deviation's, which tells of the distance as well
    expected = p * np.outer(x, x) / r**2 * (1 + 2 * slope**2) / sigma**2
    np.testing.assert_allclose(told[25, 1], expected, rtol=1e-9)


def test_receding_horizon_counts_what_others_tell():
    """A beacon tells of the AUV's east every second; its north is left to learn, which the vehicle starts in the south of it for."""
    m = mission(steps=40, auvs=1, every=4, start=np.array([0.0, -40.0, 0.3]))
    still = replace(m, position=np.zeros((41, 1, 2)), speed=np.zeros((41, 1)))
    beacon = Beacon(
        position=np.tile([500.0, 0.0], (41, 1)),
        ranging=Ranging(0.05),
        schedule=Schedule(interval=1.0),
    )
    aside = []
    for beacons in ((), (beacon,)):
        turns = Turns(replace(still, beacons=beacons), 4)
        x, y, _ = turns.poses(receding_horizon(turns, 6, 7, 32))[0, -1]
        aside.append(abs(math.atan2(x, -y)))
    alone, aided = aside
    assert aided < math.radians(30) < math.radians(50) < alone


def test_search_of_the_receding_horizon_is_told_what_a_beacon_tells_within_each_stage(monkeypatch):
    asked = []

    def search(*given, stages, known, **rest):
        asked.append((np.cumsum(stages.duration), known))
        return search_manoeuvres(*given, stages=stages, known=known, **rest)

    monkeypatch.setattr("formulations.whole_mission.starts.search_manoeuvres", search)
    m = at_sea()
    one = replace(m, vehicles=m.vehicles[:1])
    receding_horizon(Turns(one, 4), 6, 7, 8)
    told, begins = information(one), [0, *one.stages.end[:-1]]
    for begin, (ends, known) in zip(begins, asked, strict=True):
        edges = begin + np.append(0.0, ends) / one.time_step
        for stage in range(len(ends)):
            within = [k for k in (20, 25, 36, 41, 52, 57) if edges[stage] < k <= edges[stage + 1]]
            np.testing.assert_allclose(known[stage], told[within].sum(axis=0), rtol=1e-9)


def moored(depth, ranging, about):
    """An AUV at rest at a depth; a vehicle that starts at one and a half times a radius, which it rounds in 126 samples."""
    n, step = 301, about / 40
    vehicle = AidVehicle(
        start=np.array([1.5 * about, 0.0, np.pi / 2]),
        speed=2.0,
        max_turn_rate=16.0 / about,
        ranging=ranging,
        schedule=Schedule(interval=2 * step),
    )
    return Problem(
        time_step=step,
        position=np.zeros((n, 1, 2)),
        heading=np.ones((n, 1, 2)) * [1.0, 0.0],
        speed=np.zeros((n, 1)),
        depth=np.full((n, 1), depth),
        covariance=np.diag([(0.02 * about) ** 2] * 2 + [1e-4, 1e-6])[None],
        process_noise=np.array([[8e-5 * about, 8e-5 * about, 0.0, 0.0]]),
        weights=np.ones(1),
        compass=0.02,
        vehicles=(vehicle,),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sigma", "growth", "radius"),
    [
        # of (a^2 + b^2 r^2) r^2 / rho^2 the least is at rho^2 = h sqrt(a^2 + b^2 h^2) / b
        (1.0, 0.01, math.sqrt(50 * math.sqrt(1 + 0.25) / 0.01)),
        (1e-3, 0.01, 50.0),
    ],
)
def test_planned_orbit_has_the_radius_of_the_law(sigma, growth, radius):
    m = moored(50.0, Ranging(sigma, growth=growth, slant=True), radius)
    plan = optimise(m, hold=10, count=1, random=RNG(1))
    x = Turns(m, 10).poses(plan.x.ravel() / m.vehicles[0].max_turn_rate)[0, 151:, :2]
    assert np.hypot(*x.T).mean() == pytest.approx(radius, rel=0.05)


@pytest.mark.slow
def test_two_vehicles_at_once_beat_one_and_each_in_turn():
    both = at_sea(beacons=())
    one = replace(both, vehicles=both.vehicles[:1])
    alone = optimise(one, hold=8, count=3, random=RNG(2))
    in_turns = in_turn(both, hold=8, count=3, random=RNG(2))
    plan = optimise(both, hold=8, count=3, random=RNG(2))
    assert plan.x.shape == (2, 8)
    assert plan.objective < 0.9 * alone.objective
    assert plan.objective <= in_turns.value
    limits = np.array([[vehicle.max_turn_rate] for vehicle in both.vehicles])
    assert (np.abs(plan.x) <= limits).all()
    x = paths(both, plan.x / limits, 8)
    scored = PredictedVariance(both).value(x[:, both.stages.end].swapaxes(0, 1))
    assert plan.objective == pytest.approx(scored, rel=1e-9)


@pytest.mark.slow
def test_planning_in_turn_ends_where_no_vehicle_alone_does_better():
    m = at_sea(beacons=())
    best = in_turn(m, hold=4, count=4, random=RNG(2))
    turns = Turns(m, 4)
    _, gradient = Objective(turns).penalised(best.w, 0.0)
    projected = np.clip(best.w - gradient, -1, 1) - best.w
    start = np.abs(Objective(turns).penalised(np.zeros(32), 0.0)[1]).max()
    assert np.abs(projected).max() < 0.05 * start


@pytest.mark.slow
def test_vehicles_keep_their_distances():
    m = at_sea(beacons=())
    free = optimise(m, hold=8, count=1, random=RNG(3))
    limits = np.array([[vehicle.max_turn_rate] for vehicle in m.vehicles])

    def distances(plan):
        one, other = paths(m, plan.x / limits, 8)
        return np.hypot(*(one - other).T)[1:]

    least = 1.2 * distances(free).min()
    held = replace(m, vehicles=tuple(replace(v, margin=0.3) for v in m.vehicles))
    kept = optimise(replace(held, separation=(least, 80.0)), hold=8, count=1, random=RNG(3))
    assert kept.status in (Status.OPTIMAL, Status.INACCURATE, Status.BEST_MANOEUVRE)
    assert distances(kept).min() >= least
    assert distances(kept).max() <= 80.0
    assert kept.objective >= free.objective * 0.999
