"""Recorded missions: read from logs as a `Tape` and the `Scenario` beside it, and estimated."""

from obsplan.replay.log import Discarded
from obsplan.replay.read import read
from obsplan.replay.recorded import Recording
from obsplan.replay.write import write_recording

__all__ = ["Discarded", "Recording", "read", "write_recording"]
