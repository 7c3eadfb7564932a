"""What became of a measurement: whether a filter took it, and if not, why."""

from enum import IntEnum


class Fate(IntEnum):
    """What a filter did with a measurement; `words` says it."""

    ACCEPTED = 0
    NO_ESTIMATE = 1
    DUPLICATE = 2
    OUT_OF_ORDER = 3
    OUT_OF_REACH = 4
    SHORTER_THAN_DEPTH = 5
    INNOVATION = 6
    UNKNOWN_BEACON = 7
    REOPENED = 8
    NO_DISTANCE = 9

    @property
    def taken(self) -> bool:
        """Whether the filter used it."""
        return self in TAKEN

    @property
    def words(self) -> str:
        """The reason, as a table shows it."""
        return WORDS[self]


TAKEN = (Fate.ACCEPTED, Fate.REOPENED)

WORDS = {
    Fate.ACCEPTED: "accepted",
    Fate.NO_ESTIMATE: "no estimate yet",
    Fate.DUPLICATE: "duplicate",
    Fate.OUT_OF_ORDER: "out of order",
    Fate.OUT_OF_REACH: "out of reach",
    Fate.SHORTER_THAN_DEPTH: "shorter than the depth",
    Fate.INNOVATION: "innovation too large",
    Fate.UNKNOWN_BEACON: "unknown beacon",
    Fate.REOPENED: "accepted after the estimate was made less certain",
    Fate.NO_DISTANCE: "no distance",
}
