"""What a cluster loses on the way does not end a campaign; a scheduler that is gone does."""

import asyncio
import time
from concurrent.futures import CancelledError

import pytest
from campaigns import wait_until, write_scenario
from distributed import Client, KilledWorker, LocalCluster

import obsplan
from obsplan.campaign import cluster as cluster_module
from obsplan.campaign import plan_cells
from obsplan.campaign.cluster import Cluster, brought
from obsplan.campaign.code import code_hash
from obsplan.campaign.execute import Flight
from obsplan.campaign.store import Store
from obsplan.campaign.worker import Batch, Flown, Outcome
from obsplan.types import ObsplanError

BATCH = Batch(1, "{}", (0,), False)
LOST = "the scheduler was lost; what was flown is kept"


def fly_nothing(batch):
    """A batch of missions that take no time."""
    outcomes = [Outcome(seed, None, {}, "{}", "{}") for seed in batch.seeds]
    return Flown(outcomes, 0.0, obsplan.__version__, code_hash())


@pytest.fixture
def pool():
    """A cluster of one worker inside this process, and its client."""
    one = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(processes=False, **one) as pool, Client(pool) as client:
        yield pool, client


def test_worker_that_dies_with_finished_results_costs_none(tmp_path, pool, monkeypatch):
    cluster, client = pool
    monkeypatch.setattr(cluster_module, "fly_batch", fly_nothing)
    deaths = []

    def kill_once(done, todo, _):
        """Once the first batch is stored and the others wait: take the worker that holds them."""
        if deaths or done == todo:
            return
        wait_until(lambda: all(state.status == "finished" for state in client.futures.values()))
        time.sleep(0.2)  # so that their results are here
        deaths.append(done)
        client.sync(cluster.workers[0].close)
        cluster.scale(2)
        client.wait_for_workers(1)

    with Store(tmp_path) as store:
        (number,) = store.enter(plan_cells([write_scenario(tmp_path, duration=10.0)], runs=20))
        flight = Flight(crew=Cluster(client), store=store, progress=kill_once, todo=20)
        flight.drive((Batch(number, "{}", (seed,), False) for seed in range(20)), pytest.fail)
        assert store.count(number, range(20)) == 20
    assert deaths


class Answering:
    """A client whose every batch comes to the same end."""

    def __init__(self, status, answer):
        self.status, self.answer = status, answer

    def submit(self, *_, **__):
        return self

    async def gather(self, *_, **__):
        raise self.answer


@pytest.mark.parametrize(
    ("status", "answer", "sentence"),
    [
        ("cancelled", CancelledError(), LOST),
        ("finished", OSError("closed"), LOST),
        ("lost", OSError("closed"), LOST),
        ("error", ImportError("no obsplan"), r"cannot fly missions \(ImportError: no obsplan\)"),
        ("error", OSError("no file"), r"cannot fly missions \(OSError: no file\)"),
    ],
)
def test_what_ends_a_campaign_is_said_by_name(status, answer, sentence):
    with pytest.raises(ObsplanError, match=sentence):
        asyncio.run(brought(Answering(status, answer), BATCH))


def test_result_that_was_lost_and_then_kills_its_workers_is_a_death_and_no_endless_wait():
    dead = KilledWorker("fly_batch", None, 3)
    assert asyncio.run(brought(Answering("error", dead), BATCH)) is None
