"""Recorded missions: read from logs as a `Tape` and the `Scenario` beside it."""
