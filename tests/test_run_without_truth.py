"""Runs of recordings: what is known without the truth, what became of ranges, and what is said."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from replays import NODES, replayed
from scipy.io import netcdf_file
from scipy.stats import chi2

import obsplan as op
from obsplan.fates import Fate
from obsplan.replay.result import grid
from obsplan.report import filter_notes, verdicts
from obsplan.report.hindsight import hindsight, survey_of
from obsplan.report.ranged import ranges_csv
from obsplan.report.tables import run_html, run_table

OF_THE_TRUTH = {
    *("rms_error_m", "max_error_m", "mean_nees", "pcrb_rms_m", "bound_rms_m", "efficiency"),
    *("separation_mean_m", "separation_max_m", "smoothed_rms_error_m"),
}


@pytest.fixture(scope="module")
def replay():
    return replayed()


@pytest.fixture(scope="module")
def without(replay):
    return replay.run(truth=False)


@pytest.fixture(scope="module")
def files(without, tmp_path_factory):
    folder = tmp_path_factory.mktemp("replay") / "files"
    op.write_run(without, folder)
    return folder


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_replay_of_a_simulations_tape_and_estimates_is_that_simulation(replay):
    run, flown = replay.run(), replay.simulated
    for name in ("time", "mean", "covariance", "truth", "ranges", "cna"):
        np.testing.assert_array_equal(getattr(run, name), getattr(flown, name), err_msg=name)
    np.testing.assert_allclose(run.speed[:-1], flown.speed[:-1], rtol=1e-3)  # chords of arcs
    np.testing.assert_allclose(run.turn_rate[:-1], flown.turn_rate[:-1], rtol=1e-9)
    ours, theirs = run.summary()["all"], flown.summary()["all"]
    for key in OF_THE_TRUTH & {*theirs}:
        assert ours[key] == pytest.approx(theirs[key], rel=1e-9), key
    assert ours["smoothed_rms_error_m"] == pytest.approx(0.25 * np.sqrt(2))


def test_what_needs_the_truth_is_absent_and_nothing_is_judged_by_it(without):
    summary = without.summary()
    for figures in (summary["all"], *summary["auv"].values()):
        assert not OF_THE_TRUTH & {*figures}
        assert figures["sigma_rms_m"] > 0
    assert summary["unbounded"] == "no truth was given"
    assert all("no truth was given" in said and " off (" not in said for said in verdicts(without))
    with pytest.raises(op.ObsplanError, match="no truth was given"):
        _ = without.rms_error


def test_files_of_a_run_without_truth_leave_empty_what_is_not_known(files, without):
    names = {path.name for path in files.iterdir()}
    assert {"map.png", "errors.png", "nis.png", "ranges.csv", "smoothed.csv"} <= names
    assert not any(name.startswith("path") for name in names)
    for row in table(files / "tracks.csv"):
        assert row["auv_x_m"] == row["auv_heading_rad"] == row["error_m"] == ""
        assert row["est_x_m"] != ""
    with netcdf_file(files / "tracks.nc", mmap=False) as data:
        assert data.source == b"replay"
        assert not {"error", "nees", "pcrb", "separation", "auv_x"} & {*data.variables}
        assert data.variables["smoothed_x"].shape == without.mean.shape[:2]
    assert json.loads((files / "summary.json").read_text())["source"] == "replay"


def test_ranges_have_a_row_each_with_their_time_of_day_expectation_and_fate(files, replay):
    rows, tape = table(files / "ranges.csv"), replay.tape
    assert len(rows) == tape.measurements.value.size
    assert rows[0]["received_s"] == "4.000000"
    assert rows[0]["received"] == "2025-06-02T00:00:02.000000Z"  # past midnight
    for row, nu, S in zip(
        rows, replay.estimates.innovation, replay.estimates.innovation_variance, strict=True
    ):
        assert float(row["value"]) - float(row["expected"]) == pytest.approx(nu, abs=2e-6)
        assert float(row["nis"]) == pytest.approx(nu**2 / S, abs=2e-6)
        assert (row["unit"], row["fate"]) == ("m", "accepted")


def test_nis_is_the_mean_square_of_those_taken_within_chi_squares_band(replay):
    fate = replay.estimates.fate.copy()
    fate[::5] = Fate.INNOVATION
    run = replay.run(fate=fate)
    rows = (run.log.auv == 1) & (run.log.fate == Fate.ACCEPTED)
    squares = replay.estimates.innovation[rows] ** 2 / replay.estimates.innovation_variance[rows]
    said = run.summary()["ranges"]["b"]
    assert said["nis_mean"] == pytest.approx(squares.mean())
    assert said["nis_count"] == squares.size
    low, high = chi2.ppf([0.025, 0.975], squares.size) / squares.size
    assert (said["nis_low"], said["nis_high"]) == (pytest.approx(low), pytest.approx(high))
    assert said["beacon"]["cna"]["nis_mean"] == said["nis_mean"]


@pytest.mark.parametrize("every", [3, 10])
def test_alarm_is_raised_where_more_than_a_fifth_is_rejected(replay, every):
    fate = replay.estimates.fate.copy()
    fate[::every] = Fate.OUT_OF_REACH
    notes = filter_notes(replay.run(fate=fate))
    assert any("out of reach" in note for note in notes)
    assert any(note.startswith("Alarm") for note in notes) == (every == 3)


def test_innovations_too_large_are_said_and_right_ones_are_not(replay):
    assert all("as its filter expects" in note for note in filter_notes(replay.run()))
    loud = replay.run(innovation=2.0 * replay.estimates.innovation)
    assert all("more than its filter expects" in note for note in filter_notes(loud))


def test_several_positions_are_announced_with_the_time_at_which_one_is_left(replay):
    fitting = np.ones(replay.simulated.mean.shape[:2])
    time = replay.tape.time
    fitting[1, (time >= 10.0) & (time < 70.5)] = 2
    run = replay.run(hypotheses=fitting)
    said = "b: two positions fit since 00:00:10; one left at 00:01:10."
    assert run.announcements == (said,)
    assert filter_notes(run)[-1] == said
    fitting[1] = 3
    assert replay.run(hypotheses=fitting).announcements == (
        "b: three positions fit since 00:00:00; three are left at the end.",
    )


def test_of_several_ranges_within_a_sample_the_last_that_was_taken_is_on_the_grid(replay):
    m, estimates = replay.tape.measurements, replay.estimates
    thrice = np.flatnonzero((m.auv == 0) & (m.received == 8.0)).repeat(3)
    m = type(m)(*(np.concatenate([column, column[thrice]]) for column in m))
    value = m.value.copy()
    value[-3:] = 7.0, 8.0, 9.0
    fate = np.concatenate([estimates.fate, [Fate.ACCEPTED, Fate.REOPENED, Fate.INNOVATION]])
    more = np.ones(3)
    several = replace(
        replay,
        tape=replace(replay.tape, measurements=m._replace(value=value)),
        estimates=replace(
            estimates,
            fate=fate,
            innovation=np.append(estimates.innovation, more),
            innovation_variance=np.append(estimates.innovation_variance, more),
        ),
    )
    run = several.run()
    at = int(np.flatnonzero(run.time == 8.0)[0])
    assert (run.ranges[0, 0, at], run.fates[0, 0, at]) == (8.0, Fate.REOPENED)
    assert run.log.value.size == value.size


def test_errors_are_told_of_the_times_at_which_the_truth_is_known(replay):
    truth = replay.tape.truth.copy()
    truth[:, :100] = np.nan
    run = replace(replay, tape=replace(replay.tape, truth=truth)).run()
    away = replay.simulated.mean[:, 100:, :2] - truth[:, 100:, :2]
    figures = run.summary()["all"]
    assert figures["rms_error_m"] == pytest.approx(np.sqrt(np.mean(np.sum(away**2, axis=-1))))
    assert "pcrb_rms_m" not in figures
    assert all("the truth is known" in said for said in verdicts(run))


def test_without_an_aid_vehicle_nothing_is_said_of_one(tmp_path):
    cna = {"speed": 2.0, "min_turn_radius": 5.0, "ranged": False}
    moored = replayed(cna=cna, beacon=NODES).run()
    assert not {"separation_mean_m", "efficiency"} & {*moored.summary()["all"]}
    op.write_run(moored, tmp_path / "moored")
    assert all(row["cna_x_m"] == "" for row in table(tmp_path / "moored" / "tracks.csv"))
    with pytest.raises(op.ObsplanError, match="no aid vehicle"):
        hindsight(moored)


def test_a_time_that_the_recording_lacks_is_refused():
    with pytest.raises(op.ObsplanError, match=r"no sample at 1.5 s"):
        grid(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.5]))


def test_hindsight_of_a_path_that_no_planner_could_mend_finds_no_loss(replay):
    """The recorded path is the circle that was flown: simulated again it errs as it did."""
    found = hindsight(replay.run(truth=False), seeds=2)
    flown = [op.simulate(replay.simulated.scenario, seed=seed).rms_error for seed in found.seeds]
    assert found.errors.own == pytest.approx(flown, rel=0.2)
    assert 0 < found.efficiency <= 1
    assert found.deviation < 2.0
    assert "default planner" in found.sentence


def test_surveys_of_tracks_are_where_tracks_are_when_they_are():
    time = np.arange(0.0, 100.0, 0.5)
    track = np.column_stack([50 * np.sin(time / 30), 0.01 * time**2])
    survey = survey_of(track, time)
    reference = op.Waypoints(points=survey["points"], speeds=tuple(survey["speeds"])).reference(
        speed=None, current=np.zeros(2)
    )
    off = np.hypot(*(reference.sample(time).position - track).T)
    assert off[time <= 95.0].max() < 0.1  # chords of at least 2 m; after the last leg it waits


def test_a_table_has_dashes_for_an_auv_whose_truth_is_not_known(replay):
    run = replay.run()
    truth = run.truth.copy()
    truth[1] = np.nan
    some = replace(run, truth=truth)
    columns = [[*column.cells] for column in run_table(some).columns]
    of_the_first, of_the_second, _ = zip(*columns, strict=True)
    assert "–" not in of_the_first
    assert "–" in of_the_second
    assert "<td>–</td>" in run_html(some)


def test_the_last_of_many_changes_is_told(replay):
    fitting = np.ones(replay.simulated.mean.shape[:2])
    for begin in range(10, 90, 10):
        fitting[0, (replay.tape.time >= begin) & (replay.tape.time < begin + 5)] = 2
    (said,) = replay.run(hypotheses=fitting).announcements
    assert said.endswith("; 10 more changes; one left at 00:01:25.")


def test_columns_of_ranges_that_a_simulation_cannot_fill_are_left_out(replay):
    header = next(ranges_csv(replay.simulated, replay.simulated.ranged))
    assert header.startswith("received_s,auv,")
