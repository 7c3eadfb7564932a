"""What a run derives from its recording, against the formulas written out sample by sample."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from oracles import Silent, Spy, scenario

import obsplan as op
from formulations.solution import Status
from obsplan.simulation import inputs as loop_inputs
from obsplan.simulation.inputs import Streams


@pytest.fixture(scope="module")
def run():
    return op.simulate(scenario())


def every_sample(run):
    return [(i, k) for i in range(2) for k in range(run.time.size)]


def test_error_nees_and_separation_are_those_of_their_formulas(run):
    for i, k in every_sample(run):
        d = run.mean[i, k, :2] - run.truth[i, k, :2]
        assert run.error[i, k] == pytest.approx(math.hypot(*d), rel=1e-14)
        assert run.nees[i, k] == pytest.approx(
            d @ np.linalg.inv(run.covariance[i, k, :2, :2]) @ d, rel=1e-9
        )
        assert run.separation[i, k] == pytest.approx(
            math.dist(run.cna[k, :2], run.truth[i, k, :2]), rel=1e-14
        )


def test_rms_and_greatest_error_are_over_time_and_auvs_with_the_first_estimate(run):
    squares = [sum((run.mean[i, k, :2] - run.truth[i, k, :2]) ** 2) for i, k in every_sample(run)]
    assert run.rms_error == pytest.approx(math.sqrt(sum(squares) / len(squares)), rel=1e-12)
    assert run.max_error == pytest.approx(math.sqrt(max(squares)), rel=1e-12)


def test_nees_of_a_singular_covariance_is_not_a_number(run):
    covariance = run.covariance.copy()
    covariance[0, 3, :2, :2] = [[4.0, 2.0], [2.0, 1.0]]
    covariance[1, 5] = 0.0
    nees = replace(run, covariance=covariance).nees
    assert np.argwhere(np.isnan(nees)).tolist() == [[0, 3], [1, 5]]


@pytest.mark.parametrize("kind", ["range", "squared-range"])
def test_cramer_rao_bound_is_the_covariance_of_a_filter_that_makes_no_error(kind, monkeypatch):
    monkeypatch.setattr(
        loop_inputs, "streams", lambda seed: Streams(*[Silent] * len(Streams._fields))
    )
    noise = {"position": 0.08, "heading_deg": 1.0, "speed": 0.05}
    run = op.simulate(
        scenario(
            ranging__kind=kind,
            ranging__sigma=0.8,
            environment__current=(0.3, 0.1),
            # two positions that fit would be held, of which the mean is no truth
            estimator={"process_noise": noise, "hypotheses": 1},
            duration=60.0,
        )
    )
    assert run.max_error < 1e-9
    np.testing.assert_allclose(run.cramer_rao, run.covariance, rtol=1e-7, atol=1e-10)


def test_cramer_rao_bound_does_not_depend_on_the_measured_ranges(run):
    deafened = replace(run, ranges=run.ranges + 7.0, mean=run.mean + 3.0)
    np.testing.assert_array_equal(run.cramer_rao, deafened.cramer_rao)


def test_information_bound_lies_below_what_the_path_achieves(run):
    summary = run.summary()
    for figures in (summary["all"], *summary["auv"].values()):
        assert 0 < figures["bound_rms_m"] <= figures["pcrb_rms_m"]
        assert figures["efficiency"] == pytest.approx(
            figures["bound_rms_m"] / figures["pcrb_rms_m"], rel=1e-12
        )


def test_bound_of_squared_ranges_is_of_the_farthest_place_the_vehicle_can_reach():
    """In closed form for one range about an AUV sure of its course: half of its information each way, and nobody has more."""
    known = {"sigma_position": 2.0, "sigma_heading_deg": 0.0, "sigma_speed": 0.0}
    sure = {"position": 0.0, "heading_deg": 0.0, "speed": 0.0}
    mission = scenario(
        ranging__kind="squared-range",
        ranging__sigma=300.0,
        ranging__interval=12.0,
        **{f"auv__{i}__first_estimate": known for i in range(2)},
        **{f"auv__{i}__process_noise": sure for i in range(2)},
    )
    run = op.simulate(mission)
    samples, ping = run.time.size, 24  # one range, after 12 s of 20 s
    assert np.flatnonzero(np.isfinite(run.range[0])).tolist() == [ping]
    for i in range(2):
        farthest = math.dist(run.truth[i, ping, :2], run.cna[0, :2]) + 2.0 * 12.0
        sigma = 300.0 / (2 * farthest)  # of the range that the squared one is worth there
        after = 2 / (1 / 4.0 + 1 / (2 * sigma**2))
        mean = (ping * 2 * 4.0 + (samples - ping) * after) / samples
        assert run.information_bounds[i].bound == pytest.approx(mean, rel=1e-9)


def test_summary_is_json_and_its_figures_are_those_of_each_auv_and_of_all(run):
    summary = json.loads(json.dumps(run.summary(), allow_nan=False))
    assert {k: summary[k] for k in ("scenario", "planner", "seed", "version")} == {
        "scenario": "scenario",
        "planner": "path-inertia",
        "seed": 1,
        "version": op.__version__,
    }
    assert list(summary["auv"]) == run.names == ["a", "b"]
    for i, figures in enumerate(summary["auv"].values()):
        assert figures["rms_error_m"] == pytest.approx(
            math.sqrt((run.error[i] ** 2).mean()), rel=1e-12
        )
        assert figures["max_error_m"] == run.error[i].max()
        assert figures["mean_nees"] == pytest.approx(run.nees[i].mean(), rel=1e-12)
        assert figures["separation_mean_m"] == pytest.approx(run.separation[i].mean(), rel=1e-12)
        assert figures["separation_max_m"] == run.separation[i].max()
        variance = run.cramer_rao[i, :, 0, 0] + run.cramer_rao[i, :, 1, 1]
        assert figures["pcrb_rms_m"] == pytest.approx(math.sqrt(variance.mean()), rel=1e-12)
    assert summary["all"]["rms_error_m"] == pytest.approx(run.rms_error, rel=1e-12)
    assert (
        summary["all"]["max_error_m"]
        == run.max_error
        == max(f["max_error_m"] for f in summary["auv"].values())
    )
    for key in ("rms_error_m", "pcrb_rms_m", "bound_rms_m"):
        assert summary["all"][key] ** 2 == pytest.approx(
            np.mean([f[key] ** 2 for f in summary["auv"].values()]), rel=1e-12
        )


def test_summary_leaves_out_the_bound_if_asked_to_and_says_nothing_where_there_is_no_number(run):
    assert "efficiency" in run.summary()["all"]
    assert "efficiency" not in run.summary(bounds=False)["all"]
    certain = replace(run, covariance=np.zeros_like(run.covariance))
    assert certain.summary(bounds=False)["all"]["mean_nees"] is None


def test_status_is_counted_by_its_label_once_per_decision(run):
    counts = run.status_counts
    assert set(counts) <= {status.label for status in Status}
    assert sum(counts.values()) == 20 == np.isfinite(run.status).sum()
    assert op.simulate(scenario(planner={"kind": "circle", "interval": 2.0})).status_counts == {
        "optimal": 10
    }
    straight = op.simulate(scenario(auv__0__weight=0.0, auv__1__weight=0.0))
    assert straight.status_counts == {"no-targets": 20}


def test_condition_number_is_recorded_per_auv_at_each_decision_and_labelled():
    labels = {"path-inertia": "κ(J)", "gramian": "κ(W)", "circle": "", "stationary": ""}
    for name, label in labels.items():
        recorded = op.simulate(
            scenario(planner={"kind": name, "interval": 1.0, "knowledge": "truth"})
        )
        assert recorded.condition_label == label
        decided = np.isfinite(recorded.status)
        assert (np.isfinite(recorded.condition) == (decided & bool(label))).all()
        assert (recorded.condition[np.isfinite(recorded.condition)] >= 1 - 1e-12).all()


def test_condition_number_recorded_is_that_of_the_decision():
    mission = scenario()
    spy = Spy(mission.planner())
    recorded = op.simulate(mission, planner=spy)
    for k, (*_, decision) in enumerate(spy.said):
        np.testing.assert_array_equal(recorded.condition[:, 2 * k], decision.condition)
        assert recorded.score[2 * k] == decision.score
        assert recorded.status[2 * k] == decision.status


def test_recording_has_a_sample_for_every_instant_and_every_auv(run):
    n = run.time.size
    np.testing.assert_allclose(run.time, np.arange(41) * 0.5)
    assert run.cna.shape == (n, 3)
    assert run.truth.shape == run.mean.shape == (2, n, 4)
    assert run.covariance.shape == run.cramer_rao.shape == (2, n, 4, 4)
    assert run.range.shape == run.condition.shape == run.error.shape == (2, n)
    assert run.turn_rate.shape == run.speed.shape == run.score.shape == run.status.shape == (n,)
    np.testing.assert_array_equal(run.covariance, np.swapaxes(run.covariance, -1, -2))
    assert (np.linalg.eigvalsh(run.covariance) > 0).all()
