"""Tables of ranges: our own, lists of one-way travel times, and PX4's ranging beacons."""

from pathlib import Path

import numpy as np

from obsplan.missions.mission import check_latlon
from obsplan.quantities import Quantity
from obsplan.replay.log import Fixes, Log, Ranges, counted
from obsplan.replay.table import Table, time_names

LISTS = "ranging_beacon"  # in the name of PX4's table, as ulog2csv calls it
KINDS = ("range_m", "one_way_s", "two_way_s")
OTHERS = ("measured_range", "owtt", "range")
STILL = 1.0  # [m]; a beacon whose fixes are nearer to each other is moored
WIDE = Quantity(-1e12, 1e12, "", "no instrument gives more digits")
DEGREES = Quantity(-360.0, 360.0, "degrees", "a whole turn")


def read_ranges(log: Log, path: Path) -> None:
    """Add the ranges of a table, and the beacons if it has them.

    Raises
    ------
    ObsplanError
        A column that is missing, or a cell that is no number; names file, line, column and value.
    """
    times = time_names("received", "time", "timestamp", "timestamp_sample")
    table = Table(path, [times, [*KINDS, *OTHERS]])
    for remark in table.remarks:
        log.note(f"{path.name}: {remark}")
    if {"beacon_id", "range"} <= set(table.names):
        _read_px4(log, table)
    elif {"src", "dest"} <= set(table.names):
        _read_one_way_list(log, table)
    else:
        _read_own(log, table)


def _read_own(log: Log, table: Table) -> None:
    """Our own columns."""
    table = Table(table.path, [["sender", "beacon"], KINDS])
    sender = table.first_of("sender", "beacon") or ""
    kind = table.first_of(*KINDS) or ""
    value, flight = _distances(log, table, kind)
    vehicle = table.first_of("vehicle", "receiver", "auv")
    received = table.times("received", "time", "timestamp")
    sent = table.times("sent")
    sent = np.where(np.isfinite(sent), sent, received - flight)
    unused = table.tell_unused(
        [
            *(sender, kind, vehicle or "", "sigma_m"),
            *time_names("received", "time", "timestamp", "sent"),
        ]
    )
    if unused:
        log.note(unused)
    log.ranges.append(
        Ranges(
            received=received,
            sent=sent,
            vehicle=table.labels(vehicle) if vehicle else [""] * len(table),
            sender=table.labels(sender),
            value=value,
            sigma=_sigmas(log, table, "sigma_m"),
        )
    )


def _distances(log: Log, table: Table, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m], and how long before it was received each was sent [s]."""
    settings, told = log.settings, table.numbers(kind, WIDE)
    c = settings.sound_speed
    if kind != "range_m" and settings.table.sound_speed is None:
        log.note(f"sound_speed is not told: travel times are made distances by {c:g} m/s")
    if kind == "range_m":
        return told, told / c
    if kind == "one_way_s":
        return told * c, told
    one_way = (told - settings.table.turn_around) / 2
    return one_way * c, one_way


def _sigmas(log: Log, table: Table, name: str) -> np.ndarray:
    """Standard deviations [m]; nan where there is none, or none that can be."""
    if name not in table.names:
        return np.full(len(table), np.nan)
    sigma = table.numbers(name, WIDE)
    wrong = sigma <= 0
    if wrong.any():
        log.note(
            f"{table.path.name}: {counted(int(wrong.sum()), 'standard deviation')} of 0 or less "
            "passed over: the scenario's is taken"
        )
    return np.where(wrong, np.nan, sigma)


def _read_one_way_list(log: Log, table: Table) -> None:
    """The columns timestamp, src, dest, owtt and measured_range."""
    received = table.times("timestamp", "time", "received")
    c = log.settings.sound_speed
    flight = np.full(len(table), np.nan)
    if "owtt" in table.names:
        flight = table.numbers("owtt", WIDE)
    if "measured_range" in table.names:
        value = table.numbers("measured_range", WIDE)
        flight = np.where(np.isfinite(flight), flight, value / c)
    else:
        value = flight * c
        if log.settings.table.sound_speed is None:
            log.note(f"sound_speed is not told: travel times are made distances by {c:g} m/s")
    log.note(f"{table.path.name}: timestamp is taken for the time at which dest received")
    log.ranges.append(
        Ranges(
            received=received,
            sent=received - flight,
            vehicle=table.labels("dest"),
            sender=table.labels("src"),
            value=value,
            sigma=np.full(len(table), np.nan),
        )
    )


def _read_px4(log: Log, table: Table) -> None:
    """The uORB topic ranging_beacon: ranges, and where beacons are."""
    name = "timestamp_sample" if "timestamp_sample" in table.names else "timestamp"
    received = table.numbers(name, WIDE) * 1e-6
    value = table.numbers("range", WIDE)
    senders = table.labels("beacon_id")
    log.note(f"{table.path.name}: {name} is taken for the reception, heights are passed over")
    log.ranges.append(
        Ranges(
            received=received,
            sent=received.copy(),  # by radio
            vehicle=[""] * len(table),
            sender=senders,
            value=value,
            sigma=_sigmas(log, table, "range_accuracy"),
        )
    )
    if not {"lat", "lon"} <= set(table.names):
        return
    place = np.column_stack([table.numbers(key, DEGREES) for key in ("lat", "lon")])
    for sender in dict.fromkeys(senders):
        rows = np.flatnonzero(np.array(senders) == sender)
        where = table.place(int(rows[0]), "lat")
        at = np.array(
            [check_latlon(lat, lon, where, "lat, lon") for lat, lon in place[rows].tolist()]
        )
        log.beacons[sender] = _track(received[rows], at)


def _track(time: np.ndarray, place: np.ndarray) -> Fixes:
    """A beacon's fixes [degrees]; one of them if it is moored."""
    from obsplan import geo

    whole = np.isfinite(time) & np.isfinite(place).all(axis=1)
    time, place = time[whole], place[whole]
    time, first = np.unique(time, return_index=True)
    place = place[first]
    if len(place) and geo.distance(place[:1], place).max() < STILL:
        time, place = np.array([np.nan]), np.median(place, axis=0)[None]
    nothing = np.zeros(time.size)
    return Fixes(time, place, nothing, nothing + np.nan, geographic=True)
