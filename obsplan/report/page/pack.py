"""Numbers in a page: typed arrays as base64, thinned so that a page stays small."""

import json
from base64 import b64encode
from typing import Any

import numpy as np
from jaxtyping import Float, Integer

from obsplan.report.style import outline

MOST_VERTICES = 6000  # of a track on a map
FINEST = 1 / 2000  # of the map's longer side: what a track may be off by, half a pixel

Packed = dict[str, str]


def packed(values: Any) -> Packed:
    """Numbers as little-endian 32-bit floats in base64, which a browser reads at once."""
    flat = np.ascontiguousarray(values, dtype="<f4")
    return {"f4": b64encode(flat.tobytes()).decode()}


def packed_bytes(values: Any) -> Packed:
    """Whole numbers from 0 to 255 in base64."""
    flat = np.ascontiguousarray(values, dtype="u1")
    return {"u1": b64encode(flat.tobytes()).decode()}


def as_script(data: Any) -> str:
    """JSON that is safe within an HTML element: no character in it ends or begins one."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def line(time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]) -> dict[str, Packed]:
    """A line over time, thinned so that no spike is lost; what is not known is left out."""
    known = np.isfinite(values)
    time, values = time[known], values[known]
    shown = outline(values)
    return {"t": packed(time[shown]), "y": packed(values[shown])}


def chosen_frames(samples: int, most: int) -> Integer[np.ndarray, " frames"]:
    """Samples that are played back: all, or as many, evenly apart, and the last."""
    every = -(-samples // most)
    return np.unique(np.append(np.arange(0, samples, every), samples - 1))


def track(places: Float[np.ndarray, "n 2"], side: float) -> dict[str, Packed]:
    """A track on a map whose longer side is so long [m], with no more corners than it shows."""
    import shapely

    places = places[np.isfinite(places).all(axis=1)]
    tolerance = FINEST * side
    while len(places) > 1:
        drawn = shapely.LineString(places).simplify(tolerance, preserve_topology=False)
        corners = shapely.get_coordinates(drawn)
        if len(corners) <= MOST_VERTICES:
            places = corners
            break
        tolerance *= 2
    return {"x": packed(places[:, 0]), "y": packed(places[:, 1])}
