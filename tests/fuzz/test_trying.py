"""The judges of the suite find what is wrong: bad sentences, hangs and crashes."""

import pytest
from fuzz import trying
from fuzz.test_mission_files import fault_of_refusal as fault_of_mission
from fuzz.test_scenarios import fault_of_refusal as fault_of_scenario
from fuzz.trying import fault_of_form, outcome

import obsplan as op

GOOD = "s.toml: cna.speed = -1.0 (cruising speed [m/s]): must be from 0.001 to 50 m/s: correct it"


@pytest.mark.parametrize(
    ("said", "fault"),
    [
        (GOOD, None),
        (GOOD.replace(": correct it", ""), "without a remedy"),
        (GOOD.replace("s.toml: ", ""), "without the file"),
        (GOOD.replace("cna.speed", "the value"), "without a key"),
        (GOOD.replace("must", "\nmust"), "in several lines"),
        (GOOD.replace("must", "ValueError: must"), "in a programmer's words"),
        ("s.toml: name is wrong; correct it", "without a value"),
    ],
)
def test_what_a_refusal_of_a_scenario_lacks_is_told(said, fault):
    assert fault_of_scenario(said) == fault


@pytest.mark.parametrize(
    ("said", "fault"),
    [
        ("m.csv: line 2, column 'x', must be a number, got 'a': correct it", None),
        ("m.csv: must be a number, got 'a': correct it", "without a place"),
        ("line 2 must be a number, got 'a': correct it", "without the file"),
        ("m.csv: line 2 must be a number, got 'a'", "without a remedy"),
    ],
)
def test_what_a_refusal_of_a_mission_lacks_is_told(said, fault):
    assert fault_of_mission(said) == fault


def test_a_hang_is_ended_and_a_crash_is_named(monkeypatch):
    def hang():
        while True:
            pass

    def crash():
        raise KeyError("x")

    def refuse():
        raise op.ObsplanError("no")

    monkeypatch.setattr(trying, "PATIENCE", 0.1)
    became = [outcome(attempt, fault_of_form) for attempt in (hang, crash, refuse, str)]
    assert became == ["hung", "raised KeyError('x')", "refused without a remedy: no", ""]
