"""What tests of campaigns share: a small scenario, the command as a process, a Dask cluster."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import obsplan
from obsplan.campaign import execute, fly_campaign, plan_cells
from obsplan.campaign.code import code_hash
from obsplan.campaign.layout import FIGURES
from obsplan.campaign.worker import Flown, Outcome

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
DIVERGES = "estimator.drift=0.0,1e200"  # the square of which no number holds
TABLES = ("campaign.csv", "campaign.parquet")
LOOPBACK = ["--host", "127.0.0.1", "--no-dashboard"]


def write_scenario(
    folder, *, duration=60.0, sigma=1.0, length=40.0, name="pond.toml", diverging=False
):
    """``diverging``: under `DIVERGES` some missions fail."""
    path = Path(folder) / name
    estimator = 'estimator = { kind = "tests.diverging:Diverging" }\n' if diverging else ""
    text = SCENARIO.format(duration=duration, sigma=sigma, length=length)
    path.write_text(text.replace("[[auv]]", f"{estimator}[[auv]]"))
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


RUNS = 60  # of each of two cells: some sixty pages


def figures_of(batch, seed):
    """Figures like a mission's, at once."""
    rng = np.random.default_rng([len(batch.content), seed])
    return dict(zip(FIGURES, rng.lognormal(size=len(FIGURES)).tolist(), strict=True))


class Instant:
    """A crew that flies at once, and counts."""

    def __init__(self):
        self.flown = 0

    def threads(self):
        return 1

    def send(self, batch):
        self.flown += len(batch.seeds)
        outcomes = []
        for seed in batch.seeds:
            figures = figures_of(batch, seed)
            auv = json.dumps({"alpha": figures})
            outcomes.append(Outcome(seed, None, figures, auv, '{"optimal":12}'))
        future = Future()
        future.set_result(Flown(outcomes, 1e-3, obsplan.__version__, code_hash()))
        return future


def instant_crew(monkeypatch):
    """Have all campaigns flown by one who flies at once."""
    crew = Instant()
    aboard = contextmanager(lambda **_: (yield crew))
    monkeypatch.setattr(execute, "crew_of", aboard)
    return crew


def complete_campaign(folder):
    """Fly a campaign into `out` in a folder; gives its cells."""
    cells = plan_cells([write_scenario(folder)], vary=["cna.speed=1.5,3.0"], runs=RUNS)
    fly_campaign(cells, Path(folder) / "out")
    return cells
