"""One clear sentence from what pydantic found wrong."""

from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from obsplan.plugins import is_own
from obsplan.quantities import Quantity, quantity_of
from obsplan.scenario.choice import Choice
from obsplan.scenario.places import DEGREES, METRES, Degrees, InDegrees
from obsplan.scenario.tables import (
    AREA,
    CORNERS,
    DEPTHS,
    ONE,
    ONE_DEPTH,
    SEVERAL,
    AreaTable,
    Cna,
    ScenarioTable,
)
from obsplan.spelling import nearest
from obsplan.types import ObsplanError

REASONS = {  # where pydantic's words are Python's and not the file's
    "model_type": "must be a table with keys of its own: see `obsplan schema`",
    "model_attributes_type": "must be a table with keys of its own: see `obsplan schema`",
    "tuple_type": "must be a list: put it in [ ... ]",
    "too_short": "has too few entries: add one",
    "too_long": "has too many entries: remove some",
    "string_type": "must be text: put it in quotes",
    "string_pattern_mismatch": (
        "must begin with a letter or digit and have no other characters: rename it"
    ),
    "string_too_long": "is too long: shorten it",
}

OWN = ' (a class of your own is "mypackage.module:Class")'
NUMBERS = {  # what a key must be, before the range of its numbers
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "finite_number": "must be a finite number",
}
LONGEST_VALUE = 80  # letters of a value that is shown

FORMS: dict[int | str, type[BaseModel] | None] = {
    METRES: None,
    DEGREES: Degrees,
    CORNERS: None,
    AREA: AreaTable,
    ONE: Cna,
    SEVERAL: None,
    ONE_DEPTH: None,
    DEPTHS: None,
}


def as_toml(value: object) -> str:
    """A value as the user wrote it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {as_toml(v)}' for key, v in value.items())}}}"
    if isinstance(value, tuple):
        return f"[{', '.join(as_toml(v) for v in value)}]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def as_error(
    source: str,
    error: ValidationError,
    told: str | None = None,
    root: type[BaseModel] = ScenarioTable,
) -> ObsplanError:
    """The first fault found, as an error that names file, key, value and remedy.

    ``told`` is the key of a table that stands for another's ``ranging``, ``root`` the table that
    the file is.
    """
    faults = error.errors()
    # a misspelt key explains the key that is missing
    fault = next((f for f in faults if f["type"] == "extra_forbidden"), faults[0])
    if told is None:
        table, path, field = locate(fault["loc"], root)
    else:
        table, path, field = locate(("ranging", *fault["loc"]), root)
        path[0] = told
    key = shortened(".".join(path))
    if fault["type"] == "extra_forbidden":
        return ObsplanError(f"{source}: unknown key {key}; {nearest(path[-1], known_keys(table))}")
    about = f" ({field.description})" if field is not None and field.description else ""
    if fault["type"] == "missing":
        return ObsplanError(f"{source}: {key} is missing{about}; add it")
    if fault["type"] == "union_tag_not_found":
        return ObsplanError(
            f"{source}: {key}.kind is missing; give one of {', '.join(kinds(field))}"
        )
    if fault["type"] == "union_tag_invalid":
        tag = shortened(str((fault.get("ctx") or {}).get("tag")))
        return ObsplanError(
            f'{source}: {key}.kind = "{tag}" is not known; {nearest(tag, kinds(field))}{OWN}'
        )
    written = as_toml(fault["input"])
    tabular = isinstance(fault["input"], dict) and bool(field and tables_in(field.annotation))
    value = "" if tabular else f" = {shortened(written)}"
    return ObsplanError(f"{source}: {key}{value}{about}: {reason_of(fault, field)}")


def reason_of(fault: Any, field: Any) -> str:
    """What is wrong with a value, and what to do."""
    said, kind = fault["msg"], fault["type"]
    if kind == "value_error":  # of a check of ours, which says what to do
        return said.removeprefix("Value error, ")
    if kind in REASONS:
        return REASONS[kind]
    must = NUMBERS.get(kind, said.replace("Input should be", "must be"))
    quantity = quantity_of_field(field) if kind in NUMBERS else None
    within = "" if quantity is None else f" {quantity}"
    return f"{must}{within}: correct it"


def shortened(text: str) -> str:
    """The beginning of a long text."""
    return f"{text[:LONGEST_VALUE]}..." if len(text) > LONGEST_VALUE else text


def locate(
    loc: tuple[int | str, ...], root: type[BaseModel]
) -> tuple[type[BaseModel] | None, list[str], Any]:
    """The table that holds a fault, its key as the user wrote it, and the field's description."""
    table: type[BaseModel] | None = root
    path: list[str] = []
    holder, field, tags = table, None, {}
    for part in loc:
        if part in FORMS or part in tags:  # pydantic's name for one of several; no key of the file
            table, tags = (FORMS | tags)[part] or table, {}
            continue
        if is_own(part) and (own := own_table(field, str(part))):
            table, tags = own, {}
            continue
        path.append(str(part))
        if isinstance(part, int):
            continue
        holder = table
        field = table.model_fields.get(part) if table is not None else None
        tables = tables_in(field.annotation) if field is not None else []
        table = tables[0] if len(tables) == 1 else None
        tags = {kind_of(t): t for t in tables} if len(tables) > 1 else {}
    return holder, path or ["the file"], field


def quantity_of_field(field: Any) -> Quantity | None:
    """The range of a key's numbers, if it has one."""
    if field is None:
        return None
    marks = (mark for mark in field.metadata if isinstance(mark, Quantity))
    return next(marks, None) or quantity_of(field.annotation)


def own_table(field: Any, kind: str) -> type[BaseModel] | None:
    """The table of a user's class; None where the part is no class but a key that has a colon."""
    choice = choice_of(field)
    try:
        return None if choice is None else choice.table(kind)
    except ValueError:
        return None


def choice_of(field: Any) -> Choice | None:
    """What chooses the class of a key; None where nothing does."""
    chosen = [] if field is None else field.metadata
    return next((mark for mark in chosen if isinstance(mark, Choice)), None)


def tables_in(annotation: Any) -> list[type[BaseModel]]:
    """The tables among the alternatives of a type; a corner in degrees is a value, not a table."""
    if annotation == InDegrees:
        return []
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    found = [table for part in get_args(annotation) for table in tables_in(part)]
    return [*dict.fromkeys(found)]


def kind_of(table: type[BaseModel]) -> str:
    """The word by which a union knows a table."""
    return get_args(table.model_fields["kind"].annotation)[0]


def kinds(field: Any) -> list[str]:
    """The kinds a discriminated key may have."""
    return [kind_of(t) for t in tables_in(field.annotation)] if field is not None else []


def known_keys(table: type[BaseModel] | None) -> list[str]:
    """The keys of a table."""
    return list(table.model_fields) if table is not None else []
