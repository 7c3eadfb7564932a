"""What the figures share: colours, the time axis, thinning, and PNGs that are the same bytes on every run."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float, Integer
from matplotlib import style
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogFormatter

# Okabe & Ito (2008) without its yellow and black, then two of P. Tol's "muted": told apart by colour-blind readers, and on white
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#999933")
AID = "#333333"  # the aid vehicle
FAINT = "#888888"
DPI = 150
MOST_POINTS = 4000  # of a line over time; more than twice the pixels of its panel

_STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "figure.dpi": DPI,
}


@contextmanager
def styled() -> Iterator[None]:
    """Draw in our style, whatever the user's is, and leave the user's as it was."""
    with style.context(["default", _STYLE]):
        yield


def png(draw: Callable[[], Figure], *, trim: bool = False) -> bytes:
    """Draw a figure without any window system, its white margins off if asked; the bytes say neither when nor by whom they were made."""
    buffer = io.BytesIO()
    with styled():
        draw().savefig(
            buffer,
            format="png",
            dpi=DPI,
            bbox_inches="tight" if trim else None,
            metadata={"Software": None},
        )
    return buffer.getvalue()


def colour(i: int) -> str:
    """Colour of an AUV."""
    return COLOURS[i % len(COLOURS)]


def time_axis(time: Float[np.ndarray, " samples"]) -> tuple[Float[np.ndarray, " samples"], str]:
    """Times in a readable unit, and the axis's label."""
    longest = 600.0  # [s]; more are told in minutes
    return (time, "Time [s]") if time[-1] <= longest else (time / 60.0, "Time [min]")


def plain_decades(axis: Axis) -> None:
    """Label a logarithmic axis 1, 10, 100, and between decades where they are few."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(LogFormatter(minor_thresholds=(2.0, 0.4)))


def outline(values: Float[np.ndarray, " n"], most: int = MOST_POINTS) -> Integer[np.ndarray, " k"]:
    """Indices of a line's points that draw it as all would: of each stretch the least and the greatest, so no spike is lost."""
    n = values.size
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    lows = [a + int(np.argmin(values[a:b])) for a, b in pairwise(edges)]
    highs = [a + int(np.argmax(values[a:b])) for a, b in pairwise(edges)]
    return np.unique([0, *lows, *highs, n - 1])
