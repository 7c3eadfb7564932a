"""Tables whose ``kind`` chooses a class, ours or a user's: the class's fields are their keys."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import lru_cache
from typing import Annotated, Any, Literal, Union, get_origin, get_type_hints

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, ValidationError, create_model
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from obsplan.plugins import checked_class, is_own, kind_of_object
from obsplan.quantities import BEARING, WHOLE, quantity_of
from obsplan.scenario.base import Table, tuples
from obsplan.scenario.places import Corners, Place, Position
from obsplan.types import Point, Points

# what a file holds where a constructor takes east and north: places, in metres or degrees
IN_FILES: dict[Any, Any] = {
    Point: Position,
    Point | None: Position | None,  # pyright: ignore[reportOperatorIssue]
    Points: Corners,
}


def table_of(
    cls: type,
    name: str,
    *,
    kind: str,
    omit: tuple[str, ...] = (),
    base: type[Table] = Table,
) -> type[Table]:
    """Table with a key for every field of a dataclass but those in ``omit``.

    A field ``heading`` becomes the key ``heading_deg``, x and y make a `Place`. A field's
    description is the string in its ``Annotated`` type.
    """
    about = base.model_fields["kind"].description if "kind" in base.model_fields else "which one"
    keys: dict[str, Any] = {"kind": (Literal[kind], Field(default=kind, description=about))}
    hints = get_type_hints(cls, include_extras=True)
    for f in fields(cls):
        if f.name in omit or not f.init:
            continue
        hint, default = hints[f.name], _default(f)
        description = hint.__metadata__[0] if hasattr(hint, "__metadata__") else ""
        hint = IN_FILES.get(getattr(hint, "__origin__", hint), hint)
        key, description = (
            (f"{f.name}_deg", description.replace("[rad]", "[deg]"))
            if f.name == "heading"
            else (f.name, description)
        )
        if quantity_of(hint) is None:  # of a heading, whose quantity is in radians; of a user's own
            whole = getattr(hint, "__origin__", hint) in (int, int | None)
            bound = BEARING if f.name == "heading" else WHOLE if whole else None
            hint = hint if bound is None else Annotated[hint, bound]
        keys[key] = (hint, Field(default, description=description))
    bases = (Place, base) if {"x", "y"} <= keys.keys() else base
    return create_model(name, __base__=bases, __module__=__name__, **keys)


def _default(f: Any) -> Any:
    """Default of a dataclass's field; ... where it has none."""
    if f.default_factory is not MISSING:
        return f.default_factory()
    return ... if f.default is MISSING else f.default


def options(cls: type, table: Any) -> dict[str, Any]:
    """Constructor arguments of a dataclass from its table; ``heading_deg`` gives ``heading``."""
    values = {}
    for f in fields(cls):
        if f.name == "heading":
            values["heading"] = float(np.deg2rad(table.heading_deg))
        elif hasattr(table, f.name):
            values[f.name] = getattr(table, f.name)
    return values


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """One key of a scenario whose ``kind`` chooses a class; stands in its ``Annotated`` type."""

    what: str  # in messages and in the names of tables
    known: Mapping[str, type[Any]]  # the folder's table
    needs: tuple[str, ...]  # of a user's class
    base: type[Table] = Table  # keys that every kind has
    told: tuple[str, ...] = ()  # fields that the scenario fills: no keys
    default: str | None = None  # the kind of a table without one
    besides: tuple[type[Table], ...] = field(default=())  # kinds that are no class

    def annotation(self) -> Any:
        """The key's type."""
        tables = (*map(self.table, self.known), *self.besides)
        return Annotated[Union[tables], self]  # noqa: UP007 - made at run time

    def table(self, kind: str) -> type[Table]:
        """Table of a kind.

        Raises
        ------
        ValueError
            A user's class that cannot be used, and why.
        """
        if not is_own(kind):
            return self._table(self.known[kind], kind)
        cls = checked_class(kind, self.needs)
        clash = [f.name for f in fields(cls) if f.name in self.base.model_fields]
        if clash:
            raise ValueError(
                f"has a field {clash[0]}, which is a key of every {self.what}; rename it"
            )
        try:
            hints = get_type_hints(cls)
            table = self._table(cls, kind)
        except (NameError, TypeError, RuntimeError) as error:  # a type that no file can hold
            said = str(error).splitlines()[0]
            raise ValueError(
                f"has a field that no file can hold: {said}; use numbers, text and tuples of them"
            ) from error
        lists = [name for name, hint in hints.items() if list in (hint, get_origin(hint))]
        if lists:
            raise ValueError(
                f"has a list as field {lists[0]}; write tuple[float, ...] or the like, which "
                "cannot change"
            )
        return table

    @lru_cache(maxsize=64)  # noqa: B019 - choices are made once, with the module
    def _table(self, cls: type, kind: str) -> type[Table]:
        return table_of(cls, cls.__name__, kind=kind, omit=self.told, base=self.base)

    def fits(self, value: object) -> bool:
        """Whether an object, given instead of a table or a kind, is of this choice's classes."""
        return all(hasattr(value, need) for need in self.needs)

    def default_table(self) -> Any:
        """The table where a scenario has none."""
        return self.table(str(self.default))()

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        several = len(self.known) + len(self.besides) > 1
        known = handler(Annotated[source, Field(discriminator="kind")] if several else source)
        return core_schema.with_info_wrap_validator_function(
            self._validate, known, serialization=core_schema.simple_ser_schema("any")
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        kind = {"type": "string", "pattern": "^[^:]+:[^:]+$", "description": "a class of your own"}
        own = {"type": "object", "properties": {"kind": kind}, "required": ["kind"]}
        return {"anyOf": [handler(schema), own]}

    def _validate(self, value: Any, handler: Any, info: Any) -> Any:
        if value is None or self.fits(value):
            value = {} if value is None else {"kind": value}
        if not isinstance(value, dict):
            return handler(value)
        if self.default is not None:
            value = {"kind": self.default, **value}
        if self.fits(value.get("kind")):
            value = value | self._as_table(value["kind"])
        kind = value.get("kind")
        return self._own(kind, value, info) if is_own(kind) else handler(value)

    def _own(self, kind: Any, value: dict[str, Any], info: Any) -> Table:
        """A table of a user's class; faults are located under its kind, as with ours."""
        try:
            table = self.table(kind)
        except ValueError as error:
            wrong = PydanticCustomError("plugin", "{said}", {"said": str(error)})
            fault = InitErrorDetails(type=wrong, loc=("kind",), input=kind)
            raise ValidationError.from_exception_data(self.what, [fault]) from error
        try:
            return table.model_validate(value, context=info.context)
        except ValidationError as error:
            faults = [
                InitErrorDetails(
                    type=fault["type"],
                    loc=(kind, *fault["loc"]),
                    input=fault["input"],
                    ctx=fault.get("ctx", {}),
                )
                for fault in error.errors()
            ]
            raise ValidationError.from_exception_data(self.what, faults) from None

    def _as_table(self, given: Any) -> dict[str, Any]:
        """The table of an object: its class and its fields, so that a file can hold it."""
        kind = kind_of_object(given, self.known)
        cls = type(given) if kind in self.known else checked_class(kind, self.needs)
        table: dict[str, Any] = {"kind": kind}
        for f in fields(cls):
            if f.init and f.name not in self.told:
                table[f.name] = tuples(getattr(given, f.name))
        if "heading" in table:
            table["heading_deg"] = float(np.rad2deg(table.pop("heading")))
        return {key: value for key, value in table.items() if value is not None}
