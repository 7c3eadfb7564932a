"""The files of a comparison: all of them, or no folder."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from obsplan.files import write_atomically
from obsplan.report.comparison import Rows, compare_figure
from obsplan.report.files import REPORT, new_folder, rounded, table_csv
from obsplan.report.page.comparison import Side, comparison_page


def write_comparison(
    rows: Rows,
    folder: Path | str,
    title: str = "",
    *,
    sides: Sequence[Side] = (),
    notes: Sequence[str] = (),
) -> None:
    """Write ``compare.csv``, a row per planner and seed, and ``compare.png`` into a new folder.

    It is written as by `obsplan.write_run`.

    Parameters
    ----------
    rows
        Of each mission its planner, seed and figures of merit.
    folder
        Made, and complete or not there.
    title
        Of the figure and of the page.
    sides
        One run of each planner under the same noise, which ``report.html`` plays side by side;
        without any there is no such file.
    notes
        Sentences on them, for that page.

    Raises
    ------
    ObsplanError
        The folder exists or cannot be written.
    """
    from obsplan.report.style import png

    with new_folder(Path(folder)) as made:
        columns = list(rows[0])
        body = [["" if row[key] is None else rounded(row[key]) for key in columns] for row in rows]
        write_atomically(made / "compare.csv", table_csv([columns, *body]))
        write_atomically(made / "compare.png", png(partial(compare_figure, rows, title)))
        if sides:
            write_atomically(made / REPORT, comparison_page(sides, title, notes))
