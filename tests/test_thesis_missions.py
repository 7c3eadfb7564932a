"""What the thesis claims of several AUVs, of the Gramian method and of localization."""

import math

import numpy as np
import pytest
import xarray as xr
from scipy.stats import binomtest

import obsplan as op
from formulations import displacement_moments
from obsplan.planning.fallback import two_thirds_turn
from obsplan.simulation import ClosedLoop
from obsplan.thesis import (
    ITEMS,
    study_blend,
    study_gramian,
    study_inertia,
    study_measure,
    study_speeds,
    tables,
)
from obsplan.thesis.flights import fly, pose, random_starts, scenario
from obsplan.thesis.groups import centroid_offset, static_formation, typical_condition
from obsplan.thesis.horizon import settled
from obsplan.thesis.marks import marks
from obsplan.thesis.montecarlo import fly_as_campaign, fly_grid, fly_here, interval
from obsplan.thesis.study_gramian import EulerHorizon
from obsplan.thesis.study_inertia import CovarianceWeighted, strayed

FEW = {"runs": 6, "seed": 3}
THIRTY_SECONDS = "duration=30.0"


def finding(name, **size):
    item = ITEMS[name]
    return item.found(item.compute(**(FEW | size)))


def test_mission_flies_from_the_start_it_is_given():
    setup = scenario("fixed-auv", "path-inertia", "duration=2.0")
    loop, start = ClosedLoop(scenario=setup, planner=setup.planner()), pose(3.0, -1.0, 20.0)
    np.testing.assert_array_equal(
        loop.fly(1, start=start).cna[0], [start.x, start.y, start.heading]
    )
    np.testing.assert_array_equal(loop.fly(1).cna[0], [1.0, 0.0, math.pi / 2])


def test_path_about_three_auvs_is_that_about_one_at_their_centroid():
    start = pose(0.5, 2.0, 130.0)
    three = fly(static_formation(), [start])
    one = fly(
        scenario(
            "fixed-auv",
            "path-inertia",
            "planner.gamma=1.0",
            "duration=300.0",
            "auv.0.survey.y=-0.3333333333333333",
        ),
        [start],
    )
    np.testing.assert_allclose(
        three.x, one.x, atol=1e-6
    )  # rounding over 3000 steps through some 60 passes of the centroid
    np.testing.assert_allclose(three.y, one.y, atol=1e-6)


def test_unequal_weights_leave_the_centroid():
    start = pose(0.5, 2.0, 130.0)
    uneven = scenario(
        "fixed-formation", "path-inertia", "planner.gamma=1.0", "duration=300.0", "auv.0.weight=5.0"
    )
    off = [
        np.hypot(*centroid_offset(fly(one, [start]))[0, -600:].mean(axis=0))
        for one in (static_formation(), uneven)
    ]
    assert off[0] < 0.4 < off[1]


@pytest.mark.slow
def test_equal_weights_do_not_give_equal_condition_numbers():
    assert finding("fig5.8").agrees
    condition = typical_condition(fly(static_formation(), random_starts(6, seed=2, half_width=3.0)))
    assert np.median(condition.max(axis=1) / condition.min(axis=1)) > 1.1


def test_moving_formation_is_followed_on_both_legs():
    assert finding("fig5.9").agrees


def test_gramian_method_spirals_into_a_circle_nearly_centred_on_the_auv():
    assert finding("fig5.10").agrees


def test_gramian_method_runs_away_outward_unless_the_heading_coupling_is_dropped():
    start = pose(4.0, 3.0, math.degrees(math.atan2(3.0, 4.0)))
    away = {}
    for variant in ("exact", "empirical", "thesis"):
        flown = fly(
            scenario("fixed-auv", "gramian", f'planner.gramian="{variant}"', THIRTY_SECONDS),
            [start],
        )
        away[variant] = float(flown.distance[0, 0, -1])
    assert away["exact"] > 30.0  # nearly 5 m and 30 s at 1 m/s
    assert away["empirical"] > 30.0
    assert away["thesis"] < 1.0


@pytest.mark.slow
def test_random_starts_settle_but_for_the_distant_outward_ones():
    data = ITEMS["fig5.11"].compute(runs=40, seed=1)
    share = {variant: settled(data.sel(gramian=variant)).mean() for variant in ("exact", "thesis")}
    assert share["thesis"] == 1.0
    assert 0.8 < share["exact"] < 1.0
    assert ITEMS["fig5.11"].found(data).agrees


@pytest.mark.slow
def test_separation_from_several_auvs_does_not_grow():
    assert finding("fig5.12").agrees


def test_point_reflection_about_a_beacon_at_rest_has_the_same_ranges_and_cannot_be_left():
    image = (
        "auv.0.first_estimate.x=4.0",
        "auv.0.first_estimate.y=0.0",
        "auv.0.first_estimate.speed=-1.0",
    )
    sure = (
        "auv.0.first_estimate.sigma_position=0.1",
        "auv.0.first_estimate.sigma_speed=0.1",
        "duration=180.0",
    )
    run = op.simulate(
        op.load("survey-slow", planner="stationary", settings=(*image, *sure)), seed=2
    )  # beacon at (1, 0), AUV at (-2, 0)
    assert marks(run)["at_point"] > 0.9
    off = run.mean[0, -1, :2] - (2 * run.cna[-1, :2] - run.truth[0, -1, :2])
    assert np.hypot(*off) < 1.0 < run.error[0, -1]
    right = op.simulate(
        op.load(
            "survey-slow",
            planner="stationary",
            settings=("auv.0.first_estimate.x=-2.0", "auv.0.first_estimate.speed=1.0", *sure),
        ),
        seed=2,
    )
    assert marks(right)["at_truth"] > 0.9


def test_share_of_seeds_has_the_interval_of_wilson():
    for k, n in ((3, 10), (50, 100), (99, 100), (0, 20)):
        exact = binomtest(k, n).proportion_ci(method="wilson")
        np.testing.assert_allclose(
            interval(k / n, n), (exact.low, exact.high), atol=1e-4
        )  # 1.96 against 1.95996


def table_of(errors):
    """Data of a table, from errors by policy and seed."""
    return xr.Dataset(
        {"rms_error": (("policy", "seed"), np.array([*errors.values()]))},
        coords={"policy": [*errors]},
    )


def test_orderings_are_reproduced_reversed_or_undecided():
    seeds = np.arange(40.0)
    errors = {
        "Path Inertia": seeds,
        "Empirical Gramian": seeds + 1,
        "Circular": np.where(seeds % 2 == 0, seeds + 2, seeds),
        "Stationary": seeds,
    }
    data = table_of(errors)
    assert tables.holds(data.rms_error, "Path Inertia", "Empirical Gramian") == (1.0, True)
    assert tables.holds(data.rms_error, "Empirical Gramian", "Path Inertia") == (0.0, False)
    assert tables.holds(data.rms_error, "Empirical Gramian", "Circular") == (0.5, None)
    assert tables.orderings("survey-slow")[0] == ("Path Inertia", "Stationary")
    assert ("Circular", "Stationary") in tables.orderings("survey-fast")


@pytest.mark.slow
def test_grid_holds_each_mission_in_its_place():
    cases = {
        (g, str(s)): op.load(
            "fixed-auv", settings=(f"planner.gamma={g}", f"ranging.sigma={s}", "duration=3.0")
        )
        for g in "01"
        for s in (0.1, 0.5)
    }
    data = fly_grid(cases, ("gamma", "sigma"), range(4, 6))
    assert data.rms_error.dims == ("gamma", "sigma", "seed")
    for (gamma, sigma), one in cases.items():
        for seed in (4, 5):
            run = op.simulate(one, seed=seed)
            assert float(data.rms_error.sel(gamma=gamma, sigma=sigma, seed=seed)) == run.rms_error
            assert float(data.max_error.sel(gamma=gamma, sigma=sigma, seed=seed)) == run.max_error


@pytest.mark.slow
def test_campaign_gives_what_flying_here_gives():
    cases = [(one, range(1, 4)) for one in strayed_pair()]
    assert fly_as_campaign(cases) == [fly_here(*case) for case in cases]


def strayed_pair():
    """Two missions of three AUVs, and the first once more."""
    first, second = (strayed(f"auv.0.weight={weight}", "duration=10.0") for weight in (1.0, 2.0))
    return first, second, first


def test_euler_horizon_goes_to_the_integrals_with_its_steps():
    cna = op.Unicycle(speed=1.0, min_turn_radius=0.5)
    exact = displacement_moments(
        1.0, EulerHorizon(op.Situation(cna), 1).candidates, two_thirds_turn(cna)
    )
    errors = [
        max(
            np.abs(a[0] - b[0]).max()
            for a, b in zip(EulerHorizon(op.Situation(cna), n).moments(), exact, strict=True)
        )
        for n in (100, 200, 400)
    ]
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 2.0, rtol=0.05)  # first order


def test_weights_that_follow_covariances_are_their_traces():
    cna = op.Unicycle(speed=1.0, min_turn_radius=0.5)
    plain = op.PathInertia(op.Situation(cna), gamma=1.0)
    covariances = [np.diag([4.0, 1.0, 0.1, 0.1]), np.diag([0.5, 0.5, 0.1, 0.1])]
    place = [(3.0, 1.0), (-2.0, 4.0)]
    given = [op.Belief.at(*p, covariance=P) for p, P in zip(place, covariances, strict=True)]
    weighted = [op.Belief.at(*p, weight=w) for p, w in zip(place, (5.0, 1.0), strict=True)]
    at = op.Pose(0.0, 0.0, 0.3)
    assert (
        CovarianceWeighted(plain.situation, plain).plan(at, given).turn_rate
        == plain.plan(at, weighted).turn_rate
    )
    assert (
        CovarianceWeighted(plain.situation, plain).plan(at, given).turn_rate
        != plain.plan(at, given).turn_rate
    )


@pytest.fixture
def coarse(monkeypatch):
    """Studies of fewer cases and shorter surveys."""
    short = ("auv.0.survey.legs=1", "auv.0.survey.length=8.0")
    for study in (study_gramian, study_inertia, study_measure):
        monkeypatch.setattr(study, "SMALL", short)
    monkeypatch.setattr(study_gramian, "HORIZONS", (1 / 6, 2 / 3, 4.0))
    monkeypatch.setattr(study_gramian, "EULER_STEPS", (1, 5, 21))
    monkeypatch.setattr(study_blend, "WEIGHTS", (1.0, 30.0))
    monkeypatch.setattr(study_inertia, "WEIGHTS", (study_inertia.EQUAL, 0.7))
    monkeypatch.setattr(study_speeds, "RATIOS", (1.0, 10.0))
    surveys = {name: study_speeds.SURVEYS[name] for name in ("lawnmower", "straight")}
    monkeypatch.setattr(study_speeds, "SURVEYS", surveys)
    # of the table's grid only the first row of each block: it has nearly thirty
    for grid in ("CHANGES", "OURS"):
        monkeypatch.setattr(tables, grid, dict(list(getattr(tables, grid).items())[:1]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name in ITEMS if name.startswith("study-")] + ["table5.2"]
)
@pytest.mark.usefixtures("coarse")
def test_study_is_computed_drawn_and_answered(name):
    item = ITEMS[name]
    data = item.compute(runs=2, seed=1)
    item.draw(data)
    assert len(item.found(data).sentence) > 100
    if item.asks:
        heading, *rows = item.rows(data)
        assert {len(row) for row in rows} == {len(heading)}
        assert "the reference" in {cell for row in rows for cell in row}


def test_every_item_of_the_thesis_is_there_and_every_question():
    figures = (
        ["fig2.1", "eq4.6", "figA.1", "figA.2"]
        + [f"fig5.{k}" for k in range(1, 13)]
        + ["table5.1", "table5.2"]
        + [f"figB.{k}" for k in range(1, 9)]
    )
    questions = [
        f"study-{name}"
        for name in ("horizon", "aggregate", "weights", "blend", "speeds", "curvature", "measure")
    ]
    assert sorted(ITEMS) == sorted(figures + questions)
