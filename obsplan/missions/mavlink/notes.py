"""Remarks that would be said of many items, said once."""

from collections import Counter

from obsplan.missions.mavlink.commands import Command
from obsplan.missions.mavlink.items import Item

_PLACES = 3  # items named one by one; more are counted
_KINDS = 12  # commands named one by one


class Notes:
    """What was passed over or changed, and at which items: one remark for each reason."""

    def __init__(self) -> None:
        self._places: dict[str, dict[str, None]] = {}  # by reason; a dict keeps the order of a set

    def add(self, reason: str, item: Item) -> None:
        """Note an item once, however often it is flown."""
        self._places.setdefault(reason, {})[item.place] = None

    def remarks(self) -> tuple[str, ...]:
        """One sentence for each reason, in the order in which they came up."""
        return tuple(f"{reason}: {_listed(list(p))}" for reason, p in self._places.items())


def _listed(places: list[str]) -> str:
    """The first few places, and how many more there are."""
    named = ", ".join(places[:_PLACES])
    more = len(places) - _PLACES
    return f"{named} and {more} more" if more > 0 else named


def counted(names: Counter[str]) -> str:
    """How often each name occurs, the most frequent first."""
    common = names.most_common(_KINDS)
    text = ", ".join(f"{count} {name}" for name, count in common)
    more = len(names) - len(common)
    return f"{text} and {more} other kinds" if more > 0 else text


def command_name(command: int) -> str:
    """Name and number of a command."""
    try:
        return f"{Command(command).name} ({command})"
    except ValueError:
        return f"command {command}"
