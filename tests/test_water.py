import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from oracles import Spy, arc, scenario

import obsplan as op
from formulations.solution import Status
from obsplan.estimators import Ekf
from obsplan.next_move import Stream, loiter_violation
from obsplan.planners import planner_class
from obsplan.planners.circle import Circle
from obsplan.planners.whole_mission import WholeMission
from obsplan.planning.filed import Filed
from obsplan.planning.limits import LimitsAhead, within_limits
from obsplan.planning.water import in_the_water
from obsplan.sensors import SPEED_SENSORS, Dvl, WaterSpeed
from obsplan.sensors.sensor import BEACON
from obsplan.vehicles import STATES
from obsplan.water import Tide, Water

PROFILE = ((10.0, 0.4, 0.0), (30.0, 0.2, -0.1), (100.0, 0.0, -0.1))


@pytest.mark.parametrize(
    ("depth", "added"),
    [
        (0.0, (0.4, 0.0)),  # above the first row
        (10.0, (0.4, 0.0)),
        (15.0, (0.35, -0.025)),  # a quarter of the way
        (65.0, (0.1, -0.1)),
        (4000.0, (0.0, -0.1)),  # below the last
    ],
)
def test_current_is_linear_between_the_depths_of_a_profile_which_adds_to_the_uniform_one(
    depth, added
):
    water = Water(current=(0.1, 0.2), profile=PROFILE)
    np.testing.assert_allclose(water.at(0.0, depth), np.add((0.1, 0.2), added), atol=1e-15)


def test_tide_is_greatest_at_its_phase_and_turns_half_a_period_later():
    water = Water(
        current=(0.1, 0.0), tide=Tide(amplitude=(0.3, -0.4), period=4000.0, phase=np.pi / 2)
    )
    times = np.array([0.0, 1000.0, 2000.0, 3000.0])
    found = water.at(times, 5.0) - (0.1, 0.0)
    np.testing.assert_allclose(found, [[0, 0], [0.3, -0.4], [0, 0], [-0.3, 0.4]], atol=1e-15)


def test_mean_is_that_over_a_tide_and_the_strongest_current_is_never_exceeded():
    water = Water(
        current=(0.1, 0.2),
        profile=PROFILE,
        tide=Tide(amplitude=(0.3, 0.1), period=600.0, phase=1.0),
    )
    times, depths = np.arange(600.0), np.array([0.0, 20.0, 50.0])
    found = water.at(times[:, None], depths)
    assert found.shape == (600, 3, 2)
    np.testing.assert_allclose(found.mean(axis=0), water.mean(depths), atol=1e-14)
    speed = np.linalg.norm(found, axis=-1).max(axis=0)
    # the nearest sample is half a second off the peak: relatively (π / 600)² / 2 of the tide
    np.testing.assert_allclose(speed, water.strongest(depths), rtol=2e-5)
    assert (speed <= water.strongest(depths) + 1e-15).all()


def test_still_water_is_uniform_and_at_rest():
    assert Water().is_uniform
    np.testing.assert_array_equal(Water().at(np.zeros(3), 7.0), np.zeros((3, 2)))
    assert not Water(profile=PROFILE).is_uniform
    assert not Water(tide=Tide()).is_uniform


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda: Water(current=(11.0, 0.0)), "current must be from -10 to 10 m/s .*, got 11.0"),
        (lambda: Water(current=(math.nan, 0.0)), "current must be .*, got nan"),
        (
            lambda: Water(profile=((5.0, 0.0, 0.0), (5.0, 0.1, 0.0))),
            "profile must have increasing depths, got 5.0 after 5.0: order it",
        ),
        (lambda: Water(profile=((-1.0, 0.0, 0.0),)), r"profile\[0\] must be a depth from 0"),
        (lambda: Water(profile=((1.0, 0.0, 99.0),)), r"profile\[0\] .*got \[1.0, 0.0, 99.0\]"),
        (lambda: Tide(period=1.0), "period must be from 60 to 2678400 s .*, got 1.0"),
        (lambda: Tide(amplitude=(0.0, -20.0)), "amplitude must be .*, got -20.0"),
        (lambda: Tide(phase=math.inf), r"phase must be finite \[rad\], got inf"),
    ],
)
def test_water_that_no_sea_has_is_refused(build, said):
    with pytest.raises(ValueError, match=said):
        build()


def told(east, north):
    """A beacon of which the current alone is known."""
    beacon = np.zeros(len(BEACON))
    beacon[BEACON.index("east_current")] = east
    beacon[BEACON.index("north_current")] = north
    return beacon


def measured(sensor, x, beacon):
    """What a sensor measures, as a number."""
    s, b = ca.SX.sym("x", len(x)), ca.SX.sym("b", len(beacon))
    return float(ca.Function("z", [s, b], [sensor.measure(s, b)])(x, beacon))


def test_a_log_measures_speed_through_the_water_and_a_dvl_the_velocity_over_ground_from_the_bow():
    rng = np.random.default_rng(1)
    for _ in range(20):
        x, c = rng.normal(size=4), complex(*rng.normal(size=2))
        beacon = told(c.real, c.imag)
        # over ground, turned until the bow points along the real axis
        seen = (x[3] * np.exp(1j * x[2]) + c) * np.exp(-1j * x[2])
        forward, left = Dvl().components([*STATES])
        (log,) = WaterSpeed().components([*STATES])
        assert measured(forward, x, beacon) == pytest.approx(seen.real, abs=1e-14)
        assert measured(left, x, beacon) == pytest.approx(seen.imag, abs=1e-14)
        assert measured(log, x, beacon) == x[3]
        own = [*STATES, "current_east", "current_north"]
        estimated = np.array([*x, c.real, c.imag])
        for component, z in zip(Dvl().components(own), (seen.real, seen.imag), strict=True):
            assert measured(component, estimated, told(9.0, 9.0)) == pytest.approx(z, abs=1e-14)


def corrected(x, P, z, sensors, beacon):
    """Mean and covariance of an EKF after measurements at once."""
    for value, sensor in zip(z, sensors, strict=True):
        x, P = Ekf().update(x, P, ca.SX(value), sensor, ca.SX(beacon))
    return ca.evalf(x).full().ravel(), ca.evalf(P).full()


@pytest.mark.parametrize("kind", SPEED_SENSORS)
def test_a_filter_finds_its_current_from_a_dvl_beside_a_log_and_not_from_a_log(kind):
    """Speed and heading known well, the DVL's error alone is left of the current's."""
    names = [*STATES, "current_east", "current_north"]
    truth = np.array([0.0, 0.0, 0.6, 1.2, 0.3, -0.2])
    first = np.array([0.0, 0.0, 0.6, 1.2, 0.0, 0.0])
    P = np.diag([1.0, 1.0, 1e-8, 1e-8, 0.25, 0.25])
    sensors = SPEED_SENSORS[kind](sigma=0.01).components(names)
    z = [measured(sensor, truth, told(0.3, -0.2)) for sensor in sensors]
    x, after = corrected(ca.SX(first), ca.SX(P), z, sensors, told(0.0, 0.0))
    sigma = np.sqrt(np.linalg.eigvalsh(after[4:, 4:]))
    if kind == "dvl":
        # 1/σ² = 1/0.01² + 1/0.5², and the same share of the first error is left
        np.testing.assert_allclose(sigma, (1 / 0.01**2 + 1 / 0.5**2) ** -0.5, rtol=1e-3)
        np.testing.assert_allclose(x[4:], truth[4:], rtol=1e-3)
    else:
        np.testing.assert_array_equal(sigma, 0.5)
        np.testing.assert_array_equal(x[4:], 0.0)


@pytest.mark.parametrize("cls", SPEED_SENSORS.values())
def test_a_log_errs_by_the_same_everywhere(cls):
    for sensor in cls(sigma=0.07).components([*STATES]):
        assert sensor.deviation(ca.SX.zeros(4), ca.SX.zeros(len(BEACON))) == 0.07
        assert not sensor.periodic


# the aid vehicle in the water that carries it

CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)
FLOW = (0.25, -0.5)  # binary fractions: differences are exact
POSE = op.Pose(3.0, -2.0, 0.4, 0.1)
TIMES = np.arange(0.0, 40.0)


def beliefs(flow, *, with_route=True):
    """Two AUVs in water that flows: one on a bent route, one that is dead-reckoned."""
    P = np.diag([9.0, 4.0, 0.01, 0.04])

    def route(t):
        bend = np.stack([30.0 + t, 10.0 + np.maximum(t - 8.0, 0.0)], axis=-1)
        return bend + np.asarray(t)[:, None] * flow

    return [
        op.Belief(
            mean=np.array([30.0, 10.0, 0.0, 1.0]),
            covariance=P,
            process_noise=(0.05, 0.01, 0.02),
            current=flow,
            route=route if with_route else None,
        ),
        op.Belief(
            mean=np.array([-20.0, 15.0, 2.0, 1.25]),
            covariance=2 * P,
            process_noise=(0.05, 0.01, 0.02),
            weight=2.0,
            current=flow,
        ),
    ]


DECIDING = [
    ("centroid-orbit", {}),
    ("error-ellipse", {}),
    ("gramian", {}),
    ("gramian", {"motion": "constant-velocity", "sampling": "pings"}),
    ("information", {}),
    ("path-inertia", {}),
    ("trail", {}),
    ("trajectory", {}),
]
AT_REST = [("path-inertia", {}), ("gramian", {})]  # what they take AUVs to be, whatever is told


@pytest.mark.parametrize(("name", "options"), DECIDING)
def test_in_water_that_carries_all_alike_decisions_are_those_in_still_water(name, options):
    """Only the difference of the currents counts (thesis 3.7, 3.8)."""
    cls = planner_class(name)
    still = cls(op.Situation(CNA, ping_interval=4.0), **options)
    carried = cls(op.Situation(CNA, ping_interval=4.0, current=FLOW), **options)
    rest = still.plan(POSE, beliefs((0.0, 0.0)), time=1.0)
    flowing = carried.plan(POSE, in_the_water(beliefs(FLOW), FLOW), time=1.0)
    np.testing.assert_allclose(flowing.turn_rate, rest.turn_rate, atol=1e-6)
    np.testing.assert_allclose(flowing.speed, rest.speed, rtol=1e-9)
    np.testing.assert_allclose(flowing.path, rest.path, atol=1e-6)
    np.testing.assert_allclose(flowing.score, rest.score, rtol=1e-8)
    assert flowing.status == rest.status
    # and the difference does count
    told = still.plan(POSE, beliefs(FLOW), time=1.0)
    alike = told.turn_rate == pytest.approx(rest.turn_rate) and told.score == pytest.approx(
        rest.score
    )
    assert alike == ((name, options) in AT_REST)


def test_beliefs_in_still_water_are_told_as_they_are():
    known = beliefs((0.0, 0.0))
    for told_of, auv in zip(in_the_water(known, (0.0, 0.0)), known, strict=True):
        assert told_of is auv


def filed(flow):
    """One AUV's survey, carried along, as filed for 40 s."""
    heading = np.where(TIMES < 20.0, 0.0, 1.5)[:, None]
    east = np.minimum(TIMES, 20.0) + np.maximum(TIMES - 20.0, 0.0) * math.cos(1.5)
    north = np.maximum(TIMES - 20.0, 0.0) * math.sin(1.5)
    position = np.stack([east, north], axis=-1) + TIMES[:, None] * flow
    return Filed(
        time=TIMES,
        position=position[:, None],
        heading=heading,
        speed=np.ones_like(heading),
        covariance=np.diag([9.0, 4.0, 0.01, 0.04])[None],
        process_noise=np.array([[0.05, 0.05, 0.01, 0.02]]),
        weights=np.ones(1),
    )


def test_a_whole_mission_in_water_that_carries_all_alike_is_that_in_still_water():
    start = op.Pose(20.0, -10.0, 0.5)
    turns = []
    for flow in ((0.0, 0.0), FLOW):
        situation = op.Situation(CNA, ping_interval=4.0, filed=filed(flow), current=flow)
        planner = WholeMission(situation, starts=2)
        turns.append(planner.open_loop(start).turn_rates)
        # followed over ground it remains the plan
        pose = np.array([start.x, start.y, start.heading])
        for k in range(8):
            decision = planner.plan(op.Pose(*pose), beliefs(flow), time=float(k))
            pose = drifted(pose, decision, flow, 1.0)
            assert decision.turn_rate == turns[-1][k // 2]
    np.testing.assert_allclose(turns[1], turns[0], atol=1e-6)


def drifted(pose, decision, flow, t):
    """Pose over ground after a time on an arc in water that flows."""
    return arc(pose, decision.turn_rate, decision.speed, t) + np.array([*flow, 0.0]) * t


class Watched:
    """A planner whose statuses are remembered."""

    def __init__(self, planner):
        self.planner, self.situation, self.said = planner, planner.situation, []
        self.constraints = planner.constraints

    def plan(self, pose, auvs, *, time=0.0):
        decision = self.planner.plan(pose, auvs, time=time)
        self.said.append(decision.status)
        return decision


def flown(planner, flow, start, auvs, decisions):
    """Positions over ground, ten a second, of a vehicle that is carried and decides each second."""
    situation, pose, track = planner.situation, start, []
    for k in range(decisions):
        at, seen = op.Pose(*pose), in_the_water(auvs, situation.current)
        decision = planner.plan(at, seen, time=float(k))
        if not hasattr(planner, "constraints"):
            decision = within_limits(decision, at, seen, situation)
        track += [drifted(pose, decision, flow, t)[:2] for t in np.linspace(0.1, 1.0, 10)]
        pose = drifted(pose, decision, flow, 1.0)
    return np.array(track)


def test_the_circle_is_kept_over_ground_in_a_current_that_carries_the_vehicle():
    off = {}
    for told_of in ((0.4, 0.3), (0.0, 0.0)):
        planner = Circle(op.Situation(CNA, current=told_of), center=(10.0, 5.0), radius=40.0)
        track = flown(planner, (0.4, 0.3), (50.0, 5.0, math.pi / 2), [], 120)
        off[told_of] = np.abs(np.hypot(*(track[300:] - (10.0, 5.0)).T) - 40.0).max()
    assert off[0.4, 0.3] < 0.25 * off[0.0, 0.0]
    assert off[0.4, 0.3] < 1.0


FENCE = op.Constraints(geofence=op.Disc(x=0.0, y=0.0, radius=45.0))


@pytest.mark.parametrize("name", ["information", "gramian", "trail"])
def test_limits_are_kept_over_ground_in_a_current_that_carries_the_vehicle(name):
    """AUVs at rest over ground outside the fence, downstream: what planners like lies beyond it."""
    flow = (0.8, 0.4)
    auvs = [op.Belief.at(70.0, 30.0, covariance=np.diag([9.0, 4.0, 0.01, 0.04]))]
    farthest = []
    for told_of in (flow, (0.0, 0.0)):
        situation = op.Situation(CNA, ping_interval=4.0, current=told_of, constraints=FENCE)
        planner = planner_class(name)(situation, **({"stages": 4} if name == "information" else {}))
        track = flown(planner, flow, (10.0, 0.0, 0.0), auvs, 60)
        farthest.append(np.hypot(*track.T).max())
    assert 30.0 < farthest[0] <= 45.0 + 1e-3
    assert farthest[1] > 45.1  # who is not told the current is carried out


def test_a_trajectory_is_optimised_within_limits_over_ground_and_seldom_falls_back():
    flow = (0.8, 0.4)
    auvs = [op.Belief.at(70.0, 30.0, covariance=np.diag([9.0, 4.0, 0.01, 0.04]))]
    situation = op.Situation(CNA, ping_interval=4.0, current=flow, constraints=FENCE)
    planner = Watched(planner_class("trajectory")(situation, stages=6))
    track = flown(planner, flow, (10.0, 0.0, 0.0), auvs, 20)
    assert 30.0 < np.hypot(*track.T).max() <= 45.0 + 1e-3
    assert planner.said.count(Status.OPTIMAL) >= 18  # blind to the current it is best-manoeuvre


def test_the_way_to_the_next_decision_is_held_against_limits_where_it_is_over_ground():
    """Straight on at 2 m/s east for 10 s, carried at 1 m/s north over the middle of a keep-out."""
    around = op.Constraints(keep_out=(op.Disc(x=10.0, y=5.0, radius=4.0),))
    situation = op.Situation(CNA, decision_interval=10.0, constraints=around, current=(0.0, 1.0))
    broken = LimitsAhead(situation, []).first_move(np.zeros(3), np.zeros(1), 2.0)
    # the radius, and half the way between two of sixteen points
    np.testing.assert_allclose(broken, 4.0 + 0.5 * 3.0 * 10.0 / 16)


def test_a_loiter_in_a_current_is_within_the_line_that_its_limit_is_looked_at_on():
    """A turn until it heads upstream, the way of a whole turn against the current, a turn."""
    rng = np.random.default_rng(4)
    for _ in range(30):
        pose = np.array([*rng.normal(0.0, 10.0, 2), rng.uniform(-7.0, 7.0)])
        bearing = rng.uniform(-np.pi, np.pi)
        c = rng.uniform(0.1, 1.2) * np.array([math.cos(bearing), math.sin(bearing)])
        around = 2 * np.pi * CNA.min_turn_radius / CNA.speed
        found = loiter_violation(FENCE, pose, 5.0, Stream(tuple(c.tolist()), around))
        for side, sign in enumerate((1.0, -1.0)):
            rate = sign * CNA.max_turn_rate
            until = ((bearing + np.pi - pose[2]) * sign % (2 * np.pi)) / CNA.max_turn_rate
            way = np.hypot(*c) * around
            legs = [(rate, until), (0.0, way / (CNA.speed - np.hypot(*c))), (rate, around)]
            place, track = pose, []
            for turn, lasts in legs:
                leg = op.Decision(turn_rate=turn, speed=CNA.speed)
                track += [drifted(place, leg, c, t) for t in np.linspace(0.0, lasts, 200)]
                place = track[-1]
            farthest = np.hypot(*np.array(track)[:, :2].T).max() - 45.0
            assert farthest <= found[side] + 1e-9
            # and it is no farther than a turn's drift beyond what is sailed
            assert found[side] <= farthest + way + way / 16 + 1e-9


# scenarios

TIDE = {"amplitude": [0.2, -0.1], "period": 60.0, "phase_deg": 90.0}
WATER = {
    "current": [0.1, 0.05],
    "current_profile": [[0.0, 0.2, 0.0], [20.0, 0.0, 0.1]],
    "tide": TIDE,
}
QUIET = {"position": 0.0, "heading_deg": 0.0, "speed": 0.0}


def gone(time):
    """How far the tide has gone, in steps of half a second."""
    rate = 2 * np.pi / 60.0
    flow = np.sin(rate * time[:-1])[:, None] * (0.2, -0.1)  # cos(x - 90 degrees)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * flow, axis=0)])


@pytest.mark.parametrize("planner", ["trail", "information"])  # folded into the step, and called
def test_a_carried_aid_vehicle_sails_its_arcs_in_the_surface_current_and_others_over_ground(
    planner,
):
    for carried in (True, False):
        run = op.simulate(scenario(environment=WATER, cna__carried=carried, planner__kind=planner))
        pose, expected = run.cna[0], [run.cna[0]]
        for turn_rate, speed in zip(run.turn_rate[:-1], run.speed[:-1], strict=True):
            pose = arc(pose, turn_rate, speed, 0.5)
            expected.append(pose)
        drift = gone(run.time) + run.time[:, None] * (0.3, 0.05)
        expected = np.array(expected)
        # arcs do not depend on where they begin
        expected[:, :2] += carried * drift
        np.testing.assert_allclose(run.cna, expected, atol=1e-9)


def test_auvs_steer_for_the_mean_current_at_their_depth_and_the_tide_carries_them_off():
    mission = scenario(
        environment=WATER,
        auv__0__depth=10.0,
        auv__0__process_noise=QUIET,
        auv__1__depth=[0.0, 20.0],
        auv__1__process_noise=QUIET,
    )
    assert mission.assumed_currents[0] == pytest.approx((0.1 + 0.1, 0.05 + 0.05))
    assert mission.assumed_currents[1] == pytest.approx((0.1 + 0.1, 0.05 + 0.05))
    run = op.simulate(mission)
    off = run.truth[0, :, :2] - mission.motions[0].position
    np.testing.assert_allclose(off, gone(run.time), atol=1e-9)
    # the other's own depth is more or less than what it counts on
    share = mission.depths[:-1, 1] / 20.0
    excess = np.stack([0.2 - 0.2 * share - 0.1, 0.1 * share - 0.05], axis=-1)
    off = run.truth[1, :, :2] - mission.motions[1].position - gone(run.time)
    np.testing.assert_allclose(off[1:], np.cumsum(0.5 * excess, axis=0), atol=1e-9)


def test_planners_are_told_currents_relative_to_what_carries_the_vehicle():
    for carried, flow in ((True, (-0.1, 0.05)), (False, (0.2, 0.1))):
        mission = scenario(
            environment=WATER, cna__carried=carried, auv__0__depth=10.0, duration=3.0
        )
        spy = Spy(mission.planner())
        op.simulate(mission, planner=spy)
        for _, _, auvs, _ in spy.said:
            assert auvs[0].current == pytest.approx(flow)


def test_an_expression_is_told_of_the_water_what_plan_is_told():
    mission = scenario(environment=WATER, cna__carried=True, planner__kind="centroid-orbit")
    folded = op.simulate(mission)
    called = op.simulate(mission, planner=Spy(mission.planner()))
    np.testing.assert_allclose(folded.cna, called.cna, atol=1e-9)


def test_a_follower_keeps_its_place_in_water_of_its_own():
    mission = scenario(
        environment={"current_profile": [[0.0, 0.3, 0.0], [20.0, 0.0, 0.1]]},
        auv__0__depth=20.0,
        auv__0__process_noise=QUIET,
        auv__1={
            "name": "b",
            "survey": {"kind": "formation", "leader": "a", "east": 5.0, "north": 3.0},
        },
    )
    run = op.simulate(mission)
    apart = run.truth[1, :, :2] - run.truth[0, :, :2]
    np.testing.assert_allclose(apart, np.broadcast_to((5.0, 3.0), apart.shape), atol=1e-9)


@dataclass(frozen=True, kw_only=True)
class CurrentEkf(Ekf):
    """EKF that is not told the current, and estimates it."""

    sigma: float = 0.3  # standard deviation of each component at first [m/s]

    def states(self, model):
        unknown = op.State("m s-1", sigma=self.sigma)
        return {**STATES, "current_east": unknown, "current_north": unknown}

    def step(self, x, u, process):
        still = op.DeadReckoning().step(x[:4], u, process.dt)
        return ca.vertcat(still[:2] + x[4:] * process.dt, still[2:], x[4:])


def test_with_a_dvl_a_filter_finds_the_current_of_a_mission_and_with_a_log_it_does_not():
    left = {}
    for kind in ("water-speed", "dvl"):
        sensor = {"kind": kind, "sigma": 0.01, "interval": 1.0}
        mission = scenario(
            environment__current=[0.3, -0.2],
            auv__0__speed_sensor=sensor,
            auv__0__process_noise=QUIET,
            ranging__heading_sigma_deg=0.1,
        ).replace(estimator=CurrentEkf())
        run = op.simulate(mission, seed=4)
        sigma = np.sqrt(np.diagonal(run.covariance[0, -1])[4:])
        error = run.mean[0, -1, 4:] - (0.3, -0.2)
        assert (np.abs(error) < 4 * sigma).all()
        left[kind] = sigma.max()
    assert left["dvl"] < 0.02 < left["water-speed"]


def test_the_bound_counts_what_a_log_measures():
    bounds = {}
    for sensor in (None, {"kind": "water-speed", "sigma": 0.01, "interval": 2.0}):
        change = {} if sensor is None else {"auv__0__speed_sensor": sensor}
        run = op.simulate(scenario(planner__kind="circle", auv__0__process_noise=QUIET, **change))
        bounds[sensor is None] = run.cramer_rao[0, -1, 3, 3]
        # an EKF near the truth: the bound is along the truth, the filter's along its estimate
        assert run.covariance[0, -1, 3, 3] == pytest.approx(bounds[sensor is None], rel=0.1)
    # ten measurements and what was known; without noise the speed is one number
    assert bounds[False] == pytest.approx(1 / (1 / bounds[True] + 10 / 0.01**2), rel=0.05)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"environment": {"current_profile": [[5.0, 0.0, 0.0], [5.0, 0.1, 0.0]]}},
            "environment: profile must have increasing depths, got 5.0 after 5.0: order it",
        ),
        ({"environment": {"tide": {"amplitude": [0.1, 0.0], "period": 1.0}}}, "tide.period .*60"),
        ({"environment": {"tide": {"amplitude": [3.0, 0.0]}}}, "up to 3 m/s .* too strong"),
        ({"auv__0__speed_sensor": {"kind": "dvl", "interval": 0.7}}, "speed_sensor.interval"),
        ({"auv__0__speed_sensor": {"kind": "dvl", "sigma": 0.0}}, "sigma .*0.0001"),
        ({"auv__0__speed_sensor": {"kind": "pitot"}}, "speed_sensor.*pitot"),
    ],
)
def test_water_and_logs_that_cannot_be_are_refused_by_key(change, said):
    with pytest.raises(op.ObsplanError, match=said):
        scenario(**change)
