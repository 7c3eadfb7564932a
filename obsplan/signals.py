"""Signals that ask a program to end."""

import signal

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")  # Ctrl-C; Slurm and `kill`; a terminal that is closed
STOPS = tuple(getattr(signal, name) for name in NAMES if hasattr(signal, name))


received: list[int] = []  # those that came and were listened for, in order


def hear_stops() -> None:
    """Interrupt if a signal came before: a library may have swallowed its exception.

    Whatever takes long asks this between two of its steps.
    """
    if received:
        raise KeyboardInterrupt


def ignore_stops() -> None:
    """Let these signals pass from now on: another process ends this one, or it is ending."""
    for number in STOPS:
        signal.signal(number, signal.SIG_IGN)
