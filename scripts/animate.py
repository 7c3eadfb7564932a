"""Write the moving picture of README: the first part of a mission, seen from above.

    python scripts/animate.py [.readme/mission.gif]

Each dashed line is a range, each ellipse where an AUV believes itself to be, with 95 % confidence.
The same versions of numpy, matplotlib and Pillow give the same bytes.
"""

import argparse
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image

import obsplan as op
from obsplan.report.map import ellipses
from obsplan.report.style import AID, COLOURS, FAINT, styled

SCENARIO, SEED = "harbor-survey", 7
DURATION, EVERY = 720.0, 12.0  # [s] of the mission, and of each picture
SHOWN = 0.12  # [s] that a picture stays
LAST = 2.0  # [s] that the last one stays
TAIL = 240.0  # [s] of the aid vehicle's path that is drawn dark
HEARD = 6.0  # [s] for which a range is drawn
SIZE, DPI = (7.2, 4.6), 100  # [inch], dots an inch
COLOURS_KEPT = 48
HIGHEST = 15.0  # [m] of the errors shown


def pictures(run: op.Run) -> Iterator[Image.Image]:
    """One picture after the other."""
    for time in np.arange(EVERY, run.time[-1] + 1e-9, EVERY):
        content = io.BytesIO()
        drawn(run, int(np.searchsorted(run.time, time))).savefig(content, format="png", dpi=DPI)
        yield Image.open(content).convert("RGB")


@styled()
def drawn(run: op.Run, now: int) -> Figure:
    """The mission at a sample: from above, and the errors so far."""
    figure = Figure(figsize=SIZE, layout="constrained")
    above, errors = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    draw_surveys(above, run, now)
    draw_aid(above, run, now)
    minutes, seconds = divmod(round(run.time[now]), 60)
    above.set_title(f"{minutes:2d}:{seconds:02d} min", family="monospace")
    places = np.concatenate([run.cna[:, :2], *run.places])
    low, high = places.min(axis=0) - 15.0, places.max(axis=0) + 15.0
    above.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    above.set(xlabel="East [m]", ylabel="North [m]")
    draw_errors(errors, run, now)
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return figure


def draw_errors(axes: Axes, run: op.Run, now: int) -> None:
    """How far each estimate is off so far, and what its filter says of that."""
    time = run.time / 60.0
    for i, colour in enumerate(COLOURS[: len(run.names)]):
        variance = np.trace(run.covariance[i, : now + 1, :2, :2], axis1=1, axis2=2)
        axes.fill_between(time[: now + 1], 2.0 * np.sqrt(variance), color=colour, alpha=0.12, lw=0)
        axes.plot(time[: now + 1], run.error[i, : now + 1], color=colour, lw=1.3)
    axes.set(xlim=(0.0, time[-1]), ylim=(0.0, HIGHEST), xlabel="Time [min]")
    axes.set_title("Position error [m]; shaded: two standard deviations")


def draw_surveys(axes: Axes, run: op.Run, now: int) -> None:
    """Each AUV: where it will go, has been and believes to be, and its last range."""
    for i, colour in enumerate(COLOURS[: len(run.names)]):
        place, belief = run.places[i], run.mean[i, now, :2]
        axes.plot(*place.T, color=colour, lw=0.8, alpha=0.25)
        axes.plot(*place[: now + 1].T, color=colour, lw=1.6)
        (outline,) = ellipses(run.covariance[i, now : now + 1, :2, :2], belief[None])
        axes.add_patch(Polygon(outline, fc=colour, ec=colour, alpha=0.35))
        axes.plot(*belief, "+", color=colour, ms=7)
        axes.plot(*place[now], "o", color=colour, ms=6, mec="white", label=run.names[i])
        heard = np.flatnonzero(np.isfinite(run.range[i, : now + 1]))
        if heard.size and run.time[now] - run.time[heard[-1]] < HEARD:
            ends = np.array([run.cna[now, :2], place[now]])
            axes.plot(*ends.T, color=colour, lw=1.2, ls=(0, (4, 2)))


def draw_aid(axes: Axes, run: op.Run, now: int) -> None:
    """The aid vehicle, the way it has come, and its heading."""
    path, heading = run.cna[: now + 1, :2], run.cna[now, 2]
    recent = run.time[: now + 1] >= run.time[now] - TAIL
    axes.plot(*path.T, color=FAINT, lw=0.6, alpha=0.6)
    axes.plot(*path[recent].T, color=AID, lw=1.4)
    marker = (3, 0, np.degrees(heading) - 90.0)
    axes.plot(*path[-1], marker=marker, color=AID, ms=11, mec="white", ls="", label="aid vehicle")


def main() -> None:
    """Fly, draw and write."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("path", nargs="?", type=Path, default=Path(".readme/mission.gif"))
    path = arguments.parse_args().path
    run = op.simulate(op.load(SCENARIO).replace(duration=DURATION), seed=SEED)
    frames = list(pictures(run))
    palette = frames[len(frames) // 2].quantize(COLOURS_KEPT, dither=Image.Dither.NONE)
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    lasts = [round(1000 * SHOWN)] * (len(frames) - 1) + [round(1000 * LAST)]
    first, *rest = indexed
    first.save(path, save_all=True, append_images=rest, duration=lasts, loop=0, optimize=False)
    print(f"{path}: {len(frames)} pictures, {path.stat().st_size / 1e6:.2f} MB")  # noqa: T201


if __name__ == "__main__":
    main()
