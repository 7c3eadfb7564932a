"""What stands about a map, none of it over the data: heading, scale bar, north arrow, notes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation, Transform

LINE = 0.21  # height of a line of a heading [inch]
NORTH, BAR = 0.3, 0.7  # the arrow and the bar's left end, from the map's right edge [inch]
LONGEST_BAR = 1.1  # [inch]
PAD = 0.1  # white margin of the figure [inch]


def inches(axes: Axes, x: float, y: float) -> Transform:
    """Inches from a place in the axes: (0, 0) is their lower left, (1, 1) their upper right."""
    scale: Any = axes.figure.dpi_scale_trans  # pyright: ignore[reportOptionalMemberAccess]
    corner: Any = axes.transAxes
    return scale + ScaledTranslation(x, y, corner)


def draw_heading(axes: Axes, lines: Sequence[tuple[str, str]]) -> None:
    """Write lines, each with its colour, above the axes; the first is the title."""
    for k, (text, colour) in enumerate(lines):
        height = 0.1 + LINE * (len(lines) - 1 - k)
        line = axes.text(0.0, height, text, transform=inches(axes, 0.0, 1.0), color=colour)
        line.set_fontsize(11 if k == 0 else 9)
        line.set_fontweight("bold" if k == 0 else "normal")


def draw_notes(axes: Axes, notes: Sequence[str]) -> None:
    """Write lines below the axes' labels."""
    for k, note in enumerate(notes):
        axes.text(0.0, -0.68 - LINE * k, note, transform=inches(axes, 0.0, 0.0), fontsize=8)


def round_length(most: float) -> float:
    """Largest of 1, 2 and 5 times a power of ten that is no longer."""
    decade = 10.0 ** np.floor(np.log10(most))
    return float(
        max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= most * (1 + 1e-9))
    )


def draw_bar_and_north(axes: Axes, width: float, inch: float) -> None:
    """Draw a bar of a round length and an arrow to the north, to the right of the axes.

    Parameters
    ----------
    axes
        The map.
    width
        Of the map [m].
    inch
        Inches a metre.
    """
    beside = inches(axes, 1.0, 1.0)
    length = round_length(min(LONGEST_BAR / inch, width))
    bar = Line2D(
        [BAR, BAR + length * inch],
        [-0.3, -0.3],
        transform=beside,
        color="black",
        lw=2.0,
        marker="|",
        ms=6,
        solid_capstyle="butt",
        clip_on=False,
        gid="scale bar",
    )
    axes.add_artist(bar)
    middle = BAR + length * inch / 2
    axes.text(
        middle, -0.22, f"{length:g} m", transform=beside, ha="center", va="bottom", fontsize=8
    )
    axes.annotate(
        "N",
        xy=(NORTH, 0.0),
        xytext=(NORTH, -0.42),
        xycoords=beside,
        textcoords=beside,
        ha="center",
        va="center",
        fontsize=10,
        fontweight="bold",
        arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 1.2, "shrinkA": 6, "shrinkB": 0},
        annotation_clip=False,
    )


def fit_figure(figure: Figure, axes: Axes) -> None:
    """Make a figure as large as what stands about its only axes needs; the axes stay."""
    size = figure.get_size_inches()
    low, high = axes.get_position().get_points() * size
    needed = figure.get_tightbbox()
    origin = np.array(needed.min) - PAD
    size = np.array(needed.max) + PAD - origin
    figure.set_size_inches(*size.tolist())
    axes.set_position((*((low - origin) / size), *((high - low) / size)))
