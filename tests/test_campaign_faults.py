"""Campaigns that are killed, starved or crowded end with the table of one left in peace."""

import os
import resource
import signal
import sqlite3
import time
from functools import partial
from pathlib import Path

import numpy as np
import psutil
import pytest
from campaigns import (
    DIVERGES,
    PLANNERS,
    VARY,
    cluster,
    finish,
    start,
    tables,
    wait_until,
    write_scenario,
)

from obsplan import load_campaign

pytestmark = pytest.mark.xdist_group("campaign-faults")  # they share a campaign
RUNS = 70  # of each of four cells: enough to be compiled on one or two workers
MISSIONS = RUNS * len(PLANNERS) * 2


@pytest.fixture(scope="module")
def arguments(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenario")
    return [
        write_scenario(folder),
        "--planners",
        ",".join(PLANNERS),
        "--vary",
        *VARY,
        "--runs",
        RUNS,
        "--out",
    ]


@pytest.fixture(scope="module")
def undisturbed(arguments, tmp_path_factory):
    """The tables of a campaign on one worker."""
    folder = tmp_path_factory.mktemp("undisturbed")
    finish(start(*arguments, folder, "--workers", 1))
    return tables(folder)


def flown(folder):
    """Missions in the store, read beside the campaign."""
    if not (folder / "campaign.sqlite").exists():
        return 0
    connection = sqlite3.connect(f"file:{folder / 'campaign.sqlite'}?mode=ro", uri=True, timeout=60)
    try:
        return connection.execute("SELECT count(*) FROM mission").fetchone()[0]
    except sqlite3.OperationalError:  # no table yet
        return 0
    finally:
        connection.close()


def await_flown(folder, many, process):
    """Wait until a campaign has flown so many missions, or has ended, as it does if it has fewer.

    It flies some hundred a second.
    """
    wait_until(lambda: flown(folder) >= many or process.poll() is not None)


def limit_files(size):
    """Let no file of this process grow beyond so many bytes: to a store, a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def sound(folder):
    """Whether SQLite finds nothing wrong with the store."""
    connection = sqlite3.connect(folder / "campaign.sqlite")
    try:
        return connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    finally:
        connection.close()


def workers_of(process):
    """Processes that fly missions for a campaign."""
    children = psutil.Process(process.pid).children(recursive=True)
    alive = [child for child in children if child.status() != psutil.STATUS_ZOMBIE]
    return [child for child in alive if "spawn_main" in " ".join(child.cmdline())]


@pytest.mark.slow
def test_two_workers_give_the_table_of_one(tmp_path, arguments, undisturbed):
    finish(start(*arguments, tmp_path, "--workers", 2))
    assert tables(tmp_path) == undisturbed
    assert len(load_campaign(tmp_path)) == MISSIONS


@pytest.mark.slow
def test_killed_three_times_at_random_and_finished_gives_the_same_table(
    tmp_path, arguments, undisturbed
):
    seed = np.random.SeedSequence().entropy
    print(f"the instants are of seed {seed}")  # noqa: T201, shown if it fails
    rng = np.random.default_rng(seed)
    for _ in range(3):
        before = flown(tmp_path)
        enough = before + rng.integers(1, MISSIONS // 4)
        process = start(*arguments, tmp_path)
        await_flown(tmp_path, enough, process)
        time.sleep(rng.uniform(0.0, 0.2))
        process.kill()
        finish(process, code=0 if process.wait() == 0 else -signal.SIGKILL)
        assert sound(tmp_path)
    before = flown(tmp_path)
    out, _ = finish(start(*arguments, tmp_path))
    assert (
        f"{MISSIONS - before} flown now, {before} were there, 0 failed" in out
    )  # what was kept was not flown again
    assert tables(tmp_path) == undisturbed


@pytest.mark.slow
def test_killed_while_it_starts_leaves_nothing_in_the_way(tmp_path, arguments, undisturbed):
    process = start(*arguments, tmp_path / "out", "--workers", 2)
    wait_until((tmp_path / "out").exists)
    process.kill()
    finish(process, code=-signal.SIGKILL)
    finish(start(*arguments, tmp_path / "out", "--workers", 2))
    assert tables(tmp_path / "out") == undisturbed


@pytest.mark.slow
def test_interrupted_says_so_and_keeps_what_was_flown(tmp_path, arguments):
    process = start(*arguments, tmp_path, start_new_session=True)
    wait_until(lambda: flown(tmp_path) >= 10)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers get it too
    _, err = finish(process, code=130)
    assert err == (
        f"obsplan: interrupted; what is finished is kept in {tmp_path}, "
        "and the same command goes on from there\n"
    )
    assert sound(tmp_path)
    assert len(load_campaign(tmp_path)) == flown(tmp_path) >= 10


@pytest.mark.slow
def test_worker_killed_midway_costs_nothing_but_time(tmp_path, arguments, undisturbed):
    process = start(*arguments, tmp_path, "--workers", 2)
    wait_until(lambda: flown(tmp_path) >= 10)
    workers_of(process)[0].kill()
    finish(process)
    assert tables(tmp_path) == undisturbed


@pytest.mark.slow
def test_workers_do_not_outlive_a_killed_campaign(tmp_path, arguments):
    process = start(*arguments, tmp_path, "--workers", 2)
    wait_until(lambda: flown(tmp_path) >= 10)
    workers = workers_of(process)
    process.kill()
    finish(process, code=-signal.SIGKILL)
    assert len(workers) == 2
    wait_until(
        lambda: (
            not any(
                worker.is_running() and worker.status() != psutil.STATUS_ZOMBIE
                for worker in workers
            )
        )
    )


@pytest.mark.slow
def test_without_a_compiler_a_message_and_the_same_table(tmp_path, arguments, undisturbed):
    environment = {key: value for key, value in os.environ.items() if key != "CC"} | {
        "PATH": str(tmp_path)
    }
    _, err = finish(start(*arguments, tmp_path / "out", "--workers", 1, env=environment))
    assert err == (
        "no C compiler found: using CasADi's virtual machine, "
        "with the same results, about three times slower\n"
    )
    assert tables(tmp_path / "out") == undisturbed


@pytest.mark.slow
def test_second_campaign_into_one_store_is_refused_and_harms_nothing(
    tmp_path, arguments, undisturbed
):
    first = start(*arguments, tmp_path, "--workers", 1)
    wait_until(lambda: flown(tmp_path) > 0)
    first.send_signal(signal.SIGSTOP)  # else it may end before the second has begun
    _, err = finish(start(*arguments, tmp_path, "--workers", 1), code=2)
    assert f"another campaign is at work in {tmp_path} (process {first.pid} on " in err
    first.send_signal(signal.SIGCONT)
    finish(first)
    assert sound(tmp_path)
    assert tables(tmp_path) == undisturbed


@pytest.mark.slow
def test_dask_cluster_gives_the_same_table_though_a_worker_is_killed(
    tmp_path, arguments, undisturbed
):
    with cluster(tmp_path) as address:
        finish(start(*arguments, tmp_path / "out", "--scheduler", address))
        assert tables(tmp_path / "out") == undisturbed
        process = start(*arguments, tmp_path / "again", "--scheduler", address)
        wait_until(lambda: flown(tmp_path / "again") >= 10)
        workers_of(psutil.Process())[0].kill()  # its nanny starts another
        finish(process)
        assert tables(tmp_path / "again") == undisturbed


@pytest.mark.slow
def test_mission_that_kills_its_worker_is_recorded_and_costs_no_other(tmp_path):
    poison = tmp_path / "poison.py"
    poison.write_text(
        "import os\nfrom obsplan.simulation import ClosedLoop\n"
        "poisoned = lambda fly: lambda self, seed: os._exit(1) if seed == 7 else fly(self, seed)\n"
        "ClosedLoop.fly = poisoned(ClosedLoop.fly)\n"
    )
    impatient = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
    with cluster(tmp_path, options=["--preload", str(poison)], environment=impatient) as address:
        pond = write_scenario(tmp_path, duration=10.0)
        _, err = finish(
            start(pond, "--runs", 40, "--scheduler", address, "--out", tmp_path / "out"), code=3
        )
    reason = "its worker process died every time it was tried; perhaps the memory did not suffice"
    assert err == f"obsplan: pond, path-inertia, seed 7: {reason}\n"
    table = load_campaign(tmp_path / "out").set_index("seed")
    assert list(table.index[table["status"] == "failed"]) == [7]
    assert table.loc[7, "error"] == reason
    assert len(table) == 40


DEADLY = """
import os
from dataclasses import dataclass
import obsplan

@dataclass(frozen=True)
class Deadly:
    situation: obsplan.Situation

    def plan(self, pose, auvs, *, time=0.0):
        os._exit(1)
"""


@pytest.mark.slow
def test_mission_that_kills_its_process_here_is_recorded_and_costs_no_other(tmp_path):
    (tmp_path / "deadly.py").write_text(DEADLY)
    pond = write_scenario(tmp_path, duration=10.0)
    line = [pond, "--planners", "deadly:Deadly,circle", "--runs", 1, "--workers", 2]
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    process = start(*line, "--out", tmp_path / "out", env=os.environ | {"PYTHONPATH": path})
    out, err = finish(process, code=3)
    assert "2 missions: 2 flown now, 0 were there, 1 failed." in out
    assert err.count("its worker process died every time it was tried") == 1
    assert sorted(load_campaign(tmp_path / "out")["status"]) == ["done", "failed"]


@pytest.mark.slow
def test_scheduler_that_is_killed_is_one_sentence_and_the_store_goes_on_elsewhere(
    tmp_path, arguments, undisturbed
):
    with cluster(tmp_path) as address:
        process = start(*arguments, tmp_path / "out", "--scheduler", address)
        wait_until(lambda: flown(tmp_path / "out") >= 10)
        for child in psutil.Process().children():
            if any("dask_scheduler" in word for word in child.cmdline()):
                child.kill()
        _, err = finish(process, code=2)
    assert err.startswith("obsplan: the scheduler was lost; what was flown is kept")
    assert err.count("\n") == 1
    assert flown(tmp_path / "out") >= 10
    finish(start(*arguments, tmp_path / "out", "--workers", 1))
    assert tables(tmp_path / "out") == undisturbed


@pytest.mark.slow
def test_full_disk_is_one_sentence_and_the_store_goes_on_when_there_is_room(
    tmp_path, arguments, undisturbed
):
    process = start(
        *arguments,
        tmp_path / "out",
        "--workers",
        1,
        preexec_fn=partial(limit_files, 40_000),
        env=os.environ | {"OBSPLAN_CACHE": str(tmp_path)},
    )
    _, err = finish(process, code=2)
    told = [line for line in err.splitlines() if line.startswith("obsplan: ")]
    assert len(told) == 1
    assert (
        "see that the disk has space and works: "
        "what was flown is kept, and the same command goes on from there" in told[0]
    )
    assert sound(tmp_path / "out")
    before = flown(tmp_path / "out")
    assert before > 0
    out, _ = finish(start(*arguments, tmp_path / "out", "--workers", 1))
    assert f"{before} were there" in out
    assert tables(tmp_path / "out") == undisturbed


@pytest.mark.slow
def test_table_that_finds_no_room_leaves_the_one_before(tmp_path):
    pond = write_scenario(tmp_path, duration=10.0, diverging=True)
    line = [pond, "--vary", DIVERGES, "--runs", 2, "--workers", 1, "--out", tmp_path / "out"]
    finish(start(*line), code=3)
    before = tables(tmp_path / "out")
    for name in ("campaign.csv", "campaign.parquet"):
        assert (tmp_path / "out" / name).stat().st_size > 1000
    _, err = finish(start(*line, preexec_fn=partial(limit_files, 1000)), code=2)
    assert err.count("\n") == 1
    assert tables(tmp_path / "out") == before
    assert not list(Path(tmp_path / "out").glob(".*.part"))
