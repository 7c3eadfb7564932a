"""End in order when a signal asks for it: Ctrl-C, Slurm or `kill`, a terminal that is closed."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

from obsplan.cli.terminal import complain
from obsplan.signals import STOPS, ignore_stops, received

SIGNALLED = 128  # a shell's exit code is this and the number of the signal
KEPT = "what is finished is kept in {}, and the same command goes on from there"
WRITTEN = "everything was written to {} before"

# what was kept, as `keeping` says it; a signal may be swallowed by a library, and heard later
told_kept: list[str] = []


def listen() -> None:
    """Have each of these signals raise KeyboardInterrupt, and note which it was.

    It is noted because libraries in other languages turn it into errors of theirs. A signal that
    is ignored already, in the background or under `nohup`, stays ignored.
    """
    for number in STOPS:
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, interrupt)


def interrupt(number: int, _: FrameType | None) -> NoReturn:
    """Note a signal and interrupt whatever runs."""
    received.append(number)
    raise KeyboardInterrupt


def is_stop(error: BaseException) -> bool:
    """Whether an error is, or comes of, a signal to end."""
    return isinstance(error, KeyboardInterrupt) or bool(received)


def stop(told: str) -> NoReturn:
    """Say which signal ended the program, and what became of its work; end."""
    ignore_stops()
    number = received[0] if received else signal.SIGINT
    name = signal.Signals(number).name
    cause = "interrupted" if number == signal.SIGINT else f"ended by {name}"
    complain(f"{cause}; {told}")
    sys.exit(SIGNALLED + number)


def stop_at_last() -> NoReturn:
    """End the program outside `keeping`; what was kept in it stays."""
    stop(told_kept[-1] if told_kept else "nothing was written")


@contextmanager
def keeping(folder: Path, told: str = KEPT) -> Iterator[None]:
    """Say what stays in a folder where a signal ends the program in here."""
    told_kept.append(told.format(folder))
    try:
        yield
    except BaseException as error:
        if not is_stop(error):
            raise
        stop(told.format(folder))
