"""Damage charts by seed, and print as JSON what became of their pictures.

`python -m fuzz.chart_trials FOLDER SEED COUNT` in the folder of the tests. In a process of its own, which a library that
is not ours might crash.
"""

import json
import random
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from charts import decoded, frame, geotiff, grid, mbtiles
from fuzz.trying import fault_of_form, outcome
from PIL import Image

from obsplan.report.page import raster
from obsplan.report.page.chart import chart_of

raster.MOST_PIXELS = 250  # quickly

HERE = (0.0, 1.0)  # on the equator, where degrees are 111 km


def sound(folder: Path) -> list[Path]:
    """Charts that are drawn: of numbers, of colours, by a palette, of tiles."""
    rng = np.random.default_rng(1)
    there = grid(0.99, 0.01, 0.0002)
    colours = rng.integers(0, 255, (4, 100, 100), dtype="uint8")
    palette = {k: (k, 255 - k, 90, 255) for k in range(256)}
    depths = rng.normal(size=(1, 100, 100)).astype("float32")
    more = {"nodata": -9999, "compress": "deflate", "predictor": 3}
    files = [
        geotiff(folder / "depths.tif", depths, "EPSG:4326", there, **more),
        geotiff(
            folder / "colours.tif",
            colours,
            "EPSG:4326",
            there,
            tiled=True,
            blockxsize=32,
            blockysize=32,
        ),
        geotiff(
            folder / "palette.tif", colours[:1], "EPSG:4326", there, palette=palette, compress="lzw"
        ),
    ]
    column, n = int((1 / 180 + 1) * 2**14), 2**14
    tiles = {
        (15, column + i, n + j): Image.fromarray(np.resize(colours[:3].T, (256, 256, 3)))
        for i in range(-2, 3)
        for j in range(-2, 3)
    }
    return [
        *files,
        *(mbtiles(folder / f"{kind}.mbtiles", tiles, kind=kind) for kind in ("JPEG", "WEBP")),
    ]


def damaged(content: bytes, rng: random.Random) -> bytes:
    """A file with some bytes that are others, most of them where it says what it is; or cut short."""
    if rng.random() < 0.15:
        return content[: rng.randrange(len(content))]
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        reach = rng.choice((64, 512, 4096, len(changed)))
        at = rng.randrange(min(reach, len(changed)))
        if rng.random() < 0.3:
            at = len(changed) - 1 - at
        changed[at] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    return bytes(changed)


def attempt(path: Path) -> str:
    """What becomes of a chart, in words what is wrong."""

    def draw() -> str:
        pictures = chart_of([path], [frame(HERE)]).pictures
        return "drawn" if [decoded(picture) for picture in pictures] else "not near"

    return outcome(draw, fault_of_form)


def main(folder: Path, seed: int, count: int) -> None:
    """Try so many files, and tell how many became what; and which are wrong."""
    rng = random.Random(seed)
    files = sound(folder)
    assert [attempt(path) for path in files] == ["drawn"] * len(files)
    became: Counter[str] = Counter()
    for k in range(count):
        whole = files[k % len(files)]
        path = folder / f"damaged{whole.suffix}"
        path.write_bytes(damaged(whole.read_bytes(), rng))
        told = attempt(path)
        became[told] += 1
        if told not in ("drawn", "refused", "not near"):
            path.rename(folder / f"wrong-{k}{path.suffix}")
    print(json.dumps(became))  # noqa: T201 - the result


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
