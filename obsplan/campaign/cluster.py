"""Where missions are flown: processes of this machine, or a Dask cluster."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 30.0  # [s] for the scheduler to answer, and for its first worker
DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"  # Ctrl-C is for the process that started the workers and ends them


@contextmanager
def connected(*, workers: int | None, most: int, scheduler: str | None) -> Iterator["Client"]:
    """A client of the cluster at an address, or of local processes, never more than ``most``, made for the while.

    Local processes talk over the loopback interface only, and there is no dashboard.

    Raises
    ------
    ObsplanError
        Nobody answers, or nobody works there.
    """
    from dask.system import CPU_COUNT
    from distributed import Client, LocalCluster

    if scheduler is not None:
        with remote(scheduler) as client:
            yield client
        return
    number = min(workers or CPU_COUNT, most)
    options = {"n_workers": number, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "memory_limit": None}
    with LocalCluster(host="127.0.0.1", silence_logs=logging.CRITICAL, preload=DEAF, **options) as cluster, Client(cluster) as client:
        yield client


@contextmanager
def remote(address: str) -> Iterator["Client"]:
    """A client of the cluster at an address."""
    from distributed import Client

    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, ValueError, TimeoutError) as error:
        raise ObsplanError(f"no Dask scheduler answers at {address} ({error}); start one with `dask scheduler`") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise ObsplanError(f"the scheduler at {address} has no workers; start some with `dask worker {address}`") from None
        yield client
