"""Mission files by seed, of every format: each is refused in one sentence, or a scenario is written that loads."""

import re
from collections import Counter

import pytest
from fuzz.corpus import MISSIONS
from fuzz.missions import missions
from fuzz.trying import SEED, fault_of_form, outcome, share, told

import obsplan as op
from obsplan.scenario.account import write_new

PLACE = re.compile(
    r"line \d+|column|point|track|route|placemark|features?\b|items?\b|geoFence|rallyPoints|mission\b|position|version"
)


@pytest.fixture
def place(tmp_path):
    """A folder with nothing in it."""
    (tmp_path / "here").mkdir()
    return tmp_path / "here"


def attempt(place, suffix: str, content: bytes) -> str:
    """What becomes of a mission file; nothing but its scenario may be written, and only whole."""
    file, made = place / f"m{suffix}", place / "made.toml"
    file.write_bytes(content)
    became = outcome(lambda: write_new(file, made), fault_of_refusal)
    if became == "taken":
        became = outcome(lambda: op.load(made), lambda _: "by the scenario that was written")
    elif made.exists():
        became = f"{became}, half-written"
    made.unlink(missing_ok=True)
    file.unlink()
    left = [path.name for path in place.iterdir()]
    return f"{became}, left {left}" if left else became


def fault_of_refusal(said: str) -> str | None:
    """What a refusal of a mission lacks: its form, the file, or the place of the value it shows."""
    file = re.search(r"\bm\.\w+", said)
    if file is None:
        return "without the file"
    if "got" in said and not PLACE.search(said[file.end() :]):
        return "without a place"
    return fault_of_form(said)


@pytest.mark.parametrize("name", MISSIONS)
def test_past_failures_of_missions_are_refused(name, place):
    suffix, text = MISSIONS[name]
    assert attempt(place, suffix, text.encode()) == "refused"


@pytest.mark.slow
def test_mutated_missions_are_read_or_refused_by_file_place_and_remedy(place):
    outcomes: Counter[str] = Counter()
    for suffix, content in missions(SEED, share(500)):
        outcomes[attempt(place, suffix, content)] += 1
    assert told("missions", outcomes, {"taken", "refused"}) == []
