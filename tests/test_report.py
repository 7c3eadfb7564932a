"""Claims about the files of a run and of a comparison."""

import csv
import errno
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pymap3d
import pyogrio.raw
import pytest
import shapely
from pymavlink.mavwp import MAVWPLoader

from obsplan.report import files, free_folder, write_comparison, write_run
from obsplan.report.files import as_json, tracks_csv
from obsplan.scenario import load
from obsplan.simulation import simulate
from obsplan.types import ObsplanError

pytestmark = pytest.mark.xdist_group("report")  # they share a run's folder
LAT, LON = 47.629, -122.337  # of harbor-survey's origin
FILES = [
    "errors.png",
    "map.png",
    "nis.png",
    *(f"path.{name}" for name in ("bhv", "csv", "geojson", "gpx", "kml", "plan", "waypoints")),
    "ranges.csv",
    "report.html",
    "scenario.toml",
    "summary.json",
    "timing.json",
    "tracks.csv",
    "tracks.nc",
]
COLUMNS = [
    *("time_s", "cna_x_m", "cna_y_m", "cna_heading_rad", "cna_turn_rate_radps"),
    *(
        "auv",
        "auv_x_m",
        "auv_y_m",
        "auv_heading_rad",
        "est_x_m",
        "est_y_m",
        "sigma_x_m",
        "sigma_y_m",
        "error_m",
        "range_m",
    ),
]
HALF_A_DIGIT = 0.5e-6  # tables have six decimals
SHORT = ["duration=200.0"]


def fly(seed=3):
    return simulate(load("harbor-survey", planner="path-inertia", settings=SHORT), seed=seed)


@pytest.fixture(scope="module")
def run():
    return fly()


@pytest.fixture(scope="module")
def folder(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "harbor"
    write_run(run, path)
    return path


@pytest.fixture(scope="module")
def table(folder):
    """Rows of tracks.csv by AUV; numbers where they are."""
    with (folder / "tracks.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {
        name: {
            key: np.array([float(row[key] or "nan") for row in rows if row["auv"] == name])
            for key in COLUMNS
            if key != "auv"
        }
        for name in ("alpha", "bravo")
    }


def enu(latlon):
    """East and north by another library than the writer's own."""
    return np.stack(
        pymap3d.geodetic2enu(latlon[:, 0], latlon[:, 1], 0.0, LAT, LON, 0.0)[:2], axis=-1
    )


# --- what is written -------------------------------------------------------------------------------------------------------------


def test_folder_holds_every_file_and_nothing_else(folder):
    assert sorted(path.name for path in folder.iterdir()) == FILES
    assert [path.name for path in folder.parent.iterdir()] == ["harbor"]


@pytest.mark.slow
def test_same_scenario_and_seed_give_the_same_bytes_but_for_the_timing(folder, tmp_path):
    write_run(fly(), tmp_path / "again")
    for name in set(FILES) - {"timing.json"}:
        assert (folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name
    write_run(fly(seed=4), tmp_path / "other")
    for name in set(FILES) - {"timing.json"}:
        assert (folder / name).read_bytes() != (tmp_path / "other" / name).read_bytes(), name


def test_scenario_file_alone_gives_the_run_again_bit_by_bit(run, folder, tmp_path):
    alone = tmp_path / "scenario.toml"
    alone.write_bytes(
        (folder / "scenario.toml").read_bytes()
    )  # away from the mission file it was made of
    again = simulate(load(alone))
    assert (again.seed, again.planner, again.names) == (run.seed, run.planner, run.names)
    for name in ("time", "cna", "turn_rate", "truth", "mean", "covariance", "range", "condition"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))


@pytest.mark.slow
def test_scenario_file_says_when_it_cannot_name_the_planner(run, tmp_path):
    write_run(replace(run, planner="MyPlanner"), tmp_path / "out")
    assert "# but steered by MyPlanner" in (tmp_path / "out" / "scenario.toml").read_text()


def test_tracks_have_a_row_per_time_and_auv(run, folder, table):
    with (folder / "tracks.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert rows[0] == COLUMNS
    assert [row[5] for row in rows[1:]] == ["alpha", "bravo"] * run.time.size
    sigma = np.sqrt(run.covariance[:, :, [0, 1], [0, 1]])
    for i, name in enumerate(("alpha", "bravo")):
        recorded = [
            run.time,
            *run.cna.T,
            run.turn_rate,
            *run.truth[i, :, :3].T,
            *run.mean[i, :, :2].T,
            *sigma[i].T,
        ]
        recorded += [np.hypot(*(run.mean - run.truth)[i, :, :2].T), run.range[i]]
        for values, column in zip(recorded, table[name].values(), strict=True):
            np.testing.assert_allclose(column, values, atol=1.01 * HALF_A_DIGIT)
        np.testing.assert_array_equal(
            np.flatnonzero(np.isfinite(table[name]["range_m"])), np.arange(30, 401, 30)
        )  # each 15 s


def test_squared_ranges_are_told_as_ranges_and_negative_ones_as_zero():
    run = simulate("survey-slow", seed=1)
    table = "".join(tracks_csv(run)).splitlines()
    values = np.array([float(row["range_m"] or "nan") for row in csv.DictReader(table)])
    squared = run.range[0]
    assert (squared < 0).any()  # else the claim is empty
    np.testing.assert_array_equal(np.isnan(values), np.isnan(squared))
    told = np.sqrt(np.where(squared < 0, 0.0, squared))
    np.testing.assert_allclose(values, told, atol=1.01 * HALF_A_DIGIT)


def test_no_number_is_minus_zero_or_nan():
    assert files.rounded(np.array([-4e-7, -0.0, np.nan, -6e-7])) == [
        "0.000000",
        "0.000000",
        "",
        "-0.000001",
    ]
    assert [files.rounded(value) for value in (-4e-7, 3, "name")] == ["0.000000", 3, "name"]


def test_gdal_reads_the_tracks_back(folder, table):
    _, _, geometry, (names, times) = pyogrio.raw.read(
        folder / "path.geojson", columns=["name", "time_s"]
    )
    assert list(names) == ["cna", "alpha-truth", "alpha-estimate", "bravo-truth", "bravo-estimate"]
    lines = {
        name: enu(shapely.get_coordinates(shapely.from_wkb(shape))[:, ::-1])
        for name, shape in zip(names, geometry, strict=True)
    }
    for time in times:
        np.testing.assert_allclose(time, table["alpha"]["time_s"])
    expected = {
        "cna": ("alpha", "cna"),
        "alpha-truth": ("alpha", "auv"),
        "bravo-truth": ("bravo", "auv"),
        "bravo-estimate": ("bravo", "est"),
    }
    for name, (auv, prefix) in expected.items():
        xy = np.stack([table[auv][f"{prefix}_x_m"], table[auv][f"{prefix}_y_m"]], axis=-1)
        assert (
            np.hypot(*(lines[name] - xy).T).max() < 0.1
        )  # 1e-9 degrees and six decimals are 1e-4 m


@pytest.mark.slow
def test_a_vehicle_that_never_moves_is_a_point(tmp_path):
    write_run(simulate("fixed-auv", planner="stationary"), tmp_path / "out")
    _, _, geometry, (names,) = pyogrio.raw.read(tmp_path / "out" / "path.geojson", columns=["name"])
    kinds = dict(zip(names, (shapely.from_wkb(shape).geom_type for shape in geometry), strict=True))
    assert kinds == {"cna": "Point", "alpha-truth": "Point", "alpha-estimate": "LineString"}


def test_pymavlink_reads_the_aid_path_back(folder, table):
    loader = MAVWPLoader()
    loader.load(str(folder / "path.waypoints"))
    placed = [w for w in loader.wpoints if w.command in (16, 17)]
    waypoints = enu(np.array([(w.x, w.y) for w in placed]))
    flown = np.stack([table["alpha"]["cna_x_m"], table["alpha"]["cna_y_m"]], axis=-1)
    assert np.hypot(*(waypoints[0] - flown[0])) < 0.1  # home
    route = shapely.LineString(waypoints[1:])
    assert shapely.distance(shapely.points(flown), route).max() < 0.5
    assert shapely.distance(shapely.points(waypoints), shapely.LineString(flown)).max() < 0.1


def test_summary_is_strict_json_with_the_figures_of_merit_of_each_and_all(run, folder):
    summary = json.loads(
        (folder / "summary.json").read_text(),
        parse_constant=lambda name: pytest.fail(f"{name} is not JSON"),
    )
    assert summary.pop("export")["items"] > 2  # claimed in test_run_export.py
    assert summary == run.summary()
    assert set(summary["auv"]) == {"alpha", "bravo"}
    assert summary["all"]["rms_error_m"] == pytest.approx(np.sqrt(np.mean(run.error**2)))


def test_json_refuses_what_is_no_number():
    with pytest.raises(ValueError, match="JSON"):
        as_json({"a": float("nan")})


def test_timing_has_decisions_only_where_they_were_timed(run, folder):
    timing = json.loads((folder / "timing.json").read_text())
    assert timing["decision_median_s"] is timing["decision_max_s"] is None
    assert timing["steps_per_second"] == pytest.approx(400 / run.timing.seconds)
    timed = files.timing(
        replace(run, timing=replace(run.timing, seconds=8.0, decision_seconds=[0.25, 1.0, 0.5]))
    )
    assert timed == {
        "decision_median_s": 0.5,
        "decision_max_s": 1.0,
        "step_mean_s": 0.02,
        "steps_per_second": 50.0,
    }


@pytest.mark.slow
def test_run_whose_filter_failed_is_written_up_to_there(tmp_path):
    run = simulate("fixed-auv")
    mean, covariance = run.mean.copy(), run.covariance.copy()
    mean[0, 100:], covariance[0, 100:] = np.nan, np.nan
    write_run(replace(run, mean=mean, covariance=covariance), tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["all"]["rms_error_m"] is None
    _, _, geometry, _ = pyogrio.raw.read(tmp_path / "out" / "path.geojson")
    assert [len(shapely.get_coordinates(shapely.from_wkb(shape))) for shape in geometry] == [
        201,
        1,
        100,
    ]
    rows = list(csv.DictReader((tmp_path / "out" / "tracks.csv").read_text().splitlines()))
    assert (rows[99]["est_x_m"] != "", rows[100]["est_x_m"], rows[100]["auv_x_m"]) == (
        True,
        "",
        "0.000000",
    )


# --- what is never half written ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_whatever_stops_the_writing_nothing_is_left(run, tmp_path, monkeypatch, stop):
    def interrupted(*_):
        assert [path.name.startswith(".out.") for path in tmp_path.iterdir()] == [True]
        raise stop

    monkeypatch.setattr(files, "timing", interrupted)  # the last file
    with pytest.raises(stop):
        write_run(run, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_full_disk_is_one_sentence_about_the_folder(run, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(
        ObsplanError, match=r"/out cannot be written \(No space left on device\): [^.]*$"
    ):
        write_run(run, tmp_path / "out")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_folder_that_appears_meanwhile_is_kept(run, tmp_path, monkeypatch):
    monkeypatch.setattr(files, "timing", lambda _: (tmp_path / "out").mkdir() or {})
    with pytest.raises(ObsplanError, match="exists and is not overwritten"):
        write_run(run, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    "write", [lambda path: free_folder(path, "name"), lambda path: write_comparison(ROWS, path)]
)
def test_folder_that_exists_or_cannot_be_made_is_refused(tmp_path, monkeypatch, write):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "gone")
    for name in ("file", "link"):
        with pytest.raises(
            ObsplanError, match=f"{name} exists and is not overwritten: give another folder"
        ):
            write(tmp_path / name)
    for name in ("file", "gone"):
        with pytest.raises(ObsplanError, match=f"{name} is not a folder: make that first"):
            write(tmp_path / name / "out")
    monkeypatch.setattr(files.os, "access", lambda *_: False)
    with pytest.raises(ObsplanError, match="cannot be written to: give another folder"):
        write(tmp_path / "out")
    assert (tmp_path / "file").read_text() == "mine"


def test_folder_is_numbered_unless_it_is_given(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert free_folder(None, "harbor") == Path("harbor")
    for taken in ("harbor", "harbor-2"):
        Path(taken).mkdir()
    assert free_folder(None, "harbor") == Path("harbor-3")
    assert free_folder(tmp_path / "mine", "harbor") == tmp_path / "mine"


# --- comparisons -------------------------------------------------------------------------------------------------------------------

ROWS = [
    {
        "planner": planner,
        "seed": seed,
        "rms_error_m": rms + seed,
        "max_error_m": 200.0,
        "mean_nees": None,
        "separation_mean_m": 3.0,
    }
    for planner, rms in (("slow, wide", 9.0), ("quick", 1.0))
    for seed in (1, 2, 4)
]


def test_comparison_is_a_row_per_planner_and_seed_and_a_figure(tmp_path):
    write_comparison(ROWS, tmp_path / "out", title="both")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "compare.csv",
        "compare.png",
    ]
    with (tmp_path / "out" / "compare.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["planner"], row["seed"]) for row in rows] == [
        (row["planner"], str(row["seed"])) for row in ROWS
    ]
    assert [float(row["rms_error_m"]) for row in rows] == [10.0, 11.0, 13.0, 2.0, 3.0, 5.0]
    assert {row["mean_nees"] for row in rows} == {""}


# --- who pays for what -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_tables_and_sentences_do_not_load_matplotlib_and_figures_do_not_load_pyplot():
    code = """
import sys
from obsplan.report import compare_table, free_folder, run_table, verdicts, write_run
assert "matplotlib" not in sys.modules
from obsplan.report import errors_figure, map_figure
assert "matplotlib.pyplot" not in sys.modules
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
