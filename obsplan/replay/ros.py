"""Rosbags: ROS 1 bags, rosbag2 folders and MCAP files, by the optional package rosbags."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.replay.log import Fixes, Log, Ranges, counted
from obsplan.replay.motion import increments
from obsplan.replay.settings import NAME, read_settings
from obsplan.spelling import nearest
from obsplan.types import ObsplanError

BAGS = (".mcap", ".db3", ".bag")
METADATA = "metadata.yaml"  # of a rosbag2 folder
ODOMETRY = "nav_msgs/msg/Odometry"
FIX = "sensor_msgs/msg/NavSatFix"
RANGE = "sensor_msgs/msg/Range"
INSTALL = "install it by: pip install 'obsplan[ros]'"
MOST_MESSAGES = 2_000_000


def is_bag(path: Path) -> bool:
    """Whether a path is a rosbag: a file, or a folder with its metadata."""
    if path.is_dir():
        return (path / METADATA).exists()
    return path.suffix.lower() in BAGS


def read_bag(path: Path) -> Log:
    """Read the topics that ``recording.toml``, in the folder or beside the file, names.

    Raises
    ------
    ObsplanError
        The package rosbags is missing, topics that are not named or not there, or a type of message
        that is not read.
    """
    folder = path if path.is_dir() else path.parent
    log = Log(path=path, settings=read_settings(folder))
    topics = log.settings.table.topics
    if not (topics.odometry and topics.ranges and topics.beacons):
        raise ObsplanError(
            f"{folder / NAME} must name the bag's topics: [topics] with odometry, beacons and "
            'ranges, each { name = "/topic" }'
        )
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ObsplanError(
            f"{path} is a rosbag, and the package rosbags is not installed: {INSTALL}"
        ) from error
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            _read_topics(log, reader)
    except AnyReaderError as error:
        raise ObsplanError(
            f"{path} cannot be read as a rosbag ({str(error)[:200]}): record it again, or convert "
            "it to MCAP"
        ) from error
    return log


def _read_topics(log: Log, reader: Any) -> None:
    topics = log.settings.table.topics
    for name, topic in topics.odometry.items():
        stamps, rows = _rows(log, reader, topic, {ODOMETRY: _pose})
        motion = increments(log, topic, stamps, _seen_from_before(rows), 0.0)
        if motion is not None:
            log.motions[name] = motion
    for name, topic in topics.beacons.items():
        log.beacons[name] = _fixes(log, *_rows(log, reader, topic, {FIX: _fix}), topic, True)
    for name, topic in topics.truth.items():
        stamps, rows = _rows(log, reader, topic, {ODOMETRY: _pose, FIX: _fix})
        geographic = rows.shape[1] == 2
        log.truths[name] = _fixes(log, stamps, rows, topic, geographic)
    for name, topic in topics.ranges.items():
        stamps, rows = _rows(log, reader, topic, {RANGE: _range})
        count, (vehicle, _, sender) = stamps.size, name.rpartition("/")
        flight = rows[:, 0] / log.settings.sound_speed
        log.ranges.append(
            Ranges(
                received=stamps,
                sent=stamps - flight,
                vehicle=[vehicle] * count,
                sender=[sender] * count,
                value=rows[:, 0],
                sigma=np.full(count, np.nan),
            )
        )


def _rows(
    log: Log, reader: Any, topic: str, kinds: dict[str, Any]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"]]:
    """Times [s] and numbers of a topic's messages, by their headers' stamps."""
    found = [one for one in reader.connections if one.topic == topic]
    if not found:
        known = sorted({one.topic for one in reader.connections})
        raise ObsplanError(f'{log.path} has no topic "{topic}"; {nearest(topic, known)}')
    kind = found[0].msgtype
    if kind not in kinds:
        raise ObsplanError(
            f'{log.path}: topic "{topic}" is of {kind}, and {" or ".join(kinds)} is read there: '
            "name another"
        )
    messages = list(_messages(log, reader, found))
    stamps = np.array([_stamp(message) for message, _ in messages])
    if stamps.size and (stamps == 0).all():
        log.note(f"{topic}: headers have no time, that of recording is taken")
        stamps = np.array([recorded * 1e-9 for _, recorded in messages])
    width = {_pose: 3, _fix: 2, _range: 1}[kinds[kind]]
    rows = np.array([kinds[kind](message) for message, _ in messages], dtype=float)
    return stamps, rows.reshape(-1, width)


def _messages(log: Log, reader: Any, connections: list[Any]) -> Iterator[tuple[Any, int]]:
    for i, (connection, recorded, raw) in enumerate(reader.messages(connections=connections)):
        if i >= MOST_MESSAGES:
            raise ObsplanError(
                f"{log.path}: {connection.topic} has more than {MOST_MESSAGES} messages: thin "
                "the bag out"
            )
        yield reader.deserialize(raw, connection.msgtype), recorded


def _stamp(message: Any) -> float:
    stamp = message.header.stamp
    return stamp.sec + stamp.nanosec * 1e-9


def _pose(message: Any) -> tuple[float, float, float]:
    """East, north [m] and heading [rad]: REP 103, x east and y north, or as it began."""
    place, q = message.pose.pose.position, message.pose.pose.orientation
    yaw = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
    return place.x, place.y, float(yaw)


def _fix(message: Any) -> tuple[float, float]:
    """Latitude and longitude [degrees]; nan where there is no fix."""
    if message.status.status < 0:
        return np.nan, np.nan
    return message.latitude, message.longitude


def _range(message: Any) -> tuple[float]:
    return (message.range,)


def _seen_from_before(poses: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Each pose in the frame of the one before: forward, left [m], turn [rad]."""
    found = np.zeros_like(poses)
    east, north, turn = np.diff(poses, axis=0).T
    heading = poses[:-1, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    found[1:, 0] = east * cos + north * sin
    found[1:, 1] = north * cos - east * sin
    found[1:, 2] = np.arctan2(np.sin(turn), np.cos(turn))
    return found


def _fixes(
    log: Log,
    stamps: Float[np.ndarray, " n"],
    rows: Float[np.ndarray, "n k"],
    topic: str,
    geographic: bool,
) -> Fixes:
    """Places by their times, each time once."""
    whole = np.isfinite(rows[:, :2]).all(axis=1)
    if not whole.all():
        log.note(f"{topic}: {counted(int((~whole).sum()), 'message')} without a place passed over")
    time, first = np.unique(stamps[whole], return_index=True)
    if not time.size:
        raise ObsplanError(f"{log.path}: {topic} has no place: name another topic")
    rows = rows[whole][first]
    heading = rows[:, 2] if rows.shape[1] > 2 else np.full(time.size, np.nan)
    return Fixes(time, rows[:, :2], np.zeros(time.size), heading, geographic)
