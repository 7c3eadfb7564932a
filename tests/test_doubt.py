"""How far positions are doubted: recounted by a plain filter, and what planners make of it."""

import math

import numpy as np
import pytest
from oracles import NumpyEkf, Spy, scenario

import obsplan as op
from formulations.beam_search import search_manoeuvres
from formulations.model.covariance import Tracks, conditioned
from formulations.model.ranging import Ranging
from formulations.model.schedule import Stages
from obsplan.types import ObsplanError

DOUBTED = {"planner__doubt": "innovations", "planner__knowledge": "estimate"}
ASTRAY = {"ranging__outliers": 0.3, "ranging__outlier_mean": 20.0, "duration": 60.0}


class Straight:
    """Heads on, whatever it is told."""

    def plan(self, pose, auvs, *, time=0.0):
        return op.Decision(turn_rate=0.0, speed=1.0)


def told_doubts(mission):
    """A run, and by time the doubts of its first AUV that a planner was told."""
    spy = Spy(Straight())
    run = op.simulate(mission, planner=spy)
    return run, {time: auvs[0].doubt for time, _, auvs, _ in spy.said}


def straight_on(**change):
    """A mission whose first AUV heads on and knows its heading: the compass tells it nothing."""
    survey = {"kind": "waypoints", "points": [[0.0, 0.0], [200.0, 90.0]]}
    surely = {"sigma_position": 2.0, "sigma_heading_deg": 0.0, "sigma_speed": 0.2}
    noise = {"position": 0.05}
    first = {"auv__0__survey": survey, "auv__0__first_estimate": surely}
    return scenario(**{**first, "auv__0__process_noise": noise, **ASTRAY, **change})


@pytest.mark.parametrize("kind", ["range", "squared-range"])
@pytest.mark.parametrize("latency", [0.0, 1.0])
def test_doubt_is_the_root_of_the_mean_excess_of_innovations_recounted_by_a_plain_filter(
    kind, latency
):
    sigma = 1.0 if kind == "range" else 150.0
    more = {"ranging__kind": kind, "ranging__sigma": sigma, "communication": {"latency": latency}}
    if kind == "squared-range":  # which has no outliers: it errs more than the filter is told
        more |= {"ranging__outliers": 0.0, "ranging__sigma": 10 * sigma}
        more |= {"estimator__ranging": {"sigma": sigma}}
    more |= {"estimator__gate": 0.0, "estimator__hypotheses": 1}  # the plain filter takes all
    run, told = told_doubts(straight_on(**more, **DOUBTED))
    dt, squared = run.time[1], kind == "squared-range"
    Q = np.diag([0.05, 0.05, 0.0, 0.0]) ** 2 * dt
    ekf = NumpyEkf(run.mean[0, 0].copy(), run.covariance[0, 0].copy(), Q, dt, (0.0, 0.0))
    excess, expected = 0.0, {0.0: 0.0}
    for k, time in enumerate(run.time[1:], start=1):
        ekf.predict(0.0, 0.0)
        z = run.range[0, k]
        if np.isfinite(z):
            beacon = run.cna[k, :2]
            d = math.hypot(*(ekf.x[:2] - beacon))
            u = (ekf.x[:2] - beacon) / d
            # in metres: a squared range is 2 d times as much
            error = (z - d * d) / (2 * d) if squared else z - d
            spread = sigma / (2 * d) if squared else sigma
            newest = error**2 - (u @ ekf.P[:2, :2] @ u + spread**2)
            excess += 0.25 * (newest - excess)
            ekf.range(z, beacon, sigma, squared)
            expected[round(float(time) + latency, 6)] = math.sqrt(max(excess, 0.0))
    last = 0.0
    for time, doubt in told.items():
        last = expected.get(round(time, 6), last)
        assert doubt == pytest.approx(last, rel=1e-6, abs=1e-6)
    assert max(expected.values()) > 3.0  # outliers are doubted
    assert any(doubt == 0 for doubt in expected.values())


def test_nothing_is_doubted_unless_asked_for():
    _, told = told_doubts(straight_on(planner__knowledge="estimate"))
    assert set(told.values()) == {0.0}


def test_doubt_that_nothing_reports_is_refused():
    with pytest.raises(ObsplanError, match=r'planner\.doubt.*set planner\.doubt = "none"'):
        scenario(
            communication={"reports": "none"},
            planner__knowledge="survey",
            planner__doubt="innovations",
        )


@pytest.mark.parametrize("form", ["horizontal", "squared", "slant"])
def test_doubt_adds_to_the_second_order_of_ranges_alone(form):
    P = np.array([[4.0, 1.0], [1.0, 2.0]])
    x, doubt, height, sigma = np.array([30.0, 40.0]), 6.0, 12.0, 1.5
    ranging = Ranging(sigma, squared=form == "squared", slant=form == "slant")
    given = P + doubt**2 * np.eye(2)
    if form == "slant":
        r = math.sqrt(x @ x + height**2)
        h, hessian = x / r, (np.eye(2) - np.outer(x, x) / r**2) / r
    elif form == "squared":
        h, hessian = 2 * x, 2 * np.eye(2)
    else:
        r = math.hypot(*x)
        h, hessian = x / r, (np.eye(2) - np.outer(x, x) / r**2) / r
    # E[(e' B e / 2)^2] of a Gaussian e (Jazwinski 1970, section 9.3)
    spread = hessian @ given
    second = (np.trace(spread) ** 2 + 2 * np.trace(spread @ spread)) / 4
    S = h @ P @ h + sigma**2 + second
    expected = P - np.outer(P @ h, P @ h) / S
    found = conditioned(P, x, ranging, 1.0, height if form == "slant" else 0.0, doubt)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_the_search_keeps_farther_from_a_doubted_auv():
    stages = Stages(np.full(6, 15.0), np.ones(6))
    tracks = Tracks(np.zeros((6, 1, 2)), np.zeros((6, 1)), np.zeros((6, 1)))
    nearest = []
    for doubt in (0.0, 10.0):
        best = search_manoeuvres(
            np.array([-60.0, 5.0, 0.0]),
            np.diag([2.0, 9.0, 0.0, 0.0])[None],
            tracks=tracks,
            process_noise=np.array([[0.1, 0.1, 0.0, 0.0]]),
            weights=np.ones(1),
            stages=stages,
            turn_rates=np.array([0.2, 0.07, 0.0, -0.07, -0.2]),
            speed=2.0,
            ranging=Ranging(1.0, squared=False),
            doubts=np.array([doubt]),
        )
        nearest.append(np.hypot(*best.poses[1:, :2].T).min())
    assert nearest[1] > 1.5 * nearest[0]


SLANT = {
    "ranging__geometry": "slant",
    "auv__0__depth": 20.0,
    "auv__1__depth": 20.0,
    "estimator__ranging": {"geometry": "horizontal"},
}
UNKNOWN = {"environment__current": [0.0, 0.0], "estimator__current": [0.2, 0.0]}


@pytest.mark.parametrize(
    ("planner", "sea"),
    [("trail", SLANT), pytest.param("information", UNKNOWN, marks=pytest.mark.slow)],
)
def test_filters_that_are_wrong_about_the_sea_err_less_where_they_are_doubted(planner, sea):
    late = {"none": [], "innovations": []}
    for doubt, errors in late.items():
        mission = op.load("harbor-survey").replace(planner=planner, **sea)
        # a gate that rejects what is far off leaves less to doubt
        mission = mission.replace(planner__doubt=doubt, estimator__gate=0.0)
        for seed in (1, 2, 3):
            run = op.simulate(mission, seed=seed)
            off = run.mean[..., :2] - run.truth[..., :2]
            errors.append(math.sqrt((off[:, run.time.size // 2 :] ** 2).sum(axis=-1).mean()))
    assert np.median(late["innovations"]) < 0.6 * np.median(late["none"])
