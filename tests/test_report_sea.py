"""What a run says of lost and false ranges, of what filters are told, and of the water."""

import csv
import io
import math

import numpy as np
import pytest
from oracles import scenario

import obsplan as op
import obsplan.report.measurements as table
from obsplan.report.measurements import measurements_csv
from obsplan.report.sea import sea_notes, summary_of

BEACON = [{"x": 20.0, "y": 60.0, "depth": 50.0}]


def said(**changes):
    return " ".join(sea_notes(op.simulate(scenario(**changes))))


def test_nothing_is_said_and_no_figure_added_where_every_range_came_and_all_is_told():
    run = op.simulate(scenario(ranging__growth=0.02, environment__current=(0.1, 0.2)))
    assert sea_notes(run) == []
    assert summary_of(run) == run.summary()


def test_ranges_that_were_due_are_those_that_came_and_those_that_were_lost():
    whole = op.simulate(scenario(beacon=BEACON, ranging__jitter=0.5))
    run = op.simulate(scenario(beacon=BEACON, ranging__jitter=0.5, ranging__loss=0.4))
    assert 0 < run.came.sum() < whole.came.sum()  # the schedule is the seed's, lost or not
    lost = (whole.came & ~run.came).sum(axis=2)
    figures = summary_of(run, bounds=False)
    assert figures["all"]["ranges_due"] == whole.came.sum()
    assert figures["all"]["ranges_lost"] == lost.sum()
    for i, note in enumerate(sea_notes(run)):
        name, due = run.names[i], whole.came[:, i].sum()
        assert figures["auv"][name]["ranges_due"] == due
        assert note.startswith(f"{name}: {due} ranges were due, {lost[:, i].sum()} were lost (")
        assert f"{lost[0, i]} of {whole.came[0, i].sum()} of cna, " in note
        assert f"{lost[1, i]} of {whole.came[1, i].sum()} of beacon-1)" in note


def test_ranges_that_came_twice_are_those_of_the_tape():
    run = op.simulate(scenario(ranging__duplicates=0.5, ranging__loss=0.2))
    tape = op.to_tape(run)
    twice = len(tape.measurements.value) - run.came.sum()
    assert twice > 0
    assert summary_of(run, bounds=False)["all"]["ranges_twice"] == twice


def test_keys_that_filters_or_planners_are_told_otherwise_are_named():
    untold = {"estimator__ranging": {"growth": 0.0}}
    words = "take ranges for what they are not: growth is 0.02, told 0."
    assert said(ranging__growth=0.02, **untold) == f"Filters and planners {words}"
    one = said(ranging__growth=0.02, planner__ranging={"growth": 0.0})
    assert one == f"Planners {words}"
    other = said(ranging__growth=0.02, **untold, planner__ranging={"growth": 0.02})
    assert other == f"Filters {words} Planners are told how they are."


@pytest.mark.parametrize(
    ("key", "value"),
    [("outliers", 0.1), ("scale_sigma", 0.01), ("clock_offset", 1e-3), ("compass_bias_deg", 2.0)],
)
def test_what_nobody_is_told_of_is_named(key, value):
    changes = {f"ranging__{key}": value}
    assert said(**changes) == f"Neither filters nor planners are told of ranging.{key} = {value:g}."


def test_water_is_said_to_differ_where_an_auv_counts_on_another_current():
    run = op.simulate(
        scenario(environment__current=(0.0, 0.3), estimator__current=(0.0, -0.1), cna__carried=True)
    )
    alike = "differs from that by up to 0.4 m/s (0.4 m/s in the mean)"
    *of_auvs, carried = sea_notes(run)
    assert [alike in note and run.names[i] in note for i, note in enumerate(of_auvs)] == [True] * 2
    assert "carried by the current" in carried


def test_silent_intervals_are_summed_within_the_mission():
    duration = float(op.simulate(scenario()).time[-1])
    note = said(ranging__silent=((5.0, 15.0), (duration - 5.0, duration + 50.0)))
    assert note.startswith("No range was due during the silent intervals, 15 s in all")


def test_a_table_in_a_notebook_has_a_column_of_lost_ranges():
    run = op.simulate(scenario(ranging__loss=0.4))
    assert "<th>Lost</th>" in run._repr_html_()


# measurements.csv

LOGS = {
    "auv__0__speed_sensor": {"kind": "water-speed", "sigma": 1e-4, "interval": 1.0},
    "auv__1__speed_sensor": {"kind": "dvl", "sigma": 1e-4, "interval": 2.0},
    "environment__current": (0.3, -0.2),
}


def rows_of(run):
    return [*csv.DictReader(io.StringIO("".join(measurements_csv(run))))]


def test_measurements_hold_speeds_through_the_water_and_over_ground():
    run = op.simulate(scenario(**LOGS))
    measured = {(row["auv"], float(row["received_s"]), row["sensor"]): row for row in rows_of(run)}
    for k in range(1, run.time.size):
        time = float(run.time[k])
        _, _, _, speed = run.truth[0, k]
        _, _, heading, other = run.truth[1, k]
        along = np.array([math.cos(heading), math.sin(heading)])
        if time % 1.0 == 0:
            row = measured[run.names[0], time, "water-speed-1"]
            assert float(row["value"]) == pytest.approx(speed, abs=6e-4)  # six sigma
            assert (row["unit"], row["beacon"], row["sent_s"]) == ("m/s", "", row["received_s"])
        if time % 2.0 == 0:
            forward = other + along @ [0.3, -0.2]
            left = along[0] * -0.2 - along[1] * 0.3
            row = [measured[run.names[1], time, f"dvl-{n}"]["value"] for n in (1, 2)]
            np.testing.assert_allclose([*map(float, row)], [forward, left], atol=6e-4)
        else:
            assert (run.names[1], time, "dvl-1") not in measured


def test_measurements_say_when_a_question_was_sent_and_what_came_twice():
    changes = {"ranging__timing": "two-way", "ranging__turn_around": 0.3}
    run = op.simulate(scenario(beacon=BEACON, **changes, ranging__duplicates=0.3))
    rows = rows_of(run)
    assert len(rows) == run.came.sum() + summary_of(run, bounds=False)["all"]["ranges_twice"]
    for row in rows:
        b, i = ["cna", "beacon-1"].index(row["beacon"]), run.names.index(row["auv"])
        k = int(np.abs(run.time - float(row["received_s"])).argmin())
        assert float(row["value"]) == pytest.approx(run.ranges[b, i, k], abs=1e-6)
        away = float(row["received_s"]) - float(row["sent_s"])
        assert away == pytest.approx(2 * run.ranges[b, i, k] / 1500.0 + 0.3, abs=3e-6)


def test_measurements_are_the_same_in_one_piece_or_many(monkeypatch):
    run = op.simulate(scenario(beacon=BEACON, ranging__bearing_sigma_deg=3.0, **LOGS))
    whole = "".join(measurements_csv(run))
    monkeypatch.setattr(table, "BLOCK", 7)
    assert "".join(measurements_csv(run)) == whole
    assert {row["sensor"] for row in rows_of(run)} == {
        "range", "bearing", "water-speed-1", "dvl-1", "dvl-2"
    }  # fmt: skip


def test_measurements_are_written_only_where_tracks_cannot_hold_them(tmp_path):
    quick = {"export__replays": 0, "duration": 20.0}
    for name, changes in {"plain": {}, "more": {"beacon": BEACON}}.items():
        op.write_run(op.simulate(scenario(**quick, **changes)), tmp_path / name)
    assert not (tmp_path / "plain" / "measurements.csv").exists()
    assert (tmp_path / "more" / "measurements.csv").exists()


def test_names_in_measurements_are_no_formulas():
    run = op.simulate(scenario(beacon=[{"x": 0.0, "y": 60.0, "depth": 1.0, "name": "=1+1"}]))
    assert not {row["beacon"][0] for row in rows_of(run)} & set("=+-@")
