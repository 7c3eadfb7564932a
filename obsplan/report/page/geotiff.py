"""GeoTIFF as a chart, by the optional package rasterio: rendered charts, depths, heights.

Only the file itself is opened: by the driver of GeoTIFF alone, without the files beside it.
"""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.report.page.raster import Pixels, Window, short
from obsplan.spelling import visible
from obsplan.types import ObsplanError

INSTALL = "install it by: pip install 'obsplan[charts]'"
MOST_READ = 300e6  # pixels of all bands: some seconds
MOST_BLOCK = 200e6  # bytes of a block, which is read whole
OPTIONS = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",  # nothing is looked for beside the file
    "GDAL_PAM_ENABLED": "NO",  # nor written there
    "GDAL_CACHEMAX": 256,  # [MB]
}
METRES = ("m", "metre", "metres", "meter", "meters")
PICTURE, GREYS, PALETTE, NUMBERS = "picture", "greys", "palette", "numbers"


@dataclass
class GeoTiff:
    """An open GeoTIFF."""

    path: Path
    dataset: Any  # of rasterio
    rows: int
    columns: int
    period: float | None
    kind: str
    bands: list[int]
    numbers: bool
    unit: str
    said: list[str]

    def places(self, latlon: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Give row and column of latitudes and longitudes [degrees]; nan where there is none."""
        from rasterio.warp import transform

        lat, lon = latlon.T.tolist()
        x, y = transform("EPSG:4326", self.dataset.crs, lon, lat)[:2]
        back = ~self.dataset.transform
        east, north = np.array(x), np.array(y)
        rows = back.d * east + back.e * north + back.f
        return np.column_stack([rows, back.a * east + back.b * north + back.c])

    def read(self, window: Window, rows: int, columns: int) -> Pixels:
        """Read a window at about so many pixels, each the mean of what it covers.

        Raises
        ------
        ObsplanError
            Too much would have to be read for it.
        """
        from rasterio.enums import Resampling

        self._check_cost(window, rows, columns)
        finer = 2 if self.kind == PALETTE else 1  # colours are mixed once they are colours
        shape = [min(finer * n, most) for n, most in zip((rows, columns), window[2:], strict=True)]
        how = Resampling.nearest if self.kind == PALETTE else Resampling.average
        rows_of = (window.row, window.row + window.rows)
        columns_of = (window.column, window.column + window.columns)
        part: dict[str, Any] = {"window": (rows_of, columns_of), "resampling": how}
        given = self.dataset.read(self.bands, out_shape=(len(self.bands), *shape), **part)
        masks = self.dataset.read_masks(self.bands, out_shape=(len(self.bands), *shape), **part)
        known = masks.max(axis=0) / 255.0
        if self.kind == PALETTE:
            return _through_palette(self.dataset.colormap(1), given[0], known)
        values = np.moveaxis(given, 0, -1).astype(float)
        if self.kind == GREYS:
            values = np.repeat(values, 3, axis=-1)
        if self.kind == NUMBERS:
            values = values * self.dataset.scales[0] + self.dataset.offsets[0]
            known = known * (np.abs(values[..., 0]) < np.finfo("f4").max)  # nor nan
            values = np.where(known[..., None] > 0, values, 0.0)
        return Pixels(values, known)

    def fineness(self, pixel: float) -> str:
        """Say how long a pixel of the file is."""
        return f"the file has one every {short(pixel)}"

    def _check_cost(self, window: Window, rows: int, columns: int) -> None:
        """Refuse to read what would take minutes; a file with overviews reads those."""
        coarser = min(window.rows / rows, window.columns / columns)
        overviews = [1, *self.dataset.overviews(1)]
        step = max(factor for factor in overviews if factor <= max(1.2 * coarser, 1.0))
        cost = len(self.bands) * window.rows * window.columns / step**2
        if cost > MOST_READ:
            raise ObsplanError(
                f"{self.path} has {cost / 1e6:.0f} million pixels about the mission, and at most "
                f"{MOST_READ / 1e6:.0f} million are read: give it overviews (gdaladdo -r average "
                f"{self.path.name} 4 16 64), or cut it"
            )


def _through_palette(palette: dict[int, Any], index: np.ndarray, known: np.ndarray) -> Pixels:
    """Colours of a picture that numbers them."""
    table = np.zeros((int(np.iinfo(index.dtype).max) + 1, 4))
    for k, colour in palette.items():
        table[k] = colour
    colours = table[index]
    return Pixels(colours[..., :3], known * colours[..., 3] / 255.0)


@contextmanager
def geotiff(path: Path) -> Iterator[GeoTiff]:
    """Open a GeoTIFF.

    Raises
    ------
    ObsplanError
        The package rasterio is missing; the file is damaged, does not say where on Earth it is, or
        is of a kind that is not drawn.
    """
    try:
        import rasterio
        from rasterio.errors import CRSError, RasterioError
    except ImportError as error:
        raise ObsplanError(
            f"{path} is a GeoTIFF, and the package rasterio is not installed: {INSTALL}"
        ) from error
    whole = path.resolve()
    if str(whole).startswith("/vsi"):
        raise ObsplanError(f"{path} is in a folder whose name begins with /vsi: move it elsewhere")
    try:
        with _quiet(), rasterio.Env(**OPTIONS), rasterio.open(whole, driver="GTiff") as dataset:
            yield _opened(path, dataset)
    except (RasterioError, CRSError, UnicodeDecodeError, MemoryError) as error:
        why = " ".join(visible(str(error.__cause__ or error)).split())[:200]
        raise ObsplanError(
            f"{path} cannot be read as a GeoTIFF ({why}): it may be damaged, export it again"
        ) from error


@contextmanager
def _quiet() -> Iterator[None]:
    """Let GDAL's remarks pass: what matters is raised, and said in one sentence."""
    logger, nobody = logging.getLogger("rasterio"), logging.NullHandler()
    before = logger.propagate, sys.excepthook, sys.unraisablehook
    logger.addHandler(nobody)
    logger.propagate = False
    # rasterio prints a traceback for a remark that is not UTF-8, by both of these
    sys.excepthook = sys.unraisablehook = lambda *_: None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.propagate, sys.excepthook, sys.unraisablehook = before
        logger.removeHandler(nobody)


def _opened(path: Path, dataset: Any) -> GeoTiff:
    """A GeoTIFF that can be drawn."""
    if not dataset.crs or dataset.transform.is_degenerate or dataset.transform.is_identity:
        control = " but by control points" if dataset.gcps[0] else ""
        raise ObsplanError(
            f"{path} does not say where on Earth it is{control}, and files beside it (.tfw, "
            ".aux.xml) are not read: convert it, with gdal_translate -a_srs or gdalwarp"
        )
    for (rows, columns), kind in zip(dataset.block_shapes, dataset.dtypes, strict=True):
        size = rows * columns * np.dtype(kind).itemsize
        if size > MOST_BLOCK:
            raise ObsplanError(
                f"{path} is stored in blocks of {size / 1e6:.0f} MB, each of which is read whole: "
                "convert it, with gdal_translate -co TILED=YES"
            )
    kind, bands, said = _kind(path, dataset)
    return GeoTiff(
        path=path,
        dataset=dataset,
        rows=dataset.height,
        columns=dataset.width,
        period=_period(dataset),
        kind=kind,
        bands=bands,
        numbers=kind == NUMBERS,
        unit=_unit(dataset),
        said=said,
    )


def _unit(dataset: Any) -> str:
    """What the first band's numbers are in; empty where the file does not say."""
    told = visible(str(dataset.units[0] or "")).strip()[:20]
    return "m" if told.lower() in METRES else told


def _kind(path: Path, dataset: Any) -> tuple[str, list[int], list[str]]:
    """What pixels are, in which bands, and what is to be said of that."""
    from rasterio.enums import ColorInterp as Means

    means = list(dataset.colorinterp)
    colours = [means.index(one) + 1 for one in (Means.red, Means.green, Means.blue) if one in means]
    shown = [k for k, one in enumerate(means, start=1) if one != Means.alpha] or [1]
    first = dataset.dtypes[shown[0] - 1]
    if means[0] == Means.palette:
        return PALETTE, [1], _left(shown, 1)
    whole = all(kind == "uint8" for kind in dataset.dtypes)
    if (len(colours) == 3 and not whole) or first.startswith("complex"):
        raise ObsplanError(
            f"{path} has bands of {first} ({', '.join(one.name for one in means[:4])}): export it "
            "as a picture of 8 bits in red, green and blue, or as one band of numbers"
        )
    if whole and len(shown) >= 3:
        bands = colours if len(colours) == 3 else shown[:3]
        return PICTURE, bands, _left(shown, 3)
    plain = dataset.scales[0] == 1 and dataset.offsets[0] == 0 and not dataset.units[0]
    if whole and plain:
        return GREYS, shown[:1], ["Its one band of 8 bits is drawn in greys.", *_left(shown, 1)]
    said = _left(shown, 1)
    if all("all_valid" in {flag.name for flag in flags} for flags in dataset.mask_flag_enums[:1]):
        said.append("The file names no value that stands for nothing measured.")
    return NUMBERS, shown[:1], said


def _left(shown: list[int], drawn: int) -> list[str]:
    """What is said of bands that are not drawn."""
    if len(shown) <= drawn:
        return []
    which = "the first is" if drawn == 1 else f"the first {drawn} are"
    return [f"Of its {len(shown)} bands {which} drawn."]


def _period(dataset: Any) -> float | None:
    """Columns around the Earth, of a raster whose columns are meridians."""
    across = dataset.transform.a
    if dataset.transform.d != 0 or across <= 0:
        return None
    if dataset.crs.is_geographic:
        around = 2 * np.pi / dataset.crs.units_factor[1]
    elif dataset.crs.to_epsg() == 3857:
        around = 2 * np.pi * 6_378_137.0
    else:
        return None
    return float(around / across)
