"""The closed loop against a filter in plain numpy, arcs in complex numbers, and the rules of the schedule."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from oracles import NumpyEkf, Silent, Spy, arc, recording, scenario
from scipy.stats import kstest

import obsplan as op
from formulations.solution import Status
from obsplan.simulation import ClosedLoop
from obsplan.simulation import inputs as loop_inputs
from obsplan.simulation.inputs import Streams, mission_inputs, streams

QUIET = {
    "process_noise": {},
    "first_estimate": {"sigma_position": 0.0, "sigma_heading_deg": 0.0, "sigma_speed": 0.0},
}
CURRENT = (0.4, -0.3)


def quiet(**change):
    """The short mission without process noise, its first estimates exact."""
    keys = {f"auv__{i}__{key}": value for i in range(2) for key, value in QUIET.items()}
    return scenario(**keys, **change)


@dataclass
class Wanderer:
    """A user's planner: turn and speed at random, within what the vehicle can do."""

    generator: np.random.Generator = field(default_factory=lambda: np.random.default_rng(8))

    def plan(self, pose, auvs, *, time=0.0):
        speed = float(self.generator.uniform(0.0, 2.0))
        turn_rate = float(self.generator.uniform(-1.0, 1.0)) * speed / 5.0
        path = np.array([[pose.x, pose.y, pose.heading]])
        return op.Decision(
            turn_rate=turn_rate,
            speed=speed,
            predict=lambda: path,
            score=turn_rate,
            status=Status.OPTIMAL,
        )


# Truth


@pytest.mark.parametrize("current", [(0.0, 0.0), CURRENT])
@pytest.mark.parametrize("time_step", [0.5, 0.25])
def test_without_process_noise_the_truth_is_the_survey_with_its_corners(current, time_step):
    mission = quiet(environment__current=current, time_step=time_step, duration=80.0)
    run = op.simulate(mission)
    for truth, reference in zip(run.truth, mission.references, strict=True):
        np.testing.assert_allclose(truth[:, :2], reference.position(run.time), atol=1e-9)
    assert (
        max(reference.arrival[1] for reference in mission.references) < 80.0
    )  # corners and the end are passed


def test_process_noise_moves_the_truth_as_a_random_walk_of_its_strength():
    mission = scenario(
        duration=500.0, time_step=0.25, ranging__interval=2.0, planner={"kind": "stationary"}
    )
    run = op.simulate(mission)
    drift = run.truth[..., :2] - np.stack([r.position(run.time) for r in mission.references])
    under_way = int(
        4 * max(r.duration for r in mission.references)
    )  # where headings and speeds off the survey's add to it
    moved = np.diff(drift[:, under_way:], axis=1)
    assert kstest(moved.ravel() / (0.05 * np.sqrt(0.25)), "norm").pvalue > 0.01
    wanted = np.stack([np.column_stack([m.heading, m.speed]) for m in mission.motions])
    off = (run.truth[:, 1:, 2:] - wanted[:, 1:]) / (
        np.sqrt(0.25) * np.array([np.deg2rad(0.5), 0.02])
    )
    assert kstest(off.ravel(), "norm").pvalue > 0.01  # the autopilot brings both back every step
    assert np.abs(drift[:, -1]).max() > 0.2  # but not the position


def test_aid_vehicle_moves_on_exact_arcs_at_the_turn_and_speed_recorded():
    run = op.simulate(scenario(), planner=Wanderer())
    assert np.unique(run.turn_rate).size == np.unique(run.speed).size == 20
    for k in range(run.time.size - 1):
        np.testing.assert_allclose(
            run.cna[k + 1], arc(run.cna[k], run.turn_rate[k], run.speed[k], 0.5), atol=1e-10
        )
    np.testing.assert_array_equal(run.cna[0], [80.0, -30.0, np.deg2rad(140.0)])


def test_command_is_held_between_decisions():
    run = op.simulate(scenario(planner__interval=2.0), planner=Wanderer())
    assert np.isfinite(run.score).nonzero()[0].tolist() == list(range(0, 40, 4))
    np.testing.assert_array_equal(run.turn_rate[:-1], np.repeat(run.turn_rate[:-1:4], 4))
    np.testing.assert_array_equal(run.score[:-1:4], run.turn_rate[:-1:4])


# Filter


@pytest.mark.parametrize(
    ("kind", "current", "motion"),
    [
        ("range", (0.0, 0.0), "measured"),
        ("range", CURRENT, "measured"),
        ("squared-range", (0.0, 0.0), "measured"),
        ("squared-range", CURRENT, "measured"),
        ("range", CURRENT, "commanded"),
    ],
)
def test_estimates_are_those_of_a_filter_in_plain_numpy(kind, current, motion):
    noise = {"position": 0.08, "heading_deg": 1.0, "speed": 0.05}
    mission = scenario(
        ranging__kind=kind,
        ranging__sigma=1.0 if kind == "range" else 60.0,
        environment__current=current,
        estimator={"process_noise": noise, "motion": motion},
    )
    run = op.simulate(mission, seed=5)
    tape = op.to_tape(run)
    _, inputs = mission_inputs(mission, mission.starts, 5)
    Q = 0.5 * np.diag([0.08, 0.08, np.deg2rad(1.0), 0.05]) ** 2
    for i in range(2):
        ekf = NumpyEkf(
            run.mean[i, 0], np.diag([2.0, 2.0, np.deg2rad(2.0), 0.5]) ** 2, Q, 0.5, current
        )
        np.testing.assert_allclose(run.covariance[i, 0], ekf.P, rtol=1e-14)
        for k in range(40):
            made = (
                inputs.steer[k, i] - run.truth[i, k, 2:]
            )  # turn and change of speed, which the vehicle measures
            if motion == "commanded":  # by the survey, whatever the vehicle does
                survey = mission.motions[i]
                made = np.array([np.diff(survey.heading)[k], np.diff(survey.speed)[k]])
            told = tape.turn[i, k], tape.change_of_speed[i, k]
            np.testing.assert_allclose(told, made, atol=1e-12)
            ekf.predict(*made)
            ekf.heading(run.truth[i, k + 1, 2] + inputs.heading_error[k, i, 0], np.deg2rad(1.0))
            if (k + 1) % 4 == 0:
                ekf.range(
                    run.range[i, k + 1],
                    run.cna[k + 1, :2],
                    mission.table.ranging.sigma,
                    kind == "squared-range",
                )
            np.testing.assert_allclose(run.mean[i, k + 1], ekf.x, atol=1e-9)
            np.testing.assert_allclose(run.covariance[i, k + 1], ekf.P, atol=1e-9)


def test_filter_certain_of_its_start_reckons_the_way_through_corners_and_current():
    run = op.simulate(quiet(environment__current=CURRENT, duration=60.0))
    np.testing.assert_allclose(run.mean, run.truth, atol=1e-9)
    assert (
        np.ptp(run.truth[0, :, 3]) > 0.1
    )  # chords across corners change the speed: that input matters too
    assert np.ptp(run.truth[0, :, 2]) > 0.5


def test_first_estimates_are_drawn_with_their_stated_deviations():
    loop = ClosedLoop(
        scenario=scenario(duration=0.5, planner={"kind": "stationary"}), planner=op.Stationary()
    )
    runs = [loop.fly(seed) for seed in range(300)]
    errors = np.array([run.mean[:, 0] - run.truth[:, 0] for run in runs]).reshape(-1, 4) / [
        2.0,
        2.0,
        np.deg2rad(2.0),
        0.5,
    ]
    assert kstest(errors.ravel(), "norm").pvalue > 0.01
    np.testing.assert_allclose(np.corrcoef(errors.T), np.eye(4), atol=4 / np.sqrt(600))


def consistent(**change):
    """Missions of four AUVs ringed by a distant circle: ranges far greater than their errors, so that the filter is nearly linear."""
    auv = {
        "speed": 1.0,
        "first_estimate": {"sigma_position": 1.0, "sigma_heading_deg": 2.0, "sigma_speed": 0.1},
        "process_noise": {"position": 0.1, "heading_deg": 0.5, "speed": 0.03},
    }
    ways = [
        [[0.0, 0.0], [20.0, 9.0], [20.0, 90.0]],
        [[0.0, 9.0], [-90.0, 0.0]],
        [[9.0, 0.0], [9.0, -20.0], [90.0, 0.0]],
        [[-9.0, 0.0], [0.0, 90.0]],
    ]
    auvs = [
        {"name": f"{i}", "survey": {"kind": "waypoints", "points": way}, **auv}
        for i, way in enumerate(ways)
    ]
    circle = {"kind": "circle", "center": (0.0, 0.0), "radius": 200.0}
    return scenario(
        auv=auvs,
        planner=circle,
        time_step=1.0,
        duration=60.0,
        cna__speed=10.0,
        ranging__sigma=1.0,
        **change,
    )


def final_nees(mission, missions):
    """NEES at the end of independent missions, of each of the four AUVs."""
    loop = ClosedLoop(scenario=mission, planner=mission.planner())
    return np.concatenate([loop.fly(seed).nees[:, -1] for seed in range(missions)])


def test_final_nees_over_independent_runs_is_chi_square():
    nees = final_nees(consistent(), 100)
    assert kstest(nees, "chi2", args=(2,)).pvalue > 0.01
    assert kstest(1.5 * nees, "chi2", args=(2,)).pvalue < 1e-4  # negative control


def test_filter_told_half_the_process_noise_is_found_out():
    half = {"position": 0.05, "heading_deg": 0.25, "speed": 0.015}
    assert (
        kstest(
            final_nees(consistent(estimator={"process_noise": half}), 100), "chi2", args=(2,)
        ).pvalue
        < 1e-4
    )


# Ranges


def test_ranges_are_measured_at_their_interval_and_none_at_time_zero():
    for interval in (0.5, 2.0, 7.5):
        run = op.simulate(scenario(ranging__interval=interval))
        pings = np.arange(1, int(20.0 / interval) + 1) * interval
        for i in range(2):
            np.testing.assert_array_equal(run.time[np.isfinite(run.range[i])], pings)


@pytest.mark.parametrize(("kind", "power"), [("range", 1), ("squared-range", 2)])
def test_range_error_is_normal_with_its_stated_deviation(kind, power):
    mission = scenario(
        ranging__kind=kind,
        ranging__sigma=0.7,
        ranging__interval=0.5,
        duration=1000.0,
        planner={"kind": "stationary"},
    )
    run = op.simulate(mission)
    error = (run.range - run.separation**power)[:, 1:] / 0.7
    assert kstest(error.ravel(), "norm").pvalue > 0.01  # 4000 of them
    assert kstest(1.1 * error.ravel(), "norm").pvalue < 0.01  # negative control
    assert abs(np.corrcoef(error)[0, 1]) < 4 / np.sqrt(2000)


# Noise


def range_error(run):
    """Measured less true range at the pings."""
    return (run.range - run.separation)[:, run.scenario.pings]


def test_same_seed_gives_the_same_bytes_and_another_seed_other_noise():
    mission = scenario(seed=3)
    first, again, by_name = op.simulate(mission), op.simulate(mission), op.simulate(mission, seed=3)
    other = op.simulate(mission, seed=4)
    assert recording(first) == recording(again) == recording(by_name)
    assert (first.seed, other.seed) == (3, 4)
    for name in ("truth", "mean", "range"):
        assert recording(first)[name] != recording(other)[name]


@pytest.mark.parametrize(
    "planner",
    ["gramian", "circle", "stationary", Wanderer()],
    ids=["gramian", "circle", "stationary", "wanderer"],
)
def test_every_planner_meets_the_same_noise(planner):
    mission = scenario()
    ours, theirs = op.simulate(mission), op.simulate(mission, planner=planner)
    assert not np.array_equal(ours.cna, theirs.cna)
    np.testing.assert_array_equal(ours.truth, theirs.truth)
    np.testing.assert_array_equal(
        ours.mean[:, :4], theirs.mean[:, :4]
    )  # the first estimate, and headings up to the first ping
    np.testing.assert_allclose(range_error(ours), range_error(theirs), atol=1e-12)
    deaf = scenario(ranging__interval=1000.0)
    np.testing.assert_array_equal(
        op.simulate(deaf).mean, op.simulate(deaf, planner=planner).mean
    )  # so all headings are the same


def test_process_and_measurement_noise_come_from_streams_of_their_own():
    louder = {"position": 0.5, "heading_deg": 5.0, "speed": 0.2}
    one, other = op.simulate(scenario()), op.simulate(scenario(auv__0__process_noise=louder))
    assert not np.array_equal(one.truth[0], other.truth[0])
    np.testing.assert_allclose(range_error(one), range_error(other), atol=1e-12)
    precise = op.simulate(scenario(ranging__sigma=0.25))
    np.testing.assert_array_equal(one.truth, precise.truth)
    np.testing.assert_allclose(range_error(one) / 4, range_error(precise), atol=1e-12)
    rarer = op.simulate(scenario(ranging__interval=7.0))
    np.testing.assert_array_equal(one.truth, rarer.truth)


def test_no_two_streams_share_a_number_nor_does_one_wait_for_another():
    drawn = [stream.standard_normal(100) for seed in (5, 6) for stream in streams(seed)]
    assert np.unique(drawn).size == 2 * 100 * len(Streams._fields)
    fresh, used = streams(5), streams(5)
    used.measurement.standard_normal(17)
    assert fresh.process.standard_normal() == used.process.standard_normal()
    assert fresh.planner.standard_normal() == used.planner.standard_normal()


def test_longer_missions_begin_as_shorter_ones():
    short, long = op.simulate(scenario(duration=10.0)), op.simulate(scenario(duration=20.0))
    np.testing.assert_allclose(short.truth[..., :2], long.truth[:, :21, :2], atol=1e-12)
    np.testing.assert_array_equal(short.mean[:, 0], long.mean[:, 0])


def test_silence_leaves_no_noise(monkeypatch):
    monkeypatch.setattr(
        loop_inputs, "streams", lambda seed: Streams(*[Silent] * len(Streams._fields))
    )
    run = op.simulate(scenario())
    np.testing.assert_allclose(range_error(run), 0.0, atol=1e-12)
    np.testing.assert_allclose(run.mean, run.truth, atol=1e-9)


# Lengths, chunks, progress


@pytest.mark.parametrize("steps", [1, 2, 255, 256, 257, 513])
@pytest.mark.parametrize("folded", [True, False], ids=["folded", "walked"])
def test_mission_of_any_number_of_steps_is_flown_whole(steps, folded):
    mission, calls = quiet(duration=0.5 * steps), []
    planner = mission.planner() if folded else Spy(mission.planner())
    run = op.simulate(
        mission, planner=planner, progress=lambda done, total: calls.append((done, total))
    )
    assert run.time.size == steps + 1
    assert calls[-1] == (steps, steps)
    assert all(total == steps for _, total in calls)
    assert [done for done, _ in calls] == sorted({done for done, _ in calls})
    assert len(calls) == -(-steps // 256)
    for k in range(steps):
        np.testing.assert_allclose(
            run.cna[k + 1], arc(run.cna[k], run.turn_rate[k], run.speed[k], 0.5), atol=1e-10
        )
    for truth, reference in zip(run.truth, mission.references, strict=True):
        np.testing.assert_allclose(truth[:, :2], reference.position(run.time), atol=1e-9)


def test_duration_that_is_no_whole_number_of_steps_is_covered():
    assert op.simulate(scenario(duration=20.1)).time[-1] == 20.5
    survey = max(reference.duration for reference in scenario().references)
    run = op.simulate(scenario(duration=None))
    assert survey <= run.time[-1] < survey + 0.5


@pytest.mark.parametrize(
    ("key", "name"),
    [("ranging__interval", "ranging.interval"), ("planner__interval", "planner.interval")],
)
def test_interval_that_is_no_multiple_of_the_step_is_refused(key, name):
    with pytest.raises(
        op.ObsplanError,
        match=rf"{name}: 0\.7 s is not a whole multiple of time_step = 0\.5 s; change one of them",
    ):
        scenario(**{key: 0.7})


def test_planner_is_given_by_name_by_object_or_by_the_scenario():
    mission = scenario()
    assert op.simulate(mission).planner == "path-inertia"
    assert op.simulate(mission, planner="circle").planner == "circle"
    assert op.simulate(mission, planner=Wanderer()).planner == "Wanderer"
    assert recording(op.simulate(mission, planner="path-inertia")) == recording(
        op.simulate(mission)
    )
    with pytest.raises(
        op.ObsplanError, match='no planner "path-inertai"; did you mean "path-inertia"'
    ):
        op.simulate(mission, planner="path-inertai")


def test_one_compiled_loop_flies_many_missions_as_each_would_fly_alone():
    mission = scenario()
    loop = ClosedLoop(scenario=mission, planner=mission.planner())
    for seed in (1, 2, 1):
        assert recording(loop.fly(seed)) == recording(op.simulate(mission, seed=seed))


def test_flight_without_covariances_is_the_same_flight():
    mission = scenario()
    for planner in (mission.planner(), Spy(mission.planner())):
        loop = ClosedLoop(scenario=mission, planner=planner)
        whole, bare = loop.fly(3), loop.fly(3, covariances=False)
        assert np.isnan(bare.covariance).all()
        assert recording(replace(bare, covariance=whole.covariance)) == recording(whole)


def test_machine_code_flies_the_same_mission_to_the_last_bit(tmp_path, monkeypatch):
    monkeypatch.setenv("OBSPLAN_CACHE", str(tmp_path))
    mission = scenario()
    loop = ClosedLoop(scenario=mission, planner=mission.planner(), compiled=True)
    assert recording(loop.fly(1)) == recording(op.simulate(mission, seed=1))


def test_decisions_outside_the_step_are_timed_and_folded_ones_are_not():
    mission = scenario()
    assert op.simulate(mission).timing.decision_seconds == []
    timing = op.simulate(mission, planner=Spy(mission.planner())).timing
    assert len(timing.decision_seconds) == 20
    assert 0 < sum(timing.decision_seconds) < timing.seconds


@pytest.mark.parametrize(
    ("turn_rate", "flown", "status"),
    [
        (9.0, 2.0, "clipped"),
        (-9.0, -2.0, "clipped"),
        (np.nan, 2.0, "invalid-decision"),
        (np.inf, 2.0, "invalid-decision"),
        (1.5, 1.5, "optimal"),
    ],
)
def test_vehicle_flies_no_turn_beyond_its_limit_and_circles_where_it_is_no_number(
    turn_rate, flown, status
):
    class Wild:
        def plan(self, pose, auvs, *, time=0.0):
            return op.Decision(turn_rate=turn_rate, speed=1.0)

    run = op.simulate("fixed-auv", planner=Wild())
    np.testing.assert_array_equal(run.turn_rate, flown)
    assert run.status_counts == {status: 200}


def test_slow_vehicle_turns_on_no_smaller_circle():
    class Slow:
        def plan(self, pose, auvs, *, time=0.0):
            return op.Decision(turn_rate=2.0, speed=0.25)

    run = op.simulate(
        "fixed-auv", planner=Slow()
    )  # whose vehicle turns at 2 rad/s when it does 1 m/s
    np.testing.assert_array_equal(run.turn_rate, 0.5)
    assert run.status_counts == {"clipped": 200}
