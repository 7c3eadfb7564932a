"""Claims about tables and sentences."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from scipy.stats import chi2

from formulations.solution import Status
from obsplan.report import compare_table, planner_notes, run_table, verdicts
from obsplan.report.verdict import INSIDE, mirror, sentence
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


@pytest.mark.parametrize(
    ("nees", "word"),
    [(0.4, "cautious"), (0.6, "consistent"), (3.9, "consistent"), (4.1, "overconfident")],
)
def test_filter_is_judged_by_its_mean_nees(run, nees, word):
    assert f"filter {word} (NEES {nees} where 2 is expected, inside its 95 % ellipse" in said(
        run, mean_nees=nees
    )


def test_share_of_time_inside_the_ellipse_is_counted(run):
    error = np.zeros((201, 2))
    error[:50, 0] = 3.0  # of 201; beyond sqrt(5.991) = 2.45 σ
    assert "inside its 95 % ellipse 75 % of the time" in said(
        estimated(run, run.truth[0, :, :2] + error, 1.0)
    )


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
    run = simulate("survey-slow", planner="stationary", seed=3)
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
