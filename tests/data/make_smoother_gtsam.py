"""Write smoother_gtsam.json: a small problem of one vehicle and three beacons, and GTSAM's solution.

    pip install gtsam==4.3.0 && python tests/data/make_smoother_gtsam.py

GTSAM (Georgia Institute of Technology, BSD licence) is not needed by the tests.
"""

import json
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, X

STEPS, DT, SPEED = 90, 1.0, 1.2
WALK = np.array([0.05, 0.05, 0.02])  # m, m, rad, each per sqrt(s)
FIRST_SIGMA = np.array([2.0, 2.0, 0.1])
SIGMA, HUBER = 0.4, 1.345
BEACONS = np.array([[-20.0, 15.0], [45.0, -10.0], [30.0, 50.0]])


def problem():
    """Turns, ranges and the first estimate, drawn about a track of three legs."""
    rng = np.random.default_rng(7)
    turn = np.zeros(STEPS)
    turn[[29, 59]] = 1.9, 1.9
    truth = [np.array([0.0, 0.0, 0.2])]
    for k in range(STEPS):
        x = truth[-1]
        ahead = SPEED * DT * np.array([np.cos(x[2]), np.sin(x[2]), 0.0])
        truth.append(x + ahead + [0.0, 0.0, turn[k]] + WALK * np.sqrt(DT) * rng.normal(size=3))
    rows = []
    for k in range(2, STEPS + 1, 2):
        beacon = int(rng.integers(len(BEACONS)))
        error = SIGMA * rng.normal() + (12.0 if k % 14 == 0 else 0.0)  # every seventh is gross
        rows.append([k, beacon, float(np.hypot(*(truth[k][:2] - BEACONS[beacon])) + error)])
    first = truth[0] + FIRST_SIGMA * rng.normal(size=3)
    return {
        "dt": DT,
        "speed": SPEED,
        "walk": WALK.tolist(),
        "first": first.tolist(),
        "first_sigma": FIRST_SIGMA.tolist(),
        "sigma": SIGMA,
        "huber": HUBER,
        "beacons": BEACONS.tolist(),
        "turn": turn.tolist(),
        "ranges": rows,
    }


def graph(data, robust):
    """GTSAM's factors."""
    diagonal = gtsam.noiseModel.Diagonal.Sigmas
    found = gtsam.NonlinearFactorGraph()
    # not PriorFactorPose2, whose error is the logarithm: it mixes a large one of heading into others
    first = gtsam.Pose2(*data["first"])
    found.add(gtsam.PoseTranslationPrior2D(X(0), first, diagonal(FIRST_SIGMA[:2])))
    found.add(gtsam.PoseRotationPrior2D(X(0), first, diagonal(FIRST_SIGMA[2:])))
    for k, turn in enumerate(data["turn"]):
        moved = gtsam.Pose2(SPEED * DT, 0.0, turn)
        found.add(gtsam.BetweenFactorPose2(X(k), X(k + 1), moved, diagonal(WALK * np.sqrt(DT))))
    noise = gtsam.noiseModel.Isotropic.Sigma(1, SIGMA)
    if robust:
        noise = gtsam.noiseModel.Robust.Create(
            gtsam.noiseModel.mEstimator.Huber.Create(HUBER), noise
        )
    for i, place in enumerate(BEACONS):
        held = gtsam.noiseModel.Isotropic.Sigma(2, 1e-7)
        found.add(gtsam.PriorFactorPoint2(B(i), gtsam.Point2(*place), held))
    for k, beacon, value in data["ranges"]:
        found.add(gtsam.RangeFactor2D(X(k), B(beacon), value, noise))
    return found


def solved(data, robust):
    """GTSAM's positions and its error."""
    factors, values = graph(data, robust), gtsam.Values()
    pose = gtsam.Pose2(*data["first"])
    for k in range(STEPS + 1):
        values.insert(X(k), pose)
        if k < STEPS:
            pose = pose.compose(gtsam.Pose2(SPEED * DT, 0.0, data["turn"][k]))
    for i, place in enumerate(BEACONS):
        values.insert(B(i), gtsam.Point2(*place))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-15)
    parameters.setAbsoluteErrorTol(1e-15)
    parameters.setMaxIterations(500)
    found = gtsam.LevenbergMarquardtOptimizer(factors, values, parameters).optimize()
    poses = [found.atPose2(X(k)) for k in range(STEPS + 1)]
    return [[pose.x(), pose.y()] for pose in poses], factors.error(found)


if __name__ == "__main__":
    data = problem()
    for name, robust in (("squares", False), ("huber", True)):
        data[f"{name}_positions"], data[f"{name}_cost"] = solved(data, robust)
    path = Path(__file__).with_name("smoother_gtsam.json")
    path.write_text(json.dumps(data, indent=1) + "\n")
