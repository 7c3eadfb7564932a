"""Whether a recording's headings look half a turn, a quarter or a mirror off."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

# dead reckoning turns with time: only the first part says how headings are meant
WINDOWS = 100  # displacements that are compared with the truth's
PART = 4  # of the recording, one in so many
MOST_RANGES = 300  # the first, that a dead-reckoned track is fitted to
EXPLAINED = 0.25  # misfit to the truth's displacements, in squares, that a convention has at most
FEWEST = 8
BETTER = 0.5  # of the misfit: what another convention has to leave at most
DOUBTFUL = 2.0  # standard deviations of the ranges, by which the track as it is has to miss
LEAST = 1.0  # [m]; who moves less has no direction
VAGUE = 45.0  # [deg]; a first heading that is less well known is no convention


class Convention(NamedTuple):
    """What displacements may have to be turned by, or mirrored, to be right."""

    words: str
    remedy: str
    mirrored: bool
    factor: complex
    about_first: bool = False  # mirrored left for right, whatever the first heading

    def applied(self, moved: Complex[np.ndarray, " n"], heading: float) -> np.ndarray:
        """Displacements, east + i north [m], by this convention; ``heading`` is the first [rad]."""
        turned = np.conj(moved) if self.mirrored else moved
        if self.about_first:
            turned = turned * np.exp(2j * heading)
        return self.factor * turned


AS_IS = Convention("as they are", "", False, 1.0)
CONVENTIONS = (
    Convention("half a turn off", "add 180 degrees", False, -1.0),
    Convention("a quarter turn off, to the right", "add 90 degrees", False, 1j),
    Convention("a quarter turn off, to the left", "subtract 90 degrees", False, -1j),
    Convention("mirrored, left for right", "turns have the other sign", True, 1.0, True),
    Convention(
        "mirrored, left for right, and half a turn off",
        "turns have the other sign, and the first heading lacks 180 degrees",
        True,
        -1.0,
        True,
    ),
    Convention("clockwise from north", "name the column compass_deg", True, 1j),
    Convention("clockwise from south", "name the column compass_deg, add 180", True, -1j),
    Convention("mirrored, clockwise from east", "give them the other sign", True, 1.0),
    Convention("mirrored, clockwise from west", "subtract them from 180 degrees", True, -1.0),
)


class Reckoned(NamedTuple):
    """A vehicle's dead-reckoned places as the headings are, and the first of these."""

    name: str
    time: Float[np.ndarray, " samples"]
    place: Complex[np.ndarray, " samples"]  # east + i north from the first [m]
    heading: float  # [rad]


def against_truth(track: Reckoned, truth: Float[np.ndarray, "samples n"]) -> str:
    """A sentence where another convention explains the truth much better; else empty."""
    known = np.flatnonzero(np.isfinite(truth[:, :2]).all(axis=1))
    if known.size < FEWEST:
        return ""
    last = max(known.size // PART, FEWEST) - 1
    some = known[np.unique(np.linspace(0, last, WINDOWS + 1).astype(int))]
    true = np.diff(truth[some, 0] + 1j * truth[some, 1])
    moved = np.diff(track.place[some])
    if np.abs(true).sum() < LEAST or np.abs(moved).sum() < LEAST:
        return ""

    def misfit(convention: Convention) -> float:
        off = true - convention.applied(moved, track.heading)
        return float((np.abs(off) ** 2).sum() / (np.abs(true) ** 2).sum())

    best, least = _best(misfit)
    if least > min(BETTER * misfit(AS_IS), EXPLAINED):
        return ""
    return (
        f'headings of "{track.name}" look {best.words}: as they are, the motion differs from the '
        f"true one by {100 * np.sqrt(misfit(AS_IS)):.0f} % of its length, and once put right by "
        f"{100 * np.sqrt(least):.0f} %; {best.remedy}, if that is so"
    )


class Heard(NamedTuple):
    """Ranges of one vehicle to beacons, made horizontal."""

    sample: np.ndarray  # of the track
    beacon: Complex[np.ndarray, " n"]  # east + i north [m]
    value: Float[np.ndarray, " n"]  # [m]
    sigma: float  # [m]


def against_ranges(track: Reckoned, heard: Heard, first: complex, spread: float) -> str:
    """A sentence where ranges fit another convention much better; else empty.

    ``first`` is the first place, known to ``spread`` [m].
    """
    if heard.value.size < FEWEST or np.abs(np.diff(track.place)).sum() < LEAST:
        return ""
    some = slice(MOST_RANGES)
    heard = Heard(heard.sample[some], heard.beacon[some], heard.value[some], heard.sigma)

    def misfit(convention: Convention) -> float:
        places = convention.applied(track.place[heard.sample], track.heading)
        return _misfit(places, heard, first, spread)

    best, least = _best(misfit)
    as_is = misfit(AS_IS)
    if as_is < DOUBTFUL * heard.sigma or least > BETTER * as_is:
        return ""
    return (
        f'headings of "{track.name}" look {best.words}: as they are, ranges miss its dead-reckoned '
        f"track by {as_is:.2g} m on average, and once put right by {least:.2g} m; {best.remedy}, "
        "if that is so"
    )


def _best(misfit: Callable[[Convention], float]) -> tuple[Convention, float]:
    """The convention of least misfit."""
    found = [misfit(convention) for convention in CONVENTIONS]
    at = int(np.argmin(found))
    return CONVENTIONS[at], found[at]


def _misfit(
    places: Complex[np.ndarray, " n"], heard: Heard, first: complex, spread: float
) -> float:
    """Mean miss of ranges [m] by a track whose first place is free as far as it is unknown."""
    from scipy.optimize import least_squares

    scale = max(heard.sigma, 1e-3)

    def residuals(p: np.ndarray) -> np.ndarray:
        at = complex(*p)
        off = (np.abs(places + at - heard.beacon) - heard.value) / scale
        prior = (at - first) / max(spread, scale)
        return np.append(off, [prior.real, prior.imag])

    misses = []
    for start in _starts(first, spread, scale):
        fit = least_squares(residuals, [start.real, start.imag], loss="soft_l1", max_nfev=50)
        off = np.abs(places + complex(*fit.x) - heard.beacon) - heard.value
        misses.append(float(np.abs(off).mean()))
    return min(misses)


def _starts(first: complex, spread: float, scale: float) -> Sequence[complex]:
    """Where the search for a first place begins."""
    if spread < 10 * scale:
        return [first]
    return [first, *(first + spread * 1j**k for k in range(4))]
