"""Nothing that is given wrongly ends in a traceback: a few of each kind in every test run, any number by hand.

`OBSPLAN_FUZZ=10000 python -m pytest tests/fuzz -s` tries so many, and prints what became of them.
"""

import os
from collections import Counter

from fuzz.missions import missions
from fuzz.scenarios import extremes, scenarios, toml_file

import obsplan as op
from obsplan.scenario.account import write_new

COUNT = int(os.environ.get("OBSPLAN_FUZZ", "60"))
SEED = int(os.environ.get("OBSPLAN_FUZZ_SEED", "1"))


def test_mutated_scenarios_load_or_are_refused_in_one_sentence(tmp_path):
    (tmp_path / "pond.csv").write_text("x,y\n0,0\n30,0\n30,10\n")
    file = tmp_path / "s.toml"
    outcomes: Counter[str] = Counter()
    for data in (*scenarios(SEED, COUNT), *extremes(SEED, COUNT)):
        file.write_text(toml_file(data), encoding="utf-8")
        outcomes[outcome(lambda: op.load(file))] += 1
    print(outcomes)  # noqa: T201 - asked for
    assert {*outcomes} <= {"taken", "refused"}


def test_mutated_missions_are_read_or_refused_in_one_sentence(tmp_path):
    outcomes: Counter[str] = Counter()
    for suffix, content in missions(SEED, COUNT):
        file, made = tmp_path / f"m{suffix}", tmp_path / "m.toml"
        file.write_bytes(content)
        outcomes[outcome(lambda file=file, made=made: write_new(file, made))] += 1
        made.unlink(missing_ok=True)
    print(outcomes)  # noqa: T201 - asked for
    assert {*outcomes} <= {"taken", "refused"}


def outcome(attempt) -> str:
    """Whether an attempt succeeds or is refused in a line."""
    try:
        attempt()
    except op.ObsplanError as error:
        return "refused" if "\n" not in str(error) else f"refused in several lines: {error}"
    return "taken"
