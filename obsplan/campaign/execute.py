"""Fly what is missing of a campaign: on local processes or a Dask cluster, in the same way."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol, runtime_checkable

import obsplan
from obsplan.campaign.cluster import remote
from obsplan.campaign.code import code_hash
from obsplan.campaign.faults import FILE, is_begun_store, no_store
from obsplan.campaign.integrity import Damage
from obsplan.campaign.lock import held
from obsplan.campaign.plan import Cell
from obsplan.campaign.processes import end_if_worker, local
from obsplan.campaign.store import Store
from obsplan.campaign.table import export
from obsplan.campaign.worker import Batch, Flown, Outcome, failed
from obsplan.files import write_atomically
from obsplan.types import ObsplanError

BATCH_SECONDS = 1.0  # of work in a batch; to schedule one costs some milliseconds
MOST_IN_A_BATCH = 1000
PLANS_ONCE = ("whole-mission",)  # for all seeds of a process, and for longer than they take to fly
PLANNED_BATCH = 50  # seeds that are flown by one plan
AHEAD = 3  # batches per worker thread, under way or waiting: none of them ever waits for us
WORTH_COMPILING = 32  # missions per worker that repay a second of compiling
MOST_LISTED = 20  # failures
LOOK_AROUND = 5.0  # [s] between two counts of the cluster's threads
DIED = "its worker process died every time it was tried; perhaps the memory did not suffice"

Progress = Callable[[int, int, int], None]  # missions flown now, to be flown now, failed now


@dataclass(frozen=True, kw_only=True)
class Report:
    """What became of a campaign."""

    missions: int  # planned in all
    flown: int  # now; the others were there
    failed: int  # of all planned
    failures: list[tuple[Cell, int, str]]  # the first of them: cell, seed, reason
    set_aside: int  # in the store, but of other code or scenarios since changed: not in the table
    damage: Damage | None = None  # found in the store before; what was planned is flown again


def fly_campaign(
    cells: Sequence[Cell],
    folder: Path | str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Report:
    """Fly what a folder's store lacks of the cells, keep it, and export the table.

    Everything finished stays, whatever ends the campaign; the same call goes on from there.
    Missions that failed are flown again, and those whose results were damaged since.

    Parameters
    ----------
    folder
        Made unless it is there; one that holds something else is refused.
    workers
        Local processes; default: one per core.
    scheduler
        Address of a Dask scheduler whose workers to use instead, ``tls://host:8786``.
    progress
        Called after every batch.

    Raises
    ------
    ObsplanError
        The folder cannot be used or another campaign is at work in it, the cluster is not there,
        or its workers have another copy of obsplan.
    """
    end_if_worker()
    folder = claimed(Path(folder))
    with Store(folder) as store, held(folder):
        damage = store.mend()
        numbers = store.enter(cells)
        planned = [*zip(numbers, cells, strict=True)]
        missing = lacking(store, planned)
        if any(missing):
            with crew_of(workers=workers, most=sum(missing), scheduler=scheduler) as crew:
                flight = Flight(
                    crew=crew,
                    store=store,
                    progress=progress or (lambda *_: None),
                    todo=sum(missing),
                )
                flight.fly(flight.batches(planned, missing))
                timing = flight.timing()
            write_atomically(folder / "timing.json", json.dumps(timing, indent=2) + "\n")
        export(store, folder)
        return Report(
            missions=sum(len(cell.seeds) for cell in cells),
            flown=sum(missing),
            failed=sum(lacking(store, planned)),
            failures=[*islice(failures(store, planned), MOST_LISTED)],
            set_aside=store.set_aside(),
            damage=damage,
        )


@runtime_checkable
class Crew(Protocol):
    """Whoever flies missions."""

    def threads(self) -> int:
        """How many missions are flown at a time."""
        ...

    def send(self, batch: Batch) -> "Future[Flown | None]":
        """Have a batch flown; the result is None if its worker died of it, several times over."""
        ...


def crew_of(
    *, workers: int | None, most: int, scheduler: str | None
) -> AbstractContextManager[Crew]:
    """The cluster at an address, or local processes.

    Of local processes there are ``workers`` (default: one per core), never more than ``most``.
    """
    from dask.system import CPU_COUNT

    return remote(scheduler) if scheduler else local(min(workers or CPU_COUNT, most))


def lacking(store: Store, planned: Iterable[tuple[int, Cell]]) -> list[int]:
    """How many of each cell's missions have not been flown with success."""
    return [len(cell.seeds) - store.count(number, cell.seeds) for number, cell in planned]


def failures(store: Store, planned: Iterable[tuple[int, Cell]]) -> Iterator[tuple[Cell, int, str]]:
    """Each failed mission's cell, seed and reason."""
    for number, cell in planned:
        for seed, why in store.failures(number, cell.seeds):
            yield cell, seed, why


def claimed(folder: Path) -> Path:
    """The folder of a campaign, new or to be resumed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # looked at once: another campaign may be making its store
        inside = {path.name for path in folder.iterdir() if not is_begun_store(path.name)}
        if inside and FILE not in inside:
            raise no_store(
                folder, "holds something that is not a campaign", "give another folder with --out"
            )
    except OSError as error:
        raise ObsplanError(
            f"{folder} cannot be made ({error.strerror}); give another folder with --out"
        ) from error
    return folder


@dataclass(kw_only=True)
class Flight:
    """A campaign under way.

    A window of batches moves over what is missing, so memory does not grow with it.
    """

    crew: Crew
    store: Store
    progress: Progress
    todo: int
    done: int = 0
    failed: int = 0
    issued: int = 0
    work: float = 0.0  # in the workers [s]
    capacity: float = 0.0  # of the workers [s]: threads times time
    began: float = field(default_factory=perf_counter)
    looked: float = 0.0
    counted: float = -math.inf
    threads: int = 1
    # of each cell, as last seen [s per mission]
    pace: dict[int, float] = field(default_factory=dict)
    suspects: list[Batch] = field(default_factory=list)

    def batches(
        self, planned: Iterable[tuple[int, Cell]], missing: Iterable[int]
    ) -> Iterator[Batch]:
        """Batches of about a second, smaller toward the end.

        So no worker is left alone with a long one; but of a planner that plans once for all seeds
        no two workers plan the same.
        """
        for (number, cell), many in zip(planned, missing, strict=True):
            seeds = self.store.missing(number, cell.seeds)
            plans_once = cell.planner in PLANS_ONCE
            while some := tuple(islice(seeds, PLANNED_BATCH if plans_once else self._size(number))):
                self.issued += len(some)
                compiled = many >= WORTH_COMPILING * self.threads
                yield Batch(number, cell.content, some, compiled)

    def _size(self, cell: int) -> int:
        share = math.ceil((self.todo - self.issued) / (2 * self.threads))
        by_pace = int(BATCH_SECONDS / self.pace[cell]) if cell in self.pace else 1
        return max(1, min(by_pace, share, MOST_IN_A_BATCH))

    def fly(self, batches: Iterator[Batch]) -> None:
        """Fly all missions, and find those that kill their workers.

        Batches whose workers kept dying are flown again, each mission alone.
        """
        self.drive(batches, self.suspects.append)
        for batch in self.suspects:
            for seed in batch.seeds:
                self.drive(iter([batch._replace(seeds=(seed,))]), self._blame)

    def _blame(self, alone: Batch) -> None:
        """Record that a mission, flown alone, kills its worker."""
        self._keep([(alone.cell, failed(alone.seeds[0], DIED))])

    def _look_around(self) -> None:
        """Count the workers' threads, which come and go on a cluster.

        Add the time [s] that they had since the last look to the capacity.
        """
        now = perf_counter()
        self.capacity += self.threads * (now - self.looked if self.looked else 0.0)
        self.looked = now
        if now - self.counted > LOOK_AROUND:
            self.counted = now
            with suppress(Exception):  # a scheduler that is gone is told of by the batches
                self.threads = max(1, self.crew.threads())

    def drive(self, batches: Iterator[Batch], bury: Callable[[Batch], Any]) -> None:
        """Keep the window full and store what comes out of it.

        ``bury`` gets the batches whose workers died.
        """
        flying: dict[Future[Flown | None], Batch] = {}
        while True:
            self._look_around()
            room = max(0, AHEAD * self.threads - len(flying))
            for batch in islice(batches, room):
                flying[self.crew.send(batch)] = batch
            if not flying:
                return
            landed, _ = wait(flying, timeout=LOOK_AROUND, return_when=FIRST_COMPLETED)
            self._store([(flying.pop(sent), sent.result()) for sent in landed], bury)

    def _store(
        self, landed: list[tuple[Batch, Flown | None]], bury: Callable[[Batch], Any]
    ) -> None:
        """Keep what came back, in one transaction; then hand on what did not."""
        outcomes = []
        dead = []
        for batch, flown in landed:
            if flown is None:
                dead.append(batch)
                continue
            check_same_copy(flown)
            outcomes += [(batch.cell, outcome) for outcome in flown.outcomes]
            self.work += flown.seconds
            self.pace[batch.cell] = flown.seconds / len(batch.seeds)
        if outcomes:
            self._keep(outcomes)
        for batch in dead:
            bury(batch)

    def _keep(self, flown: list[tuple[int, Outcome]]) -> None:
        self.store.add(flown)
        self.done += len(flown)
        self.failed += sum(outcome.error is not None for _, outcome in flown)
        self.progress(self.done, self.todo, self.failed)

    def timing(self) -> dict[str, float | int]:
        """How fast it was; kept apart from the results, which do not depend on it."""
        self._look_around()
        seconds = perf_counter() - self.began
        return {
            "missions": self.done,
            "threads": self.threads,
            "seconds": seconds,
            "missions_per_second": self.done / seconds,
            # the rest is scheduling, and waiting at the end
            "share_of_time_in_missions": self.work / self.capacity,
        }


def check_same_copy(flown: Flown) -> None:
    """Refuse what another version flew, or other code under the same version."""
    ours = obsplan.__version__
    if flown.version != ours:
        raise ObsplanError(
            f"a worker has obsplan {flown.version} and this is {ours}; "
            f"install {ours} there and repeat"
        )
    if flown.code != code_hash():
        raise ObsplanError(
            f"a worker has obsplan {ours}, the same version as here but other code; "
            "give both the same copy, start the workers again and repeat"
        )
