"""What of a mission the thesis's Appendix B speaks of, as numbers: its first AUV's."""

import numpy as np
from jaxtyping import Bool, Float

from obsplan.run import Run

LOST = 10.0  # error [m] of a lost position: a quarter of a leg
# between the AUV's course and the line of sight: motion nearly through the beacon
ALIGNED = np.deg2rad(20.0)
BEGINNING = 120.0  # [s]; the filter has settled by then
DEVIATIONS = 3.0

Series = Float[np.ndarray, " steps"]
Track = Float[np.ndarray, "steps 2"]

MARKS: dict[str, tuple[str, str]] = {  # name: (unit, what it is)
    "rms_error": ("m", "RMS error"),
    "max_error": ("m", "greatest error"),
    "separation": ("m", "mean distance between the vehicles"),
    "farthest": ("m", "greatest distance between the vehicles, once settled"),
    "rounds": ("1", "turns of the aid vehicle about the AUV, to the left and to the right"),
    "outside": ("1", "share of the settled time outside three deviations"),
    "sigma_exchange": (
        "1",
        "deviation on legs along an axis over that across it, the lesser of east and north",
    ),
    "least_exchange": ("1", "the same of the RMS error"),
    "most_exchange": ("1", "the same of the RMS error, the greater of east and north"),
    "lost_at": ("1", "share of the mission after which the position is first lost; 1: never"),
    "aligned": ("1", "share of the time until then, or of a third, in which course is sight"),
    "overshoot": ("1", "greatest estimated speed over the true, in the first two minutes"),
    "at_truth": ("1", "share of the settled time with the AUV the nearest, within 10 m"),
    "at_mirror": ("1", "the same of its mirror image over the line north of the aid vehicle"),
    "at_point": ("1", "the same of its point reflection about the aid vehicle"),
}


def marks(run: Run) -> dict[str, float]:
    """The numbers of `MARKS`, of a run's first AUV.

    "First two minutes" and "settled" mean before and after 120 s.
    """
    truth, mean, P = run.true[0], run.mean[0], run.covariance[0]
    cna, time, error = run.cna[:, :2], run.time, run.error[0]
    settled = time > BEGINNING
    sigma = np.sqrt(np.stack([P[:, 0, 0], P[:, 1, 1]], axis=1))
    off = mean[:, :2] - truth[:, :2]
    north = np.abs(np.sin(truth[:, 2])) > np.sin(np.pi / 4)
    distance = np.hypot(*(cna - truth[:, :2]).T)
    beginning = until_lost(error)
    found = {
        "rms_error": run.rms_error,
        "max_error": run.max_error,
        "separation": float(distance.mean()),
        "farthest": float(distance[settled].max()),
        "rounds": rounds(cna - truth[:, :2]),
        "outside": float((np.abs(off) > DEVIATIONS * sigma)[settled].any(axis=1).mean()),
        "lost_at": beginning / time.size,
        "aligned": aligned(cna - truth[:, :2], truth[:, 2], beginning),
        "overshoot": float(np.max(mean[:, 3] / truth[:, 3], where=~settled, initial=0.0)),
    }
    ways = np.stack([~north, north], axis=1)[settled]  # along east, along north
    error = exchanges(off[settled], ways)
    found["sigma_exchange"] = float(exchanges(sigma[settled], ways).min())
    found["least_exchange"], found["most_exchange"] = float(error.min()), float(error.max())
    return found | whereabouts(truth[settled, :2], mean[settled, :2], cna[settled])


def rounds(relative: Track) -> float:
    """How many turns the aid vehicle makes about the AUV, to the left and to the right."""
    bearing = np.unwrap(np.arctan2(relative[:, 1], relative[:, 0]))
    return float(np.abs(np.diff(bearing)).sum() / (2.0 * np.pi))


def until_lost(error: Series) -> int:
    """Samples until the error is first that of a lost position; all of them if it never is."""
    lost = error > LOST
    return int(lost.argmax()) if lost.any() else error.size


def aligned(relative: Track, heading: Series, until: int) -> float:
    """Share of the first samples, a third of all at most, in which the AUV's course is sight.

    That is, within 20° of the line through the aid vehicle.
    """
    first = slice(0, max(1, min(until, heading.size // 3)))
    sight = np.arctan2(relative[first, 1], relative[first, 0])
    return float((np.abs(np.sin(sight - heading[first])) < np.sin(ALIGNED)).mean())


def exchanges(values: Track, along: Bool[np.ndarray, "steps 2"]) -> Float[np.ndarray, "2"]:
    """Root mean square east and north while the AUV goes along the axis, over that across it."""
    squares = np.square(values)
    mean = squares.mean(axis=0, where=along), squares.mean(axis=0, where=~along)
    return np.sqrt(mean[0] / mean[1])


def whereabouts(truth: Track, mean: Track, beacon: Track) -> dict[str, float]:
    """Share of samples in which the estimate is at the AUV, or at either of its images.

    The mirror image over the line north of the aid vehicle has the same ranges, and while the AUV
    goes north or south the same heading: only on the way from lane to lane must the speed change
    its sign. The point reflection about the aid vehicle has the same ranges and headings if its
    speed is the opposite all the time.
    """
    mirror = np.column_stack([2.0 * beacon[:, 0] - truth[:, 0], truth[:, 1]])
    places = np.stack([truth, mirror, 2.0 * beacon - truth])
    away = np.linalg.norm(mean - places, axis=-1)
    nearest = np.where(away.min(axis=0) < LOST, away.argmin(axis=0), -1)
    names = ("at_truth", "at_mirror", "at_point")
    return {name: float((nearest == k).mean()) for k, name in enumerate(names)}
