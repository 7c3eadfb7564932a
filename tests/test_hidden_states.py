"""What filters find out besides positions: currents and errors of instruments, each within what is said of it."""

from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr
from filters import AID
from scipy.stats import chi2

import obsplan as op
from obsplan.vehicles import STATES

# legs in all directions among two moored beacons and an aid vehicle
SEA = {
    "name": "sea",
    "duration": 300.0,
    **AID,
    "auv": [
        {
            "name": "a",
            "speed": 1.0,
            "survey": {"kind": "lawnmower", "legs": 4, "length": 60.0, "spacing": 20.0},
            "first_estimate": {
                "sigma_position": 2.0,
                "sigma_heading_deg": 2.0,
                "sigma_speed": 0.05,
            },
            "process_noise": {"position": 0.03, "heading_deg": 0.1, "speed": 0.002},
        }
    ],
    "beacon": [{"x": -40.0, "y": -30.0}, {"x": 90.0, "y": 20.0}],
    "ranging": {"interval": 2.0, "sigma": 0.5, "heading_sigma_deg": 1.0},
    "planner": {"kind": "circle"},
}
# of each: what is false, what the filter is to find out, and what that is
LATE = 0.002  # [s]
FALSE = {
    "current": (
        {"environment__current": [0.2, -0.1], "estimator__current": [0.0, 0.0]},
        {"sigma": 0.2, "walk": 0.0},
        {"current_east": 0.2, "current_north": -0.1},
    ),
    "scale": (
        {
            "ranging__assumed_sound_speed": 1530.0,  # 2 % more than the true one
            "estimator__ranging": {"sound_speed": 1530.0},
        },
        {"sigma": 0.02},
        {"scale": 0.02},
    ),
    "bias": (
        {"ranging__clock_offset": LATE},
        {"sigma": 2.0},
        dict.fromkeys(("bias_1", "bias_2", "bias_3"), 1500.0 * LATE),
    ),
    "clock": ({"ranging__clock_offset": LATE}, {"sigma": 0.002}, {"clock": LATE}),
    "compass_bias": (
        {"ranging__compass_bias_deg": 3.0},
        {"sigma_deg": 2.0},
        {"compass_bias": np.deg2rad(3.0)},
    ),
    "depth": (
        {"ranging__geometry": "slant", "ranging__depth_sigma": 1.0, "auv__0__depth": 30.0},
        {"sigma": 2.0, "walk": 0.0},
        {"depth": 30.0},
    ),
}
UNITS = {"current_east": "m s-1", "current_north": "m s-1", "scale": "1", "clock": "s"}
UNITS |= {"bias_1": "m", "bias_2": "m", "bias_3": "m", "compass_bias": "rad", "depth": "m"}
SEEDS = range(2)


def flown(name, *, told=True):
    truth, table, _ = FALSE[name]
    mission = op.from_dict(SEA).replace(estimator__states={name: table} if told else {}, **truth)
    return [op.simulate(mission, seed=seed) for seed in SEEDS]


def band(runs, probability=0.9999):
    """Mean NEES of a consistent filter's positions, of as many errors as are independent."""
    count = sum(run.independent_errors.sum() for run in runs)
    tail = (1 - probability) / 2
    return chi2.ppf([tail, 1 - tail], 2 * count) / count


def nees(runs):
    return np.mean([run.nees.mean() for run in runs])


@pytest.mark.parametrize("name", FALSE)
def test_what_is_false_is_found_within_what_is_said_of_it(name):
    runs, true = flown(name), FALSE[name][2]
    assert [*runs[0].scenario.filter_states] == [*STATES, *true]
    first, last = (np.sqrt(np.diag(runs[0].covariance[0, k]))[4:] for k in (0, -1))
    assert (last < first / 10).all()
    for run in runs:
        away = run.mean[0, -1, 4:] - [*true.values()]
        assert (np.abs(away) < 4 * np.sqrt(np.diag(run.covariance[0, -1]))[4:]).all()
        assert run.ranged.share_rejected == 0.0
    low, high = band(runs)
    assert low < nees(runs) < high


@pytest.mark.parametrize("name", [name for name in FALSE if name != "depth"])
def test_a_filter_that_is_not_told_to_look_for_it_is_sure_and_wrong(name):
    runs = flown(name, told=False)
    assert [*runs[0].scenario.filter_states] == [*STATES]
    assert nees(runs) > 4 * band(runs)[1]


def test_a_current_is_found_beside_the_one_counted_on_over_ground_too():
    """By a DVL: an AUV that counts on the true current finds nothing besides, and knows where it is."""
    told = {"environment__current": [0.2, -0.1], "estimator__current": [0.2, -0.1]}
    mission = op.from_dict(SEA).replace(estimator__states={"current": {}}, **told)
    run = op.simulate(mission.replace(auv__0__speed_sensor={"kind": "dvl"}), seed=1)
    found = run.hidden[run.names[0]]
    for name in ("current_east", "current_north"):
        assert abs(found[name]["value"]) < 4 * found[name]["sigma"] < 0.04
    assert run.error[0, -100:].max() < 2.0


def test_files_name_hidden_states_with_their_units(tmp_path):
    given = {name: {} for name in FALSE}
    slant = {"ranging__geometry": "slant", "auv__0__depth": 30.0, "duration": 10.0}
    run = op.simulate(op.from_dict(SEA).replace(estimator__states=given, **slant))
    found = run.summary(bounds=False)["states"][run.names[0]]
    for k, (name, state) in enumerate(run.scenario.filter_states.items()):
        if k > 3:
            value, sigma = run.mean[0, -1, k], run.covariance[0, -1, k, k] ** 0.5
            assert found.pop(name) == {"value": value, "sigma": sigma, "unit": state.unit}
    assert not found
    op.write_netcdf(run, tmp_path / "tracks.nc")
    with xr.open_dataset(tmp_path / "tracks.nc") as tracks:
        names = [*run.scenario.filter_states]
        assert {*names[4:]} == {*UNITS}
        for name, unit in UNITS.items():
            assert tracks[f"est_{name}"].units == unit
            own = run.mean[0, :, names.index(name)]
            np.testing.assert_allclose(tracks[f"est_{name}"][0], own)


@dataclass(frozen=True, kw_only=True)
class Own(op.Ekf):
    """A filter that says itself which states it has."""

    def states(self, model):
        return STATES


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"ranging__kind": "squared-range", "estimator__states": {"scale": {}}},
            r'estimator__states\.scale.*"squared-range": give kind "range"',
        ),
        (
            {"ranging__kind": "squared-range", "estimator__states": {"bias": {}}},
            r'estimator__states\.bias.*"squared-range": give kind "range"',
        ),
        ({"estimator__states": {"depth": {}}}, r'depth.*give \[ranging\] geometry "slant"'),
        (
            {"estimator": Own(), "estimator__states": {"current": {}}},
            r"estimator__states.*has states of its own: leave them out",
        ),
    ],
)
def test_states_that_nothing_tells_of_are_refused_in_a_sentence(changes, words):
    with pytest.raises(op.ObsplanError, match=words) as caught:
        op.from_dict(SEA).replace(**changes)
    assert "\n" not in str(caught.value)


def test_with_known_heading_and_speed_it_is_the_model_of_position_and_current():
    """Thesis (3.1): x' = V cos ψ + Wx, y' = V sin ψ + Wy, the current a random walk; by hand in numpy."""
    sure = {"sigma_position": 5.0, "sigma_heading_deg": 0.0, "sigma_speed": 0.0}
    mission = op.from_dict(SEA).replace(
        estimator__states={"current": {"sigma": 0.3, "walk": 0.01}},
        estimator__current=[0.0, 0.0],
        estimator__gate=0.0,
        estimator__hypotheses=1,
        environment__current=[0.2, -0.1],
        auv__0__first_estimate=sure,
        auv__0__process_noise={"position": 0.05},
        duration=120.0,
    )
    run = op.simulate(mission, seed=1)
    dt, m = 0.5, [0, 1, 4, 5]
    F = np.eye(4) + dt * np.eye(4, k=2)
    Q = dt * np.diag([0.05, 0.05, 0.01, 0.01]) ** 2
    x, P = run.mean[0, 0, m], np.diag([5.0, 5.0, 0.3, 0.3]) ** 2
    tape = op.to_tape(run)
    heading, speed = run.mean[0, 0, 2:4]
    for k in range(1, run.time.size):
        velocity = np.array([speed * np.cos(heading), speed * np.sin(heading), 0.0, 0.0])
        x, P = F @ x + dt * velocity, F @ P @ F.T + Q
        heading += tape.turn[0, k - 1]
        speed += tape.change_of_speed[0, k - 1]
        for beacon in range(3):
            z = run.ranges[beacon, 0, k]
            if np.isfinite(z):
                away = x[:2] - tape.pose[beacon, k, :2]
                d = np.hypot(*away)
                H = np.array([*away / d, 0.0, 0.0])
                K = P @ H / (H @ P @ H + 0.25)
                x, P = x + K * (z - d), P - np.outer(K, H @ P)
        np.testing.assert_allclose(run.mean[0, k, m], x, rtol=0, atol=1e-8)
        np.testing.assert_allclose(run.covariance[0, k][np.ix_(m, m)], P, rtol=0, atol=1e-8)
    assert np.abs(x[2:] - [0.2, -0.1]).max() < 0.1
