"""The keys of a scenario file, for people and for editors."""

import re
from collections.abc import Iterator
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from obsplan.scenario.messages import as_toml, kind_of, quantity_of_field, tables_in
from obsplan.scenario.places import DEGREES, InDegrees, Place
from obsplan.scenario.tables import ScenarioTable

Row = tuple[str, str, str, str, str]  # key, type, default, description, range and its reason


def json_schema() -> dict[str, Any]:
    """JSON Schema of a scenario file, for editors that complete and check."""
    return ScenarioTable.model_json_schema()


def sections() -> Iterator[tuple[str, list[Row]]]:
    """Every table a scenario may have, by its path, with a row for each key."""
    yield from _sections(ScenarioTable, "")


def described(key: str) -> str:
    """What a key such as ``auv.0.speed`` means, with its unit; empty if no table has it."""
    path, _, name = re.sub(r"\.\d+(?=\.|$)", "[]", key).rpartition(".")
    said = [
        description.partition(";")[0]
        for table, rows in sections()
        for own, _, _, description, _ in rows
        if (table.partition(",")[0], own) == (path, name)
    ]
    return " or ".join(dict.fromkeys(said))


def _sections(table: type[BaseModel], path: str) -> Iterator[tuple[str, list[Row]]]:
    fields = list(table.model_fields.items())
    if issubclass(table, Place):  # a reader meets x and y before what may stand for them
        fields.sort(key=lambda item: item[0] in Place.model_fields)
    yield path, [_row(name, field) for name, field in fields if values_in(field.annotation)]
    for name, field in fields:
        tables = tables_in(field.annotation)
        many = get_origin(field.annotation) is tuple
        below = f"{path}.{name}".lstrip(".") + ("[]" if many else "")
        for one in tables:
            yield from _sections(
                one, f'{below}, kind = "{kind_of(one)}"' if len(tables) > 1 else below
            )


def values_in(annotation: Any) -> list[Any]:
    """The alternatives of a type that are values in a line, and no tables of their own."""
    parts = get_args(annotation)
    if get_origin(annotation) is Annotated and annotation != InDegrees:
        return values_in(parts[0])
    if get_origin(annotation) in (Union, UnionType):
        return [value for part in parts for value in values_in(part)]
    return [] if annotation is NoneType or tables_in(annotation) else [annotation]


def _row(name: str, field: Any) -> Row:
    default = field.default
    text = (
        "required"
        if default is PydanticUndefined
        else ""
        if default in (None, "")
        else as_toml(default)
    )
    allowed = quantity_of_field(field)
    range_said = "" if allowed is None else str(allowed)
    return name, _type(field.annotation), text, field.description or "", range_said


def _type(annotation: Any) -> str:
    """A type as a user would say it."""
    names = [_name(value) for value in values_in(annotation)]
    if tables_in(annotation):
        names.append("a table")
    return " or ".join(names)


def _name(value: Any) -> str:
    parts = get_args(value)
    if value == InDegrees:
        return DEGREES
    if get_origin(value) is Literal:
        return " | ".join(f'"{choice}"' for choice in parts)
    if get_origin(value) is tuple:
        many = parts[-1] is Ellipsis
        return f"list of {_type(parts[0])}" if many else f"[{', '.join(map(_type, parts))}]"
    return {float: "number", int: "integer", str: "text", bool: "true | false"}.get(
        value, str(value)
    )
