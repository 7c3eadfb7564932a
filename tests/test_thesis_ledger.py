"""The thesis's ledger names files, functions, items and tests that are there, and every item."""

import re
from pathlib import Path

from obsplan.thesis import ITEMS

ROOT = Path(__file__).parents[1]
QUOTED = re.findall(r"`([^`]+)`", (ROOT / "docs" / "thesis-ledger.md").read_text())


def test_every_test_of_the_ledger_is_there():
    sources = "".join(path.read_text() for path in (ROOT / "tests").glob("test_*.py"))
    named = {word for word in QUOTED if re.fullmatch(r"test_\w+", word)}
    assert len(named) > 60
    assert named <= set(re.findall(r"^def (test_\w+)", sources, flags=re.MULTILINE))


def test_every_place_of_the_ledger_is_there():
    places = [word.partition(":") for word in QUOTED if re.match(r"(obsplan|formulations)/", word)]
    assert len(places) > 60
    for file, _, name in places:
        defined = rf"^(def|class) {name}\b|^{name}(:.*)? = " if name else ""
        assert re.search(defined, (ROOT / file).read_text(), flags=re.MULTILINE), (file, name)


def test_every_study_of_the_ledger_is_an_item_and_every_figure_has_a_row():
    text = (ROOT / "docs" / "thesis-ledger.md").read_text()
    assert {word for word in QUOTED if word.startswith("study-")} == {
        name for name in ITEMS if name.startswith("study-")
    }
    figures = [name.removeprefix("fig") for name in ITEMS if name.startswith("fig")]
    assert len(figures) == 23
    assert all(re.search(rf"\b{re.escape(number)}\b", text) for number in figures)
