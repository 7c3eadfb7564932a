"""README and the documentation: what they have a reader type runs as printed, and the site is built without a warning."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import pytest
import typer.testing

import formulations
import obsplan as op
from obsplan.cli import app, documentation, reports
from obsplan.planners import PLANNERS

RECORDINGS = Path(op.__file__).parent / "recordings"
ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROGRAM = [sys.executable, "-m", "obsplan"]
EXECUTED = (
    *("README.md", "docs/from-plan-to-boat.md", "docs/replay.md", "docs/campaigns.md"),
    *(
        "docs/any-model.md",
        "docs/bounds.md",
    ),  # after README and the tutorial, which have tests of their own
)
LINE = [[-122.337, 47.629], [-122.337, 47.6292], [-122.3368, 47.6292]]  # 40 m, of the user's own


def blocks(page):
    """Code of a page, each with its language."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(r"^```([^\n]*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


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


def steps(page):
    """All that a page has its reader type, in order: words of a command, or a text in Python; and what it shows of the output."""
    for language, text in blocks(page):
        if language in ("python", "py"):
            yield text
        elif language in ("", "sh") and not of_a_cluster(text):
            yield from commands(text)


def shown(page):
    """The lines of output that a page shows."""
    return [
        line for language, text in blocks(page) if language == "text" for line in text.splitlines()
    ]


def words(text):
    """Words of a line without its numbers, which may differ in their last digits."""
    return " ".join(re.findall(r"[^\W\d_]{2,}", text))


def plan(line):
    items = [{"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, lat, lon, 0]} for lon, lat in line]  # fmt: skip
    home = [line[0][1], line[0][0], 0]
    return {
        "fileType": "Plan",
        "version": 1,
        "mission": {"plannedHomePosition": home, "items": items},
    }


def follow(page, folder):
    """Do what a page says, as its reader would; what each step printed."""
    printed = {}
    for step in steps(page):
        line = [*PROGRAM, *step] if isinstance(step, list) else [sys.executable, "-c", step]
        done = subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{step}\n{done.stdout}{done.stderr}"
        printed[str(step)] = done.stdout
    return printed


@pytest.mark.slow
def test_everything_in_readme_runs_one_after_the_other_in_one_folder(tmp_path):
    (tmp_path / "mission.plan").write_text(json.dumps(plan(LINE)))
    printed = follow("README.md", tmp_path)
    (python,) = [text for language, text in blocks("README.md") if language == "python"]
    assert "turn at +1.4 rad/s, condition number 8.879" in printed[python]
    assert float(re.search(r"RMS error ([\d.]+) m", printed[python])[1]) < 5.0
    made = {path.name for path in tmp_path.iterdir()}
    assert {"harbor-survey", "mission.toml", "mission", "mission-compare", "plaza2"} < made


@pytest.mark.slow
def test_tutorial_runs_and_prints_what_it_shows(tmp_path):
    shutil.copy(DOCS / "examples" / "survey.plan", tmp_path)
    printed = "\n".join(follow("docs/from-plan-to-boat.md", tmp_path).values())
    said = {words(line) for line in printed.splitlines()}
    assert [line for line in shown("docs/from-plan-to-boat.md") if words(line) not in said] == []
    numbers = [line for line in shown("docs/from-plan-to-boat.md")[:5] if line not in printed]
    assert numbers == []  # of the plan they are exact


@pytest.mark.slow
@pytest.mark.parametrize("page", EXECUTED[2:])
def test_what_a_page_has_its_reader_type_runs(page, tmp_path):
    if page == "docs/replay.md":
        shutil.copytree(RECORDINGS / "goats16", tmp_path / "cruise")
    assert follow(page, tmp_path)


def test_steps_of_readme_are_those_that_are_printed():
    """The commands that the test above runs are what a reader sees, the two that install aside."""
    first_words = [step[0] if isinstance(step, list) else "python" for step in steps("README.md")]
    assert first_words == ["run", "new", "run", "compare", "recordings", "replay", "python"]
    assert next(steps("docs/from-plan-to-boat.md")) == ["new", "survey.plan"]
    assert sum(of_a_cluster(text) for _, text in blocks("docs/campaigns.md")) == 1


def test_no_page_shows_python_or_a_command_that_no_test_runs():
    """What is not executed says so by its language: text, toml, yaml."""
    flown = "docs/your-own.md"  # by the tests of plugins
    pages = [str(path.relative_to(ROOT)) for path in sorted(DOCS.rglob("*.md"))]
    others = [page for page in pages if page not in (*EXECUTED, flown)]
    assert [page for page in others if [*steps(page)]] == []


def test_every_planner_is_listed_in_readme():
    assert [name for name in PLANNERS if f"`{name}`" not in README] == []


def test_pictures_of_readme_exist_and_the_moving_one_is_small():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / path).stat().st_size < 2e6


def test_links_of_readme_lead_to_files():
    links = re.findall(r"\]\(([^):#]+)\)", README)
    assert len(links) > 20
    assert [link for link in links if not (ROOT / link).exists()] == []


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The documentation, built by the command that CONTRIBUTING gives, elsewhere."""
    folder = tmp_path_factory.mktemp("site") / "html"
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^python -m sphinx (.*?) +#", text, flags=re.MULTILINE)
    options = command.replace("obsplan/site/html", str(folder))
    line = [sys.executable, "-m", "sphinx", "-q", *shlex.split(options)]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
@pytest.mark.xdist_group("site")
def test_site_has_every_public_name_key_and_figure(site):
    _, _, packed = (site / "objects.inv").read_bytes().partition(b"zlib.\n")
    names = {line.split()[0] for line in zlib.decompress(packed).decode().splitlines()}
    for package in (op, formulations):
        public = {f"{package.__name__}.{name}" for name in package._HOME}
        assert public - names == set()
    keys = (site / "docs" / "reference" / "scenario.html").read_text(encoding="utf-8")
    assert "from 0.001 to 50 m/s (slower is a station, and no vessel is faster)" in keys
    for notebook in (ROOT / "notebooks").glob("*.ipynb"):
        figures = notebook.read_text(encoding="utf-8").count('"image/png"')
        page = (site / "notebooks" / f"{notebook.stem}.html").read_text(encoding="utf-8")
        pictures = re.findall(r'<img [^>]*src="([^"]+)"', page)
        assert len(pictures) == figures
        assert all((site / "notebooks" / picture).is_file() for picture in pictures)


@pytest.mark.slow
@pytest.mark.xdist_group("site")
def test_site_needs_no_network(site):
    """Whatever a page loads lies beside it, so that reading and searching work on a ship."""
    for page in site.rglob("*.html"):
        loaded = re.findall(
            r'<(?:script|img|link)\b[^>]*?(?:src|href)="([^"]+)"', page.read_text(encoding="utf-8")
        )
        assert [address for address in loaded if "//" in address] == []
    assert (site / "searchindex.js").is_file()


def test_docs_opens_the_site_where_it_is_built_and_else_says_how(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(reports.webbrowser, "open", lambda address: opened.append(address) or True)
    monkeypatch.setattr(documentation, "SITE", tmp_path / "index.html")
    failed = typer.testing.CliRunner().invoke(app, ["docs"])
    assert isinstance(failed.exception, op.ObsplanError)  # which `main` makes exit code 2
    assert "python -m sphinx" in str(failed.exception)
    (tmp_path / "index.html").write_text("")
    typer.testing.CliRunner().invoke(app, ["docs"])
    assert opened == [(tmp_path / "index.html").as_uri()]
