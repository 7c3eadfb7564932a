"""What is printed: tables whose numbers are whole at any width, sentences wrapped, letters that any encoding has, a reader who leaves."""

import io
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from rich.console import Console
from rich.table import Table
from rich.text import Text
from test_campaign_report import table_of
from test_suite import table as suite_missions

from obsplan.campaign.statistics import medians
from obsplan.campaign.suite import read_suite
from obsplan.cli.terminal import ENDLESS, fitted, open_door, say_next, wrapped
from obsplan.report import campaign_table, compare_table, run_table, scenario_table, suite_table
from obsplan.scenario import load
from obsplan.simulation import simulate

WIDTHS = (40, 60, 80, 120, 160)
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def comparison():
    rng = np.random.default_rng(1)
    figures = ("rms_error_m", "max_error_m", "separation_mean_m")
    return compare_table(
        [
            {"planner": planner, "seed": seed, **dict(zip(figures, rng.uniform(1, 900, 3), strict=True))}
            for planner in ("information", "error-ellipse", "stationary")
            for seed in range(5)
        ]
    )  # fmt: skip


def campaign():
    rng = np.random.default_rng(2)
    cells = [("survey-slow", p, s, v) for p in ("path-inertia", "circle") for s in (1, 20) for v in (1.25, 2)]  # fmt: skip
    return campaign_table(
        medians(
            table_of(
                {cell: list(rng.uniform(1, 9, 12)) for cell in cells},
                keys=("ranging.sigma", "cna.speed"),
            )
        )
    )


def suite():
    noise = np.linspace(0.9, 1.1, 20)
    cells = {("narrow-geofence", "information"): noise, ("narrow-geofence", "error-ellipse"): 2 * noise}  # fmt: skip
    return read_suite(
        suite_missions(cells), {"narrow-geofence": 0.25}, {"information": 1.25, "error-ellipse": 2}
    )


def one_run():
    return run_table(simulate(load("fixed-formation", planner="circle")))


TABLES = {
    "run": one_run,
    "compare": comparison,
    "campaign": campaign,
    "suite": lambda: suite_table(suite()),
    "scenarios": lambda: scenario_table(suite()),
}


@pytest.fixture(scope="module", params=TABLES)
def table(request):
    return TABLES[request.param]()


def printed(table, width):
    console = Console(width=width, file=io.StringIO())
    for part in fitted(table, console):
        console.print(part)
    return console.file.getvalue()


@pytest.mark.parametrize("width", WIDTHS)
def test_every_number_of_a_table_is_printed_whole_at_any_width(table, width):
    text = printed(table, width)
    for line in text.splitlines():
        assert len(line) <= width
    assert "…" not in text
    whole = NUMBER.findall(printed(table, ENDLESS))
    there = NUMBER.findall(text)
    assert {n: there.count(n) for n in whole} == {n: max(whole.count(n), there.count(n)) for n in whole}  # fmt: skip


def test_wide_terminal_gets_the_table_as_it_is(table):
    assert fitted(table, Console(width=ENDLESS)) == [table]


def test_table_without_this_care_hides_numbers(table):
    console = Console(width=40, file=io.StringIO())
    console.print(table)
    assert "…" in console.file.getvalue()


def test_each_part_of_a_table_has_the_labels_of_its_rows():
    table = Table("Scenario", "Planner")
    for heading in ("RMS error [m]", "Worst error [m]", "Mean separation [m]"):
        table.add_column(Text(heading), justify="right")
    table.add_row("lake", "circle", "1.0", "2.0", "3.0")
    text = printed(table, 30)
    assert text.count("lake") == text.count("circle") > 1
    for word in ("RMS", "Worst", "separation", "1.0", "2.0", "3.0"):
        assert text.count(word) == 1


def test_sentences_are_wrapped_at_blanks_only(monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    path = "a/very/long/path/that-has-hyphens/and-no-blanks.toml"
    text = f"Written to {path}: so that it can be pasted, whatever the width."
    lines = wrapped(text, indent=2).splitlines()
    assert " ".join(line.strip() for line in lines) == text
    assert [line for line in lines if len(line) > 30] == [f"  {path}:"]
    assert all(line.startswith("  ") for line in lines[1:])


def test_next_command_is_quoted_for_the_shell(capsys, tmp_path):
    name = "it's mine & yours $HOME.toml"
    say_next("run", name)
    line = capsys.readouterr().out.removeprefix("Next: ").strip()
    echoed = subprocess.run(
        ["sh", "-c", f'obsplan() {{ printf "%s\\n" "$@"; }}; {line}'],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert echoed.stdout.splitlines() == ["run", name]


@pytest.mark.parametrize(
    ("encoding", "expected"),
    [
        ("ascii", b"Cramer-Rao 3-5 ? Zurich ?"),
        ("cp1251", "Cramer–Rao 3–5 ? Zurich ж".encode("cp1251")),
        ("cp932", "Cramer-Rao 3-5 σ Zurich ж".encode("cp932")),
        ("utf-8", "Cramér–Rao 3–5 σ Zürich ж".encode()),
    ],
)
def test_letters_that_an_encoding_lacks_are_replaced(monkeypatch, encoding, expected):
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding=encoding))
    open_door()
    sys.stdout.write("Cramér–Rao 3–5 σ Zürich ж")
    sys.stdout.flush()
    assert raw.getvalue() == expected


def test_program_goes_on_when_its_reader_has_gone():
    """Unlike `print`, which raises, and Python itself, which ends with 120 because it cannot flush."""
    code = "from obsplan.cli.terminal import say\nfor _ in range(50_000): say('more')\nprint('end'); import sys; sys.exit(3)"
    reader, writer = os.pipe()
    process = subprocess.Popen([sys.executable, "-c", code], stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert os.read(reader, 4) == b"more"
    os.close(reader)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (3, b"")


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no full disk to write to")
@pytest.mark.parametrize("words", [["schema"], ["run", "--help"], ["--help"]])
def test_full_disk_under_standard_output_is_one_sentence(tmp_path, words):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "obsplan", *words],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            cwd=tmp_path,
        )
    assert done.returncode == 2
    assert done.stderr.startswith("obsplan: what is printed cannot be written (No space left")
    assert done.stderr.count("\n") == 1
