"""README: its Python runs as printed, and what it names exists."""

import re
from pathlib import Path

import pytest

from obsplan.planners import PLANNERS

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_python_of_readme_runs_as_printed(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert "turn at +1.4 rad/s, condition number 8.879" in printed
    assert float(re.search(r"RMS error ([\d.]+) m", printed)[1]) < 5.0


def test_every_planner_is_listed_in_readme():
    assert [name for name in PLANNERS if f"`{name}`" not in README] == []


def test_pictures_of_readme_exist():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (Path(__file__).parents[1] / path).exists()
