"""The thesis as a folder: for each item its picture, its data and what was found, and a page with all of them."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from obsplan.files import write_atomically
from obsplan.report.files import new_folder, table_csv
from obsplan.thesis.item import Finding, Item
from obsplan.thesis.items import ITEMS
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    import xarray as xr

WIDTH = 720  # of a picture on the page [pixel]
HEADINGS = {
    "fig5": "Simulations (chapter 5)",
    "table5": "Localization performance (section 5.3)",
    "figB": "Appendix B",
    "study": "Open questions",
}

Progress = Callable[[int, int], None]


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
    """Make items and write pictures, data and ``thesis.md`` into a new folder, all or nothing; returns what was found, by item.

    Parameters
    ----------
    names
        Of items, or ``all``.
    runs
        Noise seeds of tables and studies, and at most so many random starts of figures.
    seed
        The first noise seed, and that of random starts. The same names, runs and seed give the same bytes.
    progress
        Called with (items done, items in all).

    Raises
    ------
    ObsplanError
        An item is not known, or the folder exists or cannot be written.
    """
    items, findings, sections = select(names), {}, []
    with new_folder(Path(folder)) as made:
        for k, item in enumerate(items):
            data = item.compute(runs=runs, seed=seed)
            findings[item.name] = item.found(data)
            write_item(item, data, made)
            sections.append(
                section(item, findings[item.name], [] if item.rows is None else item.rows(data))
            )
            if progress is not None:
                progress(k + 1, len(items))
        write_atomically(made / "thesis.md", page(items, findings, sections, runs=runs, seed=seed))
    return findings


def write_item(item: Item, data: "xr.Dataset", folder: Path) -> None:
    """Write an item's NAME.png, NAME.nc and, for a table, NAME.csv."""
    from obsplan.report.style import png

    write_atomically(folder / f"{item.name}.nc", netcdf(data))
    write_atomically(folder / f"{item.name}.png", png(partial(item.draw, data)))
    if item.rows is not None:
        write_atomically(folder / f"{item.name}.csv", table_csv(item.rows(data)))


def netcdf(data: "xr.Dataset") -> bytes:
    """A dataset as classic NetCDF."""
    return bytes(data.to_netcdf(engine="scipy", format="NETCDF3_64BIT"))  # pyright: ignore[reportArgumentType, reportCallIssue]


def page(
    items: list[Item],
    findings: dict[str, Finding],
    sections: list[list[str]],
    *,
    runs: int,
    seed: int,
) -> str:
    """The summary page, in Markdown."""
    lines = [
        "# The thesis, reproduced",
        "",
        "*Observability Based Path Planning in Range-only Localization*: each figure and table, what it claims, and what was found.",
        f"Made with `--runs {runs} --seed {seed}`.",
        "",
        "| Item | What it shows | Found |",
        "| --- | --- | --- |",
        *(
            f"| [{item.name}](#{anchor(item)}) | {item.title} | {item.verdict(findings[item.name])} |"
            for item in items
        ),
    ]
    chapter = ""
    for item, text in zip(items, sections, strict=True):
        heading = next(
            heading for prefix, heading in HEADINGS.items() if item.name.startswith(prefix)
        )
        lines += [] if heading == chapter else ["", f"## {heading}"]
        chapter = heading
        lines += text
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
    text = f"**{item.title}**<br><br>**{said}:** {item.claim}<br><br>**Found, {item.verdict(finding)}:** {finding.sentence}<br><br>{data}"
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
