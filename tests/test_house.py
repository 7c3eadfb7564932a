"""The house as CONTRIBUTING describes it: formatted, typed, imports one way, nothing too long."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    path for package in ("obsplan", "formulations") for path in (ROOT / package).rglob("*.py")
)

MOST_STATEMENTS = 30  # of a function
MOST_NODES = 110  # of one statement
WIDEST = 100  # columns, comments and docstrings included

CHECKS = {
    "ruff-check": ["-m", "ruff", "check", "--no-cache", "."],
    "ruff-format": ["-m", "ruff", "format", "--no-cache", "--check", "."],
    "types": ["-m", "basedpyright", "--pythonpath", sys.executable],
    "imports": [
        "-c",
        "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))",
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_tool_finds_nothing(check):
    done = subprocess.run(
        [sys.executable, *check], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


WHERE = "import obsplan; print(obsplan.__file__)"
SCRIPT = """
import runpy, sys
sys.argv = [{script!r}, "--version"]
try:
    runpy.run_path({script!r}, run_name="__main__")
finally:
    import obsplan
    print(obsplan.__file__)
"""


def test_tests_in_this_process_and_in_others_run_the_same_copy(tmp_path):
    import obsplan

    script = Path(sys.executable).with_name("obsplan")
    others = {"a process of its own": WHERE}
    if script.exists():
        others["the command obsplan"] = SCRIPT.format(script=str(script))
    for who, code in others.items():
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        copy = done.stdout.splitlines()[-1]
        assert copy == obsplan.__file__, (
            f"{who} runs {copy} and the tests {obsplan.__file__}: half of the tests judge another "
            "copy; in the folder of the checkout, type: python -m pip install -e '.[test]'"
        )


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_functions_are_short_and_statements_are_not_dense(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            assert statements(node) <= MOST_STATEMENTS, node.name
        if isinstance(node, ast.Assign | ast.AugAssign | ast.Return | ast.Expr):
            assert syntax_nodes(node) <= MOST_NODES, f"line {node.lineno}"


@pytest.mark.parametrize(
    ("formula", "home"),
    [
        (r"\bsinc\(", "formulations/model/arcs.py"),
        (r"\b0\.75 \*", "formulations/model/covariance.py"),  # the range's second-order term
        (r"\bfmod\(", "formulations/model/schedule.py"),
    ],
    ids=["arc", "range update", "ping rule"],
)
def test_formula_of_the_world_is_written_in_one_file(formula, home):
    found = [path for path in MODULES if re.search(formula, path.read_text(encoding="utf-8"))]
    assert found == [ROOT / home]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_code_is_read_without_scrolling(path):
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        assert len(line) <= WIDEST, f"line {number}"


def statements(function):
    """How many statements a function holds, its docstring aside."""
    return sum(isinstance(node, ast.stmt) for node in ast.walk(function)) - 2


def syntax_nodes(statement):
    """How many syntax nodes a statement holds."""
    return sum(not isinstance(node, ast.Load | ast.Store) for node in ast.walk(statement))
