"""What docstrings leave to the code: the fields of dataclasses, with their units and limits.

Fields say what they are in their types, ``Annotated[float, "length [m]", LENGTH]``, or in a comment
beside them. Both become the parameters of the class.
"""

import dataclasses
import inspect
import re
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from sphinx.application import Sphinx
from sphinx.util.typing import stringify_annotation

from obsplan.quantities import quantity_of

BEFORE_NAPOLEON = 400


def add_fields(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    """Add the fields of a dataclass to its docstring as parameters."""
    if what != "class" or not dataclasses.is_dataclass(thing):
        return
    hints = get_type_hints(thing, include_extras=True)
    fields = [field for field in dataclasses.fields(thing) if field.init]
    if not fields or "Parameters" in lines:
        return
    section = ["Parameters", "----------"]
    for field in fields:
        said = [*texts(hints[field.name]), comment(thing, field.name)]
        allowed = quantity_of(hints[field.name])
        type_said = stringify_annotation(bare(hints[field.name]), "smart").replace("*", r"\*")
        section.append(f"{field.name} : {type_said}")
        section.append("    " + "; ".join(filter(None, [*said, allowed and f"{allowed}"])))
    at = next((i for i, line in enumerate(lines[1:]) if is_rule(line)), len(lines))
    lines[at:at] = [*section, ""]


def keep_bars(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    """Leave ``|r|`` what it is in mathematics: to docutils it is a text to be filled in."""
    in_math = False
    for i, line in enumerate(lines):
        in_math = line.startswith(".. math::") or (in_math and line[:1] in ("", " "))
        if not in_math:
            parts = re.split(r"(:math:`[^`]*`|``[^`]*``)", line)
            lines[i] = "".join(p if p[:1] in (":", "`") else p.replace("|", r"\|") for p in parts)


def is_rule(line: str) -> bool:
    """Whether a line is the one below the title of a section."""
    return re.fullmatch(r"-{3,}", line) is not None


def texts(hint: Any) -> list[str]:
    """What a type says in words."""
    if get_origin(hint) is not Annotated:
        return []
    return [part for part in get_args(hint)[1:] if isinstance(part, str)]


def bare(hint: Any) -> Any:
    """A type without what is said of it."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def comment(thing: type, field: str) -> str:
    """The comment beside or above a field."""
    for owner in thing.__mro__:
        if field not in vars(owner).get("__annotations__", {}):
            continue
        lines = inspect.getsource(owner).splitlines()
        at = next(i for i, line in enumerate(lines) if re.match(rf"    {field}\s*:", line))
        beside = re.search(r"\s# (.*)$", lines[at])
        above = re.match(r"    # (.*)$", lines[at - 1])
        found = beside or above
        return "" if found is None or "noqa" in found[1] else found[1].replace("*", r"\*")
    return ""


def plain_signature(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str, returns: str
) -> tuple[str, str] | None:
    """Leave the types of a dataclass's fields to its list of parameters."""
    if what != "class" or not dataclasses.is_dataclass(thing):
        return None
    given = inspect.signature(thing).parameters.values()
    names = [parameter.replace(annotation=inspect.Parameter.empty) for parameter in given]
    return str(inspect.Signature(names)), ""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("autodoc-process-docstring", add_fields, priority=BEFORE_NAPOLEON)
    app.connect("autodoc-process-docstring", keep_bars, priority=BEFORE_NAPOLEON - 1)
    app.connect("autodoc-process-signature", plain_signature)
    return {"parallel_read_safe": True}
