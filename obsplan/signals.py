"""Signals that ask a program to end."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")  # Ctrl-C; Slurm and `kill`; a terminal that is closed
STOPS = tuple(getattr(signal, name) for name in NAMES if hasattr(signal, name))


@contextmanager
def deaf() -> Iterator[None]:
    """Hold these signals back, also from processes started meanwhile."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # which would let Ctrl-C through again if it began only now
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_stops() -> None:
    """Let these signals pass from now on: another process ends this one, or it is ending."""
    for number in STOPS:
        signal.signal(number, signal.SIG_IGN)
