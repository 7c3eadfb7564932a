"""Whether a recording's ranges can be metres, and whether they are too long by the truth."""

import numpy as np
from jaxtyping import Float

from obsplan.sensors import BEACON
from obsplan.tape import Tape

FEWEST = 8  # ranges, of which something is said
SURE = 6.0  # standard deviations of a range, by which two differ that cannot be right
OFF = 0.02  # of the distance, from which on ranges are called too long or too short
PLAIN = 6.0  # standard errors of the median, that this has to be


def impossible_changes(
    name: str,
    tape: Tape,
    auv: int,
    way: Float[np.ndarray, " samples"],
    sigma: float,
) -> str:
    """A sentence where most ranges change by more than both vehicles moved; else empty.

    ``way`` is how far the AUV has moved by each sample [m], ``sigma`` a range's deviation [m].
    """
    z = tape.measurements
    changes, moves = [], []
    for beacon in range(len(tape.beacons)):
        own = np.flatnonzero((z.auv == auv) & (z.beacon == beacon))
        sample = np.searchsorted(tape.time, z.received[own])
        aid = np.hypot(*np.diff(z.told[own, :2], axis=0).T)
        changes.append(np.abs(np.diff(z.value[own])))
        moves.append(np.diff(way[sample]) + aid)
    change, moved = np.concatenate(changes), np.concatenate(moves)
    impossible = change > moved + SURE * sigma
    if change.size < FEWEST or impossible.mean() <= 0.5:
        return ""
    return (
        f'ranges of "{name}" change by {np.median(change):.3g} m from one to the next, where both '
        f"vehicles move by {np.median(moved):.3g} m at most: they look like no metres; correct "
        "their unit, or sigma under [ranging]"
    )


def off_by_truth(name: str, tape: Tape, auv: int, *, slant: bool) -> str:
    """A sentence where ranges are too long or too short in proportion by the truth; else empty."""
    z = tape.measurements
    if tape.truth is None:
        return ""
    own = np.flatnonzero((z.auv == auv) & (z.beacon >= 0) & (z.beacon < len(tape.beacons)))
    sample = np.searchsorted(tape.time, z.received[own])
    apart = np.hypot(*(tape.truth[auv, sample, :2] - z.told[own, :2]).T)
    if slant:
        height = z.told[own, BEACON.index("depth")] - z.told[own, BEACON.index("auv_depth")]
        apart = np.hypot(apart, height)
    known = np.isfinite(apart) & (apart > 0)
    if known.sum() < FEWEST:
        return ""
    ratio = z.value[own][known] / apart[known]
    usual = float(np.median(ratio))
    scatter = 1.48 * float(np.median(np.abs(ratio - usual)))
    error = 1.25 * scatter / np.sqrt(ratio.size)
    if abs(usual - 1) < max(OFF, PLAIN * error):
        return ""
    if not 0.5 < usual < 2:
        return (
            f'ranges of "{name}" are {usual:.3g} times as long as by the truth: correct their '
            "unit, or the frame of truth and beacons"
        )
    word = "long" if usual > 1 else "short"
    percent = 100 * abs(usual - 1)
    return (
        f'ranges of "{name}" are {percent:.1f} % too {word} by the truth, in the median: '
        "--calibrate common, or scale under [estimator.states], allows for that"
    )
