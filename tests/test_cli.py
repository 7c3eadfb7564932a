"""The command line as a user meets it: in a folder of their own, through the installed program."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROGRAM = [sys.executable, "-c", "from obsplan.cli import main; main()"]
SMALL = """
origin = { lat = 47.6, lon = -122.3 }
cna = { speed = 1.0, min_turn_radius = 0.5, start = { x = 1.0 } }
auv = [{ speed = 0.5, survey = { kind = "waypoints", points = [[0.0, 0.0], [10.0, 0.0]] } }]
ranging = { interval = 1.0 }
"""
FILES = {
    "scenario.toml", "tracks.nc", "tracks.csv", "map.png", "errors.png", "summary.json", "timing.json",
    *(f"path.{name}" for name in ("bhv", "csv", "geojson", "gpx", "kml", "plan", "waypoints")),
}  # fmt: skip


def obsplan(*arguments, cwd, code=0):
    done = subprocess.run(
        [*PROGRAM, *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        encoding="utf-8",
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def refused(*arguments, cwd):
    """What is printed on refusal: exactly one line, on standard error, and nothing made."""
    before = sorted(cwd.iterdir())
    done = obsplan(*arguments, cwd=cwd, code=2)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("obsplan: ")
    assert sorted(cwd.iterdir()) == before
    return done.stderr


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    return tmp_path


@pytest.mark.slow
def test_run_ends_with_a_table_a_verdict_and_a_folder(small):
    done = obsplan("run", "small.toml", cwd=small)
    assert "RMS error [m]" in done.stdout
    assert "\nauv-1: " in done.stdout
    assert done.stderr == ""  # no progress bar in a pipe
    assert {path.name for path in (small / "scenario").iterdir()} == FILES
    again = obsplan("run", "small.toml", cwd=small)
    assert "scenario-2" in again.stdout


@pytest.mark.slow
def test_run_is_repeated_byte_for_byte_from_its_own_scenario(small):
    obsplan(
        "run",
        "small.toml",
        "--planner",
        "gramian",
        "--seed",
        5,
        "--set",
        "cna.speed=0.8",
        "--out",
        "a",
        cwd=small,
    )
    obsplan("run", "a/scenario.toml", "--seed", 5, "--out", "b", cwd=small)
    for name in FILES - {"timing.json"}:
        assert (small / "a" / name).read_bytes() == (small / "b" / name).read_bytes(), name


@pytest.mark.slow
def test_summary_agrees_with_tracks(small):
    obsplan("run", "small.toml", "--out", "a", cwd=small)
    with (small / "a" / "tracks.csv").open() as file:
        errors = [float(row["error_m"]) for row in csv.DictReader(file)]
    figures = json.loads((small / "a" / "summary.json").read_text())["all"]
    assert figures["max_error_m"] == pytest.approx(max(errors), abs=1e-5)
    assert figures["rms_error_m"] == pytest.approx(
        (sum(e**2 for e in errors) / len(errors)) ** 0.5, abs=1e-5
    )
    assert 0 < figures["efficiency"] <= 1


@pytest.mark.slow
def test_compare_ranks_planners_under_the_same_noise(small):
    done = obsplan(
        "compare",
        "small.toml",
        "--planners",
        "circle,stationary",
        "--runs",
        3,
        "--out",
        "c",
        cwd=small,
    )
    assert "median" in done.stdout
    with (small / "c" / "compare.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["planner"], row["seed"]) for row in rows] == [
        (p, s) for p in ("circle", "stationary") for s in "123"
    ]
    assert (small / "c" / "compare.png").stat().st_size > 10_000


LINE = [[-122.337, 47.629], [-122.337, 47.6295], [-122.3365, 47.6295]]
MISSIONS = {
    "line.geojson": json.dumps({"type": "LineString", "coordinates": LINE}),
    "line.csv": "lat,lon\n" + "".join(f"{lat},{lon}\n" for lon, lat in LINE),
    "local.csv": "x_m,y_m\n0,0\n0,55\n40,55\n",
    "line.plan": json.dumps(
        {
            "fileType": "Plan",
            "version": 1,
            "mission": {
                "plannedHomePosition": [47.629, -122.337, 0],
                "items": [
                    {
                        "type": "SimpleItem",
                        "command": 16,
                        "frame": 3,
                        "params": [0, 0, 0, None, lat, lon, 0],
                        "autoContinue": True,
                    }
                    for lon, lat in LINE
                ],
            },
        }
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MISSIONS)
def test_new_writes_a_scenario_that_runs_as_it_is(tmp_path, name):
    (tmp_path / name).write_text(MISSIONS[name])
    done = obsplan("new", name, cwd=tmp_path)
    assert f"obsplan run {Path(name).stem}.toml" in done.stdout
    obsplan("run", f"{Path(name).stem}.toml", "--out", "out", cwd=tmp_path)
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES


@pytest.mark.slow
def test_new_finds_its_mission_from_another_folder(tmp_path):
    (tmp_path / "missions").mkdir()
    (tmp_path / "missions" / "line.csv").write_text(MISSIONS["line.csv"])
    obsplan("new", "missions/line.csv", "--out", "mine.toml", cwd=tmp_path)
    assert 'file = "missions/line.csv"' in (tmp_path / "mine.toml").read_text()


def test_wrong_input_is_one_line_and_makes_nothing(small):
    (small / "taken").mkdir()
    (small / "broken.plan").write_text('{"fileType": "Plan", "mission": {"items": [')
    assert "taken" in refused("run", "small.toml", "--out", "taken", cwd=small)
    assert 'did you mean "harbor-survey"' in refused("run", "harbor-surve", cwd=small)
    assert 'did you mean "circle"' in refused("run", "small.toml", "--planner", "circel", cwd=small)
    assert 'did you mean "speed"' in refused("run", "small.toml", "--set", "cna.sped=1", cwd=small)
    assert "broken.plan" in refused("new", "broken.plan", cwd=small)
    assert "small.toml" in refused("new", "broken.plan", "--out", "small.toml", cwd=small)
    assert "Did you mean 'run'" in refused("rum", cwd=small)
    assert 'no planner "x"' in refused("compare", "small.toml", "--planners", "circle,x", cwd=small)


@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write anywhere")
def test_folder_that_cannot_be_written_is_refused(small):
    small.chmod(0o555)
    try:
        assert "cannot be" in refused("run", "small.toml", cwd=small)
    finally:
        small.chmod(0o755)


@pytest.mark.slow
def test_interrupted_run_leaves_no_folder(small):
    (small / "long.toml").write_text(
        "time_step = 0.1\n" + SMALL.replace("[10.0, 0.0]", "[40000.0, 0.0]")
    )
    process = subprocess.Popen(
        [*PROGRAM, "run", "long.toml"],
        cwd=small,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    time.sleep(2.5)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert error == "obsplan: interrupted; nothing was written\n"
    assert not [path for path in small.iterdir() if path.is_dir()]


def test_lists_say_what_there_is(tmp_path):
    assert "harbor-survey" in obsplan("scenarios", cwd=tmp_path).stdout
    text = obsplan("schema", cwd=tmp_path).stdout
    assert "min_turn_radius" in text
    assert "smallest turning radius [m]" in text
    assert json.loads(obsplan("schema", "--json", cwd=tmp_path).stdout)["title"] == "ScenarioTable"
