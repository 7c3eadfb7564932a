"""The suite of scenarios, and what is said of planners on it."""

import io
import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from obsplan.campaign.suite import decision_time, least_error, missions_of, read_suite
from obsplan.report.suite import (
    scenario_table,
    suite_figure,
    suite_sentences,
    suite_table,
    write_suite,
)
from obsplan.scenario import SUITES, all_shipped, load, shipped, suite
from obsplan.scenario.files import find
from obsplan.types import ObsplanError


def table(errors):
    """A campaign's table from errors by (scenario, planner), one a seed."""
    rows = [
        {
            "scenario": s,
            "planner": p,
            "seed": k,
            "status": "done",
            "rms_error_m": e,
            "pcrb_rms_m": e / 2,
            "violation_max_m": np.nan,
        }
        | dict.fromkeys(("max_error_m", "mean_nees", "separation_mean_m", "separation_max_m"), 1.0)
        | {"rms_error_late_m": e / 2, "pcrb_rms_late_m": e / 4}
        for (s, p), values in errors.items()
        for k, e in enumerate(values)
    ]
    return pd.DataFrame(rows)[
        [
            "scenario",
            "planner",
            "seed",
            *[c for c in rows[0] if c not in ("scenario", "planner", "seed")],
        ]
    ]


@pytest.fixture
def two():
    noise = np.linspace(0.9, 1.1, 20)
    return table(
        {
            ("a", "good"): noise,
            ("a", "bad"): 2 * noise,
            ("b", "good"): noise,
            ("b", "bad"): noise[::-1] * 0.999,
        }
    )


def test_suite_covers_what_users_meet():
    scenarios = [load(name) for name in suite()]
    assert len(scenarios) >= 16
    ratio = [max(auv.speed for auv in s.table.auv) / s.table.cna.speed for s in scenarios]
    assert min(r for r in ratio if r) <= 0.1 + 1e-12
    assert max(ratio) == 1.5
    assert {len(s.table.auv) for s in scenarios} >= {1, 2, 4, 8}
    assert {s.table.ranging.interval for s in scenarios} >= {0.1, 30.0}
    assert {s.table.ranging.sigma for s in scenarios} >= {0.1, 3.0}
    assert any(s.table.environment.current != (0.0, 0.0) for s in scenarios)
    assert any(s.constraints.keep_out for s in scenarios)
    assert any(s.constraints.geofence for s in scenarios)
    assert not set(suite()) & set(shipped())


def test_field_covers_what_the_sea_does():
    tables = {name.removeprefix("field/"): load(name).table for name in suite("field")}
    assert len(tables) >= 12
    rangings = [table.ranging for table in tables.values()]
    assert {r.timing for r in rangings} == {"instant", "one-way", "two-way"}
    assert {r.access for r in rangings} == {"polling", "broadcast"}
    assert {r.geometry for r in rangings} == {"slant"}
    for what in ("growth", "loss", "outliers", "duplicates", "slot", "silent", "profile"):
        assert any(getattr(r, what) for r in rangings), what
    assert max(r.interval for r in rangings) == 60.0
    deepest = max(np.max(auv.depth) for table in tables.values() for auv in table.auv)
    assert deepest == 1500.0
    assert tables["one-way-broadcast"].planner.knowledge == "survey"
    assert tables["tidal-channel"].environment.tide is not None
    assert tables["glider-current"].environment.current_profile
    assert len(tables["two-aids"].cna) == 2
    assert tables["lbl-aided"].beacon


def test_no_two_scenarios_of_the_suites_have_one_name():
    names = [load(name).table.name for folder in SUITES for name in suite(folder)]
    assert len(set(names)) == len(names)
    assert set(all_shipped()) == {
        *shipped(),
        *(name for folder in SUITES for name in suite(folder)),
    }


@pytest.mark.parametrize("name", suite("field"))
def test_each_number_of_a_field_scenario_has_its_source_beside_it(name):
    text = find(name).read_text(encoding="utf-8")
    measured = re.compile(r"^(\w+) = .*?\d", re.MULTILINE)
    keys = set(measured.findall(text)) - {"seed", "time_step", "origin", "survey", "name"}
    explained = set(re.findall(r"^(\w+) = .*# .*\w{3}", text, re.MULTILINE))
    assert keys - {"description"} <= explained


def test_the_lowest_median_wins_and_what_is_not_distinguishable_ties(two):
    result = read_suite(two, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})
    planners = result.planners.set_index("planner")
    assert planners["wins"].to_dict() == {"good": 1, "bad": 1}
    assert planners["ties"].to_dict() == {"good": 2, "bad": 1}
    assert planners.loc["bad", "worst_ratio"] == pytest.approx(2.0)
    assert planners.loc["bad", "worst_scenario"] == "a"
    assert planners.loc["good", "efficiency"] == pytest.approx(0.5)
    assert list(result.planners["planner"]) == ["good", "bad"]
    assert "2.00" in str([column._cells for column in suite_table(result).columns])


def test_the_best_on_the_whole_stands_beside_the_best_other_of_each_scenario(two):
    three = pd.concat([two, table({("a", "ugly"): [9.0] * 20, ("b", "ugly"): [0.5] * 20})])
    result = read_suite(three, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0, "ugly": 3.0})
    columns = {str(column.header): list(column.cells) for column in scenario_table(result).columns}
    assert result.planners["planner"][0] == "good"
    assert columns["Scenario"] == ["a", "b"]
    assert columns["Best other"] == ["bad", "ugly"]
    assert columns["Ratio"] == ["0.50", "2.00"]
    assert max(map(float, columns["p"])) < 1e-5  # of all 20 seeds, both times
    assert columns["Efficiency"] == ["0.50", "0.50"]
    alone = read_suite(two[two["planner"] == "good"], {"a": 0.25, "b": 0.25}, {"good": 1.0})
    assert [list(column.cells) for column in scenario_table(alone).columns][2] == ["", ""]


def test_sentence_names_who_leads_how_often_beyond_chance_and_by_how_much(two):
    """Good wins in a beyond chance, bad in b by a thousandth; bad's mean ratio is sqrt(2 * 0.999)."""
    (sentence,) = suite_sentences(
        read_suite(two, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})
    )
    assert sentence.startswith(
        "good leads on the whole: lowest median error in 1 of 2 scenarios, "
        "in 1 of them beyond chance; bad comes"
    )
    assert "with 1.41 times its error in the mean" in sentence
    few = read_suite(two[two["seed"] < 5], {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})
    told = suite_sentences(few)
    assert "in 0 of them beyond chance" in told[0]
    assert told[1].startswith("With fewer than 6 seeds")
    worse = two.assign(violation_max_m=[*np.linspace(-1.0, 3.0, 20), *[-1.0] * 60])
    told = suite_sentences(read_suite(worse, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0}))
    assert told[0].startswith("bad leads on the whole")  # good broke a limit in a
    assert "in 0 of them beyond chance" in told[0]  # in a it has no rival
    assert told[1] == "good broke a limit, by up to 3.00 m."


def test_headings_say_their_units(two):
    result = read_suite(two, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})
    console = Console(width=200, file=io.StringIO())
    console.print(suite_table(result), scenario_table(result))
    assert "Decision [ms]" in console.file.getvalue()
    assert console.file.getvalue().count("RMS [m]") == 2


def test_planner_that_always_fails_is_last_wins_nothing_and_ties_with_none(two, tmp_path):
    broken = table({("a", "broken"): [np.nan] * 20, ("b", "broken"): [0.5] * 20}).assign(error="")
    broken.loc[broken["rms_error_m"].isna(), "status"] = "failed"
    result = read_suite(
        pd.concat([two.assign(error=""), broken]),
        {"a": 0.25, "b": 0.25},
        {"good": 1.0, "bad": 2.0, "broken": 3.0},
    )
    cell = result.cells.set_index(["scenario", "planner"]).loc[("a", "broken")]
    assert not cell["ties"]
    assert cell["ratio"] == np.inf
    assert list(result.planners["planner"])[-1] == "broken"
    assert "suite.png" in write_suite(result, tmp_path)
    everything = read_suite(broken[broken["scenario"] == "a"], {"a": 0.25}, {"broken": 3.0})
    assert everything.planners["wins"].to_list() == [0]


def test_worst_violation_of_any_seed_is_told(two):
    broken = two.assign(violation_max_m=[*np.linspace(-5.0, 0.7, 20), *[-1.0] * 60])
    result = read_suite(broken, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})
    assert result.planners.set_index("planner")["violation_max_m"].to_dict() == {
        "good": 0.7,
        "bad": -1.0,
    }


def test_planner_that_breaks_a_limit_does_not_win_there_and_is_marked(two):
    """Good is twice as good in a, but enters a keep-out there; in b nothing is broken."""
    broken = two.assign(violation_max_m=[*np.linspace(-5.0, 0.7, 20), *[-1.0] * 60])
    result = read_suite(broken, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})
    planners = result.planners.set_index("planner")
    assert list(planners.index) == ["bad", "good"]
    assert planners.loc["bad", "wins"] == 2
    cells = result.cells.set_index(["scenario", "planner"])
    assert cells.loc[("a", "good"), "ratio"] == pytest.approx(0.5)
    assert not cells.loc[("a", "good"), "ties"]
    assert cells.loc[("a", "bad"), "ratio"] == 1.0
    table_ = {str(column.header): list(column.cells) for column in suite_table(result).columns}
    assert table_["Planner"] == ["bad", "good †"]
    assert table_["Limit broken by [m]"] == ["kept", "0.70"]
    figure = suite_figure(result)
    marked = [text.get_text() for text in figure.axes[0].texts if "†" in text.get_text()]
    assert marked == ["1.00 †"]
    assert "†: broke a limit" in " ".join(figure.get_supxlabel().split())


def test_where_every_planner_breaks_a_limit_the_lowest_error_wins_marked(two):
    broken = two.assign(violation_max_m=1.0)
    result = read_suite(broken, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})
    assert result.planners.set_index("planner")["wins"].to_dict() == {"good": 1, "bad": 1}
    columns = {str(column.header): list(column.cells) for column in suite_table(result).columns}
    assert all(name.endswith("†") for name in columns["Planner"])


def test_missions_under_other_settings_are_not_mixed_into_the_verdict(two, tmp_path):
    cells = tuple(
        SimpleNamespace(scenario=s, planner=p, seeds=range(20))
        for s in "ab"
        for p in ("good", "bad")
    )
    assert len(missions_of(cells, two, tmp_path)) == 80
    assert len(missions_of(cells[:2], two, tmp_path)) == 40
    with pytest.raises(
        ObsplanError, match=f"{tmp_path} has missions of these planners under several settings"
    ):
        missions_of(cells, pd.concat([two, two]), tmp_path)
    with pytest.raises(ObsplanError, match="give each --set one value"):
        missions_of((*cells, cells[0]), two, tmp_path)


def test_suite_is_written_without_what_differs_between_machines(two, tmp_path):
    for folder, speed in (("one", 1.0), ("other", 9.0)):
        (tmp_path / folder).mkdir()
        names = write_suite(
            read_suite(two, {"a": 0.25, "b": 0.25}, {"good": speed, "bad": speed}),
            tmp_path / folder,
        )
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


def test_where_no_bound_was_asked_for_there_is_a_dash(two):
    nothing = float("nan")
    result = read_suite(two, {"a": nothing, "b": nothing}, {"good": 1.0, "bad": 2.0})
    for shown in (suite_table(result), scenario_table(result)):
        (efficiency,) = (column for column in shown.columns if str(column.header) == "Efficiency")
        assert {str(cell) for cell in efficiency.cells} == {"–"}


def test_figure_marks_the_best_in_bold(two):
    axes = suite_figure(read_suite(two, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})).axes[0]
    bold = [text.get_text() for text in axes.texts if text.get_weight() == "bold"]
    assert bold == ["1.00", "1.00", "1.00"]


def test_figure_has_intervals_and_tails_below_the_medians(two):
    axes = suite_figure(read_suite(two, {"a": 0.25, "b": 0.25}, {"good": 1.0, "bad": 2.0})).axes[0]
    below = [text.get_text() for text in axes.texts if text.get_va() == "top"]
    errors = np.linspace(0.9, 1.1, 20)
    assert len(below) == 4
    interval, tail = below[0].split("\n")  # good in a
    low, high = map(float, interval.strip("[]").split(", "))
    assert 0.9 < low < 1.0 < high < 1.1
    assert tail == f"{errors[18]:.2f}"  # the nineteenth of twenty


@pytest.mark.slow
def test_least_error_and_decision_time_are_of_the_scenario():
    scenario = load("suite/tank-precise", planner="circle", settings=["duration=20.0"])
    assert 0 < least_error(scenario) < 0.5
    assert 0 < decision_time(scenario) < 1e3
