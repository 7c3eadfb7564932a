"""Claims about tables and sentences."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from scipy.stats import chi2

from formulations.solution import Status
from obsplan.report import compare_table, limit_notes, planner_notes, run_table, verdicts
from obsplan.report.consistency import INSIDE
from obsplan.report.verdict import mirror, sentence
from obsplan.report.words import title
from obsplan.scenario import from_dict, load
from obsplan.simulation import simulate

FIGURES = {
    "rms_error_m": 1.0,
    "max_error_m": 5.0,
    "mean_nees": 2.0,
    "pcrb_rms_m": 1.5,
    "separation_mean_m": 3.0,
    "separation_max_m": 5.0,
}


@pytest.fixture(scope="module")
def run():
    """An AUV at rest at (0, 0), the aid vehicle on the unit circle about it."""
    return simulate("fixed-auv", seed=3)


def said(run, **figures):
    """The sentence with some figures replaced."""
    return sentence(run, 0, FIGURES | figures)


def estimated(run, mean, sigma):
    """The run as if the filter had said so: position (samples, 2) and standard deviation [m]."""
    states = run.mean.copy()
    states[0, :, :2] = mean
    return replace(
        run,
        mean=states,
        covariance=np.broadcast_to(sigma**2 * np.eye(4), run.covariance.shape).copy(),
    )


def shown(table):
    console = Console(width=200, color_system=None)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


# --- sentences -----------------------------------------------------------------------------------------------------------------------


def test_each_auv_has_one_sentence_that_begins_with_its_name():
    run = simulate("fixed-formation")
    sentences = verdicts(run)
    assert [s.split(":")[0] for s in sentences] == ["top", "left", "right"]
    for s in sentences:
        assert s.endswith(".")
        assert ". " not in s
        assert f"{run.summary()['auv'][s.split(':')[0]]['rms_error_m']:.2f} m RMS" in s


def test_95_percent_ellipse_is_that_of_chi_square():
    assert chi2.cdf(INSIDE, 2) == pytest.approx(0.95, abs=1e-4)


def judged(run, nees, samples):
    """The sentence on a filter of that mean NEES, in a run worth so many independent errors."""
    worth = replace(run)
    worth.__dict__["independent_errors"] = np.array([samples])
    return said(worth, mean_nees=nees)


@pytest.mark.parametrize("samples", [6.0, 12.5, 40.0, 400.0])
def test_filter_is_judged_by_the_chi_square_interval_of_its_independent_errors(run, samples):
    low, high = (chi2.ppf(q, 2 * samples) / samples for q in (0.025, 0.975))
    for nees, word in (
        (0.99 * low, "cautious"),
        (1.01 * low, "consistent"),
        (0.99 * high, "consistent"),
        (1.01 * high, "overconfident"),
    ):
        sentence_ = judged(run, nees, samples)
        assert f"filter {word} (NEES {nees:.3g}; chance allows {low:.1f} to {high:.1f}" in sentence_
        assert f"for about {samples:.0f} independent errors" in sentence_


@pytest.mark.parametrize("samples", [1.0, 3.0, 4.5])
def test_too_few_independent_errors_are_no_evidence_unless_they_are_extreme(run, samples):
    assert "whether its filter is consistent cannot be told" in judged(run, 2.0, samples)
    assert "filter overconfident" in judged(run, 50.0, samples)
    assert "filter cautious" in judged(run, 0.001, samples)
    one = judged(run, 2.0, 1.0)
    assert "(NEES 2 of about 1 independent error)" in one


def test_run_that_is_said_to_be_consistent_is_never_said_to_be_seldom_inside_its_ellipse(run):
    error = np.zeros((201, 2))
    error[:50, 0] = 3.0  # of 201; beyond sqrt(5.991) = 2.45 σ
    odd = estimated(run, run.truth[0, :, :2] + error, 1.0)
    assert "inside its 95 % ellipse 75 % of the time" in judged(odd, 9.0, 20.0)
    assert "ellipse" not in judged(odd, 2.0, 20.0)


def test_independent_errors_of_a_run_are_fewer_than_its_ranges():
    slow = simulate("survey-slow", planner="circle", seed=3)
    assert 1 <= slow.independent_errors[0] < np.isfinite(slow.range).sum()


# --- limits --------------------------------------------------------------------------------------


def limited(run, **limits):
    """The run under limits that nobody kept it within."""
    table = run.scenario.table
    data = table.model_dump(mode="json", exclude_none=True) | {"constraints": limits}
    return replace(run, scenario=from_dict(data))


def test_every_limit_broken_is_told_by_its_name_with_how_much_when_and_where(run):
    """The aid vehicle circles (0, 0) at a distance of 1 m, from (1, 0) on."""
    circled = limited(
        run,
        keep_out=[{"x": 50.0, "y": 0.0, "radius": 1.0}, {"x": 0.0, "y": 1.25, "radius": 0.5}],
        geofence=[[-0.75, -5.0], [5.0, -5.0], [5.0, 5.0], [-0.75, 5.0]],
        min_separation=1.5,
        max_separation=2.0,
    )
    inside, outside, near = limit_notes(circled)
    k = int(np.argmin(np.hypot(run.cna[:, 0], run.cna[:, 1] - 1.25)))
    assert inside.startswith("Keep-out 2 was broken by up to 0.25 m after ")
    assert f"(aid vehicle at east {run.cna[k, 0]:.1f} m, north 1.0 m)" in inside
    assert f" {run.time[k]:.0f} s " in inside
    held = np.hypot(run.cna[:, 0], run.cna[:, 1] - 1.25) < 0.5
    assert inside.endswith(f", for {0.1 * held.sum():.0f} s in all.")
    assert outside.startswith("The geofence was broken by up to 0.25 m after ")
    assert "(aid vehicle at east -1.0 m, north " in outside
    assert near.startswith("Least separation from alpha (1.5 m) was broken by up to 0.50 m ")
    assert near.endswith(", for 20 s in all.")


def test_greatest_separation_is_told(run):
    (far,) = limit_notes(limited(run, max_separation=0.75))
    assert far.startswith("Greatest separation from alpha (0.75 m) was broken by up to 0.25 m ")


def test_limits_that_were_kept_are_told_with_the_closest(run):
    kept = limited(
        run, keep_out=[{"x": 0.0, "y": 4.0, "radius": 1.0}], max_separation=9.0, min_separation=0.5
    )
    (told,) = limit_notes(kept)
    assert told.startswith(
        "No limit was broken; the closest was least separation from alpha (0.5 m), with 0.50 m to spare "
    )
    (told,) = limit_notes(limited(run, keep_out=[{"x": 0.0, "y": 2.25, "radius": 1.0}]))
    assert "the closest was keep-out 1, with 0.25 m to spare after " in told


def test_what_has_no_limits_has_no_word_about_them(run):
    assert limit_notes(run) == []


def test_singular_covariance_has_no_verdict_on_the_filter(run):
    assert "filter" not in said(run, mean_nees=None)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"rms_error_m": 3.0}, ", 2.0 times its Cramér–Rao bound of 1.50 m;"),
        ({"rms_error_m": 1.0}, ", below its average Cramér–Rao bound of 1.50 m;"),
        (
            {"pcrb_rms_m": 20.0, "bound_rms_m": 15.0},
            " bound of 20.0 m, which no path brings below 15.0 m (efficiency 75 %);",
        ),
        ({"pcrb_rms_m": 150.0, "bound_rms_m": None}, " bound of 150 m;"),
    ],
)
def test_error_is_set_beside_its_bounds(run, figures, words):
    assert words in said(run, **figures)


@pytest.mark.parametrize("pcrb", [None, 0.0])
def test_missing_bound_is_not_mentioned(run, pcrb):
    assert "Cramér" not in said(run, pcrb_rms_m=pcrb)


@pytest.mark.parametrize(
    ("k", "stretch", "when"),
    [(2, 1, "at the start"), (100, 1, "after 10 s"), (100, 100, "after 16.7 min")],
)
def test_worst_error_is_told_with_its_time(run, k, stretch, when):
    error = np.zeros((201, 2))
    error[k] = 5.0
    late = replace(estimated(run, run.truth[0, :, :2] + error, 1.0), time=run.time * stretch)
    assert f"(worst 5.00 m, {when})" in said(late)


def test_anchored_beacon_that_lost_its_auv_to_the_mirror_image_is_told():
    alone = load("survey-slow", planner="stationary", settings=["estimator.hypotheses=1"])
    run = simulate(alone, seed=3)
    assert run.rms_error > 50  # else the claim is empty
    (verdict,) = verdicts(run)
    assert verdict.startswith(f"alpha: position lost, {run.rms_error:.1f} m RMS off")
    assert "locked on a mirror image" in verdict
    assert "stationary aid vehicle cannot tell" in verdict


def test_straight_pass_that_put_the_auv_on_the_other_side_is_told(run):
    t = np.linspace(-1.0, 1.0, 201)
    path = np.stack(
        [10 * t, 10 * t, 0 * t], axis=-1
    )  # along y = x, past an AUV at (-3, 3): its image is at (3, -3)
    truth = run.truth.copy()
    truth[..., :2] = [-3.0, 3.0]
    passed = replace(run, cna=path, truth=truth)
    assert "mirror image" in said(estimated(passed, [3.0, -3.0], 0.1))
    assert "straight line: ranges cannot tell left from right" in said(
        estimated(passed, [-3.0, 3.0], 0.1)
    )


def test_estimate_whose_ranges_fit_elsewhere_is_told(run):
    turned = run.cna[:, :2] @ np.array(
        [[0.0, 1.0], [-1.0, 0.0]]
    )  # on the circle about the aid vehicle, at right angles to the truth
    verdict = said(estimated(run, run.cna[:, :2] + turned, 0.01))
    assert "the ranges fit although the position does not" in verdict
    assert "mirror" not in verdict


def test_diverged_filter_is_told(run):
    assert "the filter has diverged" in said(estimated(run, [50.0, 0.0], 0.1))
    assert "lost" not in said(estimated(run, [50.0, 0.0], 50.0))  # it knows that it does not know


def test_estimate_that_is_no_number_is_told(run):
    mean = np.zeros((201, 2))
    mean[150:] = np.nan
    broken = estimated(run, mean, 1.0)
    assert verdicts(broken) == [
        "alpha: position lost after 15 s, where the filter's estimate stopped being a number."
    ]


def test_aid_vehicle_that_keeps_its_place_beside_the_auv_is_told(run):
    beside = replace(run, cna=np.broadcast_to([3.0, 4.0, 0.0], (201, 3)).copy())
    assert "ranges tell how far it is, not which way" in said(beside)
    assert "beware" not in said(run)  # it goes round


def test_separation_beyond_any_modem_is_told(run):
    assert "beware, 3000 m apart, where acoustic modems reach 2500 m at best" in said(
        run, separation_max_m=3000.0
    )
    assert "modem" not in said(run, separation_max_m=2000.0)


def test_reflection_across_the_diagonal_swaps_east_and_north():
    path = np.array([[0.0, 0.0], [5.0, 5.0], [9.0, 9.0]])
    np.testing.assert_allclose(
        mirror(np.array([[1.0, 2.0], [-4.0, 0.5], [3.0, 3.0]]), path),
        [[2.0, 1.0], [0.5, -4.0], [3.0, 3.0]],
        atol=1e-12,
    )


def test_decisions_that_were_no_optimum_are_told_with_advice(run):
    status = run.status.copy()
    assert planner_notes(run) == []
    status[:3], status[3] = Status.UNOBSERVABLE, Status.CLIPPED
    (note,) = planner_notes(replace(run, status=status))
    assert note == f"path-inertia: 3 of 200 decisions unobservable: {Status.UNOBSERVABLE.advice}."


# --- tables --------------------------------------------------------------------------------------------------------------------------


def test_table_has_a_row_per_auv_and_one_of_all_with_units():
    run = simulate("fixed-formation")
    text = shown(run_table(run))
    assert text.splitlines()[0].strip() == f"fixed-formation, path-inertia, seed {run.seed}"
    for heading in (
        "RMS error [m]",
        "Worst error [m]",
        "PCRB RMS [m]",
        "NEES [-]",
        "Max sep. [m]",
        "NEES: 2 if consistent",
    ):
        assert heading in text
    rows = [line.split("│")[1:-1] for line in text.splitlines() if "│" in line]
    assert [row[0].strip() for row in rows] == ["top", "left", "right", "all"]
    figures = [*run.summary()["auv"].values(), run.summary()["all"]]
    assert [float(row[1]) for row in rows] == [round(f["rms_error_m"], 2) for f in figures]
    assert [float(row[-1]) for row in rows] == [round(f["separation_max_m"], 1) for f in figures]


def test_table_fits_eighty_columns():
    console = Console(width=80, color_system=None)
    with console.capture() as capture:
        console.print(run_table(simulate("fixed-formation")))
    assert "…" not in capture.get()


def test_table_of_one_auv_has_no_row_of_all_and_a_dash_for_what_is_unknown(run):
    text = shown(run_table(estimated(run, [1.0, 0.0], 0.0)))
    assert " all " not in text
    assert "–" in text


def cells(text):
    return [[c.strip() for c in line.split("│")[1:-1]] for line in text.splitlines() if "│" in line]


def test_table_says_by_how_much_limits_were_broken_and_where_they_were_kept(run):
    assert "broken" not in shown(run_table(run))
    text = shown(run_table(limited(run, min_separation=1.25)))
    assert "Limit broken by [m]" in text
    assert cells(text)[-1][-1] == "0.25"
    assert cells(shown(run_table(limited(run, min_separation=0.5))))[-1][-1] == "kept"


def test_comparison_lists_planners_that_broke_a_limit_last_and_says_how_often():
    violations = {"trail": [2.5, -1.0, 0.5, -9.0], "circle": [-1.0, -2.0, -0.5, 0.0005]}
    rows = [
        {"planner": p, "seed": s, "rms_error_m": 1.0 + (p == "circle"), "max_error_m": 3.0}
        | {"separation_mean_m": 9.0, "violation_max_m": v}
        for p, values in violations.items()
        for s, v in enumerate(values)
    ]
    listed = cells(shown(compare_table(rows)))
    assert [row[0] for row in listed] == ["circle", "trail"]
    assert [row[-1] for row in listed] == ["kept", "2.50 (in 2 of 4)"]  # half a millimetre is none
    single = cells(shown(compare_table(rows[::4])))
    assert [row[-1] for row in single] == ["kept", "2.50"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("harbor-survey", "Harbor survey"),
        ("lake_2024-05-01", "Lake 2024-05-01"),
        ("M3000-run-2", "M3000 run 2"),
        ("AUV", "AUV"),
    ],
)
def test_names_of_files_become_titles(name, said):
    assert title(name) == said


ROWS = [
    {
        "planner": planner,
        "seed": seed,
        "rms_error_m": rms,
        "max_error_m": 2 * rms,
        "separation_mean_m": 7.0,
    }
    for planner, values in {
        "[bold]far": [30.0, 10.0, 20.0, 40.0],
        "near": [1.0, 3.0, 2.0, 200.0],
    }.items()
    for seed, rms in enumerate(values)
]


def test_comparison_over_seeds_has_medians_and_quartiles_the_best_first():
    text = shown(compare_table(ROWS))
    assert "median [quartiles] over 4 seeds" in text
    rows = [
        [cell.strip() for cell in line.split("│")[1:-1]]
        for line in text.splitlines()
        if "│" in line
    ]
    assert (
        rows
        == [  # sorted 1 2 3 200: quartiles by linear interpolation at 0.75, 1.5, 2.25 of the way
            ["near", "2.50 [1.75, 52.25]", "5.00 [3.50, 104.50]", "7.00 [7.00, 7.00]"],
            ["[bold]far", "25.00 [17.50, 32.50]", "50.00 [35.00, 65.00]", "7.00 [7.00, 7.00]"],
        ]
    )


def test_comparison_over_one_seed_has_the_figures_themselves():
    text = shown(compare_table(ROWS[::4]))
    assert "median" not in text
    assert [line.split("│")[2].strip() for line in text.splitlines() if "│" in line] == [
        "1.00",
        "30.00",
    ]


def test_comparison_counts_filters_that_failed_and_puts_them_last():
    failed = {
        "planner": "none",
        "seed": 0,
        "rms_error_m": None,
        "max_error_m": None,
        "separation_mean_m": 1.0,
    }
    text = shown(compare_table([failed, *ROWS]))
    rows = [
        [cell.strip() for cell in line.split("│")[1:-1]]
        for line in text.splitlines()
        if "│" in line
    ]
    assert rows[-1] == ["none", "1 of 1 failed", "1 of 1 failed", "1.00"]
