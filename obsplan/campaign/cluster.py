"""Where missions are flown: processes of this machine, or a Dask cluster."""

import logging
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import current_process, resource_tracker
from typing import TYPE_CHECKING

from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 30.0  # [s] for the scheduler to answer, and for its first worker
# Ctrl-C is for the process that started the workers and ends them
DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
NO_WORKER = (
    "no worker process could start: see that there is memory for them; a script must fly its "
    'campaigns under `if __name__ == "__main__":`, because each worker reads the script again'
)

SETTINGS = {
    # else a client keeps its last thousand messages, each with a scenario
    "distributed.admin.low-level-log-length": 10,
    # else memory goes back after each mission: 15 % of the time
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    # a sample of every worker's stack each 10 ms, which nobody looks at
    "distributed.worker.profile.enabled": False,
}


@contextmanager
def connected(*, workers: int | None, most: int, scheduler: str | None) -> Iterator["Client"]:
    """Connect to the cluster at an address, or to local processes; disconnect at the end.

    Of local processes there are ``workers`` (default: one per core), never more than ``most``.

    Raises
    ------
    ObsplanError
        Nobody answers, or nobody works there.
    """
    import distributed  # noqa: F401 - brings the defaults which are set below
    from dask import config
    from dask.system import CPU_COUNT

    where = local(min(workers or CPU_COUNT, most)) if scheduler is None else remote(scheduler)
    with config.set(SETTINGS), where as client:
        yield client


@contextmanager
def local(number: int) -> Iterator["Client"]:
    """Start local processes and connect to them; end them at the end.

    They talk over the loopback interface only, and there is no dashboard.
    """
    from distributed import Client, LocalCluster

    options = {
        "n_workers": number,
        "threads_per_worker": 1,
        "dashboard_address": "127.0.0.1:0",
        "memory_limit": None,
    }
    try:
        with deaf():
            cluster = LocalCluster(
                host="127.0.0.1", silence_logs=logging.CRITICAL, preload=DEAF, **options
            )
    except RuntimeError:
        raise ObsplanError(NO_WORKER) from None
    with cluster, Client(cluster) as client:
        yield client


def end_if_worker() -> None:
    """End a worker that is about to start the campaign again.

    It would where the user's script has no main guard: every worker runs the script.
    """
    if getattr(current_process(), "_inheriting", False):  # as multiprocessing itself tells it
        sys.exit(2)


@contextmanager
def deaf() -> Iterator[None]:
    """Hold back Ctrl-C, also from processes started meanwhile.

    A worker would receive it before it can be told to ignore it.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # which would let Ctrl-C through again if it began only now
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def remote(address: str) -> Iterator["Client"]:
    """Connect to the cluster at an address; disconnect at the end."""
    from distributed import Client

    # most faults mend themselves; the others are raised
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError, TimeoutError) as error:
        raise ObsplanError(
            f"no Dask scheduler answers at {address} ({error}); start one with `dask scheduler`"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise ObsplanError(
                f"the scheduler at {address} has no workers; "
                f"start some with `dask worker {address}`"
            ) from None
        yield client
