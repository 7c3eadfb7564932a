"""Smoothed tracks of simulated missions: each AUV alone is all of them together, and what is not done is said."""

from dataclasses import replace

import numpy as np
import pytest

import obsplan as op
from obsplan.simulation import afterwards
from obsplan.simulation.afterwards import with_smoothed

PASSES = {
    "name": "passes",
    "origin": {"lat": 47.6, "lon": -122.3},
    "duration": 80.0,
    "time_step": 0.5,
    "seed": 3,
    "cna": {"speed": 2.0, "min_turn_radius": 5.0, "start": {"x": 0.0, "y": -20.0}},
    "auv": [
        {
            "name": name,
            "survey": {"kind": "waypoints", "points": [[0.0, y], [100.0, y]]},
            "speed": 1.0,
            "first_estimate": {"sigma_position": 3.0},
            "process_noise": {"position": 0.05, "heading_deg": 0.5, "speed": 0.02},
        }
        for name, y in (("a", 0.0), ("b", 30.0))
    ],
    "planner": {"kind": "circle"},
}
RANGES = {"interval": 4.0, "kind": "range", "sigma": 0.5, "heading_sigma_deg": 2.0}
SQUARED = {"interval": 4.0, "kind": "squared-range", "sigma": 20.0, "heading_sigma_deg": 2.0}


@pytest.mark.parametrize("ranging", [RANGES, SQUARED], ids=["ranges", "squared"])
def test_each_auv_smoothed_alone_is_all_smoothed_together(ranging):
    run = op.simulate(op.from_dict({**PASSES, "ranging": ranging}))
    together = op.smooth(op.to_tape(run), run.scenario, start=run.mean)
    found, words = with_smoothed(run)
    assert words == ()
    # both searches end with steps under ten micrometres
    np.testing.assert_allclose(found.smoothed, together.mean[..., :2], atol=1e-4)
    np.testing.assert_allclose(found.smoothed_covariance, together.covariance, rtol=1e-3, atol=1e-6)
    figures = found.summary(bounds=False)["all"]
    off = np.hypot(*np.moveaxis(together.mean[..., :2] - run.true[..., :2], -1, 0))
    assert figures["smoothed_rms_error_m"] == pytest.approx(np.sqrt(np.mean(off**2)), abs=1e-4)
    assert figures["smoothed_rms_error_m"] < figures["rms_error_m"]


def test_mission_too_long_to_smooth_is_left_as_it_was_and_said(monkeypatch):
    monkeypatch.setattr(afterwards, "MOST", 100)
    run = op.simulate(op.from_dict({**PASSES, "ranging": RANGES}))
    found, (words,) = with_smoothed(run)
    assert found is run
    assert "Tracks are not smoothed" in words
    assert "there are 322" in words  # 2 AUVs, 80 s in steps of 0.5 s


def test_estimate_that_is_no_number_is_not_smoothed_and_said():
    run = op.simulate(op.from_dict({**PASSES, "ranging": RANGES}))
    found, (words,) = with_smoothed(replace(run, mean=np.full_like(run.mean, np.nan)))
    assert found.smoothed is None
    assert words.startswith("Tracks are not smoothed: ")
