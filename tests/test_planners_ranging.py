"""Planners that are told how ranges err, which of them come and when: by brute force, and by what they then do."""

import cmath
import math

import numpy as np
import pytest
from oracles import arc

import obsplan as op
from formulations.model.ranging import Ranging
from formulations.model.schedule import Schedule
from obsplan.planners.centroid_orbit import CentroidOrbit
from obsplan.planners.error_ellipse import ErrorEllipse
from obsplan.planners.trail import Trail

CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)
RATES = np.linspace(0.4, -0.4, 9)
INTERVAL, SLOTS, SILENT = 6.0, (0.0, 1.5), ((12.5, 19.0), (25.4, 25.6))
LAWS = [
    Ranging(0.7, growth=0.05),
    Ranging(0.7, slant=True),
    Ranging(0.7, loss=0.3, half_distance=25.0, reach=30.0),
    Ranging(0.7, growth=0.05, slant=True, loss=0.2, half_distance=40.0),
    Ranging(3.0, squared=True, loss=0.1, half_distance=30.0),
]


def situation(ranging, **more):
    return op.Situation(CNA, ranging=ranging, transducer_depth=2.0, heading_sigma=0.05, **more)


def deep_auvs(rng):
    """Two AUVs under way, at depth."""
    for weight, depth in ((1.0, 14.0), (2.0, 27.0)):
        root = rng.normal(size=(4, 4)) * [[3.0], [3.0], [0.1], [0.1]]
        mean = np.array([*rng.uniform(-15, 15, 2), rng.uniform(-3, 3), rng.uniform(0.5, 1.5)])
        yield op.Belief(
            mean=mean, covariance=root @ root.T, weight=weight, current=(0.2, -0.1), depth=depth
        )


def velocity(auv):
    return auv.mean[3] * np.array([math.cos(auv.mean[2]), math.sin(auv.mean[2])]) + auv.current


def arrives(ranging, r):
    near = 2.0 ** -((r / ranging.half_distance) ** 2)
    if ranging.reach < math.inf:
        near /= 1 + math.exp((r / ranging.reach - 1) / 0.05)
    far = 0.01 * (1 - near) / (1 + r / ranging.half_distance + r / ranging.reach)
    return (1 - ranging.loss) * (near + far)


def variance_of(ranging, r):
    return ranging.sigma**2 + (ranging.growth * r) ** 2


def slots_after(time, offset, count, silent=SILENT):
    """The next slots of an AUV, and whether they are heard."""
    slots = [k * INTERVAL + offset for k in range(1, 99) if k * INTERVAL + offset > time][:count]
    return [(slot, not any(start <= slot <= stop for start, stop in silent)) for slot in slots]


@pytest.mark.parametrize("auv", [0, 1])
def test_time_to_the_next_range_is_to_the_first_slot_that_is_heard(auv):
    silent = ((36.0, 43.5), (12.5, 27.0), (26.0, 29.0))
    schedule = Schedule(interval=INTERVAL, offsets=SLOTS, silent=silent)
    for time in np.arange(0.05, 40.0, 0.7):
        slots = slots_after(time, SLOTS[auv], 9, silent)
        assert float(schedule.time_to_slot(time, auv)) == pytest.approx(slots[0][0] - time)
        heard = next(slot for slot, comes in slots if comes)
        assert float(schedule.time_to_range(time, auv)) == pytest.approx(heard - time)


def gramian_by_hand(pose, auv, u, slots, time, ranging):
    """Information about the relative position and heading, from sums over slots in complex numbers."""
    W, squares, count = np.zeros((3, 3)), 0.0, len(slots)
    heard = [slot - time for slot, comes in slots if comes]
    for t in heard:
        moved = 2.0 * t if u == 0 else 2.0 / (1j * u) * (cmath.exp(1j * u * t) - 1)
        moved *= cmath.exp(1j * pose[2])
        p = complex(*(np.array(pose[:2]) - auv.mean[:2] - velocity(auv) * t)) + moved
        J = np.array([2 * p.real, 2 * p.imag, 2 * (p.conjugate() * 1j * moved).real])
        W += np.outer(J, J)
        squares += abs(p) ** 2 / len(heard)
    r = math.sqrt(squares + ((auv.depth - 2.0) ** 2 if ranging.slant else 0.0))
    worth = arrives(ranging, r) / variance_of(ranging, r) / (1 if ranging.squared else 4 * r**2)
    return worth * W + np.diag([0.0, 0.0, count / 0.05**2])


@pytest.mark.parametrize("ranging", LAWS, ids=str)
def test_the_gramian_weighs_pings_by_what_they_are_expected_to_tell(ranging):
    rng = np.random.default_rng(7)
    known = situation(ranging, ping_interval=INTERVAL, slots=SLOTS, silent=SILENT)
    planner = op.GramianHorizon(
        known,
        metric="trace-inverse",
        noise="sensor",
        motion="constant-velocity",
        sampling="pings",
        turn_rates=9,
        horizon=5 * INTERVAL,
    )
    differs = 0
    for time in (0.0, 4.9, 11.0):
        pose, believed = (4.0, -3.0, float(rng.uniform(-3, 3))), list(deep_auvs(rng))
        totals = []
        for u in RATES:
            slots = [slots_after(time, offset, 5) for offset in SLOTS]
            W = [
                gramian_by_hand(pose, auv, u, own, time, ranging)
                for auv, own in zip(believed, slots, strict=True)
            ]
            traces = [np.trace(np.linalg.inv(one)) for one in W]
            totals.append(np.average(traces, weights=[1, 2]))
        decision = planner.plan(op.Pose(*pose), believed, time=time)
        assert decision.score == pytest.approx(min(totals), rel=1e-6)
        assert decision.turn_rate == RATES[np.argmin(totals)]
        plain = op.GramianHorizon(
            situation(Ranging(0.7), ping_interval=INTERVAL),
            **{
                name: getattr(planner, name)
                for name in ("metric", "noise", "motion", "sampling", "turn_rates", "horizon")
            },
        )
        differs += plain.plan(op.Pose(*pose), believed, time=time).score != decision.score
    assert differs == 3


def test_the_gramian_says_so_where_all_pings_are_silent():
    known = situation(Ranging(1.0), ping_interval=INTERVAL, silent=((0.0, 100.0),))
    planner = op.GramianHorizon(known, noise="sensor", sampling="pings")
    decision = planner.plan(op.Pose(0.0, 0.0, 0.0), [op.Belief.at(9.0, 2.0)])
    assert (decision.turn_rate, decision.status) == (0.0, op.Status.UNOBSERVABLE)


@pytest.mark.parametrize("ranging", LAWS, ids=str)
def test_the_error_ellipse_counts_what_a_range_is_expected_to_leave(ranging):
    rng = np.random.default_rng(8)
    known = situation(ranging, ping_interval=INTERVAL, slots=SLOTS, silent=SILENT)
    planner = ErrorEllipse(known, turn_rates=9)
    for time in (0.0, 4.9, 11.0):
        pose, believed = (4.0, -3.0, float(rng.uniform(-3, 3))), list(deep_auvs(rng))
        totals = []
        for u in RATES:
            left = []
            for auv, offset in zip(believed, SLOTS, strict=True):
                slot = next(slot for slot, comes in slots_after(time, offset, 9) if comes)
                x = (
                    arc(pose, u, 2.0, slot - time)[:2]
                    - auv.mean[:2]
                    - velocity(auv) * (slot - time)
                )
                d, P = math.hypot(*x), auv.covariance[:2, :2]
                r = math.hypot(d, auv.depth - 2.0) if ranging.slant else d
                variance, b = variance_of(ranging, r), ranging.growth
                slope = 2 * d if ranging.squared else d / r
                told = slope**2 / variance + 2 * (b**2 * d / variance) ** 2
                along = x @ P @ x / d**2
                after = 1 / (1 / along + told)
                p = arrives(ranging, r)
                left.append(np.trace(P) - along + p * after + (1 - p) * along)
            totals.append(np.average(left, weights=[1, 2]))
        decision = planner.plan(op.Pose(*pose), believed, time=time)
        assert decision.score == pytest.approx(min(totals), rel=1e-9)
        assert decision.turn_rate == RATES[np.argmin(totals)]


GROWING = Ranging(1.0, growth=0.01, slant=True)  # best at 74.8 m over 50 m


@pytest.mark.parametrize(
    ("ranging", "depth", "radius"),
    [
        (GROWING, 52.0, 74.77),  # the transducer being at 2 m
        (GROWING, 6.0, 20.008),
        (GROWING, 2.0, 10.0),
        (GROWING._replace(slant=False), 52.0, 10.0),
        (Ranging(1.0, slant=True), 52.0, 10.0),  # the farther the better
    ],
)
def test_orbit_and_trail_keep_the_distance_at_which_ranges_over_the_depth_tell_most(
    ranging, depth, radius
):
    known = situation(ranging)
    believed = [
        op.Belief(mean=np.zeros(4), covariance=np.eye(4), depth=depth),
        op.Belief(mean=np.zeros(4), covariance=np.eye(4), depth=900.0, weight=0.0),
    ]
    pose = op.Pose(200.0, 0.0, 1.0)
    orbit, trail = CentroidOrbit(known), Trail(known)
    assert orbit.plan(pose, believed).score == pytest.approx((200.0 - radius) ** 2, rel=1e-3)
    assert trail.plan(pose, believed).score == pytest.approx((200.0 + radius) ** 2, rel=1e-3)
    given = CentroidOrbit(known, orbit_radius=30.0), Trail(known, behind=30.0)
    assert given[0].plan(pose, believed).score == pytest.approx(170.0**2)
    assert given[1].plan(pose, believed).score == pytest.approx(230.0**2)


def test_the_position_counts_alike_whatever_unit_the_heading_has():
    known, pose = situation(Ranging(0.7), ping_interval=INTERVAL), op.Pose(4.0, -3.0, 0.8)
    alike, other = (
        [
            op.GramianHorizon(known, gramian=name, noise="sensor", block=block).plan(
                pose, [op.Belief.at(9.0, 2.0)]
            )
            for name in ("exact", "degrees")
        ]
        for block in ("position", "pose")
    )
    assert alike[0].score == pytest.approx(alike[1].score, rel=1e-9)
    assert alike[0].turn_rate == alike[1].turn_rate
    assert other[0].score != pytest.approx(other[1].score, rel=0.5)
