"""Write the recordings that ship with obsplan from the example data of the `gtsam` wheel.

    pip download --no-deps gtsam==4.3.0 && unzip gtsam-4.3.0-*.whl 'gtsam/Data/*'
    python scripts/convert_recordings.py gtsam/Data obsplan/recordings

The same data give the same bytes. What the data are, and how the numbers in `recording.toml` were
found, stands in docs/recordings.md; those files are written by hand. The script needs numpy and
scipy, and nothing of obsplan.
"""

import argparse
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.io import loadmat

# where the reference lies in the frame of the beacons: east, north [m] of its first pose and the
# angle [rad] by which it is turned. The file does not say; ranges fit best there (soft L1, 2 m).
PLACED = {"goats15": (903.9, 133.7, 1.9799), "goats16": (439.0, 210.9, 2.8614)}
SPEED = 1.5  # of the AUV, for times that the file does not have [m/s]
PING = 3.0  # least time between two poses [s]


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Give angles within -pi and pi [rad]."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def increments(values: np.ndarray, decimals: int) -> np.ndarray:
    """Round increments so that their sum is rounded once: nothing piles up."""
    return np.diff(np.round(np.cumsum(values), decimals), prepend=0.0)


def table(columns: Mapping[str, np.ndarray], decimals: Mapping[str, int]) -> str:
    """Write columns as CSV; those without decimals are text."""
    rows = [",".join(columns)]
    for values in zip(*columns.values(), strict=True):
        cells = []
        for name, value in zip(columns, values, strict=True):
            # adding zero turns -0.0 into 0.0
            rounded = value if name not in decimals else round(float(value), decimals[name]) + 0.0
            cells.append(rounded if isinstance(rounded, str) else f"{rounded:.{decimals[name]}f}")
        rows.append(",".join(cells))
    return "\n".join(rows) + "\n"


def odometry(
    time: np.ndarray, forward: np.ndarray, left: np.ndarray | None, turn: np.ndarray
) -> str:
    """Write what was moved since the row before; nothing in the first row."""
    columns = {"time_s": time, "forward_m": np.r_[0.0, increments(forward, 5)]}
    if left is not None:
        columns["left_m"] = np.r_[0.0, increments(left, 5)]
    columns["turn_rad"] = np.r_[0.0, increments(turn, 6)]
    return table(columns, {"time_s": 3, "forward_m": 5, "left_m": 5, "turn_rad": 6})


def ranges(received: np.ndarray, sender: Sequence[str], distance: np.ndarray) -> str:
    """Write ranges in the file's order."""
    columns = {"received_s": received, "sender": np.array(sender), "range_m": distance}
    return table(columns, {"received_s": 3, "range_m": 3})


def beacons(names: Sequence[str], places: np.ndarray) -> str:
    """Write beacons that stay where they are."""
    columns = {"name": np.array(names), "east_m": places[:, 0], "north_m": places[:, 1]}
    return table(columns, {"east_m": 3, "north_m": 3})


def truth(time: np.ndarray, east: np.ndarray, north: np.ndarray, heading: np.ndarray) -> str:
    """Write where the vehicle was and where its bow pointed, counter-clockwise from east."""
    columns = {"time_s": time, "east_m": east, "north_m": north, "heading_rad": wrapped(heading)}
    return table(columns, {"time_s": 3, "east_m": 3, "north_m": 3, "heading_rad": 5})


def plaza(path: Path, name: str) -> dict[str, str]:
    """Convert a set of the CMU range-only data: everything as it is, but for Plaza 2's headings."""
    data = loadmat(path)
    time, east, north, heading = data["GT"].T
    if name == "plaza2":
        # its headings point astern: odometry leads along the truth from the opposite one
        heading = heading + np.pi
    moved, forward, turn = data["DR"].T
    began = data["DRp"][0, 0]
    received, _, tag, distance = data["TD"].T
    number, tag_east, tag_north = data["TL"].T
    return {
        "odometry.csv": odometry(np.r_[began, moved], forward, None, turn),
        "ranges.csv": ranges(received, [f"tag-{one:.0f}" for one in tag], distance),
        "beacons.csv": beacons(
            [f"tag-{one:.0f}" for one in number], np.column_stack([tag_east, tag_north])
        ),
        "truth.csv": truth(time, east, north, heading),
    }


def read_graph(path: Path) -> tuple[dict, np.ndarray, np.ndarray, list]:
    """Read a factor graph of PyFactorGraph: beacons, poses, their differences, ranges."""
    landmarks, poses, edges, measured = {}, [], [], []
    for line in path.read_text().splitlines():
        kind, *cells = line.split()
        if kind == "VERTEX_XY":
            landmarks[cells[0]] = [float(cell) for cell in cells[1:3]]
        elif kind == "VERTEX_SE2":
            poses.append([float(cell) for cell in cells[2:5]])
        elif kind == "EDGE_SE2":
            edges.append([float(cell) for cell in cells[3:6]])
        elif kind == "EDGE_RANGE":
            measured.append((int(cells[1][1:]), cells[2], float(cells[3])))
        else:
            raise ValueError(f"{path}: a line of kind {kind} is not known")
    return landmarks, np.array(poses), np.array(edges), measured


def goats(path: Path, name: str) -> dict[str, str]:
    """Convert a factor graph of a GOATS mission.

    Its poses begin at the origin, face along their second axis, and have no times.
    """
    landmarks, poses, edges, measured = read_graph(path)
    east, north, angle = PLACED[name]
    along = poses[:, :2] @ np.array(
        [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    )
    heading = poses[:, 2] + angle + np.pi / 2.0
    step = np.hypot(edges[:, 0], edges[:, 1])
    taken = np.round(np.maximum(PING, step / SPEED), 1)
    time = np.r_[0.0, np.cumsum(taken)]
    forward, left = moved_on_arcs(edges)
    pose = np.array([number for number, _, _ in measured])
    return {
        "odometry.csv": odometry(time, forward, left, edges[:, 2]),
        "ranges.csv": ranges(
            time[pose], [one for _, one, _ in measured], np.array([one for _, _, one in measured])
        ),
        "beacons.csv": beacons(list(landmarks), np.array(list(landmarks.values()))),
        "truth.csv": truth(time, east + along[:, 0], north + along[:, 1], heading),
    }


def moved_on_arcs(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give the way forward and to the left along an arc to the pose that each edge leads to.

    An edge's displacement is in the frame at its start, whose second axis is the bow's. On an arc
    of turn t it is sin(t / 2) / (t / 2) times the way, turned by t / 2.
    """
    forward, left, half = edges[:, 1], -edges[:, 0], 0.5 * edges[:, 2]
    chord = np.sinc(half / np.pi)
    along = (np.cos(half) * forward + np.sin(half) * left) / chord
    across = (np.cos(half) * left - np.sin(half) * forward) / chord
    return along, across


def digests(folder: Path) -> str:
    """Write the SHA-256 of each table of the recordings, as `sha256sum -c` reads them."""
    files = sorted(folder.glob("*/*.csv"))
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder).as_posix()}\n"
        for path in files
    ]
    return "".join(lines)


def main() -> None:
    """Convert all four."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="the wheel's folder gtsam/Data")
    parser.add_argument("out", type=Path, help="folder that gets one folder per recording")
    given = parser.parse_args()
    recordings = {
        "plaza1": plaza(given.data / "Plaza1_.mat", "plaza1"),
        "plaza2": plaza(given.data / "Plaza2_.mat", "plaza2"),
        "goats15": goats(given.data / "goats_15.pyfg", "goats15"),
        "goats16": goats(given.data / "goats_16.pyfg", "goats16"),
    }
    for name, files in recordings.items():
        folder = given.out / name
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")
    (given.out / "SHA256SUMS").write_text(digests(given.out), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
