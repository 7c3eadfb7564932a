"""Give command lines by seed to `obsplan` in this one process, and print what became of each kind as JSON.

`python -m fuzz.command_line_trials FOLDER SEED COUNT` in the folder of the tests; without a count the past failures.
"""

import io
import json
import os
import shutil
import sys
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import Future
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

from fuzz.command_lines import command_lines
from fuzz.corpus import COMMAND_LINES, pond
from fuzz.trying import HangError, fault_of_form, limited

from obsplan.campaign import execute
from obsplan.campaign.worker import fly_batch
from obsplan.cli import main
from obsplan.simulation import ClosedLoop

MOST_STEPS = 2000  # times AUVs, of a mission that is flown
MOST_MISSIONS = 12  # of a command
SLOW = ("trajectory", "whole-mission", "rolling")  # planners that take seconds
FLY = ClosedLoop.fly
flown: list[int] = []  # seeds, by the present command


class TooLongError(BaseException):
    """A command that is right, and takes longer than this suite flies."""


class Here:
    """A campaign's crew that flies in this process."""

    def threads(self):
        return 1

    def send(self, batch):
        future = Future()
        future.set_result(fly_batch(batch))
        return future


def fly_if_short(loop, seed, **options):
    """Fly as `obsplan` does, unless it is much."""
    table = loop.scenario.table
    steps = loop.scenario.time.size * len(table.auv)
    flown.append(seed)
    if steps > MOST_STEPS or table.planner.kind in SLOW or len(flown) > MOST_MISSIONS:
        raise TooLongError
    return FLY(loop, seed, **options)


def attempt(folder: Path, words: list[str]) -> str:
    """What becomes of a command line: its exit code, or in words what is wrong."""
    before = contents(folder)
    flown.clear()
    sys.argv = ["obsplan", *words]
    said, complaint = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    with redirect_stdout(said), redirect_stderr(complaint):
        became = ended()
    complaint.flush()
    complained = complaint.buffer.getvalue().decode()
    if became == "exit 2" and (fault := fault_of_complaint(complained)):
        became = f"complained {fault}: {complained}"
    after = contents(folder)
    made = after.keys() - before.keys()
    halves = [path for path in made if path.suffix == ".part"]
    if halves or (made and became == "exit 2"):
        became = f"{became}, left {sorted(made)}"
    if any(after.get(path) != content for path, content in before.items()):
        became = f"{became}, changed what was there"
    remove(made)
    return became


def contents(folder: Path) -> dict[Path, bytes | None]:
    """Every file below a folder and what is in it."""
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def remove(made: Iterable[Path]) -> None:
    """Remove files, and folders with all in them."""
    for path in sorted(made):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def ended() -> str:
    """How the command line ends."""
    try:
        with limited():
            main()
    except SystemExit as end:
        return f"exit {end.code}"
    except TooLongError:
        return "too long to fly"
    except HangError:
        return "hung"
    except BaseException as error:
        return f"raised {error!r}"
    return "did not exit"


def fault_of_complaint(said: str) -> str | None:
    """What a complaint lacks: it is one line, and of the form of a refusal."""
    if not said.startswith("obsplan: ") or said.count("\n") != 1:
        return "in other than one line"
    return fault_of_form(said.rstrip("\n"))


def try_all(folder: Path, lines: Iterable[list[str]]) -> Counter[str]:
    """Count what becomes of command lines; what is wrong is counted with its line."""
    here = folder / "here"
    here.mkdir()
    circle = pond(planner='{kind = "circle"}', export="{replays = 0}")
    (here / "s.toml").write_text(circle)
    (here / "pond.csv").write_text("x,y\n0,0\n30,0\n30,10\n")
    os.chdir(here)
    ClosedLoop.fly = fly_if_short
    execute.crew_of = contextmanager(lambda **_: (yield Here()))
    outcomes: Counter[str] = Counter()
    for words in lines:
        became = attempt(folder, words)
        some_failed = became == "exit 3" and words[0] == "campaign"
        sound = some_failed or became in ("exit 0", "exit 2", "too long to fly")
        outcomes[became if sound else f"{became} of {words}"[:3000]] += 1
    return outcomes


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[2:]]
    trials = command_lines(*given) if given else COMMAND_LINES.values()
    counted = try_all(Path(sys.argv[1]), trials)
    print(json.dumps(counted))  # noqa: T201 - to the test
