"""Numbers and names as people say them."""

import re

from obsplan.constraints import LimitHistory
from obsplan.run import Run

NO_BOUND = (
    "No bound over all paths was asked for, or found: how much better any could be is not known."
)


def metres(value: float) -> str:
    """A length to three figures or so."""
    if value < 10:
        return f"{value:.2f} m"
    return f"{value:.1f} m" if value < 100 else f"{value:.0f} m"


def time_unit(longest: float) -> tuple[float, str]:
    """Unit in which times up to the longest [s] are readable: its length [s] and its symbol."""
    seconds, minutes = 600.0, 6 * 3600.0  # longest times that are told in them
    if longest <= seconds:
        return 1.0, "s"
    return (60.0, "min") if longest <= minutes else (3600.0, "h")


def clock(run: Run, seconds: float) -> str:
    """A time or duration, in the unit in which the mission is told."""
    length, symbol = time_unit(float(run.time[-1]))
    return f"{seconds / length:.{0 if symbol == 's' else 1}f} {symbol}"


def moment(run: Run, k: int) -> str:
    """When a sample was taken; the start lasts until the first range, or 2 % of the mission."""
    start = 0.02
    if k <= max(run.scenario.ping_every, start * run.time.size):
        return "at the start"
    return after(run, k)


def after(run: Run, k: int) -> str:
    """When a sample was taken."""
    return "at the start" if k == 0 else f"after {clock(run, run.time[k])}"


def percent(share: float) -> str:
    """A share in whole percent."""
    return f"{100 * share:.0f} %"


def title(name: str) -> str:
    """A scenario's name as a title: blanks for hyphens beside letters, and a capital."""
    blanks = re.sub(r"(?<=[^\W\d_])[-_]+(?=\w)|(?<=\w)[-_]+(?=[^\W\d_])", " ", name)
    return capital(blanks)


def sailed(run: Run) -> str:
    """Who steered the aid vehicle, or that the run is a recording."""
    return "replayed" if run.is_replay else f"planner {run.planner}"


def limit_name(limit: LimitHistory) -> str:
    """A limit, with its distance if it has one."""
    return limit.name if limit.distance is None else f"{limit.name} ({limit.distance:g} m)"


def capital(text: str) -> str:
    """A sentence's beginning; the name of a file or a key stays as it is."""
    first = text.split(" ", 1)[0].rstrip(".:")
    if "." in first or "_" in first:
        return text
    return text[:1].upper() + text[1:]


def marked(name: str, broke: bool) -> str:
    """A name, with a mark if its bearer broke a limit."""
    return f"{name} †" if broke else name
