"""A folder of CSV tables, one for each kind of row, and ``recording.toml``."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Integer

from obsplan.missions.mission import check_latlon
from obsplan.quantities import DEPTH, POSITION, Quantity
from obsplan.replay.heard import LISTS, read_ranges
from obsplan.replay.log import RESOLUTION, Fixes, Log, Readings, counted
from obsplan.replay.motion import increments, speeds
from obsplan.replay.settings import read_settings
from obsplan.replay.table import Table, time_names
from obsplan.types import ObsplanError

ONLY = "auv"  # name of the only vehicle, where none is told
TURN = Quantity(-1e4, 1e4, "", "no vehicle turns more between two rows")
SPEED = Quantity(-50.0, 50.0, "m/s", "no vessel is faster")
TURN_RATE = Quantity(-50.0, 50.0, "rad/s", "no vessel turns faster")
ANGLE = Quantity(-1e6, 1e6, "", "more turns say no more")
DEGREES = Quantity(-360.0, 360.0, "degrees", "a whole turn")
HEADINGS = ("heading_rad", "heading_deg", "compass_deg")
VEHICLE = ("vehicle", "auv")
FILES = (
    *("odometry.csv", "speed.csv", "ranges.csv", "beacons.csv"),
    *("heading.csv", "depth.csv", "truth.csv"),
)


def read_folder(folder: Path, ranges: Path | None = None) -> Log:
    """Read a folder of tables; ``ranges`` is read in place of ``ranges.csv``.

    Raises
    ------
    ObsplanError
        A table that is missing or cannot be read; names file, line, column, value and remedy.
    """
    log = Log(path=folder, settings=read_settings(folder))
    names = {path.name.lower(): path for path in sorted(folder.iterdir()) if path.is_file()}
    lists = [path for name, path in names.items() if name.endswith(".csv") and LISTS in name]
    found = {name: names[name] for name in FILES if name in names}
    heard = [ranges] if ranges else [found["ranges.csv"]] if "ranges.csv" in found else lists
    others = {path for name, path in names.items() if name.endswith(".csv")}
    passed = others - {*found.values(), *heard}
    if passed:
        listed = ", ".join(sorted(path.name for path in passed))
        log.note(f"tables of other names passed over: {listed[:200]}; known are {', '.join(FILES)}")
    if not heard:
        raise missing(folder, "ranges.csv")
    _read_motion(log, found)
    for path in heard:
        read_ranges(log, path)
    readers = {
        "beacons.csv": _read_beacons,
        "heading.csv": _read_headings,
        "depth.csv": _read_depths,
        "truth.csv": _read_truth,
    }
    for name, reader in readers.items():
        if name in found:
            reader(log, found[name])
    return log


def missing(folder: Path, name: str) -> ObsplanError:
    """What to say of a table that is not there."""
    there = ", ".join(sorted(path.name for path in folder.iterdir()))[:200] or "nothing"
    return ObsplanError(f"{folder} has no {name}, but {there}: name the tables {', '.join(FILES)}")


def _read_motion(log: Log, found: dict[str, Path]) -> None:
    """Odometry, or else speed and heading."""
    if "odometry.csv" in found:
        _read_odometry(log, found["odometry.csv"])
        if "speed.csv" in found:
            log.note("speed.csv passed over: odometry.csv says how vehicles moved")
    elif "speed.csv" in found:
        _read_speeds(log, found["speed.csv"])
    else:
        raise missing(log.path, "odometry.csv or speed.csv")
    if not log.motions:
        raise ObsplanError(f"{log.path} has no row that says how a vehicle moved: add some")


def _read_odometry(log: Log, path: Path) -> None:
    table = _timed(log, path, ["forward_m"], ["turn_rad", "turn_deg"])
    time = table.times("time", "timestamp")
    turn, unit = _angle(table, "turn_rad", "turn_deg", TURN)
    forward = table.numbers("forward_m", POSITION)
    left = np.zeros(len(table))
    if "left_m" in table.names:
        left = table.numbers("left_m", POSITION)
    share = 0.5 if log.settings.table.increments == "middle" else 0.0
    steps = np.column_stack([forward, left, turn])
    for name, rows in _by_vehicle(log, table, "forward_m", "left_m", unit):
        motion = increments(log, _of(path, name), time[rows], steps[rows], share)
        if motion is not None:
            log.motions[name] = motion


def _read_speeds(log: Log, path: Path) -> None:
    table = _timed(log, path, ["speed_m_s"], [*HEADINGS, "turn_rate_rad_s"])
    time = table.times("time", "timestamp")
    turning = table.first_of(*HEADINGS) is None
    if turning:
        course, unit = table.numbers("turn_rate_rad_s", TURN_RATE), "turn_rate_rad_s"
    else:
        course, unit = _heading(log, table)
    given = np.column_stack([table.numbers("speed_m_s", SPEED), course])
    for name, rows in _by_vehicle(log, table, "speed_m_s", unit):
        read = speeds(log, _of(path, name), time[rows], given[rows], turning=turning)
        if read is None:
            continue
        log.motions[name], headings = read
        if np.isfinite(headings).any():
            log.headings[name] = Readings(log.motions[name].time, headings)


def _read_headings(log: Log, path: Path) -> None:
    if log.headings:
        log.note(f"headings of speed.csv are not taken for readings: {path.name} has them")
        log.headings.clear()
    table = _timed(log, path, HEADINGS)
    value, unit = _heading(log, table)
    _read_each(log, table, value, unit, log.headings)


def _read_depths(log: Log, path: Path) -> None:
    table = _timed(log, path, ["depth_m"])
    _read_each(log, table, table.numbers("depth_m", DEPTH), "depth_m", log.depths)


def _read_each(
    log: Log, table: Table, value: Float[np.ndarray, " n"], unit: str, into: dict[str, Readings]
) -> None:
    """Readings of each vehicle, by their times."""
    time = table.times("time", "timestamp")
    for name, rows in _by_vehicle(log, table, unit):
        at, of = _sorted_rows(log, _of(table.path, name), time[rows], value[rows, None])
        if at.size:
            into[name] = Readings(at, of[:, 0])


def _read_truth(log: Log, path: Path) -> None:
    table = _timed(log, path, ["east_m", "lat_deg"], ["north_m", "lon_deg"])
    time = table.times("time", "timestamp")
    place, geographic, used = _places(table)
    heading, unit = np.full(len(table), np.nan), ""
    if table.first_of(*HEADINGS):
        heading, unit = _heading(log, table)
    rows_of = np.column_stack([place, heading])
    for name, rows in _by_vehicle(log, table, *used, unit):
        where = _of(path, name)
        at, rows = _sorted_rows(log, where, time[rows], rows_of[rows], needed=2)
        if at.size:
            nothing = np.zeros(at.size)
            log.truths[name] = Fixes(at, rows[:, :2], nothing, rows[:, 2], geographic)


def _read_beacons(log: Log, path: Path) -> None:
    table = Table(path, [["name", "beacon"], ["east_m", "lat_deg"], ["north_m", "lon_deg"]])
    _tell(log, table)
    place, geographic, used = _places(table)
    time, depth = table.times("time", "timestamp"), np.zeros(len(table))
    if "depth_m" in table.names:
        depth = np.nan_to_num(table.numbers("depth_m", DEPTH))
    label = table.first_of("name", "beacon") or ""
    names = table.labels(label)
    unused = table.tell_unused([label, "depth_m", *time_names("time", "timestamp"), *used])
    if unused:
        log.note(unused)
    for name in dict.fromkeys(names):
        rows = np.flatnonzero(np.array(names) == name)
        where = f'{path.name}, beacon "{name}"'
        log.beacons[name] = _beacon(
            log, where, time[rows], np.column_stack([place, depth])[rows], geographic
        )


def _beacon(
    log: Log,
    where: str,
    time: Float[np.ndarray, " n"],
    rows: Float[np.ndarray, "n 3"],
    geographic: bool,
) -> Fixes:
    """A beacon: one place without a time, or a track with times.

    Raises
    ------
    ObsplanError
        No place, or several places without times.
    """
    if np.isnan(time).all():
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(np.unique(rows, axis=0)) != 1:
            raise ObsplanError(
                f"{where} has {len(np.unique(rows, axis=0))} places and no times: give one row, "
                "or time_s"
            )
        time, rows = np.array([np.nan]), rows[:1]
    else:
        time, rows = _sorted_rows(log, where, time, rows, needed=2)
        if not time.size:
            raise ObsplanError(f"{where} has no row with a time and a place: add one")
    return Fixes(time, rows[:, :2], rows[:, 2], np.full(time.size, np.nan), geographic)


def _sorted_rows(
    log: Log,
    where: str,
    time: Float[np.ndarray, " n"],
    rows: Float[np.ndarray, "n k"],
    needed: int = 1,
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m k"]]:
    """Rows that have a time and their first numbers, by their times; the last of each time."""
    whole = np.isfinite(time) & np.isfinite(rows[:, :needed]).all(axis=1)
    if not whole.all():
        log.note(f"{where}: {counted(int((~whole).sum()), 'row')} without numbers passed over")
    time, rows = time[whole], rows[whole]
    order = np.argsort(time, kind="stable")
    time, rows = time[order], rows[order]
    last = np.append(np.diff(time) > RESOLUTION, True)[: time.size]
    if not last.all():
        log.note(f"{where}: {counted(int((~last).sum()), 'row')} at a time of another passed over")
    return time[last], rows[last]


def _timed(log: Log, path: Path, *needs: Sequence[str]) -> Table:
    """A table with times and some columns."""
    table = Table(path, [time_names("time", "timestamp"), *needs])
    _tell(log, table)
    return table


def _tell(log: Log, table: Table) -> None:
    """Say what was remarkable about a table's text."""
    for remark in table.remarks:
        log.note(f"{table.path.name}: {remark}")


def _places(table: Table) -> tuple[Float[np.ndarray, "n 2"], bool, tuple[str, str]]:
    """Local places [m] or latitudes and longitudes [degrees], and the names of their columns."""
    local = {"east_m", "north_m"} <= set(table.names)
    if local:
        used = ("east_m", "north_m")
        return np.column_stack([table.numbers(name, POSITION) for name in used]), False, used
    used = ("lat_deg", "lon_deg")
    if not set(used) <= set(table.names):
        raise ObsplanError(
            f"{table.path} has one of each of east_m, north_m and lat_deg, lon_deg: give a pair"
        )
    place = np.column_stack([table.numbers(name, DEGREES) for name in used])
    for i in np.flatnonzero(np.isfinite(place).all(axis=1)):
        where = table.place(int(i), "lat_deg")
        lat, lon = place[i].tolist()
        place[i] = check_latlon(lat, lon, where, "exchange the headings of the columns")
    return place, True, used


def _heading(log: Log, table: Table) -> tuple[Float[np.ndarray, " n"], str]:
    """Headings [rad], counter-clockwise from east, and the name of their column."""
    name = table.first_of(*HEADINGS) or HEADINGS[0]
    told = table.numbers(name, ANGLE)
    if name != "compass_deg":
        return (np.deg2rad(told) if name == "heading_deg" else told), name
    east = log.settings.table.declination_deg
    return np.pi / 2 - np.deg2rad(told + east), name


def _angle(
    table: Table, rad: str, deg: str, within: Quantity
) -> tuple[Float[np.ndarray, " n"], str]:
    """Angles [rad] of one of two columns, and its name."""
    if rad in table.names:
        return table.numbers(rad, within), rad
    return np.deg2rad(table.numbers(deg, within)), deg


def _by_vehicle(
    log: Log, table: Table, *used: str
) -> Iterator[tuple[str, Integer[np.ndarray, " m"]]]:
    """Rows of each vehicle; those of the only one where none is told."""
    column = table.first_of(*VEHICLE)
    names = table.labels(column) if column else [""] * len(table)
    unused = table.tell_unused([*VEHICLE, *time_names("time", "timestamp"), *used])
    if unused:
        log.note(unused)
    at = np.array(names)
    for name in dict.fromkeys(names):
        yield name or _only(log), np.flatnonzero(at == name)


def _only(log: Log) -> str:
    """Name of the only vehicle.

    Raises
    ------
    ObsplanError
        There are several.
    """
    if len(log.motions) > 1:
        raise ObsplanError(
            f"{log.path} has {len(log.motions)} vehicles, and a table without their names: add "
            "the column vehicle"
        )
    told = log.settings.scenario.get("auv")
    first = told[0] if isinstance(told, list) and told else {}
    name = first.get("name") if isinstance(first, dict) else None
    return next(iter(log.motions), name if isinstance(name, str) and name else ONLY)


def _of(path: Path, name: str) -> str:
    """A table's rows of one vehicle, to begin a sentence with."""
    return path.name if name == ONLY else f'{path.name}, vehicle "{name}"'
