"""What of a campaign another user of the machine can speak to: nothing; of a cluster, with keys."""

import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from campaigns import cluster, finish, start, wait_until, write_scenario

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
LISTENS = "0A"  # a state of TCP
STRANGER = """
import os, sys
from distributed import Client
try:
    with Client(sys.argv[1], timeout=3) as client:
        client.run_on_scheduler(lambda mark: open(mark, "w").close(), sys.argv[2])
except (OSError, TypeError, RuntimeError, ValueError) as error:
    sys.exit(type(error).__name__)
"""


def inodes_of(processes):
    """Sockets that processes hold."""
    found = set()
    for process in processes:
        with suppress(OSError):  # closed meanwhile
            for link in Path(f"/proc/{process.pid}/fd").iterdir():
                found.update(re.findall(r"^socket:\[(\d+)\]$", os.readlink(link)))
    return found


def doors_of(processes):
    """Ports at which processes listen, and names of their sockets in the file system."""
    ours = inodes_of(processes)
    doors = []
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            _, local, _, state, *rest = line.split()
            if rest[5] in ours and (state == LISTENS or table.startswith("udp")):
                doors.append(int(local.rpartition(":")[2], 16))
    for line in Path("/proc/net/unix").read_text().splitlines()[1:]:
        *_, inode, name = [*line.split(), ""][:8]
        if inode in ours and name:
            doors.append(name)
    return doors


def family(process):
    """A process and all that it started."""
    whole = psutil.Process(process.pid)
    return [whole, *whole.children(recursive=True)]


@pytest.mark.slow
def test_campaign_on_this_machine_opens_no_door(tmp_path):
    out = tmp_path / "out"
    process = start(write_scenario(tmp_path), "--runs", 20_000, "--workers", 2, "--out", out)
    seen = []
    try:
        wait_until(lambda: seen.append(doors_of(family(process))) or len(family(process)) >= 4)
        wait_until(lambda: seen.append(doors_of(family(process))) or len(seen) >= 20)
    finally:
        process.kill()
        process.communicate()
    assert seen == [[]] * len(seen)


@pytest.mark.slow
def test_doors_are_found_where_there_are_some_and_anyone_may_run_code_there(tmp_path):
    """The negative control: a cluster as Dask starts it."""
    with cluster(tmp_path, workers=1) as address:
        doors = doors_of(family(psutil.Process()))
        assert int(address.rpartition(":")[2]) in doors
        assert visit(address, tmp_path / "ran") == ""
    assert (tmp_path / "ran").exists()


def keys_in(folder):
    """Dask's settings for TLS under a certificate made now."""
    folder.mkdir()
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    line = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=obsplan"]
    line += ["-keyout", str(key), "-out", str(certificate)]
    subprocess.run(line, check=True, capture_output=True)
    comm = "DASK_DISTRIBUTED__COMM"
    settings = {f"{comm}__DEFAULT_SCHEME": "tls", f"{comm}__REQUIRE_ENCRYPTION": "True"}
    settings[f"{comm}__TLS__CA_FILE"] = str(certificate)
    for role in ("SCHEDULER", "WORKER", "CLIENT"):
        settings[f"{comm}__TLS__{role}__CERT"] = str(certificate)
        settings[f"{comm}__TLS__{role}__KEY"] = str(key)
    return settings


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("openssl"), reason="makes certificates with openssl")
def test_cluster_under_tls_flies_for_who_has_the_keys_and_for_nobody_else(tmp_path):
    keys, others = keys_in(tmp_path / "ours"), keys_in(tmp_path / "theirs")
    pond = write_scenario(tmp_path, duration=10.0)
    with cluster(tmp_path, workers=1, environment=keys) as address:
        assert address.startswith("tls://")
        line = [pond, "--runs", 3, "--scheduler", address, "--out"]
        out, _ = finish(start(*line, tmp_path / "out", env={**os.environ, **keys}))
        assert "3 missions: 3 flown now" in out
        assert visit(address, tmp_path / "ran", others) != ""
        assert visit(address.replace("tls:", "tcp:"), tmp_path / "ran") != ""
        _, err = finish(start(*line, tmp_path / "keyless"), code=2)
    assert not (tmp_path / "ran").exists()
    assert err == (
        f"obsplan: the scheduler at {address} cannot be spoken to: it speaks TLS and no "
        "certificates are given here: name them in Dask's configuration, distributed.comm.tls\n"
    )


def visit(address, mark, keys=None):
    """Why a stranger could not run code in a scheduler; empty if he could."""
    line = [sys.executable, "-W", "ignore", "-c", STRANGER, address, str(mark)]
    done = subprocess.run(
        line, capture_output=True, text=True, check=False, env={**os.environ, **(keys or {})}
    )
    return done.stderr if done.returncode else ""
