"""Scenario files in and out; the only reader of user configuration."""

import re
import reprlib
import tomllib
from collections.abc import Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from obsplan.planners import PLANNERS
from obsplan.plugins import is_own
from obsplan.scenario.base import tuples
from obsplan.scenario.messages import OWN, as_error
from obsplan.scenario.scenario import Scenario
from obsplan.scenario.tables import CHOICES, Origin, ScenarioTable
from obsplan.spelling import nearest
from obsplan.types import ObsplanError

SHIPPED = Path(str(files("obsplan") / "scenarios"))
NESTED = "__"  # in the name of an argument, for the dot of a key


def shipped() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def suite() -> list[str]:
    """Names of the scenarios on which planners are compared."""
    return sorted(f"suite/{path.stem}" for path in (SHIPPED / "suite").glob("*.toml"))


def load(name: str | Path, *, planner: str | None = None, settings: Sequence[str] = ()) -> Scenario:
    """Read a shipped scenario by name, or a scenario file, and check all of it.

    Parameters
    ----------
    name
        Name of a shipped scenario, or path of a TOML file. A name that is shipped always means the
        shipped scenario: a file of that name is ``"./NAME"``, a folder of that name is never looked
        at.
    planner
        Replaces the kind of planner and its own options. The time between decisions and the
        planner's knowledge stay.
    settings
        ``table.key=value`` each, applied after ``planner``; tables in a list by number:
        ``auv.0.speed=0.5``.

    Raises
    ------
    ObsplanError
        What the user gave is wrong; one sentence with the place, the value and the remedy.
    """
    path = find(name)
    source = path.name
    data = with_planner(read(path), planner)
    for setting in settings:
        data = with_setting(data, setting)
    return from_dict(data, source=source, folder=path.parent)


def from_dict(data: dict[str, Any], *, source: str = "scenario", folder: Path = Path()) -> Scenario:
    """Check the contents of a scenario file; relative paths in it start at ``folder``.

    Arrays may stand for lists.

    Raises
    ------
    ObsplanError
        As `load`.
    """
    try:
        contents = tuples(data)
        table = ScenarioTable.model_validate(contents, context={"origin": origin_of(contents)})
    except ValidationError as error:
        raise as_error(source, error) from None
    scenario = Scenario(table=table, source=source, folder=folder)
    scenario.check()
    return scenario


def origin_of(data: dict[str, Any]) -> tuple[float, float] | None:
    """Latitude and longitude of a scenario's origin [deg]; None where it is missing or wrong."""
    try:
        origin = Origin.model_validate(data.get("origin"))
    except ValidationError:  # said when all of the contents are checked
        return None
    return origin.lat, origin.lon


def changed(scenario: Scenario, changes: dict[str, Any]) -> Scenario:
    """The scenario with other values for some keys; see `Scenario.replace`."""
    data = scenario.table.model_dump(exclude_unset=True, exclude_none=True)
    keys = dict(changes)
    if isinstance(keys.get("planner"), str):
        data = with_planner(data, keys.pop("planner"))
    for key, value in keys.items():
        setting = f"{key} = {reprlib.repr(value)}"
        data = replaced(data, key.split(NESTED), value, setting)
    try:
        return from_dict(data, source=scenario.source, folder=scenario.folder)
    except ObsplanError as error:
        raise ObsplanError(as_given(str(error), keys)) from None


def as_given(message: str, keys: Iterable[str]) -> str:
    """A message with the keys spelt as the caller gave them: ``cna__speed`` for ``cna.speed``."""
    for key in sorted(keys, key=len, reverse=True):
        dotted = re.escape(key.replace(NESTED, "."))
        message = re.sub(rf"(?<![\w.]){dotted}(?!\w)", key, message)
    return message


def find(name: str | Path) -> Path:
    """Path of a scenario file by its shipped name, or by its path.

    A shipped name means nothing else, whatever lies in the working directory.
    """
    if str(name) in shipped() + suite():
        return SHIPPED / f"{name}.toml"
    path = Path(name)
    if path.suffix != ".toml" and not path.exists():
        raise ObsplanError(
            f'no scenario "{name}" is shipped and no such file exists; {meant(path)}'
        )
    return path


def meant(path: Path) -> str:
    """The remedy for a path that is no scenario file: the file beside or inside it, if any."""
    candidates = (Path(f"{path}.toml"), path / "scenario.toml")
    there = [str(file) for file in candidates if file.is_file()]
    return f'did you mean "{there[0]}"?' if there else nearest(str(path), shipped())


def read(path: Path) -> dict[str, Any]:
    """Parse a TOML file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise ObsplanError(
            f"{path}: no such file; `obsplan scenarios` lists those that are shipped"
        ) from None
    except IsADirectoryError:
        raise ObsplanError(f"{path}: is a folder and no scenario file; {meant(path)}") from None
    except OSError as error:
        raise ObsplanError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ObsplanError(
            f"{path}: is not text in UTF-8 (byte {error.start}); give a scenario file in TOML"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise ObsplanError(
            f"{path}: is not valid TOML: {error}; for a mission file use `obsplan new {path.name}`"
        ) from None


def with_planner(data: dict[str, Any], planner: str | None) -> dict[str, Any]:
    """The contents with another planner, at the same interval and knowledge."""
    if planner is None:
        return data
    if not is_own(planner) and planner not in (*PLANNERS, "default"):
        remedy = nearest(planner, [*PLANNERS, "default"])
        raise ObsplanError(f'no planner "{planner}"; {remedy}{OWN}')
    table = data.get("planner", {})
    kept = {key: table[key] for key in ("interval", "knowledge") if key in table}
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
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text  # a bare word is a string
    return replaced(data, key.strip().split("."), value, f'--set "{setting}"')


def replaced(data: Any, path: list[str], value: Any, setting: str) -> Any:
    """A copy of nested tables and lists with one place replaced; ``setting`` is the user's text."""
    if not path:
        return beside(data, value)
    head, rest = path[0], path[1:]
    if isinstance(data, list | tuple):
        if not head.isdigit() or int(head) >= len(data):
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
