"""Filters on a tape: what they make of a simulated run's is that run's estimates, and of the shipped recordings what is known of them."""

import numpy as np
import pytest
from oracles import scenario as two_auvs

import obsplan as op
from obsplan.fates import Fate
from obsplan.replay.estimate import estimate

LOSSY = {
    "ranging__loss": 0.2,
    "ranging__outliers": 0.15,
    "ranging__outlier_mean": 20.0,
    "ranging__duplicates": 0.2,
}
MISSIONS = {
    "plain": {},
    "bearings": {"ranging__bearing_sigma_deg": 3.0, **LOSSY},
    "dvl": {"auv__0__speed_sensor": {"kind": "dvl", "sigma": 0.02}},
    "lossy": {"estimator": {"kind": "ekf", "states": {"scale": {}, "bias": {}}}, **LOSSY},
    "hypotheses": {
        "auv__0__first_estimate": {"sigma_position": 40.0},
        "estimator": {"kind": "ekf", "hypotheses": 24},
        "duration": 40.0,
        **LOSSY,
    },
}
BY_RANGE = {"planner": {"kind": "circle"}, "ranging__interval": 1.0}


@pytest.mark.parametrize("name", MISSIONS)
def test_a_simulated_runs_tape_gives_its_estimates(name):
    run = op.simulate(two_auvs(**{**BY_RANGE, **MISSIONS[name]}), seed=3)
    tape = op.to_tape(run)
    found = estimate(tape, run.scenario, first=run.mean[:, 0])
    # the order of sums differs, no more
    np.testing.assert_allclose(found.mean, run.mean, rtol=0, atol=1e-7)
    scale = np.abs(run.covariance).max(axis=(1, 2, 3), keepdims=True)
    np.testing.assert_allclose(found.covariance / scale, run.covariance / scale, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.hypotheses, run.hypotheses)
    z = tape.measurements
    came = (z.sensor == 0) & (found.fate != Fate.DUPLICATE)
    sample = np.searchsorted(run.time, z.received[came])
    place = z.beacon[came], z.auv[came], sample
    np.testing.assert_array_equal(found.fate[came], run.fates[place])
    np.testing.assert_allclose(found.innovation[came], run.innovations[place], atol=1e-7)
    if name in ("bearings", "lossy"):
        assert {Fate.DUPLICATE, Fate.INNOVATION} <= {Fate(code) for code in found.fate}
    if name == "hypotheses":
        assert run.hypotheses.max() > 1
