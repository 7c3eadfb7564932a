"""Colours of numbers on a chart, depths say: even steps that colour-blind readers tell apart."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import UInt8

if TYPE_CHECKING:
    from obsplan.report.page.raster import Pixels

NOTHING = 255  # the colour of what is not known: none
USUAL = (0.01, 0.99)  # quantiles at which colours begin and end: one wrong number is no scale
ABOVE = 64  # colours of numbers above zero, where there are numbers below
SWATCHES = 12  # of the key
GREYS = (0.45, 0.95)  # of land


class Shades(NamedTuple):
    """Numbers as indices into a palette, its key, and what is to be said of it."""

    steps: UInt8[np.ndarray, "rows columns"]
    palette: UInt8[np.ndarray, "256 3"]
    key: dict[str, Any]
    said: list[str]


def shades_of(found: "Pixels", name: str, unit: str) -> Shades:
    """Colour numbers from low, dark, to high; where they change sign, those above zero in greys.

    The map is viridis: perceptually uniform, and safe for colour-blind readers. Greys are none of
    its colours, and are darkest where it is lightest, so that a coast is seen.
    """
    values, known = found.values[..., 0], found.known >= 0.5
    given = values[known] if known.any() else values[found.known > 0]
    low, high = (float(end) for end in np.quantile(given, USUAL))
    if not high > low:
        low, high = float(given.min()), float(given.max())
    index = np.full(values.shape, NOTHING, dtype="u1")
    palette = np.zeros((256, 3), dtype="u1")
    crosses = bool(low < 0 < high)
    below = NOTHING - ABOVE if crosses else NOTHING  # so many colours has the map
    palette[:below] = _colours("viridis", np.linspace(0.0, 1.0, below))
    palette[below:NOTHING] = _colours("gray", np.linspace(*GREYS, NOTHING - below))
    index[known] = _steps(values[known], low, 0.0 if crosses else high, below)
    if crosses:
        land = known & (values > 0)
        index[land] = below + _steps(values[land], 0.0, high, ABOVE)
    reach = f"{_number(low)} to {_number(high)}{f' {unit}' if unit else ''}"
    colours = [_hex(palette[k]) for k in _swatches(below, crosses)]
    key = {"colours": colours, "text": f"{name}: {reach}"}
    return Shades(index, palette, key, _said(given, reach, unit, crosses))


def _steps(values: np.ndarray, low: float, high: float, count: int) -> np.ndarray:
    """Which of so many steps from low to high each value is on; all on one if there is no range."""
    share = (values - low) / (high - low) if high > low else np.full(values.shape, 0.5)
    return np.clip(np.floor(share * count), 0, count - 1).astype("u1")


def _swatches(below: int, crosses: bool) -> list[int]:
    """Indices of the colours that the key shows."""
    grey = SWATCHES // 3 if crosses else 0
    shown = np.linspace(0, below - 1, SWATCHES - grey)
    greys = np.linspace(below, NOTHING - 1, grey)
    return [*shown.astype(int).tolist(), *greys.astype(int).tolist()]


def _said(given: np.ndarray, reach: str, unit: str, crosses: bool) -> list[str]:
    """What the colours mean, and what is not known of them."""
    ends = f"{_number(float(given.min()))} and {_number(float(given.max()))}"
    of_unit = "" if unit else ", in a unit that the file does not say"
    said = [f"Colours go from {reach}{of_unit}, dark where low; drawn values are between {ends}."]
    if crosses:
        said.append(
            "Those above 0 are grey: land, if the file counts upwards, and water if it counts "
            "depth."
        )
    return said


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}".replace("-", "−")


def _colours(name: str, at: np.ndarray) -> np.ndarray:
    from matplotlib import colormaps

    return colormaps[name](at, bytes=True)[:, :3]


def _hex(colour: np.ndarray) -> str:
    return "#" + "".join(f"{part:02x}" for part in colour.tolist())
