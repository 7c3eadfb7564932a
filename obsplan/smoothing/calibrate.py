"""Scale and bias of ranges, found with the track; or a refusal where they cannot be told apart."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from obsplan.scenario import Scenario
from obsplan.sensors import BEACON, Range
from obsplan.smoothing.constants import BIAS, PRIORS, SCALE, constants_of, kinds_asked
from obsplan.smoothing.smoothed import Hidden, Smoothed, smooth
from obsplan.tape import Tape
from obsplan.types import ObsplanError

# a correlation beyond it, of either sign: only one combination of the two is known
ALIKE = 0.995
UNTOLD = (
    0.5  # a standard deviation above this share of the prior's: the ranges told next to nothing
)
SURE = 2.0  # standard deviations, from which on a scale is put in words
LEAST_WEIGHT = 0.1  # of ranges that a straight line is fitted to, where there is truth


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """Scale s and bias b of ranges, which are :math:`(1 + s) r + b`; with the track they fit."""

    constants: Hidden
    smoothed: Smoothed
    tape: Tape  # its ranges corrected: those of an instrument without scale and bias
    words: tuple[str, ...]  # a line for each constant, then correlations, then what else is known

    def __str__(self) -> str:
        return "\n".join(self.words)


def calibrate(
    tape: Tape,
    scenario: Scenario,
    *,
    start: Float[np.ndarray, "auvs samples m"] | None = None,
    per_beacon: bool = False,
    priors: Mapping[str, float] = PRIORS,
) -> Calibration:
    """Find scale and bias of a tape's ranges, common to all beacons or of each.

    Arguments are as in `smooth`. Truth is not needed; where there is some, a straight line fitted
    to the ranges' errors is told beside.

    Raises
    ------
    ObsplanError
        The ranges do not tell the constants, or not one from the other.
    """
    if "range" not in tape.sensors:
        raise ObsplanError("calibrate: there are no ranges in metres: give some, of kind range")
    smoothed = smooth(
        tape, scenario, start=start, hidden=(SCALE, BIAS), per_beacon=per_beacon, priors=priors
    )
    hidden = smoothed.hidden
    kinds = kinds_asked((SCALE, BIAS), per_beacon=per_beacon, priors=priors)
    _check_apart(hidden)
    _check_told(hidden, np.array(constants_of(tape, kinds).sigma))
    if not smoothed.converged:
        raise ObsplanError(
            "calibrate: the search did not come to rest: give a track to start from that is nearer"
        )
    words = (*_table(hidden), *smoothed.words, *_fitted(tape, smoothed))
    right = _corrected(tape, hidden)
    return Calibration(constants=hidden, smoothed=smoothed, tape=right, words=words)


def _corrected(tape: Tape, hidden: Hidden) -> Tape:
    """The tape with its ranges as if scale and bias were 0; those between AUVs as they are."""
    z = tape.measurements
    value, sigma = z.value.copy(), z.sigma.copy()
    for beacon, name in enumerate(tape.beacons):
        scale, bias = (_of(hidden, kind, name) for kind in (SCALE, BIAS))
        mine = (z.beacon == beacon) & _distances(tape)
        value[mine] = (value[mine] - bias) / (1 + scale)
        sigma[mine] /= 1 + scale
    return replace(tape, measurements=z._replace(value=value, sigma=sigma))


def _of(hidden: Hidden, kind: str, beacon: str) -> float:
    """A constant of a beacon, or the one common to all."""
    own = f"{kind} of {beacon}"
    return float(hidden.values[hidden.names.index(own if own in hidden.names else kind)])


def _check_told(hidden: Hidden, prior: Float[np.ndarray, " constants"]) -> None:
    """Refuse constants of which ranges say next to nothing."""
    for name, sigma, before in zip(hidden.names, hidden.sigma, prior, strict=True):
        if sigma > UNTOLD * before:
            raise ObsplanError(
                f"calibrate: the ranges do not tell the {name}: its standard deviation is "
                f"{sigma:.3g}, and was {before:.3g} without them: calibrate fewer constants, or "
                "give ranges from more distances and directions"
            )


def _check_apart(hidden: Hidden) -> None:
    """Refuse two constants of which only one combination is known."""
    for i, j in combinations(range(len(hidden.names)), 2):
        rho = hidden.correlation[i, j]
        if abs(rho) > ALIKE:
            raise ObsplanError(
                f"calibrate: {hidden.names[i]} and {hidden.names[j]} cannot be told apart: their "
                f"correlation is {rho:+.4f}, beyond {ALIKE}: give ranges from shorter and longer "
                "distances"
            )


def _table(hidden: Hidden) -> list[str]:
    """A line for each constant, and for each pair of scale and bias."""
    words = []
    for name, value, sigma in zip(hidden.names, hidden.values, hidden.sigma, strict=True):
        if name.startswith(SCALE):
            words.append(f"{name} {value:+.5f} ± {sigma:.5f}{_meaning(value, sigma)}")
        else:
            words.append(f"{name} {value:+.5f} ± {sigma:.5f} m")
    half = len(hidden.names) // 2  # scales, then biases
    for i in range(half):
        rho = hidden.correlation[i, i + half]
        words.append(f"correlation of {hidden.names[i]} and {hidden.names[i + half]} {rho:+.3f}")
    return words


def _meaning(scale: float, sigma: float) -> str:
    """What a scale is for ranges, where it is more than chance."""
    if abs(scale) < SURE * sigma:
        return ""
    return f": ranges are {100 * abs(scale):.2g} % too {'long' if scale > 0 else 'short'}"


def _fitted(tape: Tape, smoothed: Smoothed) -> list[str]:
    """A straight line fitted to the errors of all ranges that count, by the truth."""
    if tape.truth is None:
        return []
    z = tape.measurements
    fixed = (z.beacon >= 0) & (z.beacon < len(tape.beacons))
    mine = fixed & _distances(tape) & (smoothed.weights > LEAST_WEIGHT)
    sample = np.searchsorted(tape.time, z.received[mine])
    away = tape.truth[z.auv[mine], sample, :2] - z.told[mine, :2]
    r = np.hypot(*away.T)
    sensor, how = tape.sensors["range"], "horizontally"
    if isinstance(sensor, Range) and sensor.geometry == "slant":
        rows = [BEACON.index(name) for name in ("depth", "auv_depth")]
        r, how = np.hypot(r, np.subtract(*z.told[mine][:, rows].T)), "over the depths"
    error = z.value[mine] - r
    known = np.isfinite(r)
    if np.unique(r[known]).size < 2:
        return []
    slope, offset = np.polyfit(r[known], error[known], 1)
    left = float(np.std(error[known] - offset - slope * r[known]))
    return [
        f"by the truth, {how}: scale {slope:+.5f}, bias {offset:+.5f} m, and {left:.3f} m "
        "standard deviation of what is left"
    ]


def _distances(tape: Tape) -> np.ndarray:
    """Which measurements are ranges in metres."""
    return tape.measurements.sensor == [*tape.sensors].index("range")
