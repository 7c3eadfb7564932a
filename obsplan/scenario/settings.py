"""Other values for some keys of a scenario's contents."""

import re
import tomllib
from collections.abc import Iterable
from typing import Any

from obsplan.planners import PLANNERS
from obsplan.plugins import is_own
from obsplan.scenario.contents import DEEPEST, parse_toml
from obsplan.scenario.messages import OWN
from obsplan.scenario.tables import CHOICES
from obsplan.spelling import nearest
from obsplan.types import ObsplanError

NESTED = "__"  # in the name of an argument, for the dot of a key


def with_planner(data: dict[str, Any], planner: str | None) -> dict[str, Any]:
    """The contents with another planner, at the same interval, knowledge and doubt."""
    if planner is None:
        return data
    if not is_own(planner) and planner not in (*PLANNERS, "default"):
        remedy = nearest(planner, [*PLANNERS, "default"])
        raise ObsplanError(f'no planner "{planner}"; {remedy}{OWN}')
    table = data.get("planner", {})
    kept = {key: table[key] for key in ("interval", "knowledge", "doubt") if key in table}
    same = table if table.get("kind") == planner else {}
    return {**data, "planner": {**same, **kept, "kind": planner}}


def with_setting(data: dict[str, Any], setting: str) -> dict[str, Any]:
    """The contents with one ``table.key=value`` set."""
    key, equals, text = setting.partition("=")
    if not equals or not key.strip():
        raise ObsplanError(
            f'--set "{setting}" has no value; write table.key=value, for example cna.speed=1.5'
        )
    try:
        value = parse_toml(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text  # a bare word is a string
    except ValueError as error:
        said = str(error).removeprefix("line 1: value = ")
        raise ObsplanError(f"--set {key.strip()}: {said}") from None
    path = key.strip().split(".")
    if len(path) > DEEPEST:
        raise ObsplanError(
            f'--set "{setting[:40]}...": {len(path)} keys within each other, and a scenario has '
            f"at most {DEEPEST}: see `obsplan schema`"
        )
    return replaced(data, path, value, f'--set "{setting}"')


def replaced(data: Any, path: list[str], value: Any, setting: str) -> Any:
    """A copy of nested tables and lists with one place replaced; ``setting`` is the user's text."""
    if not path:
        return beside(data, value)
    head, rest = path[0], path[1:]
    if isinstance(data, list | tuple):
        if not head.isdecimal() or not head.isascii() or len(head) > 9 or int(head) >= len(data):
            raise ObsplanError(
                f"{setting}: {head} is not one of the {len(data)} entries, which count from 0"
            )
        return [
            replaced(item, rest, value, setting) if i == int(head) else item
            for i, item in enumerate(data)
        ]
    if not isinstance(data, dict):
        raise ObsplanError(
            f"{setting}: {head} is not a key, because the entry above it is a value; see `obsplan "
            "schema`"
        )
    return {**data, head: replaced(data.get(head, {}), rest, value, setting)}


def beside(table: Any, value: Any) -> Any:
    """What takes a table's place.

    An object keeps those keys of it that every class has, such as the time between ranges.
    """
    choice = next((choice for choice in CHOICES if choice.fits(value)), None)
    if choice is None or not isinstance(table, dict):
        return value
    kept = {key: table[key] for key in choice.base.model_fields if key in table}
    return {**kept, "kind": value}


def as_given(message: str, keys: Iterable[str]) -> str:
    """A message with the keys spelt as the caller gave them: ``cna__speed`` for ``cna.speed``."""
    for key in sorted(keys, key=len, reverse=True):
        dotted = re.escape(key.replace(NESTED, "."))
        message = re.sub(rf"(?<![\w.]){dotted}(?!\w)", key, message)
    return message
