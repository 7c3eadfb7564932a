"""What the figures share: colours, the time axis, thinning, and PNGs of the same bytes."""

import io
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from textwrap import fill
from typing import Any
from zlib import crc32

import numpy as np
from jaxtyping import Float, Integer
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogFormatter

from obsplan.planners import PLANNERS
from obsplan.report.words import marked, time_unit
from obsplan.types import UNCOMPUTABLE, uncomputable

# Okabe & Ito (2008) without its yellow and black, then two of P. Tol's "muted": colour-blind
# readers can tell them apart, on white too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#999933")
MARKERS = ("o", "s", "^", "D")  # of planners, as there are more of them than colours
AID = "#333333"  # the aid vehicle
FAINT = "#888888"
LIMIT = "#000000"  # keep-outs, geofence, separations
BROKEN = "#E3007B"  # where a limit is broken: none of the above, and drawn broader than all of them
INK = 0.75  # of a colour's brightness, for letters
LETTERS = 14  # of 8 pt in an inch, and some margin
DPI = 150
MOST_POINTS = 4000  # of a line over time; more than twice the pixels of its panel

log = logging.getLogger("obsplan")

_STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # else every title is moved until it hides no tick, which takes long
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "hatch.linewidth": 0.5,
    "text.parse_math": False,  # a name may hold dollars
    "figure.dpi": DPI,
}


@contextmanager
def styled() -> Iterator[None]:
    """Draw in our style, whatever the user's is, and leave the user's as it was."""
    with style.context(["default", _STYLE]):
        yield


def png(draw: Callable[[], Figure]) -> bytes:
    """Draw a figure without any window system; the bytes tell neither when nor by whom.

    One that numbers make impossible is replaced by one that says so, and a warning is logged: what
    was flown is kept.
    """
    with styled():
        try:
            return _saved(draw())
        except (*UNCOMPUTABLE, ValueError) as error:
            why = f"This figure cannot be drawn: {uncomputable(error)}."
            log.warning(why)
            return _saved(_not_drawn(why))


def _saved(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def _not_drawn(why: str) -> Figure:
    """A figure that says why there is none."""
    figure = Figure(figsize=(6.0, 2.0))
    figure.text(0.5, 0.5, fill(why, 70), ha="center", va="center", parse_math=False)
    return figure


def colour(i: int) -> str:
    """Colour of an AUV."""
    return COLOURS[i % len(COLOURS)]


def dark(paint: str) -> str:
    """A colour dark enough for small letters."""
    red, green, blue = (INK * part for part in to_rgb(paint))
    return to_hex((red, green, blue))


def planner_style(name: str) -> tuple[str, str]:
    """Colour and marker of a planner: the same in every figure, whoever else is in it.

    A planner that is not one of ours has a diamond and a colour that follows from its name.
    """
    ours = list(PLANNERS)
    if name in ours:
        k = ours.index(name)
        return colour(k), MARKERS[k // len(COLOURS)]
    return colour(crc32(name.encode())), MARKERS[-1]


def name_rows(axes: Axes, rows: Sequence[str], broke: Sequence[bool]) -> None:
    """Name the rows of a panel from above, those who broke a limit with a mark."""
    names = [marked(name, bool(one)) for name, one in zip(rows, broke, strict=True)]
    axes.set_yticks(range(len(rows)), names)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    for label, one in zip(axes.get_yticklabels(), broke, strict=True):
        label.set_color(BROKEN if one else "black")


def head(figure: Figure, title: str, key: str) -> None:
    """Write a title and, below in smaller letters, how the figure is to be read."""
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    if key:
        lines = fill(key, int(LETTERS * figure.get_figwidth()))
        figure.supxlabel(lines, x=0.01, ha="left", fontsize=8)


def named(text: str) -> str:
    """A name as a legend's label; matplotlib would leave out one that begins with an underscore."""
    return f" {text}" if text.startswith("_") else text


def time_axis(time: Float[np.ndarray, " samples"]) -> tuple[Float[np.ndarray, " samples"], str]:
    """Times in a readable unit, and the axis's label."""
    length, symbol = time_unit(float(time[-1]))
    return time / length, f"Time [{symbol}]"


def plain_decades(axis: Axis) -> None:
    """Label a logarithmic axis 1, 10, 100, and between decades where they are few."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(LogFormatter(minor_thresholds=(2.0, 0.4)))


def outline(values: Float[np.ndarray, " n"], most: int = MOST_POINTS) -> Integer[np.ndarray, " k"]:
    """Indices of a line's points that draw it as all would.

    Of each stretch they are the least and the greatest, so no spike is lost.
    """
    n = values.size
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    lows = [a + int(np.argmin(values[a:b])) for a, b in pairwise(edges)]
    highs = [a + int(np.argmax(values[a:b])) for a, b in pairwise(edges)]
    return np.unique([0, *lows, *highs, n - 1])
