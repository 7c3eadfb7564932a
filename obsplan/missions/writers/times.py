"""When a vehicle is where: instants for formats that hold times of day."""

from datetime import UTC, datetime, timedelta

import numpy as np
from jaxtyping import Float

from obsplan.missions.mission import Track

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)  # for a mission whose start is not known


def stamps(track: Track) -> tuple[Float[np.ndarray, "m 2"], list[float] | None]:
    """Places of a track and their times [s]; a hold's place comes twice. None without times."""
    if track.time is None:
        return track.points, None
    if track.hold is None:
        return track.points, track.time.tolist()
    repeats = np.where(track.hold > 0, 2, 1)
    index = np.repeat(np.arange(len(track.points)), repeats)
    again = np.append(False, index[1:] == index[:-1])
    return track.points[index], (track.time[index] + np.where(again, track.hold[index], 0)).tolist()


def instant(start: datetime, seconds: float) -> str:
    """An instant in UTC, to the millisecond, as ISO 8601 has it."""
    moment = start.astimezone(UTC) + timedelta(milliseconds=round(1e3 * seconds))
    return moment.strftime("%Y-%m-%dT%H:%M:%S.") + f"{moment.microsecond // 1000:03d}Z"


def explain(start: datetime) -> str:
    """What the times of a file count from, in words."""
    if start == EPOCH:
        zero = instant(EPOCH, 0.0)[:-5]
        return f"Times count from {zero}Z, which stands for the start of the mission."
    return f"The mission starts at {instant(start, 0.0)[:-5]}Z."
