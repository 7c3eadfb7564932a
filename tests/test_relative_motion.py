"""The index of relative motion against singular values, and the planner on it against brute force."""

import math

import numpy as np
import pytest

import obsplan as op
from formulations import relative_motion_index
from obsplan.thesis.study_measure import INSTANTS, RelativeMotion

CNA = op.Unicycle(speed=1.2, min_turn_radius=0.6)


def by_singular_values(x, v, time_scale=1.0):
    sigma = np.linalg.svd(np.array([x, time_scale * np.asarray(v)]), compute_uv=False)
    return sigma[1] / sigma[0]


def test_index_is_the_inverse_condition_number_of_the_gradients_of_range_and_rate():
    rng = np.random.default_rng(4)
    x, v = rng.normal(size=(2, 40)) * 3, rng.normal(size=(2, 40))
    got = relative_motion_index((x[0], x[1]), (v[0], v[1]), 2.5)
    expected = [by_singular_values(x[:, k], v[:, k], 2.5) for k in range(40)]
    np.testing.assert_allclose(got, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("v", "index"), [((0.0, 2.0), 1.0), ((2.0, 0.0), 0.0), ((0.0, 1.0), 0.5), ((0.0, 8.0), 0.25)]
)
def test_index_falls_with_the_ratio_of_lengths_and_vanishes_along_the_line_of_sight(v, index):
    assert relative_motion_index((2.0, 0.0), v) == pytest.approx(index, abs=1e-15)


def test_planner_takes_the_turn_whose_arc_has_the_greatest_mean_index():
    pose, auvs = op.Pose(3.0, -1.0, 0.7), [(0.5, 1.0, 2.0, 0.4), (-2.0, 0.0, -1.0, 0.9)]
    weights, horizon = (1.0, 3.0), 1.8
    planner = RelativeMotion(op.Situation(CNA), turn_rates=7, horizon=horizon)
    beliefs = [
        op.Belief.at(east, north, heading=heading, speed=speed, weight=weight)
        for (east, north, heading, speed), weight in zip(auvs, weights, strict=True)
    ]
    means = []
    for rate in np.linspace(2.0, -2.0, 7):
        total = 0.0
        for (east, north, heading, speed), weight in zip(auvs, weights, strict=True):
            drift = speed * np.exp(1j * heading)
            for t in horizon * np.arange(1, INSTANTS + 1) / INSTANTS:
                turned = np.exp(1j * (pose.heading + rate * t))
                moved = 1.2 * (turned - np.exp(1j * pose.heading)) / (1j * rate) if rate else 0.0
                moved = moved if rate else 1.2 * t * np.exp(1j * pose.heading)
                x = complex(pose.x, pose.y) + moved - complex(east, north) - drift * t
                v = 1.2 * turned - drift
                total += weight * by_singular_values([x.real, x.imag], [v.real, v.imag])
        means.append(total / (sum(weights) * INSTANTS))
    decision = planner.plan(pose, beliefs)
    assert decision.turn_rate == pytest.approx(np.linspace(2.0, -2.0, 7)[np.argmax(means)])
    assert decision.score == pytest.approx(1.0 - max(means), rel=1e-12)


def test_planner_turns_with_the_world_and_is_named_in_a_scenario():
    planner, auv = RelativeMotion(op.Situation(CNA)), op.Belief.at(0.0, 0.0)
    turns = [
        planner.plan(op.Pose(5 * math.cos(a), 5 * math.sin(a), a + 1.0), [auv]).turn_rate
        for a in np.linspace(0.0, 6.0, 9)
    ]
    np.testing.assert_array_equal(turns, turns[0])
    kind = "obsplan.thesis.study_measure:RelativeMotion"
    assert isinstance(op.load("fixed-auv", planner=kind).planner(), RelativeMotion)
