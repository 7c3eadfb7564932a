"""Hidden constants that a smoother finds beside the track: which there are, and their priors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Integer

from obsplan.tape import Tape
from obsplan.types import ObsplanError

SCALE, BIAS, CURRENT, COMPASS_BIAS = "scale", "bias", "current", "compass-bias"
UNITS = MappingProxyType({SCALE: "1", BIAS: "m", CURRENT: "m/s", COMPASS_BIAS: "rad"})
# standard deviations of what nothing else is known of; their means are 0
PRIORS = MappingProxyType({SCALE: 0.1, BIAS: 10.0, CURRENT: 0.5, COMPASS_BIAS: np.deg2rad(20.0)})


@dataclass(frozen=True, kw_only=True)
class Constants:
    """Constants by name, in order; each is independent of the others at first, with mean 0."""

    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()  # keys of `PRIORS`
    # the beacon, AUV or axis each is of; -1: all
    of: tuple[int, ...] = ()
    sigma: tuple[float, ...] = ()

    def __len__(self) -> int:
        return len(self.names)

    def picked(
        self, kind: str, numbers: Integer[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n constants"]:
        """1 for each constant of a kind that concerns the beacon or AUV of that number, else 0."""
        found = np.zeros((len(numbers), len(self)))
        for column, (one, of) in enumerate(zip(self.kinds, self.of, strict=True)):
            if one == kind:
                found[:, column] = (numbers == of) | (of == -1)
        return found

    def at(self, kind: str) -> list[int]:
        """Where the constants of a kind stand."""
        return [i for i, one in enumerate(self.kinds) if one == kind]


def constants_of(
    tape: Tape,
    asked: Sequence[str],
    *,
    per_beacon: bool = False,
    priors: Mapping[str, float] = PRIORS,
) -> Constants:
    """The constants of some kinds: scale and bias common to all beacons, or one of each.

    Raises
    ------
    ObsplanError
        A kind that is unknown or given twice, or a prior that is not positive.
    """
    rows: list[tuple[str, str, int]] = []
    for kind in asked:
        if kind not in PRIORS:
            raise ObsplanError(
                f'hidden: "{kind}" is no constant: give some of {", ".join(sorted(PRIORS))}'
            )
        if kind in (row[1] for row in rows):
            raise ObsplanError(f'hidden: "{kind}" is given twice: give it once')
        rows += _named(tape, kind, per_beacon=per_beacon)
    known = {**PRIORS, **priors}
    for kind, sigma in known.items():
        if kind not in PRIORS or not 0 < sigma < np.inf:
            raise ObsplanError(
                f"priors: {kind} = {sigma} must be a positive standard deviation of one of "
                f"{', '.join(sorted(PRIORS))}: correct it"
            )
    return Constants(
        names=tuple(name for name, _, _ in rows),
        kinds=tuple(kind for _, kind, _ in rows),
        of=tuple(of for _, _, of in rows),
        sigma=tuple(known[kind] for _, kind, _ in rows),
    )


def _named(tape: Tape, kind: str, *, per_beacon: bool) -> list[tuple[str, str, int]]:
    """Name, kind and number of the constants of a kind."""
    if kind == CURRENT:
        return [("current east", kind, 0), ("current north", kind, 1)]
    if kind == COMPASS_BIAS:
        return [(f"compass-bias of {name}", kind, i) for i, name in enumerate(tape.auvs)]
    if per_beacon:
        return [(f"{kind} of {name}", kind, i) for i, name in enumerate(tape.beacons)]
    return [(kind, kind, -1)]
