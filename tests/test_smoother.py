"""Smoothed tracks against numpy, scipy and GTSAM, and what may be said of errors of instruments."""

import json
from pathlib import Path

import numpy as np
import pytest
from oracles import scenario as two_auvs
from scipy.optimize import least_squares
from scipy.stats import chi2

import obsplan as op
from obsplan.sensors import Range, WaterSpeed
from obsplan.smoothing import calibrate, smooth
from obsplan.tape import Measurements, Tape

GTSAM = json.loads((Path(__file__).parent / "data" / "smoother_gtsam.json").read_text())


def measured(*rows, beacons):
    """Measurements of (time, AUV, beacon, sensor, value), beacons being places."""
    time, auv, beacon, sensor, value = zip(*rows, strict=True)
    told = np.full((len(rows), 10), np.nan)
    for row, one in zip(told, beacon, strict=True):
        if 0 <= one < len(beacons):
            row[:] = [*beacons[one], *[0.0] * 8]
    return Measurements(
        sent=np.array(time),
        received=np.array(time),
        auv=np.array(auv),
        beacon=np.array(beacon),
        sensor=np.array(sensor),
        value=np.array(value, dtype=float),
        sigma=np.full(len(rows), np.nan),
        told=told,
    )


def tape_of(dt, turn, measurements, *, beacons, sensors, heading=None, change=None):
    """A tape of AUVs that measure their turns."""
    turn = np.atleast_2d(turn)
    auvs, steps = turn.shape
    time = np.concatenate([[0.0], np.cumsum(np.broadcast_to(dt, steps))])
    places = np.array([[*place, 0.0] for place in beacons], dtype=float).reshape(-1, 1, 3)
    return Tape(
        time=time,
        auvs=tuple(f"auv-{i + 1}" for i in range(auvs)),
        beacons=tuple(f"beacon-{i + 1}" for i in range(len(beacons))),
        turn=turn,
        change_of_speed=np.zeros_like(turn) if change is None else change,
        sway=np.zeros_like(turn),
        heading=np.full_like(turn, np.nan) if heading is None else heading,
        depth=np.zeros((auvs, steps + 1)),
        pose=np.tile(places, (1, steps + 1, 1)),
        beacon_depth=np.zeros(len(beacons)),
        sensors=sensors,
        measurements=measurements,
    )


def told(firsts, *, sigma, walk, first_sigma=(2.0, 0.1, 0.0), **ranging):
    """A scenario of AUVs by their first estimates (east, north, heading, speed)."""
    keys = "sigma_position", "sigma_heading_deg", "sigma_speed"
    values = first_sigma[0], float(np.rad2deg(first_sigma[1])), first_sigma[2]
    sigmas = dict(zip(keys, values, strict=True))
    auvs = []
    for x, y, heading, speed in firsts:
        first = {"x": x, "y": y, "heading_deg": float(np.rad2deg(heading)), "speed": speed}
        noise = {"position": walk[0], "heading_deg": float(np.rad2deg(walk[1])), "speed": walk[2]}
        survey = {"kind": "waypoints", "points": [[0.0, 0.0], [9.0, 0.0]]}
        auvs.append(
            {
                "speed": 1.0,
                "survey": survey,
                "first_estimate": {**first, **sigmas},
                "process_noise": noise,
            }
        )
    return op.from_dict(
        {
            "origin": {"lat": 0.0, "lon": 0.0},
            "duration": 5.0,
            "cna": {"speed": 1.0, "min_turn_radius": 5.0},
            "auv": auvs,
            "ranging": {"kind": "range", "sigma": sigma, **ranging},
        }
    )


@pytest.mark.parametrize("loss", ["squares", "huber"])
def test_the_track_is_that_of_gtsam(loss):
    data = GTSAM
    rows = [(k * data["dt"], 0, beacon, 0, value) for k, beacon, value in data["ranges"]]
    tape = tape_of(
        data["dt"],
        data["turn"],
        measured(*rows, beacons=data["beacons"]),
        beacons=data["beacons"],
        sensors={"range": Range()},
    )
    first, walk = data["first"], data["walk"]
    known = told(
        [(*first, data["speed"])],
        sigma=data["sigma"],
        walk=(walk[0], walk[2], 0.0),
        first_sigma=(data["first_sigma"][0], data["first_sigma"][2], 0.0),
    )
    found = smooth(tape, known, loss=loss)
    assert found.converged
    away = found.mean[0, :, :2] - np.array(data[f"{loss}_positions"])
    # an error of a step is a logarithm there: it mixes that of heading, squared, into the others
    assert np.abs(away).max() < 1e-3
    assert found.cost == pytest.approx(data[f"{loss}_cost"], rel=1e-5)


def rts(x, P, F, Q, measurements):
    """Rauch, Tung and Striebel's smoother of a linear system; measurements (H, z, R) by sample."""
    filtered, predicted = [], [(x, P)]
    for k, rows in enumerate(measurements):
        x, P = predicted[-1]
        for H, z, R in rows:
            S = H @ P @ H + R
            K = P @ H / S
            x, P = x + K * (z - H @ x), P - np.outer(K, H @ P)
        filtered.append((x, P))
        if k + 1 < len(measurements):
            predicted.append((F @ x, F @ P @ F.T + Q))
    found = [filtered[-1]]
    for k in range(len(filtered) - 2, -1, -1):
        (x, P), (x_after, P_after) = filtered[k], predicted[k + 1]
        G = np.linalg.solve(P_after, F @ P).T
        x_smooth, P_smooth = found[0]
        found.insert(0, (x + G @ (x_smooth - x_after), P + G @ (P_smooth - P_after) @ G.T))
    return np.array([x for x, _ in found]), np.array([P for _, P in found])


def test_a_linear_problem_has_the_means_and_covariances_of_the_kalman_smoother():
    # beacons so far off that ranges are linear to (30 m)^2 / (2 * 1e8 m), and a known heading
    far, dt, steps, walk = 1e8, 2.0, 12, (0.1, 0.0, 0.05)
    beacons = [(-far, 0.0), (0.0, -far)]
    rng = np.random.default_rng(3)
    rows, linear = [], [[] for _ in range(steps + 1)]
    for k in range(1, steps + 1):
        if k % 3 == 0:
            beacon = (k // 3) % 2
            value = (1.3 * k if beacon == 0 else 2.0) + rng.normal()
            rows.append((k * dt, 0, beacon, 0, far + value))
            linear[k].append((np.eye(3)[beacon], value, 0.5**2))
        if k % 2 == 0:
            value = 1.0 + 0.1 * rng.normal()
            rows.append((k * dt, 0, -1, 1, value))
            linear[k].append((np.eye(3)[2], value, 0.1**2))
    tape = tape_of(
        dt,
        np.zeros(steps),
        measured(*rows, beacons=beacons),
        beacons=beacons,
        sensors={"range": Range(), "log": WaterSpeed(sigma=0.1)},
    )
    known = told([(1.0, -1.0, 0.0, 1.2)], sigma=0.5, walk=walk, first_sigma=(3.0, 0.0, 0.4))
    found = smooth(tape, known, loss="squares")
    F = np.array([[1.0, 0.0, dt], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    Q = np.diag([walk[0] ** 2, walk[0] ** 2, walk[2] ** 2]) * dt
    mean, P = rts(np.array([1.0, -1.0, 1.2]), np.diag([9.0, 9.0, 0.16]), F, Q, linear)
    smoothed = found.mean[0][:, [0, 1, 3]]
    assert smoothed == pytest.approx(mean, abs=1e-5)
    # a heading that is known does not bend what is between
    assert found.covariance[0] == pytest.approx(P[:, :2, :2], abs=1e-6)


def wandering():
    """Two AUVs that range to two beacons and to each other, with hidden constants; and what is."""
    rng = np.random.default_rng(11)
    dt, steps = 1.5, 12
    beacons = [(-10.0, 30.0), (40.0, -25.0)]
    turn = rng.uniform(-0.5, 0.5, (2, steps))
    x = np.array([[0.0, 0.0, 0.3, 1.4], [12.0, 8.0, -0.4, 1.1]])
    rows, headings = [], np.full((2, steps), np.nan)
    for k in range(steps):
        ahead = np.column_stack([np.cos(x[:, 2]), np.sin(x[:, 2])]) * x[:, 3:] * dt
        x = np.column_stack([x[:, :2] + ahead, x[:, 2] + turn[:, k], x[:, 3]])
        headings[:, k] = x[:, 2] + 0.1 + 0.05 * rng.normal(size=2)
        for auv in range(2):
            r = np.hypot(*(x[auv, :2] - beacons[k % 2]))
            rows.append(((k + 1) * dt, auv, k % 2, 0, 1.03 * r + 0.5 * rng.normal()))
        r = np.hypot(*(x[0, :2] - x[1, :2]))
        rows.append(((k + 1) * dt, 0, 3, 0, r + 0.5 * rng.normal()))
    headings[1, ::3] = np.nan
    z = measured(*rows, beacons=beacons)
    tape = tape_of(dt, turn, z, beacons=beacons, sensors={"range": Range()}, heading=headings)
    return tape, beacons


def test_mean_and_covariance_are_those_of_dense_least_squares():
    tape, beacons = wandering()
    walk, sigmas = (0.1, 0.03, 0.02), (2.0, 0.2, 0.3)
    firsts = [(1.0, 0.5, 0.2, 1.3), (11.0, 9.0, -0.3, 1.2)]
    known = told(firsts, sigma=0.5, walk=walk, first_sigma=sigmas, heading_sigma_deg=3.0)
    names = ("scale", "current", "compass_bias")
    found = smooth(tape, known, hidden=names, loss="squares")
    dt, samples, z = np.diff(tape.time), tape.time.size, tape.measurements
    prior = np.array([0.1, 0.5, 0.5, np.deg2rad(20.0), np.deg2rad(20.0)])

    def residuals(unknown):
        x, hidden = unknown[:-5].reshape(2, samples, 4), unknown[-5:]
        first = (x[:, 0] - firsts) / np.array([sigmas[0], *sigmas])
        ahead = np.stack([np.cos(x[:, :-1, 2]), np.sin(x[:, :-1, 2])], axis=-1)
        moved = (ahead * x[:, :-1, 3:] + hidden[1:3]) * dt[:, None]
        steps = np.diff(x, axis=1)
        steps[..., :2] -= moved
        steps[..., 2] -= tape.turn
        steps /= np.array([walk[0], *walk]) * np.sqrt(dt)[:, None]
        compass = (tape.heading - x[:, 1:, 2] - hidden[3:, None]) / np.deg2rad(3.0)
        ranged = []
        for time, auv, beacon, value in zip(z.received, z.auv, z.beacon, z.value, strict=True):
            k = round(time / dt[0])
            other = beacons[beacon] if beacon < 2 else x[beacon - 2, k, :2]
            ranged.append((value - (1 + hidden[0]) * np.hypot(*(x[auv, k, :2] - other))) / 0.5)
        parts = [first, steps, compass[np.isfinite(compass)], ranged, hidden / prior]
        return np.concatenate([np.ravel(part) for part in parts])

    start = np.concatenate([found.mean.ravel() + 0.01, np.zeros(5)])
    dense = least_squares(residuals, start, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    P = np.linalg.inv(dense.jac.T @ dense.jac)
    assert found.mean.ravel() == pytest.approx(dense.x[:-5], abs=1e-4)
    assert found.hidden.values == pytest.approx(dense.x[-5:], abs=1e-5)
    assert found.cost == pytest.approx(dense.cost, rel=1e-9)
    assert found.hidden.covariance == pytest.approx(P[-5:, -5:], rel=1e-3, abs=1e-8)
    for auv, sample in ((0, 0), (0, 7), (1, samples - 1)):
        at = (auv * samples + sample) * 4
        here = P[at : at + 2, at : at + 2]
        assert found.covariance[auv, sample] == pytest.approx(here, rel=1e-3, abs=1e-6)


def flown(seeds, **change):
    """Runs of a short mission with the aid vehicle on a circle."""
    known = two_auvs(planner__kind="circle", duration=60.0, **change)
    return [op.simulate(known, seed=seed) for seed in seeds]


def errors(run, **settings):
    """Errors of the smoothed positions of a run, and their covariances."""
    found = smooth(op.to_tape(run), run.scenario, start=run.mean, **settings)
    return found.mean[..., :2] - run.truth[..., :2], found.covariance


def nees(away, P):
    """Normalised squares of errors."""
    return np.einsum("...i,...ij,...j", away, np.linalg.inv(P), away)


def test_smoothed_errors_are_below_the_filters_and_as_large_as_their_covariances_say():
    seeds = range(8)
    runs = flown(seeds)
    squares, filtered, normalised = [], [], []
    for run in runs:
        away, P = errors(run, loss="squares")
        squares.append(np.mean(away**2))
        filtered.append(np.mean((run.mean - run.truth)[..., :2] ** 2))
        normalised.append(nees(away, P)[:, away.shape[1] // 2].sum())
    assert np.mean(squares) < 0.8 * np.mean(filtered)
    # two AUVs of two coordinates in the middle of each mission
    low, high = chi2.ppf([0.001, 0.999], 4 * len(runs))
    assert low < np.sum(normalised) < high


def test_a_deviation_that_is_told_too_small_shows_in_the_normalised_errors():
    quiet = {"process_noise": {"position": 0.005, "heading_deg": 0.05, "speed": 0.002}}
    total = 0.0
    for run in flown(range(6)):
        sure = run.scenario.replace(
            estimator={"kind": "ekf", "ranging": {"sigma": 0.3}, **quiet},
        )
        found = smooth(op.to_tape(run), sure, start=run.mean, loss="squares")
        away = found.mean[..., :2] - run.truth[..., :2]
        total += nees(away, found.covariance)[:, away.shape[1] // 2].sum()
    assert total > chi2.ppf(0.999, 24)


def test_gross_outliers_do_not_pull_the_track():
    (run,) = flown([4])
    tape = op.to_tape(run)
    z = tape.measurements
    gross = np.zeros(z.value.size, dtype=bool)
    gross[::8] = True
    false = z._replace(value=z.value + 30.0 * gross)
    wrong = op.Tape(**{**vars(tape), "measurements": false})
    clean = smooth(tape, run.scenario, start=run.mean)
    robust = smooth(wrong, run.scenario, start=run.mean)
    pulled = smooth(wrong, run.scenario, start=run.mean, loss="squares")
    assert robust.weights[gross].max() < 0.01
    assert np.median(robust.weights[~gross]) > 0.8
    away = [np.abs(one.mean - clean.mean)[..., :2].max() for one in (robust, pulled)]
    assert away[0] < 1.0 < away[1]


def passing(side, *, turns=(), beacon=(30.0, 40.0), steps=60, first_sigma=(50.0, 0.001, 0.0)):
    """A tape of one AUV that goes east past a beacon, first estimate on the line with some y."""
    x, rows = np.array([0.0, 0.0, 0.0]), []
    turn = np.zeros(steps)
    for k, angle in turns:
        turn[k] = angle
    for k in range(steps):
        x = x + np.array([np.cos(x[2]), np.sin(x[2]), turn[k]])
        if k % 3 == 0:
            rows.append((k + 1.0, 0, 0, 0, float(np.hypot(*(x[:2] - beacon)))))
    tape = tape_of(
        1.0,
        turn,
        measured(*rows, beacons=[beacon]),
        beacons=[beacon],
        sensors={"range": Range()},
    )
    known = told(
        [(0.0, side, 0.0, 1.0)],
        sigma=0.5,
        walk=(0.01, 0.0, 0.0),
        first_sigma=first_sigma,
    )
    return tape, known


def test_a_straight_pass_is_said_to_fit_on_both_sides_of_the_beacon():
    # the AUV is at y = 0, its image at 80; the first estimate is between them, nearer to the image
    found = smooth(*passing(50.0))
    assert any("two tracks of auv-1 fit, up to 80" in words for words in found.words)
    assert found.mean[0, 30, 1] == pytest.approx(80.0, abs=0.5)
    # half the squares of the deviations from the first estimate, 30 m and 50 m of 50 m
    assert any("0.32 more" in words for words in found.words)


def test_a_turn_leaves_one_side():
    found = smooth(*passing(50.0, turns=[(30, np.pi / 2)]))
    assert not any("two tracks" in words for words in found.words)
    assert found.mean[0, 30, 1] == pytest.approx(0.0, abs=0.5)


def test_where_nothing_is_measured_the_track_is_dead_reckoning_and_that_is_said():
    tape, known = passing(0.0)
    nothing = tape.measurements._replace(value=np.full(tape.measurements.value.size, np.nan))
    silent = op.Tape(**{**vars(tape), "measurements": nothing})
    found = smooth(silent, known)
    assert found.mean[0, :, 0] == pytest.approx(tape.time, abs=1e-9)
    assert any("dead reckoning" in words for words in found.words)
    assert any("no number" in words for words in found.words)


def test_between_samples_the_track_is_straight_and_outside_it_is_refused():
    found = smooth(*passing(0.0))
    middle = found.at(np.array([10.25]))
    expected = 0.75 * found.mean[:, 10] + 0.25 * found.mean[:, 11]
    assert middle.mean[:, 0] == pytest.approx(expected, abs=1e-12)
    with pytest.raises(op.ObsplanError, match="outside of the tape"):
        found.at(np.array([1e6]))


def calibrating(scale, bias, *, radius=(5.0, 60.0), seed=0):
    """A tape of an AUV on three legs among beacons, with ranges that are false by constants."""
    rng = np.random.default_rng(seed)
    beacons = [(0.0, radius[0]), (radius[1], -20.0), (10.0, radius[1])]
    turn = np.zeros(150)
    turn[[49, 99]] = 2.0, 2.0
    x, rows = np.array([0.0, 0.0, 0.0]), []
    for k in range(turn.size):
        x = x + np.array([np.cos(x[2]), np.sin(x[2]), turn[k]])
        r = np.hypot(*(x[:2] - beacons[k % 3]))
        rows.append((k + 1.0, 0, k % 3, 0, (1 + scale) * r + bias + 0.3 * rng.normal()))
    tape = tape_of(
        1.0,
        turn,
        measured(*rows, beacons=beacons),
        beacons=beacons,
        sensors={"range": Range()},
    )
    return tape, told([(0.5, -0.5, 0.02, 1.0)], sigma=0.3, walk=(0.03, 0.003, 0.0))


@pytest.mark.parametrize("per_beacon", [False, True])
def test_scale_and_bias_are_found_within_what_is_said_of_them(per_beacon):
    tape, known = calibrating(0.07, 0.8)
    found = calibrate(tape, known, per_beacon=per_beacon)
    half = 3 if per_beacon else 1
    true = np.repeat([0.07, 0.8], half)
    assert np.all(np.abs(found.constants.values - true) < 4 * found.constants.sigma)
    assert "correlation of scale" in str(found)
    right = smooth(found.tape, known)
    assert np.hypot(*right.mean[0, 49, :2] - [49.0, 0.0]) < 0.6


def test_constants_that_no_range_tells_are_refused():
    # on a line past a beacon 2 km away all distances are alike
    tape, known = passing(0.0, beacon=(30.0, 2000.0))
    with pytest.raises(op.ObsplanError, match="do not tell the bias"):
        calibrate(tape, known)


def test_constants_of_which_only_the_sum_is_known_are_refused():
    # a known track that is 100 to 104 m from the beacon
    tape, known = passing(0.0, beacon=(30.0, 100.0), first_sigma=(0.1, 0.001, 0.0))
    with pytest.raises(op.ObsplanError, match="scale and bias cannot be told apart"):
        calibrate(tape, known, priors={"scale": 1.0, "bias": 100.0})


def test_the_straight_line_by_the_truth_is_told_beside():
    (run,) = flown([2], ranging__scale_sigma=0.05)
    tape = op.to_tape(run)
    found = calibrate(tape, run.scenario, start=run.mean)
    (words,) = [words for words in found.words if words.startswith("by the truth")]
    z = tape.measurements
    r = np.hypot(*(run.truth[z.auv, np.searchsorted(run.time, z.received), :2] - z.told[:, :2]).T)
    line = np.polynomial.Polynomial.fit(r, z.value - r, 1).convert().coef
    assert f"scale {line[1]:+.5f}, bias {line[0]:+.5f} m" in words


def test_wrong_names_are_refused_in_words():
    tape, known = passing(0.0)
    with pytest.raises(op.ObsplanError, match='"tide" is no constant'):
        smooth(tape, known, hidden=("tide",))
    with pytest.raises(op.ObsplanError, match='loss: "l1" is none'):
        smooth(tape, known, loss="l1")
    with pytest.raises(op.ObsplanError, match="scale: -1"):
        smooth(tape, known, scale=-1.0)
    with pytest.raises(op.ObsplanError, match="priors: bias"):
        smooth(tape, known, priors={"bias": 0.0})


def test_the_same_tape_gives_the_same_bytes():
    tape, known = passing(10.0)
    first, again = (smooth(tape, known) for _ in range(2))
    assert first.mean.tobytes() == again.mean.tobytes()
    assert first.covariance.tobytes() == again.covariance.tobytes()
