"""Write a tape as a folder of tables that `read` reads."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.files import write_atomically
from obsplan.replay.settings import NAME
from obsplan.sensors import Range
from obsplan.spelling import inert
from obsplan.tape import Tape

Row = Sequence[float | str]


def write_recording(
    folder: Path | str,
    tape: Tape,
    first: Float[np.ndarray, "auvs n"],
    settings: dict[str, Any] | None = None,
) -> tuple[str, ...]:
    """Write a tape as tables, as `obsplan.replay.read` reads them.

    The motion that is read leads where the tape's does, to rounding.

    Parameters
    ----------
    folder
        Made if it is not there.
    first
        First estimates: east, north [m], heading [rad], speed [m/s]; of a run ``run.mean[:, 0]``.
    settings
        Keys of ``recording.toml`` besides, such as ``{"ranging": {"sigma": 2.0}}``.

    Returns
    -------
    A sentence for each kind of measurement that the tables cannot hold.

    Raises
    ------
    ObsplanError
        The folder cannot be written.
    """
    import tomlkit

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _write(
        folder / "odometry.csv", "time_s,vehicle,forward_m,left_m,turn_rad", _odometry(tape, first)
    )
    _write(folder / "beacons.csv", "name,time_s,east_m,north_m,depth_m", _beacons(tape))
    _write(folder / "ranges.csv", "received_s,sent_s,vehicle,sender,range_m,sigma_m", _ranges(tape))
    if np.isfinite(tape.heading).any():
        _write(folder / "heading.csv", "time_s,vehicle,heading_rad", _headings(tape))
    if tape.depth.any():
        _write(folder / "depth.csv", "time_s,vehicle,depth_m", _depths(tape))
    if tape.truth is not None:
        header = "time_s,vehicle,east_m,north_m,heading_rad"
        _write(folder / "truth.csv", header, _truth(tape))
    contents = dict(settings or {})
    auvs = [
        {"name": name, "first_estimate": _first(state)}
        for name, state in zip(tape.auvs, first, strict=True)
    ]
    write_atomically(folder / NAME, tomlkit.dumps({"increments": "start", **contents, "auv": auvs}))
    others = [name for name, sensor in tape.sensors.items() if not isinstance(sensor, Range)]
    return tuple(f"measurements of {name} are not written: tables hold ranges" for name in others)


def _write(path: Path, header: str, rows: Iterable[Row]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header.split(","))
    writer.writerows(
        [inert(cell) if isinstance(cell, str) else cell for cell in row] for row in rows
    )
    write_atomically(path, text.getvalue())


def _first(state: Float[np.ndarray, " n"]) -> dict[str, float]:
    """A first estimate, as a scenario has it."""
    east, north, heading, speed = state[:4].tolist()
    return {"x": east, "y": north, "heading_deg": float(np.rad2deg(heading)), "speed": speed}


def _odometry(tape: Tape, first: Float[np.ndarray, "auvs n"]) -> Iterable[Row]:
    elapsed = np.diff(tape.time)
    for j, name in enumerate(tape.auvs):
        speed = first[j, 3] + np.append(0.0, np.cumsum(tape.change_of_speed[j])[:-1])
        steps = np.column_stack([speed * elapsed, tape.sway[j], tape.turn[j]]).tolist()
        yield tape.time[0], name, 0.0, 0.0, 0.0
        for time, row in zip(tape.time[1:].tolist(), steps, strict=True):
            yield time, name, *row


def _beacons(tape: Tape) -> Iterable[Row]:
    for b, name in enumerate(tape.beacons):
        places, depth = tape.pose[b, :, :2].tolist(), float(tape.beacon_depth[b])
        if (tape.pose[b, :, :2] == tape.pose[b, 0, :2]).all():
            yield name, "", *places[0], depth
            continue
        for time, place in zip(tape.time.tolist(), places, strict=True):
            yield name, time, *place, depth


def _ranges(tape: Tape) -> Iterable[Row]:
    told, names = tape.measurements, [*tape.beacons, *tape.auvs]
    kinds = [isinstance(sensor, Range) for sensor in tape.sensors.values()]
    for i in np.flatnonzero(np.array(kinds)[told.sensor]):
        sigma = float(told.sigma[i])
        yield (
            *(float(told.received[i]), float(told.sent[i])),
            *(tape.auvs[told.auv[i]], names[told.beacon[i]]),
            *(float(told.value[i]), "" if np.isnan(sigma) else sigma),
        )


def _headings(tape: Tape) -> Iterable[Row]:
    for j, name in enumerate(tape.auvs):
        for k in np.flatnonzero(np.isfinite(tape.heading[j])):
            yield float(tape.time[k + 1]), name, float(tape.heading[j, k])


def _depths(tape: Tape) -> Iterable[Row]:
    for j, name in enumerate(tape.auvs):
        for time, depth in zip(tape.time.tolist(), tape.depth[j].tolist(), strict=True):
            yield time, name, depth


def _truth(tape: Tape) -> Iterable[Row]:
    if tape.truth is None:
        return
    for j, name in enumerate(tape.auvs):
        for k in np.flatnonzero(np.isfinite(tape.truth[j, :, 0])):
            yield float(tape.time[k]), name, *tape.truth[j, k, :3].tolist()
