"""Parts of pages that are made of the code: public names, keys of scenarios, columns, commands.

A page has ``<!-- generated: what words -->`` where such a part goes.
"""

import inspect
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import Any

from columns import ELSEWHERE, MEANINGS, TABLES
from sphinx.application import Sphinx

from obsplan.fates import Fate
from obsplan.planners import PLANNERS
from obsplan.scenario.schema import sections

PLACE = re.compile(r"<!-- generated: (.*?) -->")


def public_names(package: str, *homes: str) -> Iterator[str]:
    """The public names of a package whose modules begin with one of the words given."""
    module = import_module(package)
    for name in sorted(module._HOME, key=str.lower):
        home, thing = module._HOME[name], getattr(module, name)
        if home.partition(".")[0] not in homes:
            continue
        yield "```{eval-rst}"
        if inspect.isclass(thing) and not thing.__module__.startswith(package):
            owner = thing.__module__.partition(".")[0]
            yield from (f".. py:class:: {package}.{name}", "", f"   Is `{owner}.{name}`.")
        elif callable(thing):
            yield f".. auto{'class' if inspect.isclass(thing) else 'function'}:: {package}.{name}"
        else:
            yield from (f".. py:data:: {package}.{name}", "", f"   {said_of(package, home, name)}")
        yield from ("```", "")


def said_of(package: str, home: str, name: str) -> str:
    """What the comment above a constant says."""
    begin = f"{package}.{home}"
    for module in [module for key, module in sys.modules.items() if key.startswith(begin)]:
        above = rf"((?:^# .*\n)+){name}\b"
        found = re.search(above, inspect.getsource(module), re.MULTILINE)
        if found:
            return " ".join(line.removeprefix("# ") for line in found[1].splitlines())
    raise LookupError(f"no comment stands above {name} in {begin}")


def scenario_keys() -> Iterator[str]:
    """Every table of a scenario with its keys, their types, defaults and meanings."""
    for path, rows in sections():
        yield f"## {f'`[{path}]`' if path else 'Top of the file'}\n"
        yield from table(("key", "type", "default", "meaning", "range"), rows, code=(0, 2))


def csv_columns(name: str) -> Iterator[str]:
    """The columns of a table that is written, each with its meaning."""
    said = {column: MEANINGS[column] for column in TABLES[name]}
    said |= {column: text for (table_name, column), text in ELSEWHERE.items() if table_name == name}
    yield from table(("column", "meaning"), [*said.items()], code=(0,))


def fates() -> Iterator[str]:
    """What may become of a range, in the words of the tables."""
    rows = [(fate.words, "yes" if fate.taken else "no") for fate in Fate]
    yield from table(("fate", "taken"), rows)


def statuses() -> Iterator[str]:
    """How a decision may have come about, and what each advises."""
    from formulations import Status

    rows = [(status.label, status.advice) for status in Status]
    yield from table(("status", "advice"), rows, code=(0,))


def commands() -> Iterator[str]:
    """Every command with its arguments and options."""
    import typer.main

    from obsplan.cli import app

    group: Any = typer.main.get_command(app)
    for name, command in group.commands.items():
        yield f"## `obsplan {name}`\n\n{inspect.cleandoc(command.help)}\n"
        rows = [(spelled(option), option.help or "") for option in command.params]
        yield from table(("argument or option", "meaning"), rows, code=(0,))


def spelled(option: Any) -> str:
    """An argument or option as it is typed."""
    if option.param_type_name == "argument":
        return option.metavar or option.name.upper()
    flag = max(option.opts, key=len)
    return flag if option.is_flag else f"{flag} {option.metavar or '...'}"


def planners() -> Iterator[str]:
    """Every planner with the first line of what it says of itself."""
    rows = []
    for name, home in PLANNERS.items():
        module, _, class_name = home.partition(":")
        said = inspect.getdoc(getattr(import_module(module), class_name)) or ""
        rows.append((name, said.partition("\n\n")[0].replace("\n", " ")))
    yield from table(("name", "what it does"), rows, code=(0,))


def table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], *, code: Sequence[int] = ()
) -> Iterator[str]:
    """A table in Markdown; cells of the columns named are code."""
    yield line_of(heads)
    yield line_of(["---"] * len(heads))
    for row in rows:
        yield line_of([as_code(cell) if i in code else plain(cell) for i, cell in enumerate(row)])
    yield ""


def line_of(cells: Sequence[str]) -> str:
    """A row of a table."""
    return f"| {' | '.join(cells)} |"


def as_code(cell: str) -> str:
    """A cell that is shown as it is typed."""
    return f"`{cell.replace('|', chr(92) + '|')}`" if cell else ""


def plain(cell: str) -> str:
    """A cell of words, in which nothing is markup but code."""
    return re.sub(r"([|*_\[\]<>$])", r"\\\1", cell).replace("``", "`")


PARTS: dict[str, Callable[..., Iterator[str]]] = {
    part.__name__.replace("_", "-"): part
    for part in (public_names, scenario_keys, csv_columns, fates, statuses, commands, planners)
}


def fill(app: Sphinx, page: str, source: list[str]) -> None:
    """Put in each part that a page asks for."""

    def made(place: re.Match[str]) -> str:
        what, *words = place[1].split()
        return "\n".join(PARTS[what](*words))

    if page.startswith("docs/"):
        source[0] = PLACE.sub(made, source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("source-read", fill)
    return {"parallel_read_safe": True}
