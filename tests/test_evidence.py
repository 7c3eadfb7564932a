"""Evidence: independent seeds, intervals and tails, Holm over rows, drawn scenarios, and what is written of them."""

import json
from concurrent.futures import Future
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from obsplan.campaign.drawn import drawn_scenario
from obsplan.campaign.evidence import evidence
from obsplan.campaign.execute import Flight
from obsplan.campaign.layout import FIGURES
from obsplan.campaign.plan import BLOCK, block_of, plan_cells
from obsplan.campaign.statistics import median_interval, tail, tail_ratio
from obsplan.campaign.store import Store
from obsplan.campaign.suite import weighted
from obsplan.report.evidence import evidence_figure, median_table, summary, tail_summary, tail_table
from obsplan.report.files import toml_lines
from obsplan.scenario import all_shipped, from_dict, load
from obsplan.scenario.contents import parse_toml
from obsplan.types import ObsplanError

SEEDS = 40


def missions(errors, violations=None):
    """A campaign's table from errors by (scenario, planner), one a seed; late errors are half of them, bounds a tenth."""
    rows = [
        dict.fromkeys(FIGURES, np.nan)
        | {
            "scenario": scenario,
            "planner": planner,
            "seed": seed,
            "status": "failed" if np.isnan(error) else "done",
            "rms_error_m": error,
            "rms_error_late_m": error / 2,
            "pcrb_rms_late_m": error / 10 * (1 + (seed > 0)),
            "violation_max_m": (violations or {}).get((scenario, planner), np.nan),
        }
        for (scenario, planner), values in errors.items()
        for seed, error in enumerate(values)
    ]
    return pd.DataFrame(rows)


@pytest.fixture
def noise():
    return np.random.default_rng(5).lognormal(0.0, 0.2, SEEDS)


@pytest.fixture
def three(noise):
    """In a the planner is better by a tenth, in b nothing differs but by noise, in c it is worse by a tenth."""
    other = np.random.default_rng(6).permutation(noise)
    return missions(
        {
            ("a", "ours"): noise,
            ("a", "theirs"): 1.1 * noise,
            ("a", "far-off"): 9 * noise,
            ("b", "ours"): noise,
            ("b", "theirs"): other,
            ("c", "ours"): 1.1 * noise,
            ("c", "theirs"): noise,
            ("c", "whole-mission"): 0.5 * noise,
        }
    )


def test_no_two_scenarios_share_a_seed_and_the_same_are_given_again():
    names = [name.rpartition("/")[2] for name in all_shipped()]
    names += [f"drawn-{seed}" for seed in range(90001, 90301)]
    begins = {block_of(name, first=11, runs=40) for name in names}
    assert len(begins) == len(names) > 300
    assert all(begin % BLOCK == 0 for begin in begins)  # so that 40 seeds of each are apart
    two = ["suite/one-moored", "field/calm-lake"]
    both = plan_cells(two, planners=["circle"], runs=3, seed=11, independent=True)
    assert not set(both[0].seeds) & set(both[1].seeds)
    alone = plan_cells(two[1:], planners=["trail"], runs=3, seed=11, independent=True)
    assert alone[0].seeds == both[1].seeds  # whoever else flies, and under which planner
    with pytest.raises(ObsplanError, match="seed 1000000 is beyond the 1000000"):
        plan_cells(two, runs=2, seed=BLOCK - 1, independent=True)


def test_p_values_are_corrected_over_rows_as_holm_did(three):
    """Holm (1979): of m = 3 the smallest p counts three times, the next twice, and none less than one before."""
    rows = evidence(three, "ours")[0].set_index("scenario")
    by_hand = {}
    for name in "abc":
        group = three[three["scenario"] == name].pivot(
            index="seed", columns="planner", values="rms_error_m"
        )
        by_hand[name] = stats.wilcoxon(group["ours"], group["theirs"]).pvalue
    least = 0.0
    for k, name in enumerate(sorted(by_hand, key=by_hand.get)):
        least = max(least, min(1.0, (3 - k) * by_hand[name]))
        assert rows.loc[name, "p_holm"] == pytest.approx(least, rel=1e-9)
    assert rows["verdict"].to_dict() == {"a": "best", "b": "level", "c": "worse"}
    assert rows["ratio"].to_dict() == pytest.approx(
        {"a": 1 / 1.1, "b": rows.loc["b", "ratio"], "c": 1.1}
    )
    assert rows.loc["c", "whole_mission_ratio"] == pytest.approx(2.2)  # which is no rival
    assert rows.loc["c", "rival"] == "theirs"


def test_interval_of_the_median_covers_it_as_often_as_it_says():
    """Of 200 samples of 40, 95 % intervals hold the true median in 190; fewer than 178 has a chance of 2e-4."""
    rng = np.random.default_rng(7)
    held = 0
    for _ in range(200):
        _, low, high = median_interval(rng.lognormal(0.0, 0.5, SEEDS))
        held += low <= 1.0 <= high
    assert held >= 178
    assert held < 200  # an interval that is far too wide would hold it always


def test_tail_is_the_least_error_that_nineteen_of_twenty_do_not_exceed():
    assert tail(np.arange(1.0, 41.0)) == 38.0
    assert tail(np.array([1.0, np.inf])) == np.inf


def test_ratio_of_tails_is_of_pairs(noise):
    """Twice the errors have twice the quantile, whichever missions are drawn again."""
    assert tail_ratio(2 * noise, noise) == pytest.approx((2.0, 2.0, 2.0))
    ratio, low, high = tail_ratio(noise, noise[::-1].copy())
    assert ratio == 1.0
    assert low < 1.0 < high


def test_who_broke_a_limit_is_no_rival_of_one_that_kept_it(noise):
    table = missions(
        {("a", "ours"): noise, ("a", "cheat"): 0.5 * noise, ("a", "theirs"): 2 * noise},
        violations={("a", "ours"): -1.0, ("a", "cheat"): 3.0, ("a", "theirs"): -2.0},
    )
    (row,) = evidence(table, "ours")[0].to_dict("records")
    assert row["rival"] == row["tail_rival"] == "theirs"
    (broken,) = evidence(table, "cheat")[0].to_dict("records")
    assert broken["verdict"] == broken["tail_verdict"] == "broke a limit"
    assert "It broke a limit that its best rival kept: `a`." in summary(
        evidence(table, "cheat")[0], "cheat"
    )


def test_a_mission_that_failed_counts_as_worse_than_any(noise):
    failed = np.where(np.arange(SEEDS) < 12, np.nan, noise)
    table = missions({("a", "ours"): failed, ("a", "theirs"): 1.001 * noise})
    rows = evidence(table, "ours")[0]
    assert rows.loc[0, "q95"] == rows.loc[0, "worst"] == np.inf
    assert rows.loc[0, "failed"] == 12
    assert rows.loc[0, "tail_verdict"] == "worse"
    assert "| failed | failed |" in tail_table(rows, "ours", {})


def test_missions_under_one_plan_go_to_one_worker(tmp_path):
    cells = plan_cells(["suite/one-moored"], planners=["whole-mission", "circle"], runs=40)
    crew = SimpleNamespace(threads=lambda: 2, send=lambda _batch: Future())
    with Store(tmp_path) as store:
        numbers = store.enter(cells)
        flight = Flight(crew=crew, store=store, progress=lambda *_: None, todo=80, threads=2)
        batches = [*flight.batches([*zip(numbers, cells, strict=True)], [40, 40])]
    sizes = {number: [len(b.seeds) for b in batches if b.cell == number] for number in numbers}
    assert sizes[numbers[0]] == [40]
    assert sizes[numbers[1]][:3] == [1, 1, 1]
    assert sum(sizes[numbers[1]]) == 40


def test_errors_count_auvs_by_their_weights_where_these_differ():
    table = missions({("a", "ours"): [2.0, np.nan], ("b", "ours"): [2.0, 2.0]})
    own = {"rms_error_m": 1.0, "rms_error_late_m": 2.0, "pcrb_rms_m": 3.0, "pcrb_rms_late_m": 4.0}
    other = dict.fromkeys(own, 6.0)
    table["auv"] = json.dumps({"auv-1": own, "auv-2": other})
    cells = tuple(
        SimpleNamespace(
            scenario=name, content=json.dumps({"auv": [{"weight": w}, {"weight": 1.0}]})
        )
        for name, w in (("a", 4.0), ("b", 1.0))
    )
    counted = weighted(cells, table)
    expected = np.sqrt((4 * np.array([1.0, 2.0, 3.0, 4.0]) ** 2 + 36) / 5)
    assert counted.loc[0, list(own)].to_numpy(float) == pytest.approx(expected)
    assert np.isnan(counted.loc[1, "rms_error_m"])  # it failed
    assert counted.iloc[2:].equals(table.iloc[2:])


def test_tables_and_summary_say_what_the_rows_do(three):
    rows = evidence(three, "ours")[0]
    lines = median_table(rows, "ours", {"b": "survey"}).splitlines()
    assert lines[2].startswith("| `a` | 40 | ")
    assert "| `theirs` |" in lines[2]
    assert "| 0.91 | < 0.001 | best | – [–, –] | – |" in lines[2]
    assert lines[3].startswith("| `b` (survey) |")
    assert "| 1.10 | < 0.001 | worse |" in lines[4]
    assert lines[4].endswith("| 2.20 |")
    said = [*summary(rows, "ours"), *tail_summary(rows)]
    assert said[0].endswith("is lowest or level in 2; in 1 it is lower beyond chance.")
    assert said[1] == "Worse in the median beyond chance: `c`."
    assert any("ratio to the best other planner is 1.10, in `c`" in line for line in said)
    assert any("ratio to `whole-mission` is 2.20, in `c`" in line for line in said)
    assert said[-1] == "Worse in the 95 % quantile beyond chance: `c`."
    tails = tail_table(rows, "ours", {}).splitlines()
    assert tails[2].endswith(
        "| 0.91 [0.91, 0.91] | best | 5.00 |"
    )  # of seed 0: a half over a tenth


def test_figure_has_each_scenario_once_and_a_symbol_for_each_planner(three):
    axes = evidence_figure(evidence(three, "ours")[0], "ours").axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b", "c"]
    points = {line.get_label(): line.get_xdata() for line in axes.lines if line.get_marker() == "o"}
    assert points["ours"] == pytest.approx([1.0, 1.0, 1.0])
    assert points["best other"][[0, 2]] == pytest.approx([1.1, 1 / 1.1])
    assert points["whole-mission"][2] == pytest.approx(0.5 / 1.1)


@pytest.mark.parametrize("block", range(3))
def test_drawn_scenarios_are_the_same_for_a_seed_and_can_be_flown(block):
    """In 30 of them the start keeps every limit, whatever the AUVs do."""
    for seed in range(10 * block, 10 * block + 10):
        data = drawn_scenario(seed)
        assert data == drawn_scenario(seed)
        scenario = from_dict(parse_toml("\n".join(toml_lines(data))))
        assert scenario.resolved() == from_dict(data).resolved()
        start, limits = data["cna"]["start"], data["constraints"]
        for disc in limits.get("keep_out", ()):
            away = np.hypot(disc["x"] - start["x"], disc["y"] - start["y"])
            assert away > disc["radius"] + data["cna"]["min_turn_radius"]
        first = scenario.situations[0].filed.position[0]
        nearest = np.hypot(*(first - [start["x"], start["y"]]).T).min()
        assert nearest >= limits.get("min_separation", 0.0)


def test_drawn_scenarios_differ_in_what_they_say_they_do():
    drawn = [drawn_scenario(seed) for seed in range(60)]
    assert {len(data["auv"]) for data in drawn} == {1, 2, 3, 4, 6}
    kinds = {auv["survey"]["kind"] for data in drawn for auv in data["auv"]}
    assert kinds == {"static", "lawnmower", "waypoints", "formation"}
    limits = {key for data in drawn for key in data["constraints"]}
    assert limits == {"keep_out", "min_separation", "geofence"}
    assert any(data["environment"]["current"] != [0.0, 0.0] for data in drawn)
    assert any(data["ranging"]["slot"] for data in drawn)
    assert any(data["ranging"]["loss"] for data in drawn)


def test_error_after_the_first_tenth_leaves_out_the_first_estimate():
    """The run's own errors, from a tenth of its time on."""
    import obsplan as op

    run = op.simulate(load("survey-slow", planner="circle", settings=["duration=40.0"]), seed=1)
    figures = run.summary(bounds=False)["all"]
    late = np.concatenate([error[run.time >= 4.0] for error in run.error])
    assert figures["rms_error_late_m"] == pytest.approx(np.sqrt(np.mean(late**2)), rel=1e-12)
    variance = run.cramer_rao_variance[:, run.time >= 4.0]
    assert figures["pcrb_rms_late_m"] == pytest.approx(np.sqrt(variance.mean()), rel=1e-12)
