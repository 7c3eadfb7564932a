"""Write GTSAM's batch solution of a stretch of Plaza 2: what a smoother is to agree with.

    pip install gtsam==4.3.0
    python scripts/solve_factor_graph.py obsplan/recordings/plaza2 \
        tests/data/plaza2_factor_graph

The factor graph: a pose at each time at which odometry or a range came; a prior on the first;
between two poses the arc that odometry measured, with the same error along each axis and one in the
heading, white in time; to each range, horizontal, its beacon as a known point. `model.json` has all
numbers. Between its rows odometry is taken as even. The script needs numpy and gtsam, and nothing
of obsplan.
"""

import argparse
import json
import math
from pathlib import Path

import gtsam
import numpy as np

SECONDS = 60.0
MODEL = {
    "recording": "plaza2, its first 60 s",
    "solver": "GTSAM 4.3.0, Levenberg-Marquardt",
    # ranges of the recording, with the error that grows with distance taken off
    "calibration": {"range_m": "(range_m - 0.01) / 1.0696"},
    "prior": {"east_m": -34.21, "north_m": 45.3, "heading_deg": 64.2},
    "prior_sigma": {"east_m": 1.0, "north_m": 1.0, "heading_deg": 2.0},
    "process_noise": {"position_m_per_sqrt_s": 0.09, "heading_deg_per_sqrt_s": 1.0},
    "range_sigma_m": 0.56,
}


def columns(path: Path) -> np.ndarray:
    """Read a CSV as a structured array."""
    return np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")


def merged(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Give times of all poses, way and turn up to them, and the ranges, calibrated."""
    odometry, ranges = columns(folder / "odometry.csv"), columns(folder / "ranges.csv")
    begin = odometry["time_s"][0]
    ranges = ranges[(ranges["received_s"] > begin) & (ranges["received_s"] <= begin + SECONDS)]
    ranges["range_m"] = np.round((ranges["range_m"] - 0.01) / 1.0696, 4)
    rows = odometry["time_s"][odometry["time_s"] <= begin + SECONDS]
    time = np.union1d(rows, ranges["received_s"])
    way = np.interp(time, odometry["time_s"], np.cumsum(odometry["forward_m"]))
    angle = np.interp(time, odometry["time_s"], np.cumsum(odometry["turn_rad"]))
    return time, np.round(way, 6), np.round(angle, 7), ranges


def solve(
    time: np.ndarray, way: np.ndarray, angle: np.ndarray, ranges: np.ndarray, beacons: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the factor graph: poses, and their covariances in the frame of the beacons."""
    graph, guess = gtsam.NonlinearFactorGraph(), gtsam.Values()
    prior, sigma = MODEL["prior"], MODEL["prior_sigma"]
    pose = gtsam.Pose2(prior["east_m"], prior["north_m"], math.radians(prior["heading_deg"]))
    doubt = np.array([sigma["east_m"], sigma["north_m"], math.radians(sigma["heading_deg"])])
    graph.add(gtsam.PriorFactorPose2(0, pose, gtsam.noiseModel.Diagonal.Sigmas(doubt)))
    guess.insert(0, pose)
    walk = MODEL["process_noise"]
    position = walk["position_m_per_sqrt_s"]
    heading = math.radians(walk["heading_deg_per_sqrt_s"])
    for k, lasted in enumerate(np.diff(time)):
        twist = np.array([way[k + 1] - way[k], 0.0, angle[k + 1] - angle[k]])
        arc = gtsam.Pose2.Expmap(twist)
        step = math.sqrt(lasted) * np.array([position, position, heading])
        noise = gtsam.noiseModel.Diagonal.Sigmas(step)
        graph.add(gtsam.BetweenFactorPose2(k, k + 1, arc, noise))
        pose = pose.compose(arc)
        guess.insert(k + 1, pose)
    places = {row["name"]: (row["east_m"], row["north_m"]) for row in beacons}
    first = len(time)
    error = gtsam.noiseModel.Isotropic.Sigma(1, MODEL["range_sigma_m"])
    for number, (name, place) in enumerate(places.items()):
        graph.add(gtsam.NonlinearEqualityPoint2(first + number, np.array(place)))
        guess.insert(first + number, np.array(place))
        heard = ranges[ranges["sender"] == name]
        for at, distance in zip(heard["received_s"], heard["range_m"], strict=True):
            k = int(np.searchsorted(time, at))
            graph.add(gtsam.RangeFactor2D(k, first + number, float(distance), error))
    return optimized(graph, guess, len(time))


def optimized(graph, guess, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Minimize, and turn each covariance from the vehicle's frame into that of the beacons."""
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-15)
    settings.setAbsoluteErrorTol(1e-12)
    settings.setMaxIterations(200)
    best = gtsam.LevenbergMarquardtOptimizer(graph, guess, settings).optimize()
    marginals = gtsam.Marginals(graph, best)
    poses, covariances = [], []
    for k in range(count):
        pose = best.atPose2(k)
        turned = np.eye(3)
        turned[:2, :2] = pose.rotation().matrix()
        poses.append([pose.x(), pose.y(), pose.theta()])
        covariances.append(turned @ marginals.marginalCovariance(k) @ turned.T)
    return np.array(poses), np.array(covariances)


def write(path: Path, names: str, rows: list[list[str]]) -> None:
    """Write a CSV."""
    lines = [names, *(",".join(row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def main() -> None:
    """Solve, and write what was solved beside the solution."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path, help="obsplan/recordings/plaza2")
    parser.add_argument("out", type=Path, help="folder for the tables")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    beacons = columns(given.recording / "beacons.csv")
    time, way, angle, ranges = merged(given.recording)
    poses, covariances = solve(time, way, angle, ranges, beacons)
    moved = zip(time, np.diff(way, prepend=0.0), np.diff(angle, prepend=0.0), strict=True)
    write(
        given.out / "odometry.csv",
        "time_s,forward_m,turn_rad",
        [[f"{at:.3f}", f"{forward + 0.0:.6f}", f"{turn + 0.0:.7f}"] for at, forward, turn in moved],
    )
    write(
        given.out / "ranges.csv",
        "received_s,sender,range_m",
        [[f"{row[0]:.3f}", row[1], f"{row[2]:.4f}"] for row in ranges.tolist()],
    )
    write(
        given.out / "beacons.csv",
        "name,east_m,north_m",
        [[row[0], f"{row[1]:.3f}", f"{row[2]:.3f}"] for row in beacons.tolist()],
    )
    write(
        given.out / "solution.csv",
        "time_s,east_m,north_m,heading_rad,sigma_east_m,sigma_north_m,correlation,sigma_heading_rad",
        [
            [f"{at:.3f}", *(f"{value:.5f}" for value in pose), *deviations(covariance)]
            for at, pose, covariance in zip(time, poses, covariances, strict=True)
        ],
    )
    text = json.dumps(MODEL, indent=2) + "\n"
    (given.out / "model.json").write_text(text, encoding="utf-8", newline="\n")


def deviations(covariance: np.ndarray) -> list[str]:
    """Give deviations east and north, their correlation, and the deviation of the heading."""
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance[0, 1] / (sigma[0] * sigma[1])
    return [f"{value:.5f}" for value in (sigma[0], sigma[1], correlation, sigma[2])]


if __name__ == "__main__":
    main()
