"""Progress on standard error: a bar on a terminal, elsewhere a line every half minute."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from threading import Event, Thread
from time import monotonic

PULSE = 30.0  # [s] between two lines
MINUTES, HOURS = 120.0, 7200.0  # [s], from which on times are told in minutes and in hours

Advance = Callable[..., None]  # of (done, in all), and if wished what is being done


@contextmanager
def progress(title: str) -> Iterator[Advance]:
    """Show how far a task is while it lasts.

    Gives the function to call with (done, in all) and, as it changes, a title.
    """
    with bar(title) if sys.stderr.isatty() else lines(title) as advance:
        yield advance


@contextmanager
def bar(title: str) -> Iterator[Advance]:
    """A bar with the share done and the time left."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(title, total=None)
        yield lambda done, total, now=title: shown.update(
            task, completed=done, total=total, description=now
        )


@contextmanager
def lines(title: str) -> Iterator[Advance]:
    """A line every `PULSE` seconds, news or not: so a log tells work from a hang."""
    state, ended = State(title), Event()

    def tell() -> None:
        while not ended.wait(PULSE):
            with suppress(OSError):  # nobody reads it
                print(state.line(monotonic()), file=sys.stderr, flush=True)  # noqa: T201

    teller = Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield state.advance
    finally:
        ended.set()
        teller.join()


@dataclass
class State:
    """What is done of a task, and since when."""

    title: str
    done: float | int = 0
    total: float | int | None = None
    began: float = field(default_factory=monotonic)

    def advance(self, done: float | int, total: float | int, now: str | None = None) -> None:
        """Note what is done."""
        self.done, self.total, self.title = done, total, now or self.title

    def line(self, now: float) -> str:
        """Share done, time taken, and time left if the rest goes as fast."""
        taken = now - self.began
        share = self.done / self.total if self.total else 0.0
        if share == 0:
            return f"{self.title}: at work for {duration(taken)}"
        left = taken * (1 - share) / share
        done = f"{100 * share:.0f} % after {duration(taken)}"
        return f"{self.title}: {done}, about {duration(left)} left"


def duration(seconds: float) -> str:
    """A time as people say it."""
    if seconds < MINUTES:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < HOURS else f"{seconds / 3600:.1f} h"
