"""Command lines by seed: exit code 0 or 2, one line of complaint with a remedy, and nothing half-written."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from fuzz.corpus import COMMAND_LINES
from fuzz.trying import SEED, share, told


def tried(folder, *given: int) -> Counter[str]:
    """What becomes of command lines, in one process of their own: a crash ends no other test."""
    line = [sys.executable, "-m", "fuzz.command_line_trials", str(folder), *map(str, given)]
    ran = subprocess.run(line, cwd=Path(__file__).parents[1], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return Counter(json.loads(ran.stdout))


@pytest.mark.slow
def test_past_failures_of_command_lines_are_refused(tmp_path):
    assert tried(tmp_path) == {"exit 2": len(COMMAND_LINES)}


@pytest.mark.slow
def test_command_lines_end_in_order_and_leave_no_halves(tmp_path):
    outcomes = tried(tmp_path, SEED, share(100))
    known = {"exit 0", "exit 2", "exit 3", "too long to fly"}
    assert told("command lines", outcomes, known) == []
