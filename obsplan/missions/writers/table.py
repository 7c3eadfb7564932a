"""CSV: one row a point, in degrees and in local metres, with times and speeds."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from obsplan import geo
from obsplan.files import write_atomically
from obsplan.missions.mission import Mission, Point, Track
from obsplan.missions.writers.checks import check_geographic
from obsplan.missions.writers.times import stamps
from obsplan.spelling import inert

COLUMNS = ("name", "time_s", "lat", "lon", "x_m", "y_m", "speed_mps")
METRES = 3  # decimals


def write_csv(path: Path | str, mission: Mission, *, origin: Point | None = None) -> None:
    """Write geographic tracks as a table.

    ``x_m`` and ``y_m`` are east and north of the origin [degrees], by default `Mission.origin`.
    ``speed_mps`` is that of the leg that leads to the row's place, in the first row that of the
    first leg. A hold is a row repeated. What is not known is left empty. The format holds no
    limits.

    Raises
    ------
    ObsplanError
        The file cannot be written.
    ValueError
        Local tracks.
    """
    check_geographic(mission, "this table")
    lat, lon = next(iter(mission.tracks.values())).points[0].tolist()
    place = origin or mission.origin or (lat, lon)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for name, track in mission.tracks.items():
        for row in _rows(track, place):
            writer.writerow([inert(name), *row])
    write_atomically(path, text.getvalue())


def _rows(track: Track, origin: Point) -> Iterator[list[str]]:
    points, times = stamps(track)
    local = geo.to_local(points, origin).round(METRES) + 0.0  # no -0.000
    legs = [] if track.speed is None else [track.speed[0], *track.speed.tolist()]
    again = np.append(False, (points[1:] == points[:-1]).all(axis=1))
    vertex = np.cumsum(~again) - 1
    for i, ((lat, lon), (x, y)) in enumerate(zip(points.tolist(), local.tolist(), strict=True)):
        time = "" if times is None else f"{times[i]:.3f}"
        speed = _cell(legs[vertex[i]]) if legs else ""
        yield [time, f"{lat:.9f}", f"{lon:.9f}", f"{x:.{METRES}f}", f"{y:.{METRES}f}", speed]


def _cell(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""
