"""Missions flown by the workers of a Dask cluster, on other hosts as well."""

import asyncio
import logging
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import obsplan
from obsplan.campaign.worker import Batch, Flown, fly_batch
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 30.0  # [s] for the scheduler to answer, and for its first worker
# else a client keeps its last thousand messages, each with a scenario
SETTINGS = {"distributed.admin.low-level-log-length": 10}
LOST = "the scheduler was lost; what was flown is kept, and the same command goes on from there"
NO_KEYS = (
    "it speaks TLS and no certificates are given here: name them in Dask's configuration, "
    "distributed.comm.tls"
)


@contextmanager
def remote(address: str) -> Iterator["Cluster"]:
    """Connect to the cluster at an address; disconnect at the end.

    An address ``tls://...`` is spoken to under the certificates of Dask's own configuration.

    Raises
    ------
    ObsplanError
        Nobody answers, or nobody works there.
    """
    import distributed  # brings the defaults which are set below
    from dask import config

    # most faults mend themselves; the others are raised
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    with config.set(SETTINGS):
        try:
            client = distributed.Client(address, timeout=PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            raise ObsplanError(
                f"no Dask scheduler answers at {address} ({error}); start one with `dask scheduler`"
            ) from error
        except TypeError as error:  # of the TLS that lacks its context
            raise ObsplanError(
                f"the scheduler at {address} cannot be spoken to: {NO_KEYS}"
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=PATIENCE)
            except TimeoutError:
                raise ObsplanError(
                    f"the scheduler at {address} has no workers; "
                    f"start some with `dask worker {address}`"
                ) from None
            yield Cluster(client)


class Cluster:
    """The workers that a Dask client reaches."""

    def __init__(self, client: "Client"):
        self._client = client

    def threads(self) -> int:
        """Threads of the workers, which come and go."""
        threads: Any = self._client.nthreads()
        return sum(threads.values())

    def send(self, batch: Batch) -> "Future[Flown | None]":
        """Have a batch flown; the result is None if its worker died of it, several times over."""
        loop: Any = self._client.loop
        return asyncio.run_coroutine_threadsafe(brought(self._client, batch), loop.asyncio_loop)


async def brought(client: "Client", batch: Batch) -> Flown | None:
    """What a worker made of a batch, or None if it died of it.

    A worker that dies takes the finished results that it still holds; Dask computes these again,
    and ``gather`` waits for that.

    Raises
    ------
    ObsplanError
        The worker could not even begin, or the scheduler is gone.
    """
    from distributed import KilledWorker

    future = None
    try:
        future = client.submit(fly_batch, batch, pure=False)
        answer: Any = client.gather(future, asynchronous=True)
        return await answer
    except KilledWorker:
        return None
    except Exception as error:
        if future is None or future.status != "error":  # it is not the batch that failed
            raise ObsplanError(LOST) from error
        raise ObsplanError(
            f"a worker cannot fly missions ({type(error).__name__}: {error}); "
            f"install obsplan {obsplan.__version__} there"
        ) from error
