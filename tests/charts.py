"""Charts by hand: GeoTIFF by rasterio, MBTiles by sqlite3, and pictures of pages read back."""

import base64
import io
import sqlite3

import numpy as np
from PIL import Image

from obsplan.report.page.raster import Frame

SEATTLE = (47.6, -122.3)


def frame(origin=SEATTLE, half=500.0):
    """A square about an origin, so far [m] to each side; charts go twice as far."""
    return Frame(origin, np.full(2, -half), np.full(2, half))


def grid(west, north, step):
    """Square pixels, the first at the north-west corner."""
    from rasterio.transform import Affine

    return Affine(step, 0.0, west, 0.0, -step, north)


def geotiff(path, values, crs, transform, *, palette=None, units=None, **more):
    """Write bands (bands, rows, columns) as a GeoTIFF."""
    import rasterio

    values = np.atleast_3d(values)
    count, height, width = values.shape
    size = {"count": count, "height": height, "width": width}
    with rasterio.open(
        path, "w", "GTiff", crs=crs, transform=transform, dtype=values.dtype, **size, **more
    ) as file:
        file.write(values)
        if palette is not None:
            file.write_colormap(1, palette)
        if units is not None:
            file.units = [units] * count
    return path


def mbtiles(path, tiles, *, kind="PNG", told=()):
    """Write pictures by zoom, column and row (from the north) as MBTiles."""
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
    database.execute(
        "CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB)"
    )
    told = {"name": "chart", "format": kind.lower(), **dict(told)}
    database.executemany("INSERT INTO metadata VALUES (?, ?)", told.items())
    for (zoom, column, row), image in tiles.items():
        content = image
        if not isinstance(image, bytes | str):
            file = io.BytesIO()
            image.save(file, kind)
            content = file.getvalue()
        place = (zoom, column, 2**zoom - 1 - row)
        database.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (*place, content))
    database.commit()
    database.close()
    return path


def decoded(picture):
    """A picture of a page as red, green, blue, alpha (rows, columns, 4)."""
    mark = "data:image/png;base64,"
    assert picture["url"].startswith(mark)
    image = Image.open(io.BytesIO(base64.b64decode(picture["url"][len(mark) :])))
    assert image.format == "PNG"
    return np.asarray(image.convert("RGBA")).astype(int)


def place_of(picture, weight):
    """East and north [m] of the middle of what has weight in a picture."""
    row, column = (np.average(k, weights=weight) + 0.5 for k in np.indices(weight.shape))
    rows, columns = weight.shape
    east = picture["x"] + picture["w"] * column / columns
    return np.array([east, picture["y"] + picture["h"] * (1 - row / rows)])
