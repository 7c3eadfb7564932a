"""How far a task is: lines where there is no terminal, a bar where there is one, and a planner that tells while it plans."""

import os
import pty
import re
import subprocess
import sys
import time

import numpy as np
import pytest

from obsplan.cli import progress as module
from obsplan.cli.progress import State, progress
from obsplan.scenario import load
from obsplan.simulation import simulate

BRIEF = ["duration=30.0", "planner.starts=3"]


def test_line_says_share_time_taken_and_time_left():
    state = State("survey", began=100.0)
    assert state.line(130.0) == "survey: at work for 30 s"
    state.advance(1, 4)
    assert state.line(130.0) == "survey: 25 % after 30 s, about 90 s left"
    state.advance(1, 21, "survey, 1 failed")
    assert state.line(3700.0) == "survey, 1 failed: 5 % after 60 min, about 20.0 h left"


@pytest.mark.slow
def test_pipe_gets_a_line_every_while_and_none_before_or_after(capfd, monkeypatch):
    monkeypatch.setattr(module, "PULSE", 0.2)
    with progress("survey") as advance:
        advance(1, 2)
        time.sleep(0.1)
        assert capfd.readouterr().err == ""
        time.sleep(0.9)
    told = capfd.readouterr().err.splitlines()
    time.sleep(0.4)
    assert 1 <= len(told) <= 5
    assert all(re.fullmatch(r"survey: 50 % after [01] s, about [01] s left", line) for line in told)
    assert capfd.readouterr() == ("", "")


def test_task_that_tells_nothing_is_still_seen_to_be_at_work(capfd, monkeypatch):
    monkeypatch.setattr(module, "PULSE", 0.1)
    with progress("planning"):
        time.sleep(0.5)
    assert "planning: at work for 0 s" in capfd.readouterr().err


def test_terminal_gets_a_bar_and_names_with_brackets_are_no_markup():
    code = (
        "import time\nfrom obsplan.cli.progress import progress\n"
        "with progress('lake [red]') as advance:\n    advance(1, 2); time.sleep(0.5)"
    )
    ours, theirs = pty.openpty()
    process = subprocess.Popen([sys.executable, "-c", code], stdout=theirs, stderr=theirs)
    os.close(theirs)
    text = b""
    while True:
        try:
            text += os.read(ours, 4096)
        except OSError:  # Linux says so when the other end is closed
            break
    os.close(ours)
    assert process.wait(timeout=60) == 0
    assert "50%" in text.decode()
    assert "lake [red]" in text.decode()


@pytest.mark.slow
def test_planning_before_the_mission_is_the_first_half_of_its_progress():
    scenario = load("survey-slow", planner="whole-mission", settings=BRIEF)
    steps = scenario.time.size - 1
    told = []
    run = simulate(scenario, progress=lambda done, total: told.append(done / total))
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert (
        sum(share <= 0.5 for share in told) == 3 + 1 + 1
    )  # starts, those that go on, the best one's end
    assert 0.5 in told
    assert sum(share > 0.5 for share in told) == -(-steps // 256)
    plain = simulate(scenario)
    np.testing.assert_array_equal(run.cna, plain.cna)


def test_planner_that_does_not_plan_before_tells_of_its_steps():
    scenario = load("survey-slow", planner="circle", settings=["duration=60.0"])
    told = []
    simulate(scenario, progress=lambda *now: told.append(now))
    steps = scenario.time.size - 1
    assert told[-1] == (steps, steps)
    assert told[0] == (256, steps)


@pytest.mark.slow
def test_command_in_a_pipe_tells_of_planning(tmp_path):
    """As a user sees it in a log, with a pulse of a second instead of half a minute."""
    code = (
        "import obsplan.cli.progress as p; p.PULSE = 1.0\n"
        "import sys; from obsplan.cli import main\n"
        "sys.argv = ['obsplan', 'run', 'survey-slow', '--planner', 'whole-mission', '--set', 'planner.starts=3']\n"
        "main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    shares = [int(share) for share in re.findall(r"whole-mission: (\d+) % after", done.stderr)]
    assert shares
    assert shares == sorted(shares)
