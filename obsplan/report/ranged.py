"""What became of each range, and smoothed tracks, as tables."""

from collections.abc import Iterator
from datetime import datetime, timedelta

import numpy as np
from jaxtyping import Float

from obsplan.fates import Fate
from obsplan.ranged import Ranged
from obsplan.report.files import BLOCK, rounded, table_csv
from obsplan.run import Run
from obsplan.spelling import inert

RANGE_COLUMNS = (
    "received_s",
    "received",
    "sent_s",
    "auv",
    "beacon",
    "value",
    "unit",
    "expected",
    "innovation",
    "sigma",
    "nis",
    "fate",
)
SMOOTHED_COLUMNS = ("time_s", "auv", "x_m", "y_m", "sigma_x_m", "sigma_y_m")


def ranges_csv(run: Run, ranged: Ranged) -> Iterator[str]:
    """One row a range, in pieces: what was measured and expected, and its fate in words.

    ``received`` is the absolute time in UTC by ISO 8601. It is left out where nobody says when the
    run began, and ``sent_s`` where no range has a time of sending. ``sigma`` is of the innovation,
    ``nis`` its square in units of that. What a filter did not look at has none of these.
    """
    empty = [run.began is None and "received", np.isnan(ranged.sent).all() and "sent_s"]
    kept = [k for k, name in enumerate(RANGE_COLUMNS) if name not in empty]
    yield table_csv([[RANGE_COLUMNS[k] for k in kept]])
    auvs = [inert(name) for name in ranged.auvs]
    beacons = [inert(name) for name in ranged.beacons]
    words = {fate.value: fate.words for fate in Fate}
    sigma = np.sqrt(ranged.variance)
    for begin in range(0, ranged.value.size, BLOCK):
        some = slice(begin, begin + BLOCK)
        columns = (
            rounded(ranged.received[some]),
            absolute(run.began, ranged.received[some]),
            rounded(ranged.sent[some]),
            [auvs[i] for i in ranged.auv[some]],
            [beacons[b] for b in ranged.beacon[some]],
            rounded(ranged.value[some]),
            [ranged.unit] * len(ranged.value[some]),
            rounded(ranged.expected[some]),
            rounded(ranged.innovation[some]),
            rounded(sigma[some]),
            rounded(ranged.normalised[some] ** 2),
            [words[code] for code in ranged.fate[some]],
        )
        yield table_csv(zip(*(columns[k] for k in kept), strict=True))


def absolute(began: datetime | None, seconds: Float[np.ndarray, " n"]) -> list[str]:
    """Times of day of times since the beginning, to a microsecond; nothing where it is unknown."""
    if began is None:
        return [""] * seconds.size
    times = [began + timedelta(seconds=s) for s in seconds.tolist()]
    return [time.isoformat(timespec="microseconds").replace("+00:00", "Z") for time in times]


def smoothed_csv(run: Run, smoothed: Float[np.ndarray, "auvs samples 2"]) -> Iterator[str]:
    """Where AUVs were by all of their ranges, one row per time and AUV, in pieces."""
    yield table_csv([SMOOTHED_COLUMNS])
    P = run.smoothed_covariance
    spread = np.full(smoothed.shape, np.nan)
    if P is not None:
        spread = np.sqrt(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), 0.0))
    for begin in range(0, run.time.size, BLOCK):
        some = slice(begin, begin + BLOCK)
        time, per_auv = rounded(run.time[some]), []
        for i, name in enumerate(run.names):
            figures = (*smoothed[i, some].T, *spread[i, some].T)
            names = [inert(name)] * len(time)
            per_auv.append(zip(time, names, *map(rounded, figures), strict=True))
        yield table_csv(row for at_once in zip(*per_auv, strict=True) for row in at_once)
