"""Campaigns: what is planned, flown once, kept, and read as one table."""

import csv
import gc
import json
import sqlite3
import tracemalloc

import numpy as np
import pandas as pd
import pytest
from campaigns import DIVERGES, PLANNERS, cluster, finish, start, tables, write_scenario

from obsplan import load_campaign
from obsplan.campaign import fly_campaign, plan_cells
from obsplan.campaign import store as store_module
from obsplan.campaign import table as table_module
from obsplan.campaign.faults import FILE
from obsplan.campaign.layout import FIGURES
from obsplan.campaign.store import Store
from obsplan.campaign.table import look_up, uniform
from obsplan.campaign.worker import Outcome
from obsplan.scenario import load
from obsplan.simulation import simulate
from obsplan.types import ObsplanError

BAD_PLANS = {
    "a setting without values": (
        {"vary": ["cna.speed"]},
        "lacks a key or a value; write table.key=a,b,c",
    ),
    "an empty value": ({"vary": ["cna.speed=1,,2"]}, "lacks a key or a value"),
    "a misspelt key": ({"vary": ["cna.sped=1,2"]}, 'unknown key cna.sped; did you mean "speed"'),
    "a value out of range": (
        {"vary": ["cna.speed=1,-1"]},
        "cna.speed = -1 .* must be from 0.001 to 50",
    ),
    "an AUV that is not there": (
        {"vary": ["auv.3.speed=1"]},
        '--vary "auv.3.speed=1": 3 is not one of the 1 entries',
    ),
    "the seed": ({"vary": ["seed=1,2"]}, "seed is not a setting to vary; give --runs and --seed"),
    "the name": (
        {"vary": ["name=a,b"]},
        "name is not a setting to vary; give several scenario files",
    ),
    "a planner's table": (
        {"vary": ["planner=a"]},
        "planner is not a setting to vary; give --planners",
    ),
    "an unknown planner": (
        {"planners": ["gramain"]},
        'no planner "gramain"; did you mean "gramian"',
    ),
    "no seeds": ({"runs": 0}, "--runs must be at least 1 seed, got 0"),
    "seeds beyond the store": (
        {"seed": 2**63 - 1, "runs": 2},
        "is beyond 9223372036854775807; give a smaller --seed",
    ),
}


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    with cluster(tmp_path_factory.mktemp("cluster")) as address:
        yield address


@pytest.fixture
def pond(tmp_path):
    return write_scenario(tmp_path, duration=10.0)


@pytest.mark.parametrize(("options", "sentence"), BAD_PLANS.values(), ids=BAD_PLANS)
def test_bad_plan_is_refused_with_a_sentence(pond, options, sentence):
    with pytest.raises(ObsplanError, match=sentence):
        plan_cells([pond], **options)


def test_plan_crosses_scenarios_planners_and_values_and_counts_what_is_the_same_once(pond):
    cells = plan_cells(
        [pond, "fixed-auv", pond],
        planners=["circle", "gramian", "circle"],
        vary=["cna.speed=1.0,2,2.0", "ranging.sigma=3.0"],
        runs=4,
    )
    labels = [
        (cell.scenario, cell.planner, json.loads(cell.content)["cna"]["speed"]) for cell in cells
    ]
    assert labels == [
        (s, p, v) for s in ("pond", "fixed-auv") for p in ("circle", "gramian") for v in (1.0, 2.0)
    ]
    assert {cell.seeds for cell in cells} == {range(1, 5)}
    assert len({cell.key for cell in cells}) == 8


def test_lists_and_quoted_texts_are_single_values(pond):
    cells = plan_cells(
        [pond], vary=["environment.current=[0.1,0.0],[0.0,0.2]", 'auv.0.name="a,b",c']
    )
    seen = [
        (content["environment"]["current"], content["auv"][0]["name"])
        for content in (json.loads(cell.content) for cell in cells)
    ]
    assert seen == [
        (current, name) for current in ([0.1, 0.0], [0.0, 0.2]) for name in ("a,b", "c")
    ]


def test_key_of_a_mission_is_its_content_and_version_not_its_words_or_place(
    tmp_path, pond, monkeypatch
):
    (cell,) = plan_cells([pond])
    words = tmp_path / "copy.toml"
    text = (tmp_path / "pond.toml").read_text()
    words.write_text('# a comment\ndescription = "told otherwise"\n' + text)
    (same,) = plan_cells([str(words)], seed=7)
    assert (same.key, same.base, same.seeds) == (cell.key, cell.base, range(7, 8))
    words.write_text(text.replace("speed = 1.0", "speed = 1.0000000000000002"))
    assert plan_cells([str(words)])[0].key != cell.key
    monkeypatch.setattr("obsplan.__version__", "999.0")
    assert plan_cells([pond])[0].key != cell.key


def test_two_different_scenarios_of_one_name_are_refused(tmp_path, pond):
    with pytest.raises(
        ObsplanError, match='differ but are both named "pond"; change `name` in one of them'
    ):
        plan_cells([pond, write_scenario(tmp_path, sigma=2.0, name="other.toml")])


@pytest.mark.slow
def test_table_is_what_simulate_says_of_each_mission_in_order(tmp_path, pond, address):
    cells = plan_cells([pond], planners=PLANNERS[::-1], vary=["cna.speed=3.0,1.5"], runs=3)
    report = fly_campaign(cells, tmp_path / "out", scheduler=address)
    assert (report.missions, report.flown, report.failed) == (12, 12, 0)
    table = load_campaign(tmp_path / "out")
    labels = list(zip(table["planner"], table["cna.speed"], table["seed"], strict=True))
    assert labels == [
        (planner, speed, seed) for planner in PLANNERS for speed in (1.5, 3.0) for seed in (1, 2, 3)
    ]
    for row in table.iloc[[0, 5, 7, 11]].to_dict("records"):
        scenario = load(pond, planner=row["planner"], settings=[f"cna.speed={row['cna.speed']}"])
        summary = simulate(scenario, seed=row["seed"]).summary(bounds=False)
        assert {name: row[name] for name in FIGURES if row[name] == row[name]} == summary[
            "all"
        ]  # to the last bit; nan where there is none
        assert json.loads(row["auv"]) == summary["auv"]
        assert json.loads(row["status_counts"]) == summary["status_counts"]


@pytest.mark.slow
def test_exports_say_what_load_campaign_says(tmp_path, pond, address):
    fly_campaign(
        plan_cells(
            [pond], vary=["auv.0.survey.legs=1,2", "ranging.kind=range,squared-range"], runs=2
        ),
        tmp_path / "out",
        scheduler=address,
    )
    table = load_campaign(tmp_path / "out")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "out/campaign.parquet"), table)
    with (tmp_path / "out/campaign.csv").open(newline="") as file:
        for line, row in zip(csv.DictReader(file), table.to_dict("records"), strict=True):
            there = {name: value for name, value in row.items() if not pd.isna(value)}
            assert {name: type(value)(line[name]) for name, value in there.items()} == there
            assert {line[name] for name in row if name not in there} == {""}
    assert list(table["auv.0.survey.legs"].unique()) == [1.0, 2.0]
    assert list(table["ranging.kind"].unique()) == ["range", "squared-range"]


@pytest.mark.slow
def test_rerun_flies_only_what_is_missing(tmp_path, pond, address):
    def fly(runs, planners):
        return fly_campaign(
            plan_cells([pond], planners=planners, runs=runs), tmp_path / "out", scheduler=address
        )

    assert fly(3, ["gramian"]).flown == 3
    assert fly(5, ["gramian"]).flown == 2
    assert fly(5, PLANNERS).flown == 5
    assert fly(5, PLANNERS).flown == 0
    assert len(load_campaign(tmp_path / "out")) == 10


@pytest.mark.slow
def test_changed_scenario_never_mixes_with_what_it_was(tmp_path, pond, address):
    def fly():
        return fly_campaign(plan_cells([pond], runs=3), tmp_path / "out", scheduler=address)

    assert fly().set_aside == 0
    before = tables(tmp_path / "out")
    write_scenario(tmp_path, duration=10.0, sigma=4.0)
    again = fly()
    assert (again.flown, again.set_aside) == (3, 3)
    changed = load_campaign(tmp_path / "out")
    assert len(changed) == 3
    assert list(changed["rms_error_m"]) == [
        simulate(pond, seed=seed).rms_error for seed in (1, 2, 3)
    ]
    write_scenario(tmp_path, duration=10.0)
    assert fly().flown == 0  # what it was is still there
    assert tables(tmp_path / "out") == before


@pytest.mark.slow
def test_failed_missions_are_listed_left_out_and_flown_again(tmp_path, address):
    arguments = (
        write_scenario(tmp_path, diverging=True),
        "--vary",
        DIVERGES,
        "--runs",
        3,
        "--scheduler",
        address,
        "--out",
        tmp_path / "out",
    )
    _, err = finish(start(*arguments), code=3)
    reason = "the filter diverged: the estimate of alpha is not finite from 1 s on"
    assert err.splitlines() == [
        f"obsplan: pond, path-inertia, estimator.drift=1e200, seed {seed}: {reason}"
        for seed in (1, 2, 3)
    ]
    table = load_campaign(tmp_path / "out").set_index("status")
    assert list(table.index) == ["done"] * 3 + ["failed"] * 3
    assert set(table.loc["failed", "error"]) == {reason}
    assert table.loc["failed", list(FIGURES)].isna().all(axis=None)
    assert table.loc["done", "error"].isna().all()
    before = tables(tmp_path / "out")
    out, _ = finish(start(*arguments), code=3)
    assert "6 missions: 3 flown now, 3 were there, 3 failed." in out
    assert tables(tmp_path / "out") == before


def test_success_replaces_a_failure_and_is_never_replaced(tmp_path, pond):
    good, bad = (
        Outcome(5, None, dict.fromkeys(FIGURES, 1.5), "{}", "{}"),
        Outcome(5, "sank", {}, "{}", "{}"),
    )
    with Store(tmp_path) as store:
        (cell,) = store.enter(plan_cells([pond]))
        for outcomes, kept in (([bad], "sank"), ([bad, good], None), ([bad], None)):
            store.add([(cell, outcome) for outcome in outcomes])
            assert [row[1] for row in store.rows(cell)] == [kept]
    assert load_campaign(tmp_path)["rms_error_m"].item() == 1.5


def test_folder_of_something_else_is_refused_and_left_alone(tmp_path, pond):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("years of work")
    with pytest.raises(
        ObsplanError, match="mine holds something that is not a campaign; give another folder"
    ):
        fly_campaign(plan_cells([pond]), tmp_path / "mine")
    with pytest.raises(ObsplanError, match=r"pond.toml cannot be made .*; give another folder"):
        fly_campaign(plan_cells([pond]), pond)
    with pytest.raises(ObsplanError, match="mine has no campaign; give the folder"):
        load_campaign(tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


def test_file_that_is_no_store_is_refused_and_left_alone(tmp_path, pond):
    (tmp_path / FILE).write_bytes(b"GIF89a" * 1000)
    with pytest.raises(
        ObsplanError, match=r"campaign.sqlite: file is not a database; .* choose another folder"
    ):
        fly_campaign(plan_cells([pond]), tmp_path)
    assert (tmp_path / FILE).read_bytes() == b"GIF89a" * 1000
    (tmp_path / FILE).unlink()
    with sqlite3.connect(tmp_path / FILE) as other:
        other.execute("CREATE TABLE recipes (name TEXT)")
    other.close()
    with pytest.raises(
        ObsplanError, match="is not a store of this version's campaigns; choose another folder"
    ):
        fly_campaign(plan_cells([pond]), tmp_path)


@pytest.mark.slow
def test_folder_that_cannot_be_made_is_one_sentence(pond):
    _, err = finish(
        start(pond, "--out", "/proc/campaign"), code=2
    )  # no one can, whoever runs this test
    assert err.count("\n") == 1
    assert "/proc/campaign cannot be made" in err


@pytest.mark.slow
def test_read_only_store_is_one_sentence_and_can_still_be_read(
    tmp_path, pond, address, monkeypatch
):
    fly_campaign(plan_cells([pond], runs=2), tmp_path / "out", scheduler=address)
    connect = sqlite3.connect

    def read_only(place, **options):
        """As for a user without the right to write."""
        return connect(place.replace("mode=rw", "mode=ro"), **options)

    monkeypatch.setattr(store_module.sqlite3, "connect", read_only)
    with pytest.raises(
        ObsplanError,
        match="attempt to write a readonly database; make it and its folder writable, or choose another",
    ):
        fly_campaign(plan_cells([pond], runs=3), tmp_path / "out", scheduler=address)
    assert len(load_campaign(tmp_path / "out")) == 2


def test_nobody_at_the_schedulers_address_is_one_sentence(tmp_path, pond, monkeypatch):
    monkeypatch.setattr("obsplan.campaign.cluster.PATIENCE", 0.5)
    with pytest.raises(
        ObsplanError,
        match=r"no Dask scheduler answers at tcp://127.0.0.1:9 .*; start one with `dask scheduler`",
    ):
        fly_campaign(plan_cells([pond]), tmp_path / "out", scheduler="tcp://127.0.0.1:9")


@pytest.mark.slow
def test_scheduler_without_workers_is_one_sentence(tmp_path, pond, monkeypatch):
    monkeypatch.setattr("obsplan.campaign.cluster.PATIENCE", 3.0)
    with (
        cluster(tmp_path, workers=0) as lonely,
        pytest.raises(ObsplanError, match="has no workers; start some with `dask worker tcp"),
    ):
        fly_campaign(plan_cells([pond]), tmp_path / "out", scheduler=lonely)


def test_workers_of_another_version_are_refused(tmp_path, pond, address, monkeypatch):
    monkeypatch.setattr("obsplan.__version__", "999.0")
    with pytest.raises(
        ObsplanError,
        match=r"a worker has obsplan .* and this is 999.0; install 999.0 there and repeat",
    ):
        fly_campaign(plan_cells([pond]), tmp_path / "out", scheduler=address)
    assert load_campaign(tmp_path / "out").empty


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_missions(tmp_path, address, monkeypatch):
    for module in (store_module, table_module):
        monkeypatch.setattr(module, "BLOCK", 50)
    monkeypatch.setattr("obsplan.campaign.execute.MOST_IN_A_BATCH", 20)
    cells = lambda runs: plan_cells([write_scenario(tmp_path, duration=1.0)], runs=runs)  # noqa: E731

    def peak(runs):
        tracemalloc.start()
        tidy = lambda done, *_: done % 100 or gc.collect()  # noqa: E731 - the client leaves cycles, collected some time
        fly_campaign(cells(runs), tmp_path / "out", scheduler=address, progress=tidy)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    fly_campaign(cells(50), tmp_path / "out", scheduler=address)  # imports
    few, many = peak(300), peak(1800)  # 250 and 1500 new ones
    assert many < 1.2 * few
    assert len(load_campaign(tmp_path / "out")) == 1800


def test_labels_are_looked_up_in_tables_and_lists():
    content = {"cna": {"speed": 1.5}, "auv": [{"speed": 1.0}]}
    assert [look_up(content, key) for key in ("cna.speed", "auv.0.speed")] == [1.5, 1.0]
    assert [
        look_up(content, key) for key in ("auv.1.speed", "planner.gamma", "cna.speed.x", "auv.x")
    ] == [None] * 4


def test_columns_are_numbers_only_if_nothing_else_is_in_them():
    assert uniform([1, None, 2.5]) == [1.0, None, 2.5]
    assert uniform([1, "a", None, [0.5, 1.0], True]) == ["1", "a", None, "[0.5, 1.0]", "true"]


@pytest.mark.slow
def test_seeds_give_planners_the_same_noise(tmp_path, pond, address):
    """The noise is told from the first error, which is drawn before any planner acts."""
    fly_campaign(plan_cells([pond], planners=PLANNERS, runs=4), tmp_path / "out", scheduler=address)
    first = [simulate(load(pond, planner=planner), seed=3).error[:, 0] for planner in PLANNERS]
    np.testing.assert_array_equal(first[0], first[1])
    assert load_campaign(tmp_path / "out").groupby("seed").size().eq(2).all()
