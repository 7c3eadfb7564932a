"""Missions flown by processes of this machine, which nobody else can speak to.

Each process talks with the one that started it through an unnamed pipe: there is no port and no
file to connect to, and so no password to keep.
"""

import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import current_process, get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from threading import Lock, Thread, current_thread, main_thread
from typing import cast

from obsplan.campaign.worker import Batch, Flown, fly_batch
from obsplan.signals import STOPS, ignore_stops
from obsplan.types import ObsplanError

TRIES = 2  # of a batch whose worker dies, before its missions are flown one by one
NO_WORKER = (
    "no worker process could start: see that there is memory for them; a script must fly its "
    'campaigns under `if __name__ == "__main__":`, because each worker reads the script again'
)


@dataclass(frozen=True, eq=False)
class Worker:
    """A process that flies one batch after the other, and the pipe to it."""

    process: BaseProcess
    pipe: Connection

    @classmethod
    def start(cls) -> "Worker":
        """Start a process; it says so when it is ready."""
        ours, theirs = get_context("spawn").Pipe()
        process = get_context("spawn").Process(target=serve, args=(theirs,), daemon=True)
        worker = cls(process, cast("Connection", ours))
        try:
            with deaf():  # ending it is our business
                process.start()
            theirs.close()  # so that ours ends when the process does
        except BaseException:  # of a signal: nobody else knows of the process yet
            worker.end()
            raise
        return worker

    def await_ready(self) -> None:
        """Wait until it can fly.

        Raises
        ------
        ObsplanError
            It died before.
        """
        try:
            self.pipe.recv()
        except (EOFError, OSError):
            raise ObsplanError(NO_WORKER) from None

    def fly(self, batch: Batch) -> Flown:
        """Have a batch flown; raises EOFError or OSError if the process dies of it."""
        self.pipe.send(batch)
        return self.pipe.recv()

    def end(self) -> None:
        """End the process, whatever it does, if it began."""
        if self.process.pid is None:
            return
        self.process.kill()
        self.process.join()


class Processes:
    """Worker processes, each with a thread here that hands it batches."""

    def __init__(self, number: int):
        self._lanes = ThreadPoolExecutor(number)
        self._idle: SimpleQueue[Worker] = SimpleQueue()
        self._guard = Lock()  # of what follows
        self._workers: set[Worker] = set()
        self._ended = False

    def start(self, number: int) -> None:
        """Start workers; all are ready when it returns."""
        for worker in [self._started() for _ in range(number)]:
            worker.await_ready()
            self._idle.put(worker)

    def threads(self) -> int:
        """Missions that are flown at a time."""
        return len(self._workers)

    def send(self, batch: Batch) -> "Future[Flown | None]":
        """Have a batch flown; the result is None if its worker died of it, several times over."""
        return self._lanes.submit(self._fly, batch)

    def end(self) -> None:
        """End all workers at once, and forget what waits."""
        with self._guard:
            self._ended = True
            workers = [*self._workers]
        for worker in workers:
            worker.end()
        self._lanes.shutdown(cancel_futures=True)

    def _fly(self, batch: Batch) -> Flown | None:
        worker = self._idle.get()
        try:
            for _ in range(TRIES):
                with suppress(EOFError, OSError):
                    return worker.fly(batch)
                worker = self._replaced(worker)
            return None
        finally:
            self._idle.put(worker)

    def _started(self) -> Worker:
        """Start a worker, unless all have been ended.

        Raises
        ------
        EOFError
            They have.
        ObsplanError
            The system has no process, or no file, left for it.
        """
        with self._guard:
            if self._ended:
                raise EOFError
            try:
                worker = Worker.start()
            except OSError as error:
                raise ObsplanError(
                    f"no more than {len(self._workers)} worker processes can be started "
                    f"({error.strerror}): give fewer workers"
                ) from error
            self._workers.add(worker)
            return worker

    def _replaced(self, dead: Worker) -> Worker:
        """Start another worker in place of one that died."""
        dead.end()
        worker = self._started()
        with self._guard:
            self._workers.discard(dead)
        worker.await_ready()
        return worker


@contextmanager
def local(number: int) -> Iterator[Processes]:
    """Start worker processes; end them at the end.

    Raises
    ------
    ObsplanError
        None could start.
    """
    processes = Processes(number)
    try:
        processes.start(number)
        yield processes
    finally:
        processes.end()


@contextmanager
def deaf() -> Iterator[None]:
    """Hold back signals that ask to end, also from processes started meanwhile."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # which would let Ctrl-C through again if it began only now
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
    try:
        with put_off():
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def put_off() -> Iterator[None]:
    """Handle signals that ask to end only afterwards.

    One thread's mask does not suffice: the system gives a signal to any other thread, and Python
    handles it in the main one all the same.
    """
    if current_thread() is not main_thread():  # which never handles any
        yield
        return
    came: list[int] = []
    handlers = {number: signal.getsignal(number) for number in STOPS}
    for number in STOPS:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for number in came:
            signal.raise_signal(number)


def serve(pipe: Connection) -> None:
    """Fly what comes through a pipe, until it or the process at its other end is closed."""
    ignore_stops()  # they are for the process that started this one and ends it
    Thread(target=end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        pipe.send("ready")
        while True:
            pipe.send(fly_batch(pipe.recv()))


def end_with_parent() -> None:
    """End in the middle of a mission, too, when the process that started this one is gone."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def end_if_worker() -> None:
    """End a worker that is about to start the campaign again.

    It would where the user's script has no main guard: every worker runs the script.
    """
    if getattr(current_process(), "_inheriting", False):  # as multiprocessing itself tells it
        sys.exit(2)
