"""Campaigns read: medians, comparisons and figures that say what the table says."""

import csv
import math
import re

import numpy as np
import pandas as pd
import pytest
from campaigns import DIVERGES, finish, start, write_scenario
from matplotlib import image
from matplotlib.colors import same_color, to_hex
from scipy import stats

from obsplan.campaign.layout import FIGURES
from obsplan.campaign.statistics import (
    holm,
    median_interval,
    medians,
    paired,
    signed_rank_p,
    varied_keys,
)
from obsplan.cli import main
from obsplan.report import campaign as module
from obsplan.report import campaign_table, write_campaign_report
from obsplan.report.campaign import figures, sentences
from obsplan.report.campaign_figures import key_figure, map_figure, planners_figure
from obsplan.report.style import MARKERS
from obsplan.types import ObsplanError


def table_of(errors, keys=(), violations=None, violation=None):
    """A campaign's table from {(scenario, planner, value of each key): errors by seed}; nan is a failure.

    ``violations`` are of the same form; without them there are no limits. ``violation`` is of all missions.
    """
    rows = [
        [
            *labels,
            seed,
            "failed" if math.isnan(error) else "done",
            None,
            *[error] * (len(FIGURES) - 1),
            worst,
            "{}",
            "{}",
        ]
        for labels, values in errors.items()
        for seed, (error, worst) in enumerate(
            zip(values, (violations or {}).get(labels, [math.nan] * len(values)), strict=True)
        )
    ]
    assert FIGURES[-1] == "violation_max_m"
    table = pd.DataFrame(
        rows,
        columns=[
            "scenario",
            "planner",
            *keys,
            "seed",
            "status",
            "error",
            *FIGURES,
            "auv",
            "status_counts",
        ],
    )
    return table if violation is None else table.assign(violation_max_m=violation)


@pytest.fixture
def grid():
    """Two planners over two keys in one scenario; circle is the better by 1 m everywhere, and errors grow with both keys."""
    rng = np.random.default_rng(3)
    noise = rng.normal(scale=0.05, size=30)
    cells = [
        (planner, sigma, speed)
        for planner in ("circle", "gramian")
        for sigma in (1.0, 2.0, 4.0)
        for speed in (1.0, 3.0)
    ]
    error = {
        cell: cell[1]
        + 0.1 * cell[2]
        + (cell[0] == "gramian")
        + noise
        + rng.normal(scale=0.02, size=30)
        for cell in cells
    }
    return table_of(
        {("pond", *cell): list(values) for cell, values in error.items()},
        keys=("ranging.sigma", "cna.speed"),
    )


@pytest.mark.slow
def test_interval_of_a_median_covers_it_as_often_as_it_says():
    """Of 400 samples of 41 from a known law, 95 % of intervals hold its median; four standard errors of that share are 0.044."""
    rng = np.random.default_rng(1)
    intervals = np.array([median_interval(rng.exponential(size=41)) for _ in range(400)])
    covered = np.mean((intervals[:, 1] <= np.log(2)) & (np.log(2) <= intervals[:, 2]))
    assert abs(covered - 0.95) < 0.044


def test_interval_is_near_the_distribution_free_one_of_order_statistics():
    """David & Nagaraja (2003), 7.1: of 101 values, the 41st and the 61st hold the median with probability 0.95."""
    values = np.sort(np.random.default_rng(2).normal(size=101))
    median, low, high = median_interval(values)
    assert median == values[50]
    assert values[38] <= low <= values[42]
    assert values[58] <= high <= values[62]


def test_too_few_values_have_no_interval():
    assert median_interval(np.array([2.0]))[0] == 2.0
    assert np.isnan(median_interval(np.array([2.0]))[1:]).all()
    assert np.isnan(median_interval(np.empty(0))).all()
    assert median_interval(np.full(5, 3.0)) == (3.0, 3.0, 3.0)


def test_medians_leave_out_and_count_what_failed():
    found = medians(
        table_of(
            {
                ("pond", "circle"): [1.0, 2.0, math.nan, 9.0],
                ("pond", "gramian"): [math.nan, math.nan],
            }
        )
    )
    assert list(found["missions"]) == [4, 2]
    assert list(found["failed"]) == [1, 2]
    assert found["rms_error_m"][0] == 2.0
    assert found.loc[1, ["rms_error_m", "rms_error_m_low"]].isna().all()


def test_intervals_are_the_same_each_time(grid):
    pd.testing.assert_frame_equal(medians(grid), medians(grid.copy()))


def test_settings_that_a_planner_does_not_have_make_a_group_of_their_own():
    table = table_of(
        {("pond", "circle", None): [1.0, 2.0], ("pond", "path-inertia", 0.5): [3.0, 4.0]},
        keys=("planner.gamma",),
    )
    assert varied_keys(table) == ["planner.gamma"]
    assert list(medians(table)["rms_error_m"]) == [1.5, 3.5]


def test_holm_is_right_on_a_worked_example():
    """Holm (1979): p of 0.01, 0.04, 0.03, 0.005 become 0.03, 0.06, 0.06, 0.02."""
    np.testing.assert_allclose(
        holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02], rtol=1e-15
    )
    assert holm(np.array([0.9, 0.8])).max() == 1.0
    assert holm(np.empty(0)).size == 0


def test_holm_errs_at_most_as_often_as_it_says():
    """Of 2000 families of ten true hypotheses, 5 % have one rejected; without correction 40 % have."""
    p = np.random.default_rng(4).uniform(size=(2000, 10))
    assert np.mean([holm(row).min() < 0.05 for row in p]) < 0.05 + 4 * math.sqrt(0.05 * 0.95 / 2000)
    assert np.mean(p.min(axis=1) < 0.05) > 0.3


def test_signed_rank_is_exact_for_few_pairs():
    """Five differences of one sign: 2 of the 2^5 patterns of signs are as extreme."""
    assert signed_rank_p(np.array([1.0, 2.0, 3.0, 4.5, 5.0])) == pytest.approx(2 / 32)
    assert signed_rank_p(np.zeros(5)) == 1.0


def test_pairs_are_made_by_seed_and_only_of_missions_that_did_not_fail():
    errors = {
        ("pond", "circle"): [1.0, 2.0, math.nan, 4.0],
        ("pond", "gramian"): [1.5, 2.25, 1.0, 4.125],
        ("lake", "circle"): [1.0],
    }
    (row,) = paired(table_of(errors)).to_dict("records")
    assert (row["scenario"], row["planner"], row["against"], row["pairs"]) == (
        "pond",
        "circle",
        "gramian",
        3,
    )
    assert (row["difference"], row["better"]) == (-0.25, 1.0)
    assert row["p"] == pytest.approx(2 / 2**3)


def test_pairing_finds_what_unpaired_samples_hide():
    """A gain of 0.05 under noise of 1 that both planners share."""
    shared, rng = np.random.default_rng(5).normal(10.0, 1.0, size=40), np.random.default_rng(6)
    one, other = (
        shared + rng.normal(scale=0.02, size=40),
        shared + 0.05 + rng.normal(scale=0.02, size=40),
    )
    (row,) = paired(
        table_of({("pond", "circle"): list(one), ("pond", "gramian"): list(other)})
    ).to_dict("records")
    assert stats.mannwhitneyu(one, other).pvalue > 0.1
    assert row["p_holm"] < 1e-6
    assert row["low"] < -0.04 > row["difference"] > row["low"]


def test_every_pair_of_planners_is_compared_in_every_setting_and_corrected_for_all(grid):
    pairs = paired(grid)
    assert len(pairs) == 6
    assert np.allclose(pairs["difference"], -1.0, atol=0.05)
    np.testing.assert_allclose(pairs["p_holm"].min(), 6 * pairs["p"].min())


def told(table):
    return sentences(table, paired(table))


@pytest.mark.slow
def test_sentences_name_the_leader_its_margin_and_what_failed():
    errors = {
        ("pond", name): [base + 0.01 * k for k in range(13)]
        for name, base in (("a", 1.0), ("b", 2.0), ("c", 3.0))
    }
    errors["pond", "c"][3] = math.nan
    first, second = told(table_of(errors, violation=-1.0))
    lead, chance = first.split(". ", 1)
    assert lead == (
        "pond: a has the lowest RMS error, 1.06 m in the median of 13 seeds; "
        "b comes next, seed by seed 1 m higher (95 % interval 1 to 1 m)"
    )
    assert (
        2 * 2 * 0.5**12 < 0.001
    )  # Holm's factors are 3, 2, 1, and twelve pairs of one sign the worst
    assert "(p < 0.001, signed-rank test" in chance
    assert chance.startswith("Its lead over every other planner is beyond chance")
    assert second == "1 of 39 missions failed and are left out of all medians and comparisons."


def test_sentences_say_where_chance_could_explain_the_lead():
    rng = np.random.default_rng(7)
    same = table_of(
        {("pond", name): list(rng.uniform(1.0, 2.0, 12)) for name in ("a", "b")}, violation=-1.0
    )
    (sentence,) = told(same)
    leader, other = same.groupby("planner")["rms_error_m"].median().sort_values().index
    assert sentence.startswith(f"pond: {leader} has the lowest RMS error, ")
    assert f"Its lead over {other} could be chance (p up to " in sentence


@pytest.mark.parametrize(("planners", "least"), [(2, 6), (3, 7), (9, 11)])
def test_too_few_seeds_are_said_to_be_too_few_and_enough_are_not(planners, least):
    """Of n pairs all of one sign p is 2^(1-n), and Holm multiplies it by the number of comparisons."""
    comparisons = planners * (planners - 1) // 2
    assert comparisons * 2.0 ** (1 - least) < 0.05 <= comparisons * 2.0 ** (2 - least)

    def clear(seeds):
        return told(
            table_of(
                {
                    ("pond", f"p{k}"): [k + 0.1 * k * seed for seed in range(1, seeds + 1)]
                    for k in range(1, planners + 1)
                },
                violation=-1.0,
            )
        )

    (few,) = clear(least - 1)
    assert f"from {least} on (--runs {least}) it can be told" in few
    (enough,) = clear(least)
    assert "beyond chance" in enough


@pytest.mark.slow
def test_planner_that_broke_a_limit_never_leads_unmarked():
    errors = {("pond", name): [base + 0.01 * k for k in range(13)] for name, base in (("a", 1.0), ("b", 2.0), ("c", 3.0))}  # fmt: skip
    table = table_of(errors, violation=-1.0)
    table.loc[(table["planner"] == "a") & (table["seed"] == 5), "violation_max_m"] = 12.5
    (sentence,) = told(table)
    assert sentence.startswith("pond: b has the lowest RMS error of those that kept within the limits, 2.06 m")  # fmt: skip
    assert sentence.endswith("Limits were broken by a (up to 12.5 m).")
    table["violation_max_m"] = 3.0
    (sentence,) = told(table)
    assert "a has the lowest RMS error, though none kept within the limits" in sentence


def test_sentences_count_settings_where_they_are_many(grid):
    grid["violation_max_m"] = np.nan
    (sentence,) = told(grid)
    assert "of 6 settings: circle in 6 (6 beyond chance), the next with " in sentence
    ratio = float(re.search(r"the next with ([\d.]+) times", sentence)[1])
    medians_of = grid.groupby(["ranging.sigma", "cna.speed", "planner"])["rms_error_m"].median().unstack()  # fmt: skip
    assert ratio == pytest.approx(stats.gmean(medians_of["gramian"] / medians_of["circle"]), abs=0.005)  # fmt: skip
    few = told(grid[grid["seed"] < 7])
    assert "In 6 of them there are too few seeds" in few[1]
    assert "(--runs 8)" in few[1]
    grid.loc[grid["planner"] == "circle", "violation_max_m"] = 2.0
    broken = told(grid)
    assert "circle in" not in broken[0]
    assert broken[-1].startswith("circle broke a limit in 6 of them, by up to 2.00 m")


def test_settings_that_one_planner_lacks_are_compared_where_they_are_shared():
    shared = {("pond", name, None): [base] * 6 for name, base in (("circle", 1.0), ("trail", 2.0))}
    table = table_of(shared | {("pond", "path-inertia", 0.5): [3.0] * 6}, keys=("planner.gamma",))
    (sentence,) = told(table.assign(violation_max_m=np.nan))
    assert sentence.startswith("pond: circle has the lowest RMS error")


def test_lone_planner_is_compared_with_none(grid):
    alone = grid[grid["planner"] == "circle"]
    assert paired(alone).empty
    assert told(alone) == []


def curves(panel):
    """Lines of a panel by their colours; symbols are single points."""
    return {
        to_hex(line.get_color()): line.get_xydata()
        for line in panel.lines
        if line.get_linestyle() == "-"
    }


def test_lines_are_the_medians_against_the_key(grid):
    figure = key_figure(grid, "ranging.sigma", ["cna.speed"])
    (panel,) = figure.axes
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["circle", "gramian"]
    for handle, planner in zip(figure.legends[0].legend_handles, names, strict=True):
        expected = grid[grid["planner"] == planner].groupby("ranging.sigma")["rms_error_m"].median()
        curve = curves(panel)[to_hex(handle.get_color())]
        np.testing.assert_array_equal(curve[:, 0], [1.0, 2.0, 4.0])
        np.testing.assert_allclose(curve[:, 1], expected)


def test_legend_of_a_campaign_is_beside_its_panels(grid):
    figure = key_figure(grid, "ranging.sigma", ["cna.speed"])
    figure.draw_without_rendering()
    right = max(axes.get_window_extent().x1 for axes in figure.axes)
    assert figure.legends[0].get_window_extent().x0 >= right


@pytest.mark.parametrize(
    ("key", "values", "said"),
    [
        ("cna.speed", [1.0, 2.0], "cna.speed: cruising speed [m/s]"),
        ("auv.0.first_estimate.x", [1.0, 2.0], "auv.0.first_estimate.x: east [m]"),
        ("duration", [60.0, 90.0], "duration: of the mission [s]"),
        ("auv.1.weight", [1.0, 2.0], "auv.1.weight: weight in the planner's objective [-]"),
        ("planner.hold", [1.0, 2.0], "planner.hold: time a turn is held [s]"),
        ("planner.mine", [1.0, 2.0], "planner.mine [-]"),
        ("ranging.kind", ["a", "b"], "ranging.kind: what is measured with Gaussian error"),
    ],
)
def test_varied_keys_are_axes_with_their_meaning_and_unit(key, values, said):
    errors = {("pond", "circle", value): [1.0, 2.0] for value in values}
    table = table_of(errors, keys=(key,))
    (panel,) = key_figure(table, key).axes
    assert panel.get_xlabel() == said
    two = table.assign(other=0.5).rename(columns={"other": "cna.speed2"})
    columns = list(table.columns)
    two = two[[*columns[:3], "cna.speed2", *columns[3:]]]
    panel = map_figure(two, (key, "cna.speed2")).axes[0]
    assert panel.get_xlabel() == said
    assert panel.get_ylabel() == "cna.speed2 [-]"


# --- limits ---------------------------------------------------------------------------------------


@pytest.fixture
def trespass():
    """Circle has the lowest error and breaks a limit at the greater sigma; gramian keeps them."""
    errors = {
        ("pond", planner, sigma): [base + 0.01 * k for k in range(8)]
        for planner, base in (("circle", 1.0), ("gramian", 2.0))
        for sigma in (1.0, 2.0)
    }
    violations = {labels: [-1.0 - k for k in range(8)] for labels in errors}
    violations["pond", "circle", 2.0] = [-1.0] * 5 + [0.25, 3.5, 0.0004]
    return table_of(errors, keys=("ranging.sigma",), violations=violations)


def test_medians_count_missions_that_broke_a_limit_and_tell_the_worst(trespass):
    found = medians(trespass).set_index(["planner", "ranging.sigma"])
    assert found.loc[("circle", 2.0), ["violated", "violation_worst_m"]].tolist() == [2, 3.5]
    assert found.loc[("circle", 1.0), ["violated", "violation_worst_m"]].tolist() == [0, -1.0]
    free = medians(table_of({("pond", "circle"): [1.0, 2.0]}))
    assert free["violated"].tolist() == [0]
    assert free["violation_worst_m"].isna().all()


def test_table_on_the_terminal_has_a_column_of_limits_where_there_are_any(trespass, grid):
    columns = {c.header.plain: list(c.cells) for c in campaign_table(medians(trespass)).columns}
    assert columns["Limit broken by [m]"] == ["kept", "3.50 (in 2)", "kept", "kept"]
    assert not any("Limit" in c.header.plain for c in campaign_table(medians(grid)).columns)


def opened(panel):
    """Places of open symbols."""
    return sorted(
        float(line.get_xdata()[0])
        for line in panel.lines
        if line.get_marker() not in ("", "None", None) and same_color(line.get_mfc(), "white")
    )


def test_figures_mark_who_broke_a_limit_and_where(trespass, grid):
    figure = planners_figure(trespass)
    (panel,) = figure.axes
    assert [t.get_text() for t in panel.get_yticklabels()] == ["circle †", "gramian"]
    assert len(opened(panel)) == 1
    assert "†: broke a limit" in figure.get_supxlabel()
    figure = key_figure(trespass, "ranging.sigma")
    assert opened(figure.axes[0]) == [2.0]
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["circle †", "gramian"]
    assert "†" not in planners_figure(grid).get_supxlabel()
    columns = list(trespass.columns)
    two = trespass.assign(**{"cna.speed": 1.0})[[*columns[:3], "cna.speed", *columns[3:]]]
    circle, gramian = map_figure(two, ("ranging.sigma", "cna.speed")).axes[:2]
    assert circle.get_title() == "circle †"
    assert [text.get_text().endswith("†") for text in circle.texts] == [False, True]
    assert not any("†" in text.get_text() for text in gramian.texts)


def test_words_are_an_axis_too():
    table = table_of(
        {("pond", "circle", kind): [1.0, 2.0] for kind in ("range", "squared-range")},
        keys=("ranging.kind",),
    )
    (panel,) = key_figure(table, "ranging.kind").axes
    assert [label.get_text() for label in panel.get_xticklabels()] == ["range", "squared-range"]


def test_maps_have_a_field_per_setting_on_one_scale(grid):
    panels = map_figure(grid, ("ranging.sigma", "cna.speed")).axes[:2]
    meshes = [panel.collections[0] for panel in panels]
    for mesh, planner in zip(meshes, ("circle", "gramian"), strict=True):
        here = grid[grid["planner"] == planner]

        def chosen(speed, sigma, here=here):
            return here[(here["cna.speed"] == speed) & (here["ranging.sigma"] == sigma)]

        expected = [
            [np.median(chosen(speed, sigma)["rms_error_m"]) for sigma in (1.0, 2.0, 4.0)]
            for speed in (1.0, 3.0)
        ]
        np.testing.assert_allclose(mesh.get_array().reshape(2, 3), expected)
    assert len({mesh.get_clim() for mesh in meshes}) == 1


def test_planners_keep_their_colours_from_figure_to_figure(grid):
    dots = {
        to_hex(line.get_mfc())
        for line in planners_figure(grid).axes[0].lines
        if line.get_marker() in MARKERS
    }
    assert dots == set(curves(key_figure(grid, "cna.speed").axes[0]))
    alone = grid[grid["planner"] == "gramian"]
    assert set(curves(key_figure(alone, "cna.speed").axes[0])) < dots


def test_figures_are_those_the_table_can_fill(grid):
    assert list(figures(grid)) == [
        "planners.png", "error-vs-ranging.sigma.png", "error-vs-cna.speed.png", "map-pond-ranging.sigma-cna.speed.png",
    ]  # fmt: skip
    assert list(figures(grid[grid["cna.speed"] == 1.0])) == [
        "planners.png",
        "error-vs-ranging.sigma.png",
    ]


def test_table_on_the_terminal_has_a_row_per_setting_and_says_what_it_leaves_out(grid, monkeypatch):
    assert campaign_table(medians(grid)).row_count == 12
    monkeypatch.setattr(module, "MOST_ROWS", 5)
    short = campaign_table(medians(grid))
    assert (short.row_count, short.caption) == (5, "and 7 more in medians.csv")


@pytest.mark.slow
def test_report_of_a_campaign_from_the_command_line(tmp_path, monkeypatch, capsys):
    pond = write_scenario(tmp_path, duration=10.0, diverging=True)
    vary = ["--vary", DIVERGES, "--vary", "ranging.sigma=1.0,2.0"]
    finish(
        start(
            pond,
            "--planners",
            "circle,stationary",
            *vary,
            "--runs",
            5,
            "--workers",
            1,
            "--out",
            tmp_path / "out",
        ),
        code=3,
    )
    monkeypatch.setattr("sys.argv", ["obsplan", "campaign-report", str(tmp_path / "out")])
    with pytest.raises(SystemExit, match="0"):
        main()
    told = capsys.readouterr().out
    assert "20 of 40 missions failed and are left out" in told
    report = tmp_path / "out/report"
    assert {path.name for path in report.iterdir()} == {
        "medians.csv", "pairs.csv", "planners.png", "error-vs-estimator.drift.png", "error-vs-ranging.sigma.png",
        "map-pond-estimator.drift-ranging.sigma.png",
    }  # fmt: skip
    for figure in report.glob("*.png"):
        assert image.imread(figure).std() > 0.05  # something is drawn
    with (report / "medians.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [line["failed"] for line in lines] == ["0", "0", "5", "5"] * 2
    assert all(
        float(line["rms_error_m_low"])
        <= float(line["rms_error_m"])
        <= float(line["rms_error_m_high"])
        for line in lines[:2]
    )
    before = {path.name: path.read_bytes() for path in report.iterdir()}
    (report / "error-vs-old.png").write_text("of an earlier campaign")
    (report / "notes.txt").write_text("mine")
    assert set(write_campaign_report(tmp_path / "out").files) == set(before)
    assert {path.name: path.read_bytes() for path in report.iterdir()} == before | {
        "notes.txt": b"mine"
    }


def test_report_of_no_campaign_is_one_sentence(tmp_path):
    with pytest.raises(
        ObsplanError, match="has no campaign; give the folder that `obsplan campaign --out` made"
    ):
        write_campaign_report(tmp_path)
