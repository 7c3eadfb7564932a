"""What tests of campaigns share: a small scenario, the command as a process, a Dask cluster."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

SCENARIO = """
name = "pond"
time_step = 0.5
duration = {duration}
origin = {{ lat = 47.6, lon = -122.3 }}
cna = {{ speed = 2.0, min_turn_radius = 5.0 }}
planner = {{ kind = "path-inertia" }}
ranging = {{ interval = 2.0, sigma = {sigma} }}
[[auv]]
name = "alpha"
speed = 1.0
survey = {{ kind = "lawnmower", legs = 2, length = {length}, spacing = 10.0 }}
first_estimate = {{ sigma_position = 2.0 }}
process_noise = {{ position = 0.02, speed = 0.01 }}
"""
PLANNERS, VARY = ["gramian", "stationary"], ["cna.speed=1.5,3.0"]
DIVERGES = "auv.0.first_estimate.x=0.0,1e200"  # the square of which no number holds
TABLES = ("campaign.csv", "campaign.parquet")
LOOPBACK = ["--host", "127.0.0.1", "--no-dashboard"]


def write_scenario(folder, *, duration=60.0, sigma=1.0, length=40.0, name="pond.toml"):
    path = Path(folder) / name
    path.write_text(SCENARIO.format(duration=duration, sigma=sigma, length=length))
    return str(path)


def start(*arguments, **options):
    """`obsplan campaign` as a process of its own."""
    line = [
        sys.executable,
        "-c",
        "from obsplan.cli import main; main()",
        "campaign",
        *map(str, arguments),
    ]
    return subprocess.Popen(
        line,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[1],
        **options,
    )


def finish(process, code=0):
    """What a campaign said and complained, without how far it was, told each half minute."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == code, out + err
    return out, re.sub(r"^\d+ combinations?, .*\n", "", err, flags=re.MULTILINE)


def tables(folder):
    return [(Path(folder) / name).read_bytes() for name in TABLES]


def wait_until(true, *, seconds=60.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "nothing happened for a minute"
        time.sleep(0.05)


@contextmanager
def cluster(folder, *, workers=2, options=(), environment=None):
    """A Dask scheduler and workers on loopback, as a user would start them; gives the address."""
    processes, file = [], Path(folder) / "scheduler.json"

    def launch(module, *arguments):
        line = [sys.executable, "-m", f"distributed.cli.{module}", *arguments]
        log = (Path(folder) / f"{module}-{len(processes)}.log").open("w")
        processes.append(
            subprocess.Popen(
                line,
                stdout=log,
                stderr=log,
                cwd=Path(__file__).parents[1],
                env={**os.environ, **(environment or {})},
            )
        )
        log.close()

    try:
        launch("dask_scheduler", *LOOPBACK, "--port", "0", "--scheduler-file", str(file))
        wait_until(lambda: file.exists() and file.read_text().endswith("}"))
        address = json.loads(file.read_text())["address"]
        for _ in range(workers):
            launch("dask_worker", address, *LOOPBACK, "--nthreads", "1", *options)
        yield address
    finally:
        for process in reversed(processes):
            process.kill()
        for process in processes:
            process.wait(timeout=60)


def without_rights(line):
    """A command that, unlike root, is kept to what files' permissions say."""
    if os.geteuid() != 0:
        return line
    if not shutil.which("setpriv"):
        pytest.skip("root may write anywhere")
    return ["setpriv", "--bounding-set", "-dac_override,-dac_read_search", *line]
