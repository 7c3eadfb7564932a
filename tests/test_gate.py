"""What a user may give: every number within a physical range, every text printable, all of it said in one sentence."""

import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsplan as op
from obsplan.cli.terminal import complain, say
from obsplan.quantities import DISTANCE, LEGS, TURN_ACCELERATION, WHOLE, check_quantities
from obsplan.report import planner_notes, verdicts
from obsplan.report.style import png
from obsplan.scenario.contents import DEEPEST, parse_toml
from obsplan.scenario.schema import json_schema
from obsplan.scenario.understood import understand
from obsplan.spelling import inert, visible

AUV = {"speed": 1.0, "survey": {"kind": "lawnmower", "legs": 2, "length": 40.0, "spacing": 10.0}}
POND: dict[str, Any] = {
    "duration": 12.0,
    "origin": {"lat": 47.6, "lon": -122.3},
    "cna": {"speed": 2.0, "min_turn_radius": 5.0, "start": {"y": -10.0}},
    "auv": [AUV],
    "ranging": {"interval": 2.0},
    "planner": {"kind": "circle"},
}
BOUNDS = ({"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"})
# whose numbers `check_metres` holds to the map, all at once
CORNERS = ("points", "geofence", "center")


def unbounded(
    node: Any, definitions: dict[str, Any], path: str = "", ends: frozenset[str] = frozenset()
) -> Iterator[str]:
    """Keys of a JSON Schema whose numbers have no end on one side."""
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        node = definitions[name]
    ends |= node.keys()
    if node.get("type") in ("number", "integer") and not all(side & ends for side in BOUNDS):
        yield path
    for part in (*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("prefixItems", ())):
        yield from unbounded(part, definitions, path, ends)
    if isinstance(node.get("items"), dict):
        yield from unbounded(node["items"], definitions, f"{path}[]", ends)
    for key, below in node.get("properties", {}).items():
        if key not in CORNERS:
            yield from unbounded(below, definitions, f"{path}.{key}")


def test_every_number_of_a_scenario_has_both_ends():
    schema = json_schema()
    assert [*unbounded(schema, schema["$defs"])] == []


def test_a_number_without_an_end_is_found():
    assert [*unbounded({"properties": {"a": {"type": "number", "minimum": 0}}}, {})] == [".a"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"seed": 2**63}, "seed = 9223372036854775808 .* must be from 0 to 9007199254740991 "),
        ({"seed": 10**400}, r"seed = 1000*\.\.\. .* must be from 0 to "),
        (
            {"cna__speed": 300.0},
            r"cna.*speed = 300.0 .* from 0.001 to 50 m/s \(.*no vessel is faster\): correct it",
        ),
        ({"cna__speed": 10**400}, "cna.*speed = 1.* must be a number from 0.001 to 50 m/s"),
        (
            {"cna__start__x": -1e308},
            "cna.*start.*x = -1e\\+308 .* must be from -100000 to 100000 m",
        ),
        ({"duration": 1e-10}, "duration = 1e-10 .* must be from 0.001 to 2678400 s"),
        ({"duration": 0.1}, "duration: 0.1 s is shorter than a step of 0.5 s"),
        ({"ranging__interval": 1e308}, "interval = 1e\\+308 .* to 86400 s"),
        (
            {"ranging__sigma": 1e-300},
            r"sigma = 1e-300 .*no acoustic range is better than a millimetre",
        ),
        ({"auv__0__survey__legs": 10**9}, "legs = 1000000000 .* must be from 1 to 10000"),
        ({"auv__0__speed": 1e-4}, "speed of a survey that moves must be from 0.001 m/s"),
        ({"planner": {"kind": "trajectory", "horizon": 1e308}}, "horizon = 1e\\+308 .* to 86400 s"),
        (
            {"planner": {"kind": "gramian", "turn_rates": 2**63 - 1}},
            "turn_rates = 9223372036854775807 .* must be from 2 to 1001",
        ),
        (
            {"environment__current": [5.0, 0.0]},
            r"current = \[5.0, 0.0\] m/s is too strong for the aid vehicle, cna.*speed = 2.0 m/s",
        ),
        ({"auv": [AUV] * 101}, "101 AUVs are more than the 100"),
        ({"time_step": 0.001, "duration": 2.6e6}, "2600000000 steps of 2600000 s, about 5980 GB"),
        (
            {
                "planner": {"kind": "information", "turn_rates": 201, "beam_width": 10_000},
                "auv": [AUV] * 9,
            },
            "turn_rates = 201 and .* 4 GB",
        ),
        (
            {"auv__0__name": "a\rb"},
            r"auv__0__name = \"a\\rb\" has a character that cannot be printed",
        ),
        ({"auv__0__name": "x" * 1001}, "has 1001 letters"),
        ({"auv__0__name": "x" * 121}, "name = .* is too long: shorten it"),
        ({"description": [[[[[[[[[[[[[[[[[1.0]]]]]]]]]]]]]]]]]}, "nested more than 16 deep"),
    ],
)
def test_what_cannot_be_flown_is_refused_before_anything_is_made(changes, words):
    with pytest.raises(op.ObsplanError, match=words) as caught:
        op.from_dict(POND).replace(**changes)
    assert "\n" not in str(caught.value)


def test_day_at_ten_hertz_with_four_auvs_is_taken():
    auvs = [{**AUV, "name": name} for name in "abcd"]
    day = op.from_dict(POND).replace(duration=86400.0, time_step=0.1, auv=auvs)
    assert day.time.size == 864001


@pytest.mark.parametrize("brackets", ["[]", "{}"])
def test_toml_too_deep_for_the_parser_names_line_and_key(brackets):
    opening = "[" if brackets == "[]" else "{x = "
    with pytest.raises(ValueError, match=f"line 2: b is nested more than {DEEPEST} deep"):
        parse_toml(f"a = 1\nb = {opening * 900}{brackets[1] * 900}\n")


def test_an_integer_of_thousands_of_digits_reaches_the_check_of_its_key():
    assert parse_toml(f"seed = {'7' * 5000}")["seed"] == int("7" * 400)


def test_a_class_made_from_code_passes_the_same_gate():
    with pytest.raises(ValueError, match=r"legs must be from 1 to 10000 \(.*\), got 1000000000"):
        op.Lawnmower(legs=10**9, length=1.0, spacing=1.0)
    check_quantities(op.Lawnmower(legs=10_000, length=1.0, spacing=1.0))
    assert math.nan not in LEGS


@pytest.mark.parametrize("number", [np.int64(3), np.float32(3.0), np.float64(3.0)])
def test_numbers_of_numpy_are_numbers(number):
    assert LEGS.check(number) is number
    with pytest.raises(ValueError, match="must be from 1 to 10000"):
        LEGS.check(number - 3)


@pytest.mark.parametrize(
    ("quantity", "words"),
    [
        (WHOLE, "from -9007199254740991 to 9007199254740991 ("),
        (TURN_ACCELERATION, "from 0.000001 to 100 rad/s^2 ("),
        (DISTANCE, "from 0 to 100000 m ("),
    ],
)
def test_a_range_is_written_as_people_write_numbers(quantity, words):
    assert str(quantity).startswith(words)


@pytest.fixture(scope="module")
def unmeasured():
    return op.simulate(op.from_dict(POND).replace(ranging__interval=100.0))


def test_no_efficiency_is_claimed_where_not_one_range_was_measured(unmeasured):
    (sentence,) = verdicts(unmeasured)
    assert "not one range was measured (ranging.interval = 100 s, in a mission of 12 s)" in sentence
    assert "efficiency" not in sentence
    assert "known" not in sentence
    figures = unmeasured.summary()
    assert figures["all"]["efficiency"] is figures["all"]["bound_rms_m"] is None
    assert "not one range" in figures["unbounded"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ranging__sigma": 1e4}, "its ranges told next to nothing"),
        ({"auv__0__first_estimate__sigma_position": 99e3}, "position not known, "),
        (
            {"auv__0__first_estimate__sigma_position": 1e3, "duration": 300.0},
            "position found late, to 0.",
        ),
        ({"cna__start__x": 9000.0, "planner": "stationary"}, "never nearer than 89"),
    ],
)
def test_verdict_boasts_of_nothing_that_was_not_learnt(changes, words):
    (sentence,) = verdicts(op.simulate(op.from_dict(POND).replace(**changes)))
    assert words in sentence
    assert "efficiency 100 %" not in sentence


def test_what_a_strong_current_takes_for_granted_is_said():
    changes = {
        "environment__current": [1.0, 0.0],
        "auv__0__survey": {"kind": "static"},
        "auv__0__speed": 0.5,
    }
    notes = planner_notes(op.simulate(op.from_dict(POND).replace(**changes)))
    assert any(
        "against the current of 1 m/s that takes up to 3 m/s through the water" in note
        for note in notes
    )
    assert any("auv-1 keeps station in a current of 1 m/s" in note for note in notes)


def test_decisions_that_are_all_substitutes_are_no_proof_of_a_planner(unmeasured):
    infeasible = replace(
        unmeasured,
        status=np.where(np.isnan(unmeasured.status), np.nan, float(op.Status.INFEASIBLE)),
    )
    assert any(
        "Not one of its 12 decisions is what circle was asked for" in note
        for note in planner_notes(infeasible)
    )
    assert not any("Not one of its" in note for note in planner_notes(unmeasured))


@pytest.mark.parametrize("cell", ["=1+1", "+1", "-x", "@a", "\t=x", "\r=x", "\n=x"])
def test_no_cell_is_a_formula(cell):
    assert inert(cell) == f"'{cell}"


def test_cells_that_are_no_text_and_plain_names_stay():
    assert [inert(cell) for cell in ("a=1", "alpha", -1.5, None)] == ["a=1", "alpha", -1.5, None]


def test_nothing_that_a_terminal_acts_on_is_printed(monkeypatch):
    printed = []
    monkeypatch.setattr(
        "obsplan.cli.terminal.put", lambda text, stream=None: printed.append((text, stream))
    )
    say("a\x1b[31mb\rc\u202ed")
    complain("x\x07y\nz" + "long " * 1000)
    (out, _), (err, stream) = printed
    assert out == "a\\x1b[31mb\\rc\\u202ed\n"
    assert err.startswith("obsplan: x\\x07y z")
    assert err.count("\n") == 1
    assert len(err) < 900
    assert stream is sys.stderr
    assert visible("Ä\u00a0→") == "Ä\u00a0→"


def test_a_figure_that_numbers_make_impossible_is_a_figure_that_says_so(caplog):
    def draw():
        raise OverflowError("too large")

    assert png(draw).startswith(b"\x89PNG")
    assert "This figure cannot be drawn: " in caplog.text
    assert "OverflowError: too large" in caplog.text
    caplog.clear()
    with pytest.raises(TypeError):  # a fault of ours is no number's
        png(lambda: 1 + None)  # pyright: ignore[reportOperatorIssue]


@pytest.mark.parametrize(
    ("last", "said"), [("47.60100,-122.", "makes a leg of 22.6 km"), ("47.60100,-122.3", None)]
)
def test_a_last_line_that_is_cut_short_is_refused_or_remarked_on(tmp_path, last, said):
    path = tmp_path / "cut.csv"
    path.write_text(f"lat,lon\n47.60000,-122.30000\n47.60050,-122.30000\n{last}")
    if said:
        with pytest.raises(op.ObsplanError, match=said):
            understand(path)
    else:
        remarks = understand(path).remarks
        assert remarks == ("line 4, the last, has no end, and its -122.3 may be cut short",)


def test_two_points_without_a_last_line_break_are_not_judged_by_legs_that_are_not_there(tmp_path):
    path = tmp_path / "two.csv"
    path.write_text("lat,lon\n47.60000,-122.30000\n47.60000,-122.1")
    assert "may be cut short" in understand(path).remarks[0]
