"""What a campaign says when its script, store or user is in the way: one sentence."""

import errno
import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import suppress
from itertools import chain, repeat
from multiprocessing.process import BaseProcess
from threading import Event, Timer

import psutil
import pytest
from campaigns import finish, start, wait_until, without_rights, write_scenario

from obsplan import ObsplanError, load_campaign
from obsplan.campaign import fly_campaign, plan_cells
from obsplan.campaign.faults import FILE, TABLES
from obsplan.campaign.processes import NO_WORKER, Worker, local
from obsplan.campaign.store import Store
from obsplan.campaign.table import existing_store
from obsplan.campaign.worker import Batch

SCRIPT = """
from obsplan.campaign import fly_campaign, plan_cells
with open("read.txt", "a") as file:
    file.write("read\\n")
{guard}report = fly_campaign(plan_cells(["{pond}"], runs=3), "out", workers=2)
{guard}open("done.txt", "w").write(f"{{report.flown}} flown")
"""


def run_script(folder, guard):
    pond = write_scenario(folder, duration=10.0)
    (folder / "fly.py").write_text(SCRIPT.format(guard=guard, pond=pond))
    return subprocess.run(
        [sys.executable, "fly.py"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.mark.slow
def test_script_without_a_main_guard_is_told_so_in_one_sentence(tmp_path):
    done = run_script(tmp_path, guard="")
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1  # of the script's own, down to where it called
    assert "multiprocessing" not in done.stderr
    assert "distributed" not in done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("obsplan.types.ObsplanError: no worker process could start")
    assert '`if __name__ == "__main__":`' in last
    assert not (tmp_path / "done.txt").exists()  # no worker went on in the script, either


def no_more(_):
    raise OSError(errno.EMFILE, "Too many open files")


def test_workers_that_the_system_has_no_files_for_are_told_of_in_one_sentence(monkeypatch):
    monkeypatch.setattr(Worker, "start", classmethod(no_more))
    said = r"no more than 0 worker processes .*Too many open files\): give fewer workers"
    with pytest.raises(ObsplanError, match=said), local(2):
        pass


class Dead(Worker):
    """A worker that dies of its first batch, or before."""

    def __init__(self, *, ready):
        object.__setattr__(self, "ready", ready)

    def await_ready(self):
        if not self.ready:
            raise ObsplanError(NO_WORKER)

    def fly(self, _):
        raise EOFError

    def end(self):
        pass


def test_after_a_worker_could_not_be_replaced_the_next_batch_says_so_too(monkeypatch):
    workers = chain([Dead(ready=True)], repeat(Dead(ready=False)))
    monkeypatch.setattr(Worker, "start", classmethod(lambda _: next(workers)))
    with local(1) as processes:
        for _ in range(2):
            with pytest.raises(ObsplanError, match="no worker process could start"):
                processes.send(Batch(1, "{}", (1,), False)).result(timeout=10)


def test_worker_that_a_signal_interrupts_in_its_start_is_ended(monkeypatch):
    begun = []

    def start_and_be_told_to_end(process):
        begin(process)
        begun.append(psutil.Process(process.pid))
        raise KeyboardInterrupt  # as the signal's handler does, wherever the program is

    begin = BaseProcess.start
    monkeypatch.setattr(BaseProcess, "start", start_and_be_told_to_end)
    with pytest.raises(KeyboardInterrupt), local(2):
        pass
    assert [process.is_running() for process in begun] == [False]


def locked(path, seconds):
    """Keep a store locked as another program does; gives what tells that it no longer is."""
    other = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    freed = Event()

    def free():
        freed.set()
        other.close()

    Timer(seconds, free).start()
    return freed


def test_signal_ends_a_campaign_that_waits_for_a_locked_store(tmp_path):
    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    with Store(tmp_path) as store:
        freed = locked(store.path, 1.5)
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(KeyboardInterrupt):
            store.enter([])
        assert not freed.is_set()
    signal.signal(signal.SIGALRM, before)
    assert freed.wait(10)


def test_campaign_that_waits_for_a_locked_store_says_so_once_and_goes_on(
    tmp_path, monkeypatch, caplog
):
    monkeypatch.setattr("obsplan.campaign.connection.SILENCE", 0.1)
    with Store(tmp_path) as store:
        freed = locked(store.path, 0.5)
        store.enter([])
        assert freed.is_set()
        said = f"{store.path} is locked by another program; waiting for it"
    assert caplog.messages == [said]


@pytest.mark.slow
def test_script_with_a_main_guard_flies(tmp_path):
    done = run_script(tmp_path, guard='if __name__ == "__main__": ')
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "done.txt").read_text() == "3 flown"


def children(process):
    """Workers under way, which at first are but interpreters about to import."""
    return [
        child
        for child in psutil.Process(process.pid).children(recursive=True)
        if "spawn_main" in " ".join(child.cmdline())
    ]


@pytest.mark.slow
@pytest.mark.parametrize("after", [0.0, 0.2, 0.6, 1.5])
def test_ctrl_c_while_workers_start_shows_nothing_of_them(tmp_path, after):
    pond = write_scenario(tmp_path)
    line = [pond, "--runs", 500, "--workers", 2, "--out", tmp_path / "out"]
    process = start(*line, start_new_session=True)
    wait_until(lambda: children(process))
    time.sleep(after)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers get it too
    out, err = finish(process, code=130)
    assert out == ""
    assert err == (
        f"obsplan: interrupted; what is finished is kept in {tmp_path / 'out'}, "
        "and the same command goes on from there\n"
    )


WITH_ANOTHER_THREAD = """
import os, signal, threading, time
from obsplan.campaign.processes import deaf

threading.Thread(target=time.sleep, args=(9.0,), daemon=True).start()  # which hears what this one does not
try:
    with deaf():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.5)
        print("started")
    time.sleep(0.5)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.slow
def test_ctrl_c_that_another_thread_hears_waits_until_a_worker_is_started():
    line = [sys.executable, "-c", WITH_ANOTHER_THREAD]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == ["started", "interrupted"]


@pytest.fixture
def flown(tmp_path):
    """A folder with a campaign's store and table, as `fly_campaign` leaves it, and the cells."""
    cells = plan_cells([write_scenario(tmp_path, duration=10.0)])
    folder = tmp_path / "out"
    folder.mkdir()
    with Store(folder) as store:
        store.enter(cells)
    for name in TABLES:
        (folder / name).touch()
    return folder, cells


def test_store_that_was_moved_away_is_asked_for(flown):
    folder, cells = flown
    (folder / FILE).rename(folder.parent / "elsewhere.sqlite")
    sentence = (
        "out has a campaign's table but not its store, which was moved or removed: "
        f"put {FILE} back, or give"
    )
    with pytest.raises(ObsplanError, match=sentence):
        fly_campaign(cells, folder)
    with pytest.raises(ObsplanError, match=sentence):
        load_campaign(folder)
    assert sorted(path.name for path in folder.iterdir()) == sorted(TABLES)


def test_store_that_is_a_folder_is_named_as_one(flown):
    folder, cells = flown
    (folder / FILE).unlink()
    (folder / FILE).mkdir()
    for use in (lambda: fly_campaign(cells, folder), lambda: load_campaign(folder)):
        with pytest.raises(ObsplanError, match=r"campaign.sqlite: is a folder, .* choose another"):
            use()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file_mode", "folder_mode", "sentence"),
    [
        (0o444, 0o755, "campaign.sqlite: is read-only; make it writable, or choose another folder"),
        (0o644, 0o555, "campaign.sqlite: lies in a folder that is read-only; make that writable, or"),
        (0o000, 0o755, "campaign.sqlite: may not be read; make it readable and writable, or choose"),
    ],
)  # fmt: skip
def test_store_without_the_right_to_use_it_says_which_right(
    flown, file_mode, folder_mode, sentence
):
    folder, _ = flown
    (folder / FILE).chmod(file_mode)
    folder.chmod(folder_mode)
    line = [sys.executable, "-m", "obsplan", "campaign", "pond.toml", "--runs", "3", "--out", "out"]
    try:
        done = subprocess.run(
            without_rights(line), cwd=folder.parent, capture_output=True, text=True, check=False
        )
    finally:
        folder.chmod(0o755)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert sentence in done.stderr


@pytest.mark.slow
def test_store_that_is_moved_while_the_campaign_runs_is_named_as_moved(tmp_path):
    pond = write_scenario(tmp_path, duration=10.0)
    process = start(pond, "--runs", 5000, "--workers", 1, "--out", tmp_path / "out")
    wait_until(lambda: children(process))
    (tmp_path / "out" / FILE).rename(tmp_path / "elsewhere.sqlite")
    _, err = finish(process, code=2)
    assert err.count("\n") == 1
    assert f"{FILE}: was moved or removed while the campaign ran; put it back, and" in err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "name"), [(signal.SIGTERM, "SIGTERM"), (signal.SIGHUP, "SIGHUP")]
)
def test_campaign_that_is_told_to_end_keeps_what_it_has_and_takes_its_workers_along(
    tmp_path, number, name
):
    line = [write_scenario(tmp_path, duration=10.0), "--workers", 2, "--out", tmp_path / "out"]
    process = start(*line, "--runs", 20_000)
    wait_until(lambda: missions_in(tmp_path / "out") > 0)
    workers = children(process)
    process.send_signal(number)
    out, err = finish(process, code=128 + number)
    assert out == ""
    assert err == (
        f"obsplan: ended by {name}; what is finished is kept in {tmp_path / 'out'}, "
        "and the same command goes on from there\n"
    )
    assert len(workers) == 2
    assert not any(worker.is_running() for worker in workers)
    assert [path.name for path in (tmp_path / "out").iterdir()] == [FILE]


def missions_in(folder):
    """Missions kept so far, read beside the campaign."""
    with suppress(ObsplanError), existing_store(folder) as store:
        return store.size()[0]
    return 0


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "compare"])
def test_flight_that_is_told_to_end_leaves_nothing(tmp_path, command):
    write_scenario(tmp_path, duration=86_400.0, length=40_000.0)
    process = subprocess.Popen(
        [sys.executable, "-m", "obsplan", command, "pond.toml"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(2.5)
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (143, "")
    assert err == "obsplan: ended by SIGTERM; nothing was written\n"
    assert [path.name for path in tmp_path.iterdir()] == ["pond.toml"]


def test_signal_that_is_ignored_already_stays_ignored():
    """As `nohup` has it."""
    code = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN); "
        "from obsplan.cli.stopping import listen; listen(); "
        "print(signal.getsignal(signal.SIGHUP) is signal.SIG_IGN, "
        "signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True False\n"
