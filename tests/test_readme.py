"""README: its commands and its Python run as printed, one after the other in one folder, and what it names exists."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from obsplan.planners import PLANNERS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", README, flags=re.DOTALL)
PROGRAM = [sys.executable, "-m", "obsplan"]
LINE = [[-122.337, 47.629], [-122.337, 47.6292], [-122.3368, 47.6292]]  # 40 m, of the user's own


def of_a_cluster(text):
    """Whether a block is typed on several hosts: its lines begin with a host's prompt."""
    return re.search(r"^\w+\$ ", text, flags=re.MULTILINE) is not None


def commands(text):
    """`obsplan ...` of a block of shell, as lists of words; with one seed each, on which nothing printed depends."""
    whole = text.replace("\\\n", " ")
    parts = (part for line in whole.splitlines() for part in line.split(" && "))
    lines = (shlex.split(part, comments=True) for part in parts)
    named = [words for words in lines if words and Path(words[0]).name == "obsplan"]
    for words in named:
        if "--runs" in words:
            words[words.index("--runs") + 1] = "1"
    return [words[1:] for words in named]


def steps():
    """All that README has its reader type, in order: words of a command, or a text in Python."""
    for language, text in BLOCKS:
        if language in ("python", "py"):
            yield text
        elif language in ("", "sh") and not of_a_cluster(text):
            yield from commands(text)


def plan(line):
    items = [{"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, lat, lon, 0]} for lon, lat in line]  # fmt: skip
    home = [line[0][1], line[0][0], 0]
    return {
        "fileType": "Plan",
        "version": 1,
        "mission": {"plannedHomePosition": home, "items": items},
    }


@pytest.mark.slow
def test_everything_in_readme_runs_one_after_the_other_in_one_folder(tmp_path):
    (tmp_path / "mission.plan").write_text(json.dumps(plan(LINE)))
    printed = {}
    for step in steps():
        line = [*PROGRAM, *step] if isinstance(step, list) else [sys.executable, "-c", step]
        done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{step}\n{done.stdout}{done.stderr}"
        printed[str(step)] = done.stdout
    (python,) = [text for language, text in BLOCKS if language == "python"]
    assert "turn at +1.4 rad/s, condition number 8.879" in printed[python]
    assert float(re.search(r"RMS error ([\d.]+) m", printed[python])[1]) < 5.0
    made = {path.name for path in tmp_path.iterdir()}
    assert {"harbor-survey", "mission.toml", "mission", "mission-2", "mission-compare"} < made
    assert (tmp_path / "speeds" / "report" / "pairs.csv").exists()


def test_steps_of_readme_are_those_that_are_printed():
    """The commands that the test above runs are what a reader sees, the two that install, and a cluster's, aside."""
    first_words = [step[0] if isinstance(step, list) else "python" for step in steps()]
    own = ["recordings", "replay", "new", "run", "run", "compare"]
    assert first_words == ["run", *own, "python", "python", "campaign", "campaign-report", "python"]
    assert sum(of_a_cluster(text) for _, text in BLOCKS) == 1


def test_every_planner_is_listed_in_readme():
    assert [name for name in PLANNERS if f"`{name}`" not in README] == []


def test_pictures_of_readme_exist():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / path).exists()
