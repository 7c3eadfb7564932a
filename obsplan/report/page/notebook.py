"""A page within a notebook."""

from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

from obsplan.files import write_atomically
from obsplan.report.page.run import run_page
from obsplan.report.verdict import verdicts
from obsplan.report.words import NO_BOUND
from obsplan.run import Run

HEIGHT = 900  # of the frame [pixels]


@dataclass(frozen=True, repr=False)
class Player:
    """A page that a notebook shows in a frame of its own, whose scripts reach nothing else."""

    page: str

    def __repr__(self) -> str:
        return f'<Player of {len(self.page) / 1e6:.1f} MB; .save("report.html") writes it>'

    def _repr_html_(self) -> str:
        look = f"width: 100%; height: {HEIGHT}px; border: 0"
        inside = escape(self.page, quote=True)
        return f'<iframe sandbox="allow-scripts" style="{look}" srcdoc="{inside}"></iframe>'

    def save(self, path: Path | str) -> None:
        """Write the page into a file.

        Raises
        ------
        ObsplanError
            The file cannot be written.
        """
        write_atomically(path, self.page)


def played(run: Run) -> Player:
    """The page of a run with its verdicts, without the certified bound, which takes a while."""
    said = verdicts(replace(run, bounded=False))
    return Player(run_page(run, [sentence for sentence in said if sentence != NO_BOUND]))
