"""Jumps (`DO_JUMP`, `DO_JUMP_TAG`) written out: items in the order in which they are reached."""

from collections import Counter
from collections.abc import Sequence

from obsplan.missions.mavlink.commands import Command
from obsplan.missions.mavlink.items import Item
from obsplan.missions.mavlink.notes import Notes
from obsplan.types import ObsplanError

MOST_REPEATED = 10_000  # items that jumps may add
_LARGEST = 65535.0  # numbers, tags and repeat counts are 16 bits wide
_FOR_EVER = -1.0  # the repeat count of a jump without end


def unroll(items: Sequence[Item], notes: Notes) -> list[Item]:
    """Follow the jumps: each is taken as often as it says, and passed from then on.

    As in ArduPilot and PX4, counts are not reset when an outer jump leads to an inner one again.
    A jump that repeats for ever is taken once; where it comes up again, the items end, so that
    what is given is the beginning of what a vehicle would fly.

    Raises
    ------
    ObsplanError
        Jumps that add more than `MOST_REPEATED` items.
    """
    targets = _targets(items)
    taken: Counter[int] = Counter()
    visited: list[Item] = []
    i = steps = 0
    while i < len(items):
        item = items[i]
        if item.command in (Command.DO_JUMP, Command.DO_JUMP_TAG):
            target = targets.get((item.command, int(item.value(1, "target", 0.0, _LARGEST))))
            repeats = item.value(2, "repeat count", _FOR_EVER, _LARGEST)
            if repeats < 0 and taken[i]:
                notes.add("jumps that repeat for ever, flown once more and ended there", item)
                break
            if target is None:
                notes.add("jumps to an item that is not in the file, passed over", item)
            elif repeats < 0 or taken[i] < repeats:
                notes.add("jumps, their repeated items written out", item)
                taken[i] += 1
                i = target - 1
        else:
            visited.append(item)
        i += 1
        steps += 1
        if steps > len(items) + MOST_REPEATED:
            raise ObsplanError(
                f"{item.where}: jumps add more than {MOST_REPEATED} items to the mission: "
                "lower their repeat counts (parameter 2)"
            )
    return visited


def _targets(items: Sequence[Item]) -> dict[tuple[int, int], int]:
    """Index of the first item under each number and each tag, by the command that jumps to it."""
    targets: dict[tuple[int, int], int] = {}
    for i, item in enumerate(items):
        if item.number is not None:
            targets.setdefault((Command.DO_JUMP, item.number), i)
        if item.command == Command.JUMP_TAG:
            tag = int(item.value(1, "tag", 0.0, _LARGEST))
            targets.setdefault((Command.DO_JUMP_TAG, tag), i)
    return targets
