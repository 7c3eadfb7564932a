"""The thesis as a folder: each item's picture, data and finding, and a page with all of them."""

import json
import os
from collections.abc import Callable, Iterable
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import obsplan
from obsplan.campaign.code import code_hash
from obsplan.files import write_atomically
from obsplan.report.files import as_json, check_free, free_folder, numbered, table_csv
from obsplan.signals import hear_stops
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.items import ITEMS
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    import xarray as xr

PAGE, RECORD = "thesis.md", "findings.json"
WIDTH = 720  # of a picture on the page [pixel]
HEADINGS = {
    "fig2": "Localization (section 2.2)",
    "eq4": "Empirical Gramian (chapter 4)",
    "fig5": "Simulations (chapter 5)",
    "table5": "Localization performance (section 5.3)",
    "figA": "Appendix A",
    "figB": "Appendix B",
    "study": "Open questions",
}

Progress = Callable[[int, int], None]
Record = dict[str, Any]  # as it stands in findings.json


def select(names: Iterable[str]) -> list[Item]:
    """Items by name, in the thesis's order, each once; ``all`` for all.

    Raises
    ------
    ObsplanError
        No item has that name.
    """
    asked = list(dict.fromkeys(names))
    unknown = [name for name in asked if name != "all" and name not in ITEMS]
    if unknown:
        raise ObsplanError(
            f'the thesis has no "{unknown[0]}"; give all, or some of {", ".join(ITEMS)}'
        )
    return [item for name, item in ITEMS.items() if name in asked or "all" in asked]


def write_thesis(
    names: Iterable[str],
    folder: Path | str,
    *,
    runs: int = 100,
    seed: int = 1,
    progress: Progress | None = None,
) -> dict[str, Finding]:
    """Make items and write pictures, data and ``thesis.md`` into a folder; returns the findings.

    Each item is kept when it is finished, and noted in ``findings.json``; ``thesis.md`` comes
    last. If anything ends the work before, the same call goes on from there, and the folder holds
    the same bytes in the end.

    Parameters
    ----------
    names
        Of items, or ``all``.
    folder
        Made unless it was begun by the same call of the same version and code.
    runs
        Noise seeds of tables and studies, and at most so many random starts of figures.
    seed
        The first noise seed, and that of random starts. The same names, runs and seed give the
        same bytes.
    progress
        Called with (items done, items in all).

    Raises
    ------
    ObsplanError
        An item is not known, or the folder exists with anything else in it or cannot be written.
    """
    items, folder = select(names), Path(folder)
    asked = request(items, runs=runs, seed=seed)
    found = begun(folder, asked)
    if found is None:
        found = begin(folder, asked)
    for done, item in enumerate(items, start=1):
        hear_stops()
        if item.name not in found:
            found[item.name] = write_item(item, folder, runs=runs, seed=seed)
            note(folder, asked, found)
        if progress is not None:
            progress(done, len(items))
    write_atomically(folder / PAGE, page(items, found, runs=runs, seed=seed))
    return {item.name: finding_of(found[item.name]) for item in items}


def free_or_begun(
    out: Path | None, names: Iterable[str], *, runs: int = 100, seed: int = 1
) -> Path:
    """The folder for these items: the one asked for, else ``thesis``, ``thesis-2``, ...

    Of the latter it is the first that was begun for them or is free.

    Raises
    ------
    ObsplanError
        An item is not known, or the folder asked for holds anything else.
    """
    asked = request(select(names), runs=runs, seed=seed)
    there = [out] if out else takewhile(os.path.lexists, numbered("thesis"))
    for folder in there:
        if begun(folder, asked) is not None:
            return folder
    return free_folder(out, "thesis")


def request(items: list[Item], *, runs: int, seed: int) -> Record:
    """What is asked for, in the words of the record."""
    return {
        "version": obsplan.__version__,
        "code": code_hash("thesis", "report"),
        "runs": runs,
        "seed": seed,
        "items": [item.name for item in items],
    }


def begun(folder: Path, asked: Record) -> Record | None:
    """Records of the items finished in a folder begun for the same request, and incomplete.

    None of any other folder.
    """
    if (folder / PAGE).exists():
        return None
    try:
        record = json.loads((folder / RECORD).read_bytes())
    except (OSError, ValueError):  # none there, or not ours
        return None
    if not isinstance(record, dict) or any(record.get(key) != asked[key] for key in asked):
        return None
    found = record.get("found")
    return found if isinstance(found, dict) else None


def begin(folder: Path, asked: Record) -> Record:
    """Make a new folder, with a record of nothing finished."""
    check_free(folder)
    try:
        folder.mkdir()
    except OSError as error:
        raise ObsplanError(
            f"{folder} cannot be made ({error.strerror}): give another folder with --out"
        ) from error
    note(folder, asked, {})
    return {}


def note(folder: Path, asked: Record, found: Record) -> None:
    """Write the record of what is finished."""
    write_atomically(folder / RECORD, as_json(asked | {"found": found}))


def finding_of(record: Record) -> Finding:
    """What a record says was found."""
    return Finding(agrees=record["agrees"], sentence=record["sentence"])


def write_item(item: Item, folder: Path, *, runs: int, seed: int) -> Record:
    """Compute an item and write its NAME.nc, NAME.png and, for a table, NAME.csv.

    Returns all that the page says of it.
    """
    from obsplan.report.style import png

    data = item.compute(runs=runs, seed=seed)
    finding, rows = item.found(data), [] if item.rows is None else item.rows(data)
    write_atomically(folder / f"{item.name}.nc", netcdf(data))
    write_atomically(folder / f"{item.name}.png", png(partial(item.draw, data)))
    if item.rows is not None:
        write_atomically(folder / f"{item.name}.csv", table_csv(rows))
    agrees = None if finding.agrees is None else bool(finding.agrees)
    return {"agrees": agrees, "sentence": finding.sentence, "rows": rows}


def netcdf(data: "xr.Dataset") -> bytes:
    """A dataset as classic NetCDF."""
    content: Any = data.to_netcdf(engine="scipy", format="NETCDF3_64BIT")
    return bytes(content)


def page(
    items: list[Item],
    found: Record,
    *,
    runs: int,
    seed: int,
) -> str:
    """The summary page, in Markdown."""
    findings = {name: finding_of(record) for name, record in found.items()}
    lines = [
        "# The thesis, reproduced",
        "",
        (
            "*Observability Based Path Planning in Range-only Localization*: each figure and "
            "table, what it claims, and what was found."
        ),
        f"Made with `--runs {runs} --seed {seed}`.",
        "",
        "| Item | What it shows | Found |",
        "| --- | --- | --- |",
        *(
            f"| [{item.name}](#{anchor(item)}) | {item.title} | "
            f"{item.verdict(findings[item.name])} |"
            for item in items
        ),
    ]
    chapter = ""
    for item in items:
        heading = next(
            heading for prefix, heading in HEADINGS.items() if item.name.startswith(prefix)
        )
        lines += [] if heading == chapter else ["", f"## {heading}"]
        chapter = heading
        lines += section(item, findings[item.name], found[item.name]["rows"])
    return "\n".join(lines) + "\n"


def anchor(item: Item) -> str:
    """Where a heading is found on the page."""
    return item.name.lower().replace(".", "")


def section(item: Item, finding: Finding, rows: list[list[str]]) -> list[str]:
    """One item: its picture beside claim and finding, and its table."""
    said = "Question" if item.asks else "Thesis"
    data = f"[data]({item.name}.nc)" + (
        f", [table]({item.name}.csv)" if item.rows is not None else ""
    )
    paragraphs = (
        f"**{item.title}**",
        f"**{said}:** {item.claim}",
        f"**Found, {item.verdict(finding)}:** {finding.sentence}",
        data,
    )
    text = "<br><br>".join(paragraphs)
    return [
        "",
        f'### <a id="{anchor(item)}"></a>{item.name}',
        "",
        "| | |",
        "| --- | --- |",
        f'| <img src="{item.name}.png" alt="{item.title}" width="{WIDTH}"> | {escaped(text)} |',
        *(["", *markdown(rows)] if rows else []),
    ]


def markdown(rows: list[list[str]]) -> list[str]:
    """A table, its first row as the heading."""
    lines = [f"| {' | '.join(escaped(cell) for cell in row)} |" for row in rows]
    return [lines[0], f"|{' --- |' * len(rows[0])}", *lines[1:]]


def escaped(text: str) -> str:
    """Text for a cell."""
    return text.replace("|", "&#124;")
