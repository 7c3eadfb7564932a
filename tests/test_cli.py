"""The command line as a user meets it: in a folder of their own, through the installed program."""

import csv
import json
import os
import pty
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from obsplan.cli import main
from obsplan.types import ObsplanError

PROGRAM = [sys.executable, "-m", "obsplan"]
SMALL = """
origin = { lat = 47.6, lon = -122.3 }
cna = { speed = 1.0, min_turn_radius = 0.5, start = { x = 1.0 } }
auv = [{ speed = 0.5, survey = { kind = "waypoints", points = [[0.0, 0.0], [10.0, 0.0]] } }]
ranging = { interval = 1.0 }
"""
FILES = {
    "scenario.toml", "tracks.nc", "tracks.csv", "ranges.csv", "map.png", "errors.png", "nis.png",
    "smoothed.csv", "summary.json", "timing.json", "report.html",
    *(f"path.{name}" for name in ("bhv", "csv", "geojson", "gpx", "kml", "plan", "waypoints")),
}  # fmt: skip
SEARCHED = FILES | {"planned.csv"}  # of a run under a planner that searches, as the default one


def obsplan(*arguments, cwd, code=0, env=None):
    widthless = {key: value for key, value in os.environ.items() if key != "COLUMNS"}
    done = subprocess.run(
        [*PROGRAM, *map(str, arguments)],
        cwd=cwd,
        env=widthless | (env or {}),
        capture_output=True,
        text=True,
        check=False,
        encoding="utf-8",
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def refused(*arguments, cwd, env=None):
    """What is printed on refusal: exactly one line, on standard error, and nothing made."""
    before = sorted(cwd.iterdir())
    done = obsplan(*arguments, cwd=cwd, code=2, env=env)
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
    assert {path.name for path in (small / "scenario").iterdir()} == SEARCHED
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
@pytest.mark.parametrize(
    ("fault", "ends_with"),
    [
        (ObsplanError("the path is too long: allow more"), SystemExit),
        (ZeroDivisionError("division by zero"), SystemExit),
        (TypeError("a fault of ours"), TypeError),
    ],
)
def test_run_whose_path_cannot_be_exported_is_written_all_the_same_and_says_why(
    small, monkeypatch, capfd, fault, ends_with
):
    def fail(*_, **__):
        raise fault

    monkeypatch.chdir(small)
    monkeypatch.setattr("obsplan.report.export.make_exports", fail)
    monkeypatch.setattr(
        "sys.argv", ["obsplan", "run", "small.toml", "--planner", "stationary", "--no-bound"]
    )
    with pytest.raises(ends_with) as ended:
        main()
    made = {path.name for path in (small / "scenario").iterdir()}
    paths = {name for name in FILES if name.startswith("path.")}
    assert FILES - paths <= made
    assert not made & paths
    if ends_with is SystemExit:
        assert ended.value.code == 2
        said = capfd.readouterr().err.splitlines()[-1]
        assert said.startswith("obsplan: no path to load can be made of the mission: ")
        assert str(fault) in said
        assert said.endswith("; all else was written to scenario")


def test_bound_is_left_out_if_asked_to_and_that_is_said(small):
    said = "No bound over all paths was asked for"
    done = obsplan("run", "small.toml", "--no-bound", "--out", "a", cwd=small)
    assert said in done.stdout
    summary = json.loads((small / "a" / "summary.json").read_text())
    assert summary["all"]["bound_rms_m"] is None
    line = ("compare", "small.toml", "--planners", "circle", "--no-bound", "--out", "c")
    assert said in obsplan(*line, cwd=small).stdout
    (row,) = csv.DictReader((small / "c" / "compare.csv").read_text().splitlines())
    assert row["bound_rms_m"] == row["efficiency"] == ""
    assert row["pcrb_rms_m"]


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
    assert "has the lowest RMS error, " in done.stdout
    assert (
        "With 3 seeds any lead could be chance; from 6 on (--runs 6) it can be told." in done.stdout
    )
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
    assert {path.name for path in (tmp_path / "out").iterdir()} == SEARCHED


@pytest.mark.slow
def test_new_finds_its_mission_from_another_folder(tmp_path):
    (tmp_path / "missions").mkdir()
    (tmp_path / "missions" / "line.csv").write_text(MISSIONS["line.csv"])
    obsplan("new", "missions/line.csv", "--out", "mine.toml", cwd=tmp_path)
    assert 'file = "missions/line.csv"' in (tmp_path / "mine.toml").read_text()


@pytest.mark.slow
def test_wrong_input_is_one_line_and_makes_nothing(small):
    assert 'did you mean "harbor-survey"' in refused("run", "harbor-surve", cwd=small)


@pytest.mark.slow
def test_whatever_is_wrong_is_named_in_that_line(small):
    (small / "taken").mkdir()
    (small / "broken.plan").write_text('{"fileType": "Plan", "mission": {"items": [')
    assert "taken" in refused("run", "small.toml", "--out", "taken", cwd=small)
    assert 'did you mean "circle"' in refused("run", "small.toml", "--planner", "circel", cwd=small)
    assert 'did you mean "speed"' in refused("run", "small.toml", "--set", "cna.sped=1", cwd=small)
    assert "broken.plan" in refused("new", "broken.plan", cwd=small)
    assert "small.toml" in refused("new", "broken.plan", "--out", "small.toml", cwd=small)
    assert "Did you mean 'run'" in refused("rum", cwd=small)
    assert "2 what was given is wrong" in obsplan("--help", cwd=small).stdout
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


@pytest.mark.slow
def test_lists_say_what_there_is(tmp_path):
    listed = obsplan("scenarios", cwd=tmp_path).stdout
    assert "harbor-survey" in listed
    assert "suite/keep-outs" in listed
    assert "field/calm-lake" in listed
    text = obsplan("schema", cwd=tmp_path).stdout
    assert "min_turn_radius" in text
    assert "smallest turning radius [m]" in text
    assert json.loads(obsplan("schema", "--json", cwd=tmp_path).stdout)["title"] == "ScenarioTable"


@pytest.mark.slow
def test_version_and_module_are_the_program_itself(tmp_path):
    told = obsplan("--version", cwd=tmp_path).stdout
    assert re.fullmatch(r"obsplan \d+\.\d+\.\d+\n", told)
    by_name = Path(sys.executable).with_name("obsplan")
    if by_name.exists():
        done = subprocess.run([by_name, "--version"], capture_output=True, text=True, check=True)
        assert done.stdout == told
    assert "Usage: obsplan " in obsplan("run", "--help", cwd=tmp_path).stdout


@pytest.mark.slow
def test_shell_completes_commands_scenarios_and_planners(tmp_path):
    def completed(line):
        words = {"COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
        asked = {"_OBSPLAN_COMPLETE": "complete_bash", **words}
        return obsplan(cwd=tmp_path, env=asked).stdout.split()

    assert completed("obsplan camp") == ["campaign", "campaign-check", "campaign-report"]
    assert completed("obsplan run harb") == ["harbor-survey"]
    assert completed("obsplan compare suite/keep") == ["suite/keep-outs"]
    assert completed("obsplan run field/calm") == ["field/calm-lake"]
    assert completed("obsplan compare x --planners circle,sta") == ["circle,stationary"]


@pytest.mark.slow
def test_shipped_name_works_again_beside_the_folder_that_it_made(tmp_path):
    quick = ("--no-bound", "--set", "duration=10")
    for folder in ("fixed-auv", "fixed-auv-2"):
        assert f"Written to {folder}/" in obsplan("run", "fixed-auv", *quick, cwd=tmp_path).stdout
    for folder in ("fixed-auv-compare", "fixed-auv-compare-2"):
        line = ("compare", "fixed-auv", "--planners", "circle,trail", *quick)
        done = obsplan(*line, cwd=tmp_path)
        assert f"Written to {folder}/" in done.stdout


@pytest.mark.slow
def test_runs_at_once_go_to_folders_of_their_own_and_none_is_lost(small):
    line = [*PROGRAM, "run", "small.toml"]
    both = [subprocess.Popen(line, cwd=small, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    told = [process.communicate(timeout=300)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    made = {re.search(r"Written to (\S+)/:", text)[1] for text in told}
    assert made == {"scenario", "scenario-2"}
    for folder in made:
        assert {path.name for path in (small / folder).iterdir()} == SEARCHED


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "cp1251", "cp932"])
def test_output_does_not_die_of_an_encoding(small, encoding):
    poor = os.environ | {"PYTHONUTF8": "0", "PYTHONIOENCODING": encoding}
    compared = ["compare", "small.toml", "--planners", "circle", "--no-bound"]
    run = [] if encoding == "cp1251" else [["run", "small.toml"]]  # the richest of the three
    for line in (*run, ["schema"], ["run", "--help"], compared):
        done = subprocess.run(
            [*PROGRAM, *line], cwd=small, capture_output=True, check=True, env=poor
        )
        assert done.stderr == b""
        assert done.stdout.decode(encoding)
        assert line[-1] != "small.toml" or "Cramer" in done.stdout.decode(encoding)


@pytest.mark.slow
def test_refusal_does_not_die_of_an_encoding(tmp_path):
    poor = {"PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    assert 'no scenario "cafe-?" is shipped' in refused("run", "café-ж", cwd=tmp_path, env=poor)


@pytest.mark.slow
@pytest.mark.parametrize("line", [["schema"], ["--help"], ["scenarios"]], ids=" ".join)
def test_reader_who_leaves_early_ends_nothing_badly(tmp_path, line):
    reader, writer = os.pipe()
    process = subprocess.Popen([*PROGRAM, *line], cwd=tmp_path, stdout=writer, stderr=subprocess.PIPE)  # fmt: skip
    os.close(writer)
    os.read(reader, 1)
    os.close(reader)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (0, b"")


@pytest.mark.slow
def test_next_command_can_be_pasted(tmp_path):
    (tmp_path / "it's $mine & yours.csv").write_text(MISSIONS["local.csv"])
    done = obsplan("new", "it's $mine & yours.csv", cwd=tmp_path)
    (command,) = re.findall(r"^Next: obsplan (.*)$", done.stdout, flags=re.MULTILINE)
    program = " ".join(shlex.quote(word) for word in PROGRAM)
    subprocess.run(f"{program} {command} --out out", shell=True, cwd=tmp_path, check=True)
    assert {path.name for path in (tmp_path / "out").iterdir()} == SEARCHED


@pytest.mark.slow
@pytest.mark.parametrize("width", [60, 160])
def test_terminal_of_any_width_is_kept_to(tmp_path, width):
    """As on a terminal, for which a pseudo-terminal stands; escape sequences take no room."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"COLUMNS": str(width), "TERM": "xterm"}
    line = [*PROGRAM, "run", "fixed-formation"]
    process = subprocess.Popen(line, cwd=tmp_path, stdout=theirs, stderr=subprocess.DEVNULL, env=environment)  # fmt: skip
    os.close(theirs)
    text = b""
    while True:
        try:
            text += os.read(ours, 65536)
        except OSError:  # Linux says so when the other end is closed
            break
    os.close(ours)
    assert process.wait(timeout=60) == 0
    lines = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", text.decode()).replace("\r", "").splitlines()
    assert max(map(len, lines)) <= width
    summary = json.loads((tmp_path / "fixed-formation" / "summary.json").read_text())
    for name, figures in summary["auv"].items():
        row = " ".join(line for line in lines if line.startswith(f"│ {name} "))
        for key in ("rms_error_m", "max_error_m", "pcrb_rms_m", "bound_rms_m", "efficiency"):
            assert f" {figures[key]:.2f} " in row
