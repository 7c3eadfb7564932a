"""Mission files for tests: a survey in every format, and damage to them."""

import json

import numpy as np
import pytest

from obsplan.missions import Mission, read_mission, to_local
from obsplan.types import ObsplanError

ORIGIN = (47.629, -122.337)
TRACK = [(47.629, -122.337), (47.631, -122.337), (47.631, -122.336)]
LONLAT = [[lon, lat] for lat, lon in TRACK]

# a lawnmower of 240 m legs, 40 m apart, and where it lies
LAWN = [[0, 0], [0, 240], [40, 240], [40, 0], [80, 0], [80, 240]]
NORTH, SOUTH = 63.44215307, 63.44
LAWN_LATLON = [
    (SOUTH, 10.4),
    (NORTH, 10.4),
    (NORTH, 10.40080146),
    (SOUTH, 10.40080146),
    (SOUTH, 10.40160293),
    (NORTH, 10.40160293),
]
ROUNDED = 0.02  # [m]; 1e-8 degrees are 1 mm, and the plane turns by 1e-5 rad over 40 m at 63.4 degrees: 80 m by 240 m


def line(coordinates=LONLAT, **properties):
    """A GeoJSON feature with a line."""
    return feature("LineString", coordinates, **properties)


def feature(shape, coordinates, **properties):
    """A GeoJSON feature."""
    geometry = {"type": shape, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def collection(*features):
    """A GeoJSON feature collection."""
    return {"type": "FeatureCollection", "features": list(features)}


def write(folder, name, content):
    """Write text, bytes or JSON under a name; give the path."""
    path = folder / name
    if not isinstance(content, (bytes, str)):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read(folder, name, content) -> Mission:
    """Read what has been written under a name."""
    return read_mission(write(folder, name, content))


def check_lawn(mission, name):
    """A mission is the lawnmower alone, under a name."""
    assert list(mission.tracks) == [name]
    local = to_local(mission).tracks[name].points
    np.testing.assert_allclose(local, LAWN, rtol=0, atol=ROUNDED)


def check_one_sentence(message):
    """A message is one line, without a full stop inside."""
    assert "\n" not in message
    assert ". " not in message


def check_refused(folder, name, content, message):
    """A file is refused in one sentence that names it and matches the message."""
    path = write(folder, name, content)
    with pytest.raises(ObsplanError, match=message) as caught:
        read_mission(path)
    check_one_sentence(str(caught.value).replace(str(path), "FILE"))
    assert str(path) in str(caught.value)


def check_survives_damage(folder, name, content):
    """Damaged copies of a file give a mission or our error, whatever the damage."""
    rng = np.random.default_rng(10)
    outcomes, messages = set(), []
    for _ in range(100):
        path = write(folder, name, damaged(content, rng))
        try:
            outcomes.add(type(read_mission(path)))
        except ObsplanError as error:
            outcomes.add(ObsplanError)
            messages.append(str(error))
    assert not [message for message in messages if "\n" in message]
    assert outcomes == {Mission, ObsplanError}  # the damage is neither nothing nor everything


def damaged(content: bytes, rng) -> bytes:
    """Flip bytes, cut, swap or repeat parts, or put in what parsers trip over."""
    data = bytearray(content)
    first, second, third = sorted(rng.integers(0, len(data), size=3).tolist())
    match rng.integers(8):
        case 0:
            for i in rng.integers(0, len(data), size=rng.integers(1, 6)):
                data[i] = rng.integers(256)
        case 1:
            del data[first:]
        case 2:
            data[first:third] = data[second:third] + data[first:second]
        case 3:
            data[second:second] = data[first:second]
        case 4:
            del data[first:second]
        case 5:
            tokens = [b"nan", b"1e999", b"<", b'"', b"{", b"}", b"\x00", b"99999999999", b"&a;"]
            data[first : first + 3] = tokens[rng.integers(len(tokens))]
        case _:  # other numbers, in a file that stays whole
            digits = [i for i, byte in enumerate(data) if chr(byte).isdigit()]
            for i in rng.choice(digits or [0], size=3):
                data[i] = rng.choice(list(b"0123456789" * 3 + b".-e,"))
    return bytes(data)
