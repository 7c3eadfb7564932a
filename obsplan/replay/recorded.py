"""A recorded mission, ready to be replayed."""

import datetime
from dataclasses import dataclass

from obsplan.replay.log import Discarded
from obsplan.scenario import Scenario
from obsplan.tape import Tape


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What vehicles moved, measured and heard, and the scenario it belongs to.

    ``scenario`` says where filters begin and what they assume. Its AUVs are the tape's. Its
    beacons are the tape's, those that moved first, each on an aid vehicle; where none moved, there
    is one aid vehicle that nobody ranges to. ``notes`` say in a sentence each what
    was converted, assumed or left out.
    """

    tape: Tape
    scenario: Scenario
    notes: tuple[str, ...] = ()
    discarded: tuple[Discarded, ...] = ()  # ranges that are not on the tape, and why
    start: datetime.datetime | None = None  # time 0, where it is known [UTC]
    source: str = ""  # where the data are from
    licence: str = ""  # of them
    attribution: str = ""  # whom they are from
    citation: str = ""

    def __repr__(self) -> str:
        count = self.tape.measurements.value.size
        return (
            f"<Recording of {self.scenario.table.name}: {len(self.tape.auvs)} AUV"
            f"{'s' * (len(self.tape.auvs) != 1)}, {self.tape.time[-1]:g} s, {count} ranges to "
            f"{len(self.tape.beacons)} beacons>"
        )
