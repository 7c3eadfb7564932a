"""What the command line prints: sentences, commands to paste, and tables that hide no number."""

import codecs
import io
import os
import shlex
import shutil
import sys
import textwrap
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, cast

from obsplan.spelling import visible

if TYPE_CHECKING:
    from rich.console import Console, JustifyMethod
    from rich.table import Column, Table
    from rich.text import Text

WRONG_INPUT, SOME_FAILED = 2, 3  # exit codes

LONGEST = 800  # letters of a complaint
ENDLESS = 10_000  # [letters], wider than any table
EDGE, GAP = 1, 3  # letters that a table's frame takes: once, and with each column
LABEL_SHARE = 3  # one of so many parts of the width is a label's before its words are wrapped


def open_door() -> None:
    """Print something plainer for a letter that the terminal's encoding lacks, not an error."""
    codecs.register_error("plainer", plainer)
    if sys.stdout is None or sys.stderr is None:  # closed by who started us
        nobody = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - until the end
        sys.stdout, sys.stderr = sys.stdout or nobody, sys.stderr or nobody
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="plainer")


def plainer(error: UnicodeError) -> tuple[str, int]:
    """Letters without accents, hyphens for dashes, question marks else; and where to go on."""
    assert isinstance(error, UnicodeEncodeError)
    letters = unicodedata.normalize("NFKD", error.object[error.start : error.end])
    bare = (letter for letter in letters if not unicodedata.combining(letter))
    plain = ["-" if unicodedata.category(letter) == "Pd" else letter for letter in bare]
    return "".join(plain).encode("ascii", "replace").decode(), error.end


def say(text: str, *, indent: int = 0) -> None:
    """Print a line: on a terminal wrapped, what follows indented; whole in a pipe.

    Of names and files nothing reaches the terminal that it would act on.
    """
    text = visible(text)
    put((wrapped(text, indent) if sys.stdout.isatty() else text) + "\n")


def say_next(*words: str) -> None:
    """Print the command to go on with, quoted for a shell and never wrapped: it can be pasted."""
    put(f"Next: obsplan {visible(shlex.join(words))}\n")


def complain(text: str) -> None:
    """Print a line on standard error; of a long one beginning and end."""
    said = visible(text)
    if len(said) > LONGEST:
        said = f"{said[: LONGEST // 2]} ... {said[-LONGEST // 2 :]}"
    put(f"obsplan: {said}\n", sys.stderr)


def wrapped(text: str, indent: int = 0) -> str:
    """Text in lines no longer than the terminal's, broken at blanks: paths and numbers stay."""
    return textwrap.fill(
        text,
        width=shutil.get_terminal_size().columns,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def say_written(folder: Path, files: str) -> None:
    """Say where results are."""
    say(f"Written to {folder}{'' if folder.is_absolute() else '/'}: {files}.")


def put(text: str, stream: TextIO | None = None) -> None:
    """Write to a stream, standard output unless another is given.

    When its reader has gone (`| head`), what follows is written to nobody: the program ends as it
    would have.

    Raises
    ------
    ObsplanError
        Standard output cannot be written for another reason.
    """
    stream = stream or cast("TextIO", sys.stdout)
    try:
        stream.write(text)
        stream.flush()
    except OSError as error:
        nobody = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nobody, stream.fileno())
        os.close(nobody)
        if stream is not sys.stderr and not isinstance(error, BrokenPipeError):
            raise unwritable(error) from error


def unwritable(error: OSError) -> Exception:
    """What to say when standard output goes to a full disk."""
    from obsplan.types import ObsplanError

    return ObsplanError(
        f"what is printed cannot be written ({error.strerror}): send it elsewhere, or make room"
    )


def show(table: "Table") -> None:
    """Print a table in the width of the terminal or of COLUMNS; in a pipe in its own."""
    from rich.console import Console

    console = Console()
    if not sys.stdout.isatty() and "COLUMNS" not in os.environ:
        console = Console(width=natural_width(table, console))
    with console.capture() as printed:
        for part in fitted(table, console):
            console.print(part)
    put(printed.get())


def caption_of(table: "Table") -> "Text":
    """The caption of a table as a paragraph of its own, wider than the table."""
    from rich.text import Text

    return Text(str(table.caption), style="table.caption")


def natural_width(table: "Table", console: "Console") -> int:
    """Width [letters] of a table in which nothing is wrapped."""
    from rich.measure import Measurement

    return Measurement.get(console, console.options.update(width=ENDLESS), table).maximum


def fitted(table: "Table", console: "Console") -> "list[Table | Text]":
    """The table where the console is wide enough, else several below each other.

    Each has the labels and some of the numbers. Numbers begin at the first column that is
    justified to the right. Of a number no digit is left out; headings are wrapped.
    """
    if natural_width(table, console) <= console.width:
        return [table]
    right = [column.justify == "right" for column in table.columns]
    labels = right.index(True) if True in right else 1
    room = console.width - EDGE - GAP
    label = label_block(table.columns[:labels], console, room)
    room -= label.width
    parts: list[list[Block]] = [[]]
    for column in table.columns[labels:]:
        block = number_block(column, console, room - GAP)
        taken = sum(other.width + GAP for other in parts[-1])
        if parts[-1] and taken + GAP + block.width > room:
            parts.append([])
        parts[-1].append(block)
    made = [narrow_table(table, [label, *part]) for part in parts]
    made[0].title = table.title
    return [*made, *([] if table.caption is None else [caption_of(table)])]


@dataclass(frozen=True, kw_only=True)
class Block:
    """A column of a given width [letters]: its heading, and a cell for each row."""

    heading: "Text"
    cells: "list[Text]"
    width: int
    justify: "JustifyMethod"


def label_block(columns: "Sequence[Column]", console: "Console", room: int) -> Block:
    """The labels of each row as one column, wrapped where they would take much of the room."""
    cells = [texts(column, console) for column in columns]
    heading, *rows = [joined(labels) for labels in zip(*cells, strict=True)]
    whole = max(text.cell_len for text in (heading, *rows))
    words = max(longest_word(text) for text in (heading, *rows))
    width = min(whole, max(words, room // LABEL_SHARE), room // 2)
    return Block(heading=heading, cells=rows, width=width, justify="left")


def number_block(column: "Column", console: "Console", room: int) -> Block:
    """A column as narrow as its numbers and the words of its heading."""
    heading, *cells = texts(column, console)
    width = max(longest_word(heading), *(cell.cell_len for cell in cells))
    return Block(heading=heading, cells=cells, width=min(width, room), justify=column.justify)


def texts(column: "Column", console: "Console") -> "list[Text]":
    """Heading and cells of a column."""
    parts = (column.header, *column.cells)
    return [
        console.render_str(part) if isinstance(part, str) else cast("Text", part) for part in parts
    ]


def joined(labels: "Sequence[Text]") -> "Text":
    """Labels with commas between them."""
    from rich.text import Text

    return Text(", ").join(labels)


def longest_word(text: "Text") -> int:
    """Length of the longest word [letters]."""
    from rich.cells import cell_len

    return max((cell_len(word) for word in text.plain.split()), default=0)


def narrow_table(table: "Table", blocks: Sequence[Block]) -> "Table":
    """A table of the same rows and other columns; cells too long for their column are wrapped."""
    from rich.table import Table

    made = Table(
        box=table.box, title_justify=table.title_justify, caption_justify=table.caption_justify
    )
    for block in blocks:
        made.add_column(block.heading, justify=block.justify, width=block.width, overflow="fold")
    for i, row in enumerate(table.rows):
        made.add_row(*(block.cells[i] for block in blocks), end_section=row.end_section)
    return made
