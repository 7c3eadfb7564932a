"""Hidden constants that a smoother finds beside the track: which there are, and their priors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Integer

from obsplan.estimators.hidden import CLOCK, COMPASS_BIAS, SCALE
from obsplan.scenario import Scenario
from obsplan.tape import Tape
from obsplan.types import ObsplanError

BIAS, CURRENT = "bias", "current"
# standard deviations of what nothing else is known of; their means are 0
PRIORS = MappingProxyType(
    {SCALE: 0.1, BIAS: 10.0, CLOCK: 0.01, CURRENT: 0.5, COMPASS_BIAS: np.deg2rad(20.0)}
)


class Kind(NamedTuple):
    """Constants of one kind, of which there are one or several."""

    kind: str  # key of `PRIORS`
    sigma: float  # at first
    walk: float = 0.0  # of a random walk, per square root of a second
    per_beacon: bool = False


@dataclass(frozen=True, kw_only=True)
class Constants:
    """Constants by name, in order; each is independent of the others at first, with mean 0."""

    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()  # keys of `PRIORS`
    # the beacon, AUV or axis each is of; -1: all
    of: tuple[int, ...] = ()
    sigma: tuple[float, ...] = ()
    walk: tuple[float, ...] = ()  # of those that wander, per square root of a second

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


def kinds_asked(
    asked: Sequence[str], *, per_beacon: bool, priors: Mapping[str, float]
) -> tuple[Kind, ...]:
    """Kinds of constants by name.

    Raises
    ------
    ObsplanError
        A kind that is unknown or given twice, or a prior that is not positive.
    """
    for kind in (*asked, *priors):
        if kind not in PRIORS:
            raise ObsplanError(
                f'hidden: "{kind}" is no constant: give some of {", ".join(sorted(PRIORS))}'
            )
    if len({*asked}) < len(asked):
        raise ObsplanError(f"hidden: {', '.join(asked)} are not all different: give each once")
    for kind, sigma in priors.items():
        if not 0 < sigma < np.inf:
            raise ObsplanError(
                f"priors: {kind} = {sigma} must be a positive standard deviation: correct it"
            )
    known = {**PRIORS, **priors}
    each = (SCALE, BIAS) if per_beacon else ()
    return tuple(Kind(kind, known[kind], per_beacon=kind in each) for kind in asked)


def kinds_of_filter(scenario: Scenario) -> tuple[Kind, ...]:
    """The constants that a scenario's filter estimates; of its depth none."""
    table = scenario.table.estimator.states
    found: list[Kind] = []
    if table.scale is not None:
        found.append(Kind(SCALE, table.scale.sigma, table.scale.walk))
    if table.bias is not None:
        found.append(Kind(BIAS, table.bias.sigma, table.bias.walk, per_beacon=True))
    if table.clock is not None:
        found.append(Kind(CLOCK, table.clock.sigma, table.clock.walk))
    if table.current is not None:
        found.append(Kind(CURRENT, table.current.sigma, table.current.walk))
    if table.compass_bias is not None:
        degrees = table.compass_bias
        sigma, walk = np.deg2rad([degrees.sigma_deg, degrees.walk_deg]).tolist()
        found.append(Kind(COMPASS_BIAS, sigma, walk))
    return tuple(kind for kind in found if kind.sigma > 0)


def constants_of(tape: Tape, kinds: Sequence[Kind]) -> Constants:
    """The constants of some kinds on a tape."""
    rows = [(one, *named) for one in kinds for named in _named(tape, one)]
    return Constants(
        names=tuple(name for _, name, _ in rows),
        kinds=tuple(one.kind for one, _, _ in rows),
        of=tuple(of for _, _, of in rows),
        sigma=tuple(one.sigma for one, _, _ in rows),
        walk=tuple(one.walk for one, _, _ in rows),
    )


def _named(tape: Tape, one: Kind) -> list[tuple[str, int]]:
    """Name and number of each constant of a kind."""
    kind = one.kind
    if kind == CURRENT:
        return [("current east", 0), ("current north", 1)]
    if kind in (COMPASS_BIAS, CLOCK):
        return [(f"{kind} of {name}", i) for i, name in enumerate(tape.auvs)]
    if one.per_beacon:
        return [(f"{kind} of {name}", i) for i, name in enumerate(tape.beacons)]
    return [(kind, -1)]
