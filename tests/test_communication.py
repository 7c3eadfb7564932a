"""What aid vehicles hear of AUVs: recounted sample by sample, and reckoned by hand."""

import math

import numpy as np
import pytest
from oracles import NumpyEkf, Spy, recording, scenario

import obsplan as op
from formulations.model.ranging import throughput
from obsplan.report import hearing_notes

FAR = {"ranging__half_distance": 60.0, "ranging__reach": 45.0, "duration": 120.0}
ESTIMATE = {"planner__knowledge": "estimate"}
NONE = {"communication__reports": "none", "planner__knowledge": "survey"}


class Straight:
    """Heads on, whatever it is told."""

    def plan(self, pose, auvs, *, time=0.0):
        return op.Decision(turn_rate=0.0, speed=1.0)


def told(mission):
    """A run under a planner that listens and heads on, and the beliefs it was given, by time."""
    spy = Spy(Straight())
    run = op.simulate(mission, planner=spy)
    return run, {time: auvs for time, _, auvs, _ in spy.said}


def reckoned(x, P, seconds, noise, current=(0.0, 0.0), dt=0.5):
    """A filter's estimate dead-reckoned straight on, step by step."""
    ekf = NumpyEkf(x.copy(), P.copy(), np.diag(noise**2 * dt), dt, current)
    for _ in range(round(seconds / dt)):
        ekf.predict(0.0, 0.0)
    return ekf


def test_communication_that_says_nothing_changes_nothing():
    plain, given = (
        op.simulate(scenario(**ESTIMATE, **more)) for more in ({}, {"communication": {}})
    )
    assert recording(plain) == recording(given)
    assert "report_age_max_s" in given.summary()["all"]
    assert "report_age_max_s" not in plain.summary()["all"]
    assert "communication" not in plain.scenario.resolved()


@pytest.mark.parametrize("latency", [0.0, 3.0])
def test_ages_and_time_in_reach_are_those_recounted_from_the_ranges(latency):
    mission = scenario(**FAR, communication__latency=latency, planner__kind="circle")
    run = op.simulate(mission)
    figures = run.summary(bounds=False)["auv"]
    assert 0 < np.isfinite(run.range).sum() < 0.9 * 2 * mission.pings.size
    for i, name in enumerate(run.names):
        newest, heard, ages, near = 0.0, [], [], 0
        for k, time in enumerate(run.time):
            if np.isfinite(run.range[i, k]):
                heard.append(time)
            while heard and heard[0] + latency <= time:
                newest = heard.pop(0)
            ages.append(time - newest)
            near += math.dist(run.truth[i, k, :2], run.cna[k, :2]) <= 45.0
        assert figures[name]["report_age_mean_s"] == pytest.approx(np.mean(ages), rel=1e-12)
        assert figures[name]["report_age_max_s"] == max(ages)
        assert figures[name]["report_age_p95_s"] == pytest.approx(np.percentile(ages, 95))
        assert figures[name]["in_reach"] == pytest.approx(near / len(run.time), rel=1e-12)
    assert recording(run) == recording(op.simulate(mission))


# longer than the 2 s between ranges: two reports are on their way; with half a second to the next decision
@pytest.mark.parametrize(("latency", "current"), [(3.0, (0.0, 0.0)), (3.5, (0.3, -0.2))])
def test_late_report_is_the_estimate_of_that_time_dead_reckoned(latency, current):
    mission = scenario(
        **ESTIMATE, communication__latency=latency, environment__current=current, time_step=0.5
    )
    run, beliefs = told(mission)
    noise = mission.process_noise(assumed=True)
    assert {b.route for auvs in beliefs.values() for b in auvs} == {None}
    for time, auvs in beliefs.items():
        # the last range that came early enough, or the first estimate
        made = max(0.0, (time - latency) // 2.0 * 2.0)
        k = round(made / 0.5)
        for i, belief in enumerate(auvs):
            ekf = reckoned(run.mean[i, k], run.covariance[i, k], time - made, noise[i], current)
            np.testing.assert_allclose(belief.mean, ekf.x, rtol=0, atol=1e-9)
            np.testing.assert_allclose(belief.covariance, ekf.P, rtol=1e-9, atol=1e-12)


def test_late_reports_change_nothing_but_what_planners_know():
    on_time, late = (
        told(scenario(**ESTIMATE, communication__latency=latency))[0] for latency in (0.0, 7.5)
    )
    assert recording(on_time) == recording(late)


def test_reports_are_lost_as_often_as_said_and_ranges_with_none_of_them():
    keys = {**ESTIMATE, "ranging__interval": 0.5, "duration": 300.0}
    lossy = scenario(**keys, communication__loss=0.3, communication__half_distance=300.0)
    run, every = (told(mission)[0] for mission in (lossy, scenario(**keys)))
    assert recording(run) == recording(every)
    d = np.hypot(*np.moveaxis(run.truth[..., 1:, :2] - run.cna[1:, :2], -1, 0))
    p = 0.7 * 0.5 ** ((d / 300.0) ** 2)
    spread = math.sqrt((p * (1 - p)).sum())
    assert abs(run.reports.sum() - p.sum()) < 4 * spread
    assert abs(run.reports.sum() - 0.7 * p.size) > 4 * spread  # the distance counts
    assert not run.reports[:, 0].any()
    assert every.reports[:, 1:].all()


@pytest.mark.parametrize("depth", [0.0, 30.0])
def test_planners_that_hear_nothing_know_how_sure_a_filter_on_the_survey_would_be(depth):
    slant = {"ranging__geometry": "slant", "auv__0__depth": depth, "auv__1__depth": depth}
    more = slant if depth else {}
    mission = scenario(**NONE, **more, ranging__loss=0.25, ranging__growth=0.02)
    run, beliefs = told(mission)
    noise = mission.process_noise(assumed=True)
    assert not run.reports.any()
    for i in range(2):
        survey = np.column_stack(
            [mission.motions[i].position, mission.motions[i].heading, mission.motions[i].speed]
        )
        ekf = NumpyEkf(survey[0], run.covariance[i, 0], np.diag(noise[i] ** 2 * 0.5), 0.5, (0, 0))
        for k in range(1, run.time.size - 1):
            ekf.predict(0.0, 0.0)
            ekf.x[2:] = survey[k, 2:]
            ekf.heading(ekf.x[2], math.radians(1.0))
            if k % 4 == 0:
                before, away = ekf.P, ekf.x[:2] - run.cna[k, :2]
                r = math.hypot(*away, depth)
                ekf._correct(np.array([*away / r, 0.0, 0.0]), 0.0, math.hypot(1.0, 0.02 * r))
                ekf.P = 0.25 * before + 0.75 * ekf.P
            if run.time[k] in beliefs:
                belief = beliefs[run.time[k]][i]
                np.testing.assert_allclose(belief.mean, survey[k], atol=1e-12)
                np.testing.assert_allclose(belief.covariance, ekf.P, rtol=1e-8, atol=1e-10)
            ekf.x = survey[k].copy()


def test_throughput_halves_at_its_distance_and_ends_with_the_reach():
    assert throughput(40.0**2, 1 / 40.0) == pytest.approx(0.5)
    assert throughput(80.0**2, 1 / 40.0) == pytest.approx(1 / 16)
    assert throughput(80.1**2, 1 / 40.0, 1 / 80.0) == 0.0
    run = op.simulate(
        scenario(communication={"throughput": 800.0, "throughput_half_distance": 40.0})
    )
    d = np.hypot(*np.moveaxis(run.truth[..., :2] - run.cna[:, :2], -1, 0))
    mean = (800.0 * 0.5 ** ((d / 40.0) ** 2)).mean(axis=1)
    for name, expected in zip(run.names, mean, strict=True):
        found = run.summary(bounds=False)["auv"][name]["throughput_mean_bit_s"]
        assert found == pytest.approx(expected, rel=1e-12)


def test_planner_that_weighs_throughput_stays_nearer_and_without_weight_decides_the_same():
    keys = {
        "duration": 120.0,
        "auv__1__weight": 0.0,
        "planner": {"kind": "information", "stages": 3, "turn_rates": 5, "beam_width": 16},
        "communication": {"throughput": 800.0, "throughput_half_distance": 20.0},
    }
    mission = scenario(**keys)
    free, same, eager = (
        op.simulate(mission.replace(**more))
        for more in (
            {},
            {"planner__communication_weight": 0.0},
            {"planner__communication_weight": 1e4},
        )
    )
    assert recording(free) == recording(same)
    far, near = (run.summary(bounds=False)["auv"]["a"] for run in (free, eager))
    assert near["separation_mean_m"] < 0.7 * far["separation_mean_m"]
    assert near["throughput_mean_bit_s"] > 1.3 * far["throughput_mean_bit_s"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({**NONE, **ESTIMATE}, 'planner.knowledge: "estimate" .*first estimate; set .*"survey"'),
        ({**NONE, "communication__latency": 1.0}, "communication.latency: .*leave out one"),
        ({"communication__latency": 0.7}, "communication.latency: 0.7 s is not a whole multiple"),
        (
            {"communication__latency": 50.0, "ranging__interval": 0.5},
            "communication.latency: 50 s keeps up to 100 reports .*at most 60.*: give a shorter",
        ),
        ({"communication__throughput_half_distance": 9.0}, "give communication.throughput, too"),
        ({"communication__loss": 1.5}, "communication.loss = 1.5 .*must be from 0 to 1"),
        (
            {"planner": {"kind": "information", "communication_weight": 2.0}},
            "communication_weight = 2 .*give communication.throughput_half_distance",
        ),
    ],
)
def test_what_cannot_be_heard_is_refused_with_the_key_and_the_remedy(change, said):
    with pytest.raises(op.ObsplanError, match=said):
        scenario(**change)


def test_words_say_how_old_reports_were_and_that_none_came():
    run = op.simulate(scenario(**FAR, planner__kind="circle"))
    assert hearing_notes(op.simulate(scenario())) == []
    oldest, away = run.heard.age.max(axis=1), 1 - run.heard.in_reach.mean(axis=1)
    assert (away > 0.01).any()
    for name, note, age, share in zip(run.names, hearing_notes(run), oldest, away, strict=True):
        assert note.startswith(f"{name}, as heard: newest report up to {age:.0f} s old")
        told = f"out of reach {100 * share:.0f} % of the time" in note
        assert told == (share > 0.005)
    straight = scenario(**FAR, planner__kind="circle", planner__knowledge="estimate")
    *_, advice = hearing_notes(op.simulate(straight))
    assert 'with "estimate-and-survey" they count on the turns' in advice
    (last,) = hearing_notes(op.simulate(scenario(**NONE)))
    assert last.startswith("Nothing is heard of the AUVs")
