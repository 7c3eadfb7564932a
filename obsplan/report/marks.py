"""Marks on the map that say who was where when, and labels that do not hide each other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Integer
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from obsplan.report.words import time_unit

ROUND = (
    0.1,
    0.2,
    0.5,
    1,
    2,
    5,
    10,
    20,
    30,
    60,
    120,
    300,
    600,
    1200,
    1800,
    3600,
    7200,
    10800,
)  # [s]
LONGEST = 21600.0  # [s]; longer intervals are multiples of it
MOST_MARKS = 10  # on a track
POINT = 72.0  # points in an inch
SIZE = 8.0  # of a label [pt]
LETTER = 0.62  # width of a letter, of its size
DISTANCES = (5.0, 9.0)  # of a label's box from its mark [pt]
FARTHER = 3.0  # points of lines that a label rather hides than be farther from its mark
MARK = 6.0  # size of a mark, which no label hides [pt]
DIRECTIONS = tuple(np.pi / 4 * k for k in (1, 0, 3, 4, 7, 5, 2, 6))  # tried in this order [rad]
SPACING = 3.0  # of the points that stand for a line where space for a label is looked for [pt]
MOST_POINTS = 20_000  # of them


@dataclass(frozen=True, kw_only=True)
class Label:
    """Text beside a place [m]."""

    text: str
    at: Float[np.ndarray, " 2"]
    colour: str
    bold: bool = False


def mark_interval(duration: float, most: int = MOST_MARKS) -> float:
    """Smallest round time [s] that is in the mission no more often than asked."""
    for interval in ROUND:
        if duration <= most * interval:
            return float(interval)
    return LONGEST * float(np.ceil(duration / most / LONGEST))


def marked_instants(time: Float[np.ndarray, " samples"]) -> Integer[np.ndarray, " marks"]:
    """Samples nearest to the multiples of the round interval; the start has a mark of its own."""
    interval = mark_interval(float(time[-1]))
    wanted = interval * np.arange(1, int(time[-1] / interval + 1e-9) + 1)
    step = time[1] - time[0]
    return np.unique(np.rint(wanted / step).astype(int).clip(max=time.size - 1))


def mark_label(seconds: float, longest: float) -> str:
    """A time in the unit in which the mission is told, without the unit."""
    return f"{seconds / time_unit(longest)[0]:.4g}"


def marks_in_words(time: Float[np.ndarray, " samples"]) -> str:
    """What the numbers beside the marks are."""
    longest = float(time[-1])
    interval = mark_interval(longest)
    first = [mark_label(k * interval, longest) for k in (1, 2) if k * interval <= longest]
    return f"after {', '.join(first)}, … {time_unit(longest)[1]}"


def draw_labels(
    axes: Axes,
    labels: Sequence[Label],
    lines: Sequence[Float[np.ndarray, "_ 2"]],
    *,
    inch: float,
) -> None:
    """Write labels beside their places, the first ones first.

    One that would hide another label or a labelled place, wherever it is put, is left out.

    Parameters
    ----------
    axes
        The map, its limits set.
    labels
        In the order of their importance.
    lines
        Tracks [m]: a label is written where it hides least of them.
    inch
        Inches a metre.
    """
    scale = POINT * inch
    frame = scale * np.stack([axes.get_xlim(), axes.get_ylim()], axis=1)
    dots = np.concatenate([dotted(line * scale, SPACING) for line in lines])
    places = [scale * label.at for label in labels]
    marks = [[place - MARK / 2, place + MARK / 2] for place in places]
    taken = np.array(marks).reshape(-1, 2, 2)
    for label, place in zip(labels, places, strict=True):
        boxes, cost = candidate_boxes(place, label.text)
        free = within(boxes, frame) & ~overlapping(boxes, taken)
        if not free.any():
            continue
        hidden = np.where(free, dots_inside(boxes, dots) + cost, np.inf)
        box = boxes[int(np.argmin(hidden))]
        taken = np.concatenate([taken, box[None]])
        _write(axes, label, box.mean(axis=0) / scale)


def _write(axes: Axes, label: Label, center: Float[np.ndarray, " 2"]) -> None:
    axes.text(
        float(center[0]),
        float(center[1]),
        label.text,
        color=label.colour,
        fontsize=SIZE,
        fontweight="bold" if label.bold else "normal",
        ha="center",
        va="center_baseline",
        zorder=12,
        path_effects=[withStroke(linewidth=2.0, foreground="white")],
    )


def candidate_boxes(
    at: Float[np.ndarray, " 2"], text: str
) -> tuple[Float[np.ndarray, "candidates 2 2"], Float[np.ndarray, " candidates"]]:
    """Boxes (lower left, upper right) where a place's label could be, and what being far costs.

    All are in points; a cost is in points of lines that are hidden.
    """
    half = 0.5 * SIZE * np.array([LETTER * len(text), 1.0])
    boxes, cost = [], []
    for rank, distance in enumerate(DISTANCES):
        for angle in DIRECTIONS:
            ahead = np.array([np.cos(angle), np.sin(angle)])
            center = at + distance * ahead + half * np.sign(ahead.round(6))
            boxes.append([center - half, center + half])
            cost.append(FARTHER * rank)
    return np.array(boxes), np.array(cost)


def within(boxes: Float[np.ndarray, "n 2 2"], frame: Float[np.ndarray, "2 2"]) -> np.ndarray:
    """Which boxes are inside the frame."""
    return (boxes[:, 0] >= frame[0]).all(axis=1) & (boxes[:, 1] <= frame[1]).all(axis=1)


def overlapping(boxes: Float[np.ndarray, "n 2 2"], taken: Float[np.ndarray, "m 2 2"]) -> np.ndarray:
    """Which boxes overlap one that is taken."""
    apart = (boxes[:, None, 1] <= taken[None, :, 0]) | (boxes[:, None, 0] >= taken[None, :, 1])
    return np.any(~np.any(apart, axis=-1), axis=-1)


def dots_inside(
    boxes: Float[np.ndarray, "n 2 2"], dots: Float[np.ndarray, "m 2"]
) -> Integer[np.ndarray, " n"]:
    """How many dots each box would hide."""
    inside = (dots >= boxes[:, None, 0]) & (dots <= boxes[:, None, 1])
    return inside.all(axis=2).sum(axis=1)


def dotted(line: Float[np.ndarray, "n 2"], spacing: float) -> Float[np.ndarray, "_ 2"]:
    """Points along a line at even spacing, or as many as are allowed."""
    line = line[np.isfinite(line).all(axis=1)]
    if len(line) < 2:
        return line
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    count = int(np.clip(length[-1] / spacing, 1, MOST_POINTS)) + 1
    at = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(at, length, coordinate) for coordinate in line.T], axis=1)
