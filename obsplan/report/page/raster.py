"""A picture under the map of a page: what a raster has of the ground about a mission.

The places of a coarse grid of nodes are transformed one by one, and pixels between them linearly:
50 km from the origin that is off by less than 0.3 m at 60 degrees of latitude, within 5 km by less
than 3 mm. GDAL's own warp is not asked, since it loses what lies beyond 180 degrees.
"""

import io
from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from obsplan import geo
from obsplan.report.page.shades import NOTHING, Shades, shades_of
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    from PIL.Image import Image

MOST_PIXELS = 1600  # of a picture's longer side: about two for each that a screen has
FEWEST_PIXELS = 200  # where the file has few, so that those drawn stand where they are
LEAST_PIXELS = 8  # of the longer side of a picture that had to be made small
FINER = 4.0  # times as fine as the file, at most
NODES = 33  # on each side of the grid
COLOURS = 255  # of a picture that is too large in all its colours; one more is nothing at all


class Frame(NamedTuple):
    """A rectangle in the plane tangent at the origin."""

    origin: tuple[float, float]  # latitude and longitude [degrees]
    low: Float[np.ndarray, " 2"]  # east and north [m]
    high: Float[np.ndarray, " 2"]


class Window(NamedTuple):
    """Some rows and columns of a raster, the last not among them."""

    row: int
    column: int
    rows: int
    columns: int


class Pixels(NamedTuple):
    """What is read of a window: at most as fine as the raster."""

    values: Float[np.ndarray, "rows columns bands"]  # red, green, blue (0 to 255), or a number
    known: Float[np.ndarray, "rows columns"]  # which share of a pixel it has


@runtime_checkable
class Raster(Protocol):
    """An open file of pixels that knows where on Earth they are."""

    path: Path
    rows: int
    columns: int
    period: float | None  # columns around the Earth, where these go on at 180 degrees
    numbers: bool  # whether pixels hold a number each, and no colours
    unit: str  # of numbers, as the file says it; may be empty
    said: list[str]  # sentences on what of it is read

    def places(self, latlon: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Give row and column, counted from the corner, of latitudes and longitudes [degrees]."""
        ...

    def read(self, window: Window, rows: int, columns: int) -> Pixels:
        """Read a window at about so many pixels."""
        ...

    def fineness(self, pixel: float) -> str:
        """Say how fine that is of which the picture was made, a pixel being so long [m]."""
        ...


class Picture(NamedTuple):
    """What the page draws, and what is to be said of it; nothing where the raster is not near."""

    drawn: dict[str, Any] | None
    notes: list[str]


def picture_of(raster: Raster, frame: Frame, most: int) -> Picture:
    """Draw a raster into a frame, in at most so many bytes of the page.

    Raises
    ------
    ObsplanError
        The raster cannot be read, or placed.
    """
    span = frame.high - frame.low
    nodes = _nodes(raster, frame)
    pixel = _pixel(nodes, span, raster.path)
    longest = float(span.max())
    finest = max(longest / MOST_PIXELS, min(longest / FEWEST_PIXELS, pixel.mean / FINER))
    while True:
        rows, columns = (max(round(float(side) / finest), 1) for side in span[::-1])
        found = _sampled(raster, nodes, pixel, Window(0, 0, rows, columns), span)
        if not (found.known > 0).any():
            return Picture(None, [])
        shades = shades_of(found, raster.path.name, raster.unit) if raster.numbers else None
        content, said = _encoded(found, shades, most)
        if len(content) <= most or longest / finest <= LEAST_PIXELS:
            break
        finest *= max(1.1, (len(content) / most) ** 0.5)
    at = dict(zip(("x", "y", "w", "h"), [*frame.low.tolist(), *span.tolist()], strict=True))
    url = f"data:image/png;base64,{content}"
    notes = [
        f"It has a pixel every {short(finest)}{said}; {raster.fineness(pixel.mean)}.",
        *raster.said,
    ]
    if shades is None:
        return Picture({"url": url, **at}, notes)
    return Picture({"url": url, **at, "key": shades.key}, [*notes, *shades.said])


def _nodes(raster: Raster, frame: Frame) -> Float[np.ndarray, "nodes nodes 2"]:
    """Row and column of the raster at each node, northern nodes first."""
    (west, south), (east, north) = frame.low, frame.high
    plane = np.meshgrid(np.linspace(west, east, NODES), np.linspace(north, south, NODES))
    latlon = geo.to_geographic(np.stack(plane, axis=-1).reshape(-1, 2), frame.origin)
    nodes = raster.places(latlon).reshape(NODES, NODES, 2)
    if not np.isfinite(nodes).all():
        raise ObsplanError(
            f"{raster.path} cannot be drawn in the plane about {frame.origin[0]:g}, "
            f"{frame.origin[1]:g} degrees, where its projection has no place: export it in "
            "another projection"
        )
    if raster.period is not None:
        columns = nodes[..., 1]
        middle = columns[NODES // 2, NODES // 2]
        half = raster.period / 2
        nodes[..., 1] = middle % raster.period + (columns - middle + half) % raster.period - half
    return nodes


class _Pixel(NamedTuple):
    """How large a pixel of the raster is on the ground [m]."""

    row: float  # from one row to the next
    column: float
    mean: float


def _pixel(
    nodes: Float[np.ndarray, "nodes nodes 2"], span: Float[np.ndarray, " 2"], path: Path
) -> _Pixel:
    """The size of a pixel in the middle of the frame."""
    k = NODES // 2
    step = span / (NODES - 1)
    per_metre = np.stack(
        [
            (nodes[k, k + 1] - nodes[k, k - 1]) / (2 * step[0]),
            (nodes[k - 1, k] - nodes[k + 1, k]) / (2 * step[1]),
        ],
        axis=-1,
    )
    density = abs(float(np.linalg.det(per_metre)))
    if not 0 < density < np.inf:
        raise ObsplanError(f"{path} has pixels without an extent: export it again")
    row, column = np.linalg.norm(np.linalg.inv(per_metre), axis=0)
    return _Pixel(float(row), float(column), density**-0.5)


def _sampled(
    raster: Raster,
    nodes: Float[np.ndarray, "nodes nodes 2"],
    pixel: _Pixel,
    image: Window,
    span: Float[np.ndarray, " 2"],
) -> Pixels:
    """The raster at each pixel of an image that fills the frame."""
    down, across = _between(image.rows), _between(image.columns)
    row, column = (down @ nodes[..., k] @ across.T for k in (0, 1))
    finest = float(span.max()) / max(image.rows, image.columns)
    values = np.zeros((image.rows, image.columns, 1 if raster.numbers else 3))
    known = np.zeros((image.rows, image.columns))
    for turn in (0.0,) if raster.period is None else (-raster.period, 0.0, raster.period):
        window = _window(raster, row, column + turn)
        if window is None:
            continue
        rows = max(round(window.rows * min(1.0, pixel.row / finest)), 1)
        columns = max(round(window.columns * min(1.0, pixel.column / finest)), 1)
        part = _at(raster, window, raster.read(window, rows, columns), row, column + turn)
        values[part.known > known] = part.values[part.known > known]
        known = np.maximum(known, part.known)
    return Pixels(values, known)


def _between(count: int) -> Float[np.ndarray, "count nodes"]:
    """Weights of the nodes at the middles of so many pixels along a side: linear."""
    at = (np.arange(count) + 0.5) / count * (NODES - 1)
    return np.maximum(1.0 - np.abs(at[:, None] - np.arange(NODES)), 0.0)


def _window(
    raster: Raster, row: Float[np.ndarray, "r c"], column: Float[np.ndarray, "r c"]
) -> Window | None:
    """What of a raster holds the given places, and a pixel more; None if it has none of them."""
    first = [max(int(np.floor(at.min())) - 1, 0) for at in (row, column)]
    ends = zip((row, column), (raster.rows, raster.columns), strict=True)
    last = [min(int(np.ceil(at.max())) + 1, size) for at, size in ends]
    rows, columns = last[0] - first[0], last[1] - first[1]
    return Window(first[0], first[1], rows, columns) if rows > 0 and columns > 0 else None


def _at(
    raster: Raster,
    window: Window,
    read: Pixels,
    row: Float[np.ndarray, "r c"],
    column: Float[np.ndarray, "r c"],
) -> Pixels:
    """What was read of a window, bilinearly at places within the raster.

    What is not known has no weight.
    """
    from scipy.ndimage import map_coordinates

    inside = (row >= 0) & (row < raster.rows) & (column >= 0) & (column < raster.columns)
    size = read.known.shape
    at = np.stack(
        [
            (row - window.row) * (size[0] / window.rows) - 0.5,
            (column - window.column) * (size[1] / window.columns) - 0.5,
        ]
    )
    known = map_coordinates(read.known, at, order=1, mode="nearest") * inside
    known[known < 1e-3] = 0.0  # a weight to divide by
    bands = [
        map_coordinates(band * read.known, at, order=1, mode="nearest")
        for band in np.moveaxis(read.values, -1, 0)
    ]
    weight = np.where(known > 0, known, np.inf)[..., None]
    return Pixels(np.stack(bands, axis=-1) / weight, known)


def _encoded(found: Pixels, shades: Shades | None, most: int) -> tuple[str, str]:
    """A PNG in base64, and what had to be given up so that it is small."""
    from PIL import Image

    if shades is not None:
        image = Image.fromarray(shades.steps)
        image.putpalette(shades.palette.tobytes())
        return _png(image, transparency=NOTHING), ""
    rgb = Image.fromarray(np.clip(np.round(found.values), 0, 255).astype("u1"))
    whole = rgb.copy()
    whole.putalpha(Image.fromarray(np.round(255 * found.known).astype("u1")))
    content = _png(whole)
    if len(content) <= most:
        return content, ""
    few = rgb.quantize(COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    index = np.where(found.known < 0.5, COLOURS, np.asarray(few)).astype("u1")
    image = Image.fromarray(index)
    image.putpalette(bytes(few.getpalette() or []).ljust(3 * (COLOURS + 1), b"\0"))
    return _png(image, transparency=COLOURS), f", in {COLOURS} colours"


def _png(image: "Image", **options: Any) -> str:
    """An image as the page holds it."""
    file = io.BytesIO()
    image.save(file, format="PNG", optimize=True, **options)
    return b64encode(file.getvalue()).decode()


def short(length: float) -> str:
    """A length [m] to three figures."""
    return f"{length:.3g} m" if length < 1000 else f"{length:.0f} m"
