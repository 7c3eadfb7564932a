"""The keys of a scenario file, for people and for editors."""

import re
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from obsplan.scenario.messages import as_toml, kind_of, tables_in
from obsplan.scenario.tables import ScenarioTable

Row = tuple[str, str, str, str]  # key, type, default, description


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
        for own, _, _, description in rows
        if (table.partition(",")[0], own) == (path, name)
    ]
    return " or ".join(dict.fromkeys(said))


def _sections(table: type[BaseModel], path: str) -> Iterator[tuple[str, list[Row]]]:
    inner = {name: tables_in(field.annotation) for name, field in table.model_fields.items()}
    yield path, [_row(name, field) for name, field in table.model_fields.items() if not inner[name]]
    for name, tables in inner.items():
        many = get_origin(table.model_fields[name].annotation) is tuple
        below = f"{path}.{name}".lstrip(".") + ("[]" if many else "")
        for one in tables:
            yield from _sections(
                one, f'{below}, kind = "{kind_of(one)}"' if len(tables) > 1 else below
            )


def _row(name: str, field: Any) -> Row:
    default = field.default
    text = (
        "required"
        if default is PydanticUndefined
        else ""
        if default in (None, "")
        else as_toml(default)
    )
    return name, _type(field.annotation), text, field.description or ""


def _type(annotation: Any) -> str:
    """A type as a user would say it."""
    if get_origin(annotation) is Literal:
        return " | ".join(f'"{choice}"' for choice in get_args(annotation))
    parts = [part for part in get_args(annotation) if part is not type(None)]
    if get_origin(annotation) is tuple:
        return (
            f"list of {_type(parts[0])}"
            if parts[-1] is Ellipsis
            else f"[{', '.join(_type(part) for part in parts)}]"
        )
    if parts and not isinstance(parts[0], type) and get_origin(parts[0]) is None:
        return _type(annotation.__origin__)
    if parts:
        return _type(parts[0])
    return {float: "number", int: "integer", str: "text", bool: "true | false"}.get(
        annotation, str(annotation)
    )
