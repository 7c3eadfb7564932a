"""Several positions that fit, as planners are told of them: as the last report said, and no more."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

import obsplan as op
from obsplan.cli import app
from obsplan.report.files import scenario_toml
from obsplan.types import Belief, Hypothesis

ORIGIN = {"lat": 47.6, "lon": -122.3}
DROPPED = 24e-6  # share of those too unlikely to be kept, each within 200 m
HALF = 50.0  # [m] the AUV passes the aid vehicle's line at, on the side where it is not expected


def mirror(**changes):
    """A straight pass whose first estimate is on the wrong side of the aid vehicle's line."""
    survey = {"kind": "waypoints", "points": [[-100.0, HALF], [300.0, HALF]]}
    first = {"x": -100.0, "y": -HALF, "heading_deg": 0.0, "speed": 1.0}
    sigmas = {"sigma_position": 50.0, "sigma_heading_deg": 1.0, "sigma_speed": 0.02}
    auv = {"name": "auv-1", "speed": 1.0, "survey": survey, "first_estimate": first | sigmas}
    data = {
        "origin": ORIGIN,
        "duration": 60.0,
        "time_step": 0.5,
        "cna": {"speed": 2.0, "min_turn_radius": 10.0, "start": {"x": -200.0}},
        "auv": [auv],
        "ranging": {"interval": 10.0, "kind": "range", "sigma": 1.0, "heading_sigma_deg": 2.0},
        "planner": {"kind": "stationary"},
    }
    return op.from_dict(data | changes)


class Witness:
    """Goes straight on, and keeps what it is told."""

    def __init__(self):
        self.told = {}

    def plan(self, pose, auvs, *, time=0.0):
        self.told[time] = auvs[0]
        return op.Decision(turn_rate=0.0, speed=1.0)


def told(scenario):
    """Beliefs by time, and the run."""
    witness = Witness()
    run = op.simulate(scenario, planner=witness)
    return witness.told, run


def together(known):
    """Mean and covariance of the positions of a Gaussian sum."""
    shares = np.array([one.share for one in known])
    means = np.array([one.mean[:2] for one in known])
    mean = shares @ means
    apart = means - mean
    inside = sum(one.share * one.covariance[:2, :2] for one in known)
    return mean, inside + (apart * shares[:, None]).T @ apart


def test_hypotheses_together_are_mean_and_covariance_that_are_told():
    beliefs, run = told(mirror())
    several = {time: belief for time, belief in beliefs.items() if belief.hypotheses}
    assert min(several) == 10.0  # the first range
    for time, belief in several.items():
        mean, P = together(belief.hypotheses)
        np.testing.assert_allclose(mean, belief.mean[:2], atol=DROPPED * 200.0)
        if time % 10.0 == 0.0:  # reported now
            np.testing.assert_allclose(P, belief.covariance[:2, :2], atol=DROPPED * 200.0**2)
    north = sum(one.share for one in several[10.0].hypotheses if one.mean[1] > 0)
    assert 0.01 < north < 0.99
    assert run.hypotheses.max() > 1


def test_hypotheses_are_those_of_the_last_report_dead_reckoned_since():
    beliefs, _ = told(mirror())
    then, later = beliefs[20.0].hypotheses, beliefs[25.0].hypotheses
    moved = beliefs[25.0].mean - beliefs[20.0].mean
    assert [one.share for one in later] == [one.share for one in then]
    for before, after in zip(then, later, strict=True):
        np.testing.assert_allclose(after.mean, before.mean + moved, atol=1e-9)
        heading, speed = before.mean[2:]
        # position noise is none here: what grows comes from heading and speed over 5 s
        F = np.eye(4)
        F[0, 2], F[1, 2] = -5 * speed * np.sin(heading), 5 * speed * np.cos(heading)
        F[:2, 3] = 5 * np.cos(heading), 5 * np.sin(heading)
        np.testing.assert_allclose(after.covariance, F @ before.covariance @ F.T, atol=1e-9)


@pytest.mark.parametrize("late", [0.0, 10.0])
def test_planner_knows_no_sooner_than_reports_arrive(late):
    beliefs, _ = told(mirror(communication={"latency": late} if late else {}))
    assert min(time for time, belief in beliefs.items() if belief.hypotheses) == 10.0 + late


def test_planner_that_hears_nothing_is_told_of_no_hypotheses():
    planner = {"kind": "stationary", "knowledge": "survey"}
    beliefs, run = told(mirror(communication={"reports": "none"}, planner=planner))
    assert run.hypotheses.max() > 1
    assert not any(belief.hypotheses for belief in beliefs.values())


def test_one_position_is_no_hypothesis():
    beliefs, _ = told(mirror(estimator={"hypotheses": 1}))
    assert all(belief.hypotheses == () for belief in beliefs.values())


def test_shares_that_are_no_probabilities_are_refused():
    one = Hypothesis(0.7, np.zeros(4), np.eye(4))
    with pytest.raises(ValueError, match="add up to 1"):
        Belief(mean=np.zeros(4), covariance=np.eye(4), hypotheses=(one, one))


def test_run_announces_when_two_positions_fit_and_when_one_is_left(tmp_path):
    beside = {"speed": 2.0, "min_turn_radius": 10.0, "start": {"x": -100.0}}
    run = op.simulate(mirror(duration=60.0, cna=beside, planner={"kind": "information"}))
    counts = run.hypotheses[0]
    last = run.time[np.flatnonzero(counts > 1)[-1] + 1]
    file = tmp_path / "mirror.toml"
    file.write_text("".join(scenario_toml(run)))
    out = str(tmp_path / "out")
    done = CliRunner().invoke(app, ["run", str(file), "--no-bound", "--out", out])
    (sentence,) = re.findall(r"^auv-1: \w+ positions fit since .*$", done.output, re.MULTILINE)
    assert f"one left at 00:{int(last) // 60:02}:{int(last) % 60:02}." in sentence
