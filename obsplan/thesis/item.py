"""What the thesis shows, one item each: claim, our data, our picture, and whether they agree."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

VERDICTS = {True: "agrees", False: "does not agree", None: "in part"}


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What was found: whether it is what the thesis says (None: in part), and a sentence."""

    agrees: bool | None
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Item:
    """A figure or table of the thesis, or a question of its last chapter."""

    name: str  # fig5.1, table5.2, figB.3, study-speeds
    title: str
    claim: str  # what the thesis says, or asks
    # (*, runs, seed): the noise seeds, or random starts, numbered or drawn from ``seed`` on
    compute: Callable[..., "xr.Dataset"]
    draw: Callable[["xr.Dataset"], "Figure"]
    found: Callable[["xr.Dataset"], Finding]
    rows: Callable[["xr.Dataset"], list[list[str]]] | None = None  # as a table, its heading first

    @property
    def asks(self) -> bool:
        """Whether it is a question, which is answered, and not a claim, which holds or does not."""
        return self.name.startswith("study-")

    def verdict(self, finding: Finding) -> str:
        """In a word or two."""
        return "answered" if self.asks else VERDICTS[finding.agrees]
