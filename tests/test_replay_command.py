"""The commands ``replay`` and ``recordings``, with estimator and smoother of the test's own."""

import json
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from replays import replayed
from typer.testing import CliRunner

import obsplan.replay
from obsplan.cli import app
from obsplan.fates import Fate
from obsplan.replay import Discarded
from obsplan.scenario import Scenario
from obsplan.tape import Tape
from obsplan.types import ObsplanError


@pytest.fixture(scope="module")
def mission():
    return replayed()


@pytest.fixture
def command(mission, monkeypatch, tmp_path):
    """The program where ``field`` is a recording of the mission; what it is asked is kept."""
    asked = SimpleNamespace(start=None, per_beacon=None)
    lost = Discarded(2.0, "a", "whale", 9.0, Fate.UNKNOWN_BEACON, "no place is known")
    recording = Recorded(mission.tape, mission.simulated.scenario, (lost,))

    def read(path):
        if path.name != "field":
            raise ObsplanError(f"{path} is no recording: give another")
        return recording

    def smooth(_tape, _scenario, *, start):
        asked.start = start
        return mission.smoothed

    def calibrate(tape, _scenario, *, per_beacon):
        asked.per_beacon = per_beacon
        return SimpleNamespace(tape=tape, words=("scale +0.07 ± 0.01",))

    for name, contents in (
        ("obsplan.replay.estimate", {"estimate": lambda *_: mission.estimates}),
        ("obsplan.smoothing", {"smooth": smooth, "calibrate": calibrate}),
    ):
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(obsplan.replay, "read", read, raising=False)
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        return CliRunner().invoke(app, [*arguments], env={"COLUMNS": "200"})

    return SimpleNamespace(run=run, asked=asked, folder=tmp_path)


@dataclass(frozen=True)
class Recorded:
    tape: Tape
    scenario: Scenario
    discarded: tuple
    notes: tuple = ("headings are 0.3 rad off.",)
    start: datetime = datetime(2025, 6, 1, tzinfo=UTC)


def test_replay_writes_the_files_of_a_run_and_says_what_became_of_ranges(command, mission):
    done = command.run("replay", "field", "--no-bound")
    assert done.exit_code == 0, done.output
    assert "Headings are 0.3 rad off." in done.output
    assert "a: position known to " in done.output
    assert "of 31 ranges 1 was rejected (1 unknown beacon)" in done.output
    np.testing.assert_array_equal(command.asked.start, mission.estimates.mean)
    written = command.folder / "trial"
    assert (written / "nis.png").exists()
    last = (written / "ranges.csv").read_text().splitlines()[-1]
    assert last.startswith("2.000000,2025-06-01T00:00:02.000000Z,,a,whale,9.000000,m,")
    assert last.endswith(",unknown beacon")
    summary = json.loads((written / "summary.json").read_text())
    assert summary["source"] == "replay"
    assert summary["began"] == "2025-06-01T00:00:00+00:00"


def test_calibration_and_keys_of_the_scenario_are_asked_for_and_told(command):
    done = command.run(
        *("replay", "field", "--no-bound", "--calibrate", "each", "--set", "ranging.sigma=2.5"),
        *("--set", "estimator.motion=commanded"),
    )
    assert "A recording has only the motion that vehicles measured" in done.output
    assert "Calibrated: scale +0.07 ± 0.01." in done.output
    assert command.asked.per_beacon is True
    assert "sigma = 2.5" in (command.folder / "trial" / "scenario.toml").read_text()


def test_what_cannot_be_read_is_refused_and_nothing_is_written(command):
    done = command.run("replay", "nowhere")
    assert isinstance(done.exception, ObsplanError)
    assert not [*command.folder.iterdir()]


def test_shipped_recordings_are_listed():
    assert CliRunner().invoke(app, ["recordings"]).exit_code == 0
