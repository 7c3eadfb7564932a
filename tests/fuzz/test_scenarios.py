"""Scenarios by seed: each is refused in one sentence or loaded, and flown to its words where it is short."""

import re
from collections import Counter

import pytest
from fuzz.corpus import SCENARIOS
from fuzz.scenarios import extremes, scenarios, toml_file
from fuzz.trying import SEED, fault_of_form, outcome, share, told

import obsplan as op
from obsplan.report import limit_notes, planner_notes, run_table, verdicts
from obsplan.types import UNCOMPUTABLE

SHORT = 12.0  # seconds that are flown of a mission
MOST_STEPS = 2000  # times AUVs, of a mission that is flown
SLOW = ("trajectory", "whole-mission", "rolling")  # planners that take seconds
TABLES = "auv|cna|constraints|description|duration|environment|estimator|export|name|origin|planner|ranging|seed|time_step"
PLACE = re.compile(
    rf"s\.toml: (?:(?:{TABLES})\b|unknown key |the file\b|line \d+|.+ has a character that|.+ is nested|.+ has \d+ letters)"
)
VALUE = re.compile(r" = .|\bgot |[\d\"]|missing|unknown key|nested|\[")


@pytest.fixture
def file(tmp_path):
    """Where a scenario is written, and a mission file beside it."""
    (tmp_path / "pond.csv").write_text("x,y\n0,0\n30,0\n30,10\n")
    return tmp_path / "s.toml"


def fault_of_refusal(said: str) -> str | None:
    """What a refusal of a scenario lacks: its form, the file, the key, or the value."""
    if "s.toml" not in said:
        return "without the file"
    if not PLACE.search(said):
        return "without a key"
    if not VALUE.search(said):
        return "without a value"
    return fault_of_form(said)


@pytest.mark.parametrize("name", SCENARIOS)
def test_past_failures_of_scenarios_are_refused(name, file):
    file.write_text(SCENARIOS[name], encoding="utf-8")
    assert outcome(lambda: op.load(file), fault_of_refusal) == "refused"


@pytest.mark.slow
def test_mutated_scenarios_load_or_are_refused_by_key_value_and_remedy(file):
    outcomes: Counter[str] = Counter()
    for data in scenarios(SEED, share(1000)):
        file.write_text(toml_file(data), encoding="utf-8")
        outcomes[outcome(lambda: op.load(file), fault_of_refusal)] += 1
    assert told("scenarios", outcomes, {"taken", "refused"}) == []


@pytest.mark.slow
def test_extreme_scenarios_that_load_are_flown_to_their_words(file):
    outcomes: Counter[str] = Counter()
    for data in extremes(SEED, share(100)):
        file.write_text(toml_file(data), encoding="utf-8")
        outcomes[outcome(lambda: flown(op.load(file)), fault_of_form)] += 1
    known = {"refused", "flown", "too long to fly", "not computable"}
    assert told("extremes", outcomes, known) == []


def flown(scenario: op.Scenario) -> str:
    """Fly the beginning of a mission and make all of its words."""
    duration = min(float(scenario.time[-1]), SHORT)
    planner = "stationary" if scenario.table.planner.kind in SLOW else None
    brief = scenario.replace(duration=duration, planner=planner)
    if brief.time.size * len(brief.table.auv) > MOST_STEPS:
        return "too long to fly"
    try:
        run = op.simulate(brief)
        sentences = (*verdicts(run), *limit_notes(run), *planner_notes(run))
        run_table(run)
    except UNCOMPUTABLE:  # which the command line says in a sentence
        return "not computable"
    assert all("\n" not in sentence for sentence in sentences)
    return "flown"
