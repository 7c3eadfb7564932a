"""MBTiles as a chart: pictures of a rendered map in a database, tile by tile.

They are read by sqlite3 and Pillow, without GDAL: its databases may have tables that open other
files.
"""

import io
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from obsplan.report.page.raster import Pixels, Window, short
from obsplan.spelling import visible
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from PIL.Image import Image

TILE = 256  # pixels, in which places are counted; tiles may be finer
DEEPEST = 30  # zoom level
LARGEST = 20_000_000  # bytes of a tile, and of any other value
WIDEST = 2048  # pixels of a tile
PATIENCE = 20.0  # [s] of all questions to a database
MOST_PIXELS = 64_000_000  # of the tiles that are put together
ONE = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
ANY = (
    "SELECT 1 FROM tiles WHERE zoom_level = ? AND tile_column BETWEEN ? AND ? "
    "AND tile_row BETWEEN ? AND ? LIMIT 1"
)
FORMATS = ("PNG", "JPEG", "WEBP")


@dataclass
class Tiles:
    """An open MBTiles file, as one raster at its deepest zoom level (Web Mercator)."""

    path: Path
    database: sqlite3.Connection
    zooms: tuple[int, int]
    rows: int  # as many as the Earth would take
    columns: int
    period: float | None
    numbers: bool = False
    unit: str = ""
    said: list[str] = field(default_factory=list)
    used: set[int] = field(default_factory=set)

    def places(self, latlon: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Give row and column of latitudes and longitudes [degrees]."""
        lat, lon = np.radians(latlon).T
        with np.errstate(divide="ignore"):
            north = np.arctanh(np.sin(lat)) / np.pi  # of half the square
        return np.column_stack([1 - north, 1 + lon / np.pi]) * (self.rows / 2)

    def read(self, window: Window, rows: int, columns: int) -> Pixels:
        """Paint all tiles of a window, coarse ones first, at a zoom with about so many pixels.

        Where a level has no tile, that of the level above is seen.

        Raises
        ------
        ObsplanError
            A tile cannot be read, or there are too many.
        """
        from PIL import Image

        zoom = self._zoom(window, min(window.rows / rows, window.columns / columns))
        step = 2 ** (self.zooms[1] - zoom)
        part = _coarser(window, step)
        if part.rows * part.columns > MOST_PIXELS:
            raise ObsplanError(
                f"{self.path} has no tiles about the mission that are coarser than zoom {zoom}, "
                "and of that level too many: export it with coarser levels, too"
            )
        canvas = Image.new("RGBA", (part.columns, part.rows))
        self.used.clear()
        for level in range(self.zooms[0], zoom + 1):
            for at, tile in self._tiles(part, level, zoom - level):
                canvas.paste(tile, at)
                self.used.add(level)
        left, upper = window.column / step - part.column, window.row / step - part.row
        box = (left, upper, left + window.columns / step, upper + window.rows / step)
        shape = (min(columns, part.columns), min(rows, part.rows))
        resized = canvas.convert("RGBa").resize(shape, Image.Resampling.BOX, box=box)
        seen = np.asarray(resized, dtype=float)
        known = seen[..., 3] / 255.0
        return Pixels(seen[..., :3] / np.maximum(known, 1e-9)[..., None], known)

    def fineness(self, pixel: float) -> str:
        """Say which levels are drawn, a pixel of the deepest being so long [m]."""
        low, high = min(self.used), max(self.used)
        finest = short(pixel * 2 ** (self.zooms[1] - high))
        levels = f"{low} to {high}" if high > low else f"{high}"
        return f"tiles of zoom {levels} have one every {finest}"

    def _zoom(self, window: Window, coarser: float) -> int:
        """The coarsest level that is fine enough and has a tile in the window."""
        first, deepest = self.zooms
        wanted = max(deepest - int(np.log2(max(coarser, 1.0))), first)
        for zoom in range(wanted, deepest + 1):
            blocks = _blocks(_coarser(window, 2 ** (deepest - zoom)), TILE)
            rows, columns = ([one.start, one.stop - 1] for one in blocks)
            rows = [(1 << zoom) - 1 - row for row in reversed(rows)]
            if self.database.execute(ANY, (zoom, *columns, *rows)).fetchone() is not None:
                return zoom
        return wanted

    def _tiles(
        self, part: Window, level: int, coarser: int
    ) -> Iterator[tuple[tuple[int, int], "Image"]]:
        """Tiles of a level so many above that of the part, and where in the part they begin."""
        size = TILE << coarser
        for row, column in product(*_blocks(part, size)):
            found = self.database.execute(ONE, (level, column, (1 << level) - 1 - row)).fetchone()
            if found is None:
                continue
            tile = self._decoded(found[0], f"the tile {level}/{column}/{row}")
            left, upper = max(part.column - column * size, 0), max(part.row - row * size, 0)
            right = min(part.column + part.columns - column * size, size)
            lower = min(part.row + part.rows - row * size, size)
            across, down = tile.width / size, tile.height / size
            box = (left * across, upper * down, right * across, lower * down)
            at = (left + column * size - part.column, upper + row * size - part.row)
            yield at, tile.resize((right - left, lower - upper), box=box)

    def _decoded(self, content: Any, where: str) -> "Image":
        """A tile's picture."""
        from PIL import Image, UnidentifiedImageError

        try:
            with Image.open(io.BytesIO(content), formats=FORMATS) as image:
                if max(image.size) > WIDEST:
                    raise ObsplanError(
                        f"{self.path}: {where} is {image.width} pixels wide, and no tile is wider "
                        f"than {WIDEST}: export it again"
                    )
                return image.convert("RGBA")
        except UnidentifiedImageError as error:
            raise ObsplanError(
                f"{self.path}: {where} is no picture (PNG, JPEG, WebP): export it as raster tiles"
            ) from error
        except (OSError, ValueError, SyntaxError, TypeError, Image.DecompressionBombError) as error:
            why = visible(str(error))[:100]
            raise ObsplanError(
                f"{self.path}: {where} cannot be read ({why}): it may be damaged, export it again"
            ) from error


def _coarser(window: Window, step: int) -> Window:
    """The window in pixels so many times as large, all that are touched."""
    row, column = window.row // step, window.column // step
    rows = -(-(window.row + window.rows) // step) - row
    return Window(row, column, rows, -(-(window.column + window.columns) // step) - column)


def _blocks(window: Window, size: int) -> tuple[range, range]:
    """Rows and columns of the blocks of a size that a window touches."""
    rows = range(window.row // size, -(-(window.row + window.rows) // size))
    return rows, range(window.column // size, -(-(window.column + window.columns) // size))


@contextmanager
def mbtiles(path: Path) -> Iterator[Tiles]:
    """Open an MBTiles file, which is never written.

    Raises
    ------
    ObsplanError
        The file is damaged, no MBTiles, or has no raster tiles.
    """
    try:
        with closing(_connected(path)) as database:
            yield _opened(path, database)
    except (sqlite3.Error, sqlite3.Warning, OverflowError, UnicodeDecodeError) as error:
        why = visible(str(error))[:200]
        raise ObsplanError(
            f"{path} cannot be read as MBTiles ({why}): it may be damaged, export it again"
        ) from error


def _connected(path: Path) -> sqlite3.Connection:
    """A connection that neither writes, nor waits for ever, nor trusts what the file would run."""
    uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    database = sqlite3.connect(uri, uri=True)
    database.text_factory = lambda content: content.decode(errors="replace")
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
    database.execute("PRAGMA trusted_schema = OFF")
    until = time.monotonic() + PATIENCE
    database.set_progress_handler(lambda: time.monotonic() > until, 100_000)
    return database


def _opened(path: Path, database: sqlite3.Connection) -> Tiles:
    """What its metadata says, where that can be drawn."""
    kinds = dict(database.execute("SELECT name, type FROM sqlite_master"))
    if "tiles" not in kinds:
        raise ObsplanError(f"{path} is a database without tiles, and no MBTiles: export it again")
    told = {}
    if "metadata" in kinds:
        told = dict(database.execute("SELECT name, value FROM metadata LIMIT 1000"))
    if str(told.get("format")).lower() in ("pbf", "mvt"):
        raise ObsplanError(
            f"{path} has vector tiles ({told['format']}), and raster tiles are drawn: export it as "
            "png, jpg or webp"
        )
    zooms = [
        database.execute(f"SELECT {end}(zoom_level) FROM tiles").fetchone()[0]
        for end in ("min", "max")
    ]
    if zooms == [None, None]:
        raise ObsplanError(f"{path} has no tiles: export it again")
    if not all(isinstance(zoom, int) and 0 <= zoom <= DEEPEST for zoom in zooms):
        raise ObsplanError(
            f"{path} has tiles of zoom {visible(repr(zooms[0]))[:40]} to "
            f"{visible(repr(zooms[1]))[:40]}, and zoom is 0 to {DEEPEST}: export it again"
        )
    size = TILE << zooms[1]
    return Tiles(path, database, (zooms[0], zooms[1]), rows=size, columns=size, period=float(size))
