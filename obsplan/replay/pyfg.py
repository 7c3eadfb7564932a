"""PyFactorGraph's text format of planar factor graphs (`.pyfg`)."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from obsplan.missions.mission import read_number
from obsplan.missions.source import read_text
from obsplan.replay.log import Fixes, Log, Ranges, counted
from obsplan.replay.motion import increments
from obsplan.replay.settings import read_settings
from obsplan.types import ObsplanError

# how many words a line has after its kind: time, names, numbers, and covariances by columns
LENGTHS = {
    "VERTEX_SE2": 5,
    "VERTEX_XY": 3,
    "VERTEX_SE2:PRIOR": 11,
    "EDGE_SE2": 12,
    "EDGE_RANGE": 5,
}
PASSED_OVER = {
    "VERTEX_XY:PRIOR": "prior of a landmark",
    "EDGE_SE2_XY": "measured place of a landmark",
}
MOST_LINES = 2_000_000
FARTHEST = 1e6  # of any number but a time
ASTRAY = 0.25  # of the ranges, by which they miss poses in another frame


@dataclass
class Graph:
    """Lines of a file, by their kinds."""

    poses: dict[str, list[float]] = field(default_factory=dict)  # time, x, y, heading
    landmarks: dict[str, list[float]] = field(default_factory=dict)
    priors: dict[str, list[float]] = field(default_factory=dict)  # x, y, heading, covariance
    edges: list[tuple[str, str, list[float]]] = field(default_factory=list)
    ranges: list[tuple[str, str, list[float]]] = field(default_factory=list)
    passed: dict[str, int] = field(default_factory=dict)

    def pass_over(self, what: str) -> None:
        """Count a thing that is not read."""
        self.passed[what] = self.passed.get(what, 0) + 1


def read_pyfg(path: Path) -> Log:
    """Read a planar factor graph: poses, landmarks, odometry, ranges, and the first pose's prior.

    Poses' vertices are the truth. Landmarks are beacons that do not move.

    Raises
    ------
    ObsplanError
        Not such a file, or a line that is wrong; names the line.
    """
    graph = _read_lines(path)
    log = Log(path=path, settings=read_settings(path.parent))
    for what, count in graph.passed.items():
        log.note(f"{path.name}: {counted(count, what)} passed over")
    chains: dict[str, list[str]] = {}
    for name in graph.poses:
        chains.setdefault(vehicle_of(name), []).append(name)
    if not chains:
        raise ObsplanError(f"{path} has no VERTEX_SE2: give a planar graph with its poses")
    times = _times(log, graph, chains)
    placed = _is_placed(log, graph)
    for vehicle, poses in chains.items():
        _add_vehicle(log, graph, vehicle, poses, times, placed=placed)
    for name, place in graph.landmarks.items():
        nothing = np.array([np.nan])
        log.beacons[name] = Fixes(nothing, np.array([place]), np.zeros(1), nothing, False)
    _add_ranges(log, graph, times)
    return log


def vehicle_of(pose: str) -> str:
    """`A12` is a pose of A."""
    return re.sub(r"\d+$", "", pose) or pose


def number_of(pose: str) -> int:
    """`A12` is its pose 12; -1 without a number."""
    digits = re.search(r"\d{1,12}$", pose)
    return int(digits[0]) if digits else -1


def _read_lines(path: Path) -> Graph:
    """Sort the lines."""
    lines = read_text(path).splitlines()
    if len(lines) > MOST_LINES:
        raise ObsplanError(f"{path} has {len(lines)} lines, more than {MOST_LINES}: thin it out")
    graph = Graph()
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and not words[0].startswith("#"):
            _read_line(graph, words, f"{path}: line {number}")
    return graph


def _read_line(graph: Graph, words: Sequence[str], where: str) -> None:
    kind, rest = words[0], words[1:]
    if kind in PASSED_OVER:
        graph.pass_over(PASSED_OVER[kind])
        return
    if kind not in LENGTHS:
        spatial = kind.startswith(("VERTEX_SE3", "VERTEX_XYZ", "EDGE_SE3"))
        why = "is of a graph in space: project it to the plane" if spatial else "is not known"
        raise ObsplanError(f"{where} is {kind[:40]!r}, which {why}; known are {', '.join(LENGTHS)}")
    if len(rest) != LENGTHS[kind]:
        raise ObsplanError(
            f"{where} has {len(rest)} words after {kind}, and {LENGTHS[kind]} are needed: it may "
            "be cut short, save the graph again"
        )
    numbered = [word for word in rest if not _is_name(word)]
    names = [word for word in rest if _is_name(word)]
    expected = 2 if kind.startswith("EDGE") else 1
    if len(names) != expected:
        raise ObsplanError(
            f"{where} has the names {names[:3]}, and {kind} has {expected}: correct the line"
        )
    values = [read_number(word, where) for word in numbered]
    timed = kind != "VERTEX_XY"
    far = [value for value in values[timed:] if abs(value) > FARTHEST]
    if far or (timed and abs(values[0]) > 1e10):
        raise ObsplanError(f"{where} has {(far or values)[0]:g}, which is too large: correct it")
    _add(graph, kind, names, values)


def _is_name(word: str) -> bool:
    return word[0].isalpha() and word.lower() not in ("nan", "inf")


def _add(graph: Graph, kind: str, names: list[str], values: list[float]) -> None:
    """Add a line to its like."""
    if kind == "VERTEX_SE2":
        graph.poses[names[0]] = values
    elif kind == "VERTEX_XY":
        graph.landmarks[names[0]] = values
    elif kind == "VERTEX_SE2:PRIOR":
        graph.priors[names[0]] = values[1:]
    elif kind == "EDGE_RANGE":
        graph.ranges.append((names[0], names[1], values))
    else:
        graph.edges.append((names[0], names[1], values))


def _times(log: Log, graph: Graph, chains: dict[str, list[str]]) -> dict[str, float]:
    """Time of each pose [s]; their numbers where the file has none that run on."""
    times = {name: pose[0] for name, pose in graph.poses.items()}
    runs_on = all((np.diff([times[name] for name in c]) > 0).all() for c in chains.values())
    if runs_on:
        return times
    log.note(f"{log.path.name}: times of poses do not run on, a pose a second is taken")
    return {name: float(number_of(name)) for name in graph.poses}


def _is_placed(log: Log, graph: Graph) -> bool:
    """Whether the poses are in the landmarks' frame, by the ranges; said if they are not."""
    pairs = [
        (graph.poses[pose][1:3], graph.landmarks[mark], values[1])
        for pose, mark, values in graph.ranges
        if pose in graph.poses and mark in graph.landmarks
    ]
    if not pairs:
        return True
    at, marks, told = (np.array(column) for column in zip(*pairs, strict=True))
    miss = float(np.median(np.abs(np.hypot(*(at - marks).T) - told)))
    placed = miss <= ASTRAY * float(np.median(told))
    if not placed:
        log.note(
            f"{log.path.name}: ranges miss the poses by {miss:.0f} m in the median, so that these "
            "are not in the landmarks' frame: neither the truth nor where to begin is known"
        )
    return placed


def _add_vehicle(
    log: Log,
    graph: Graph,
    vehicle: str,
    poses: list[str],
    times: dict[str, float],
    *,
    placed: bool,
) -> None:
    """A vehicle's odometry and, if poses are placed among landmarks, truth and first estimate."""
    steps = {(base, to): values[1:] for base, to, values in graph.edges}
    edges = [steps.pop(pair, [math.nan] * 9) for pair in pairwise(poses)]
    rows = [[0.0, 0.0, 0.0], *(edge[:3] for edge in edges)]
    loops = [base for base, _ in steps if vehicle_of(base) == vehicle]
    if loops:
        log.note(f"{log.path.name}: {counted(len(loops), 'loop closure')} of {vehicle} passed over")
    time = np.array([times[name] for name in poses])
    # an edge is seen from its first pose: along the heading before the turn
    motion = increments(log, f"{log.path.name}, {vehicle}", time, np.array(rows), 0.0)
    if motion is None:
        return
    log.motions[vehicle] = motion
    _add_noise(log, vehicle, np.array(edges).reshape(-1, 9)[:, 3:], np.diff(time))
    if not placed:
        return
    true = np.array([graph.poses[name] for name in poses])
    order = np.argsort(time, kind="stable")
    nothing = np.zeros(time.size)
    log.truths[vehicle] = Fixes(
        time[order], true[order, 1:3], nothing, true[order, 3], geographic=False
    )
    _add_first_estimate(log, vehicle, graph.priors.get(poses[0]), true[0, 1:])


def _add_noise(log: Log, vehicle: str, covariances: np.ndarray, elapsed: np.ndarray) -> None:
    """The process noise that edges tell of, per root second, unless ``recording.toml`` says it."""
    # of either triangle, by columns, the second variance is the third or the fourth number
    place = (covariances[:, 0] + covariances[:, 2:4].max(axis=1)) / 2
    rates = np.column_stack([place, covariances[:, 5]]) / elapsed[:, None]
    rates = rates[np.isfinite(rates).all(axis=1) & (rates >= 0).all(axis=1)]
    known = _told_of(log, vehicle)
    if "process_noise" in known or not len(rates):
        return
    position, heading = np.sqrt(np.median(rates, axis=0)).tolist()
    degrees = math.degrees(heading)
    known["process_noise"] = {"position": position, "heading_deg": degrees, "speed": 0.0}
    log.note(
        f"{log.path.name}: process noise of {vehicle} is that of its edges: {position:.3g} m and "
        f"{degrees:.3g} degrees per root second"
    )


def _told_of(log: Log, vehicle: str) -> dict[str, Any]:
    """The table of a vehicle in ``recording.toml``, or a new one."""
    auvs = log.settings.scenario.setdefault("auv", [])
    known: dict[str, Any] | None = next((a for a in auvs if a.get("name") == vehicle), None)
    if known is None:
        known = {"name": vehicle}
        auvs.append(known)
    return known


def _add_first_estimate(
    log: Log, vehicle: str, prior: list[float] | None, pose: np.ndarray
) -> None:
    """The prior of a vehicle's first pose, or that pose: a graph is about it."""
    first = {"x": float(pose[0]), "y": float(pose[1])}
    first["heading_deg"] = float(np.rad2deg(pose[2]))
    if prior is None:
        log.note(f"{log.path.name}: {vehicle} has no prior, its first pose is taken for known")
        first |= {"sigma_position": 0.1, "sigma_heading_deg": 1.0}
    else:
        first |= {"x": prior[0], "y": prior[1], "heading_deg": float(np.rad2deg(prior[2]))}
        # by columns of either triangle, the second variance is the fourth or the third number
        first["sigma_position"] = math.sqrt(max(prior[3], prior[5], prior[6], 0.0))
        first["sigma_heading_deg"] = min(math.degrees(math.sqrt(max(prior[8], 0.0))), 360.0)
    known = _told_of(log, vehicle)
    told = known.get("first_estimate", {})
    known["first_estimate"] = {**first, **told}


def _add_ranges(log: Log, graph: Graph, times: dict[str, float]) -> None:
    """Ranges, each received when its pose is."""
    rows = [(pose, other, values) for pose, other, values in graph.ranges if pose in times]
    unknown = len(graph.ranges) - len(rows)
    if unknown:
        log.note(f"{log.path.name}: {counted(unknown, 'range')} of unknown poses passed over")
    received = np.array([times[pose] for pose, _, _ in rows])
    numbers = np.array([values[1:3] for _, _, values in rows]).reshape(-1, 2)
    sender = [vehicle_of(other) if other in times else other for _, other, _ in rows]
    sigma = np.sqrt(np.where(numbers[:, 1] > 0, numbers[:, 1], np.nan))
    vehicle = [vehicle_of(pose) for pose, _, _ in rows]
    log.ranges.append(Ranges(received, received.copy(), vehicle, sender, numbers[:, 0], sigma))
