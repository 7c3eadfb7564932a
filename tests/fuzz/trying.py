"""What all kinds of the suite share: how many are tried, how long each may take, and what a refusal must say.

A bounded share runs with the other tests. By hand any number is tried of each kind, or of those that `-k` names:
`OBSPLAN_FUZZ=10000 OBSPLAN_FUZZ_SEED=2 python -m pytest tests/fuzz -s`.
"""

import os
import re
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from obsplan import ObsplanError

SEED = int(os.environ.get("OBSPLAN_FUZZ_SEED", "1"))
PATIENCE = 20  # seconds of a processor that any one input may take
STALLED = 600  # seconds of a clock after which what waits for nothing is given up

IMPERATIVES = (
    "add|change|check|chmod|choose|complete|convert|correct|delete|draw|exchange|export|fly|give|"
    "head|keep|leave|load|look|lower|make|move|name|put|quote|raise|remove|rename|save|see|send|shorten|split|"
    "take|use|widen|write"
)
REMEDY = re.compile(
    rf"(?:[:;,(]|\bor|\band|\bthen) (?:{IMPERATIVES})\b|did you mean|known are |`obsplan "
)


def share(usual: int) -> int:
    """How many of a kind to try: the usual number, or what `OBSPLAN_FUZZ` says."""
    return int(os.environ.get("OBSPLAN_FUZZ", usual))


class HangError(BaseException):  # no fault of a planner, which would be taken for a status
    """Something takes longer than anybody waits."""


@contextmanager
def limited() -> Iterator[None]:
    """End with HangError what takes more of a processor than `PATIENCE`, or stalls."""

    def give_up(*_: object) -> None:
        raise HangError

    before = {number: signal.signal(number, give_up) for number in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    signal.setitimer(signal.ITIMER_REAL, STALLED)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


def outcome(attempt: Callable[[], object], judge: Callable[[str], str | None]) -> str:
    """What became of an attempt: its own word or "taken", refused in due form, or what is wrong."""
    try:
        with limited():
            became = attempt()
    except ObsplanError as error:
        fault = judge(str(error))
        return "refused" if fault is None else f"refused {fault}: {error}"
    except HangError:
        return "hung"
    except Exception as error:
        return f"raised {error!r}"
    return became if isinstance(became, str) else "taken"


def fault_of_form(said: str) -> str | None:
    """What a refusal lacks, wherever it comes from: it is one line and says what to do."""
    if "\n" in said or "\r" in said:
        return "in several lines"
    if "Traceback" in said or "Error:" in said:
        return "in a programmer's words"
    if not REMEDY.search(said):
        return "without a remedy"
    return None


def told(kind: str, outcomes: Counter[str], known: set[str]) -> list[str]:
    """Print how many had which outcome; the outcomes that nothing may have."""
    counts = ", ".join(f"{number} {name}" for name, number in sorted(outcomes.items()))
    print(f"\n{kind}: {counts}")  # noqa: T201 - asked for
    return sorted(outcomes.keys() - known)
