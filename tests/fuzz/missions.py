"""Mission files that are wrong or extreme, by seed: a sound one of each format, mutated."""

import json
import random
import re
from collections.abc import Iterator

ITEM = {"type": "SimpleItem", "command": 16, "frame": 3, "autoContinue": True, "doJumpId": 1}
PLAN = {
    "fileType": "Plan",
    "version": 1,
    "groundStation": "QGroundControl",
    "geoFence": {
        "version": 2,
        "circles": [
            {"circle": {"center": [47.6, -122.3], "radius": 500.0}, "inclusion": True, "version": 1}
        ],
        "polygons": [
            {
                "inclusion": False,
                "polygon": [[47.61, -122.3], [47.611, -122.3], [47.611, -122.301]],
                "version": 1,
            }
        ],
    },
    "rallyPoints": {"points": [], "version": 2},
    "mission": {
        "version": 2,
        "cruiseSpeed": 1.5,
        "hoverSpeed": 1.5,
        "firmwareType": 12,
        "vehicleType": 10,
        "plannedHomePosition": [47.6, -122.3, 0],
        "items": [
            {**ITEM, "params": [0, 0, 0, None, 47.6, -122.3, 0]},
            {**ITEM, "command": 178, "params": [1, 1.2, -1, 0, 0, 0, 0]},
            {**ITEM, "params": [5.0, 0, 0, None, 47.601, -122.3, 0]},
            {**ITEM, "command": 18, "params": [2, 0, 20, 0, 47.601, -122.301, 0]},
            {**ITEM, "command": 177, "params": [1, 2, 0, 0, 0, 0, 0]},
        ],
    },
}
GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {
                "name": "a",
                "speed_mps": [1.0, 1.2],
                "hold_s": [0, 5, 0],
                "time_s": [0, 100, 300],
            },
            "geometry": {
                "type": "LineString",
                "coordinates": [[-122.3, 47.6, -3], [-122.301, 47.6, -3], [-122.301, 47.601, -3]],
            },
        },
        {
            "type": "Feature",
            "properties": {"name": "keep-out wreck", "radius_m": 30.0},
            "geometry": {"type": "Point", "coordinates": [-122.302, 47.602]},
        },
        {
            "type": "Feature",
            "properties": {"name": "geofence"},
            "geometry": {
                "type": "Polygon",
                "coordinates": [[[-122.4, 47.5], [-122.2, 47.5], [-122.2, 47.7], [-122.4, 47.5]]],
            },
        },
    ],
}
WPL = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.6\t-122.3\t0\t1
1\t0\t3\t16\t5\t0\t0\t0\t47.601\t-122.3\t0\t1
2\t0\t3\t178\t1\t1.5\t-1\t0\t0\t0\t0\t1
3\t0\t3\t18\t2\t0\t20\t0\t47.602\t-122.301\t0\t1
4\t0\t3\t5001\t3\t0\t0\t0\t47.61\t-122.3\t0\t1
5\t0\t3\t5001\t3\t0\t0\t0\t47.61\t-122.31\t0\t1
6\t0\t3\t5001\t3\t0\t0\t0\t47.6\t-122.31\t0\t1
"""
GPX = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">
<rte><name>r</name><rtept lat="47.6" lon="-122.3"><ele>-2</ele></rtept><rtept lat="47.601" lon="-122.3"><ele>-2</ele></rtept></rte>
<trk><name>t</name><trkseg><trkpt lat="47.6" lon="-122.3"><time>2026-05-01T08:00:00Z</time></trkpt>
<trkpt lat="47.601" lon="-122.301"><time>2026-05-01T08:02:00Z</time></trkpt></trkseg></trk></gpx>
"""
KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><Folder><name>f</name>
<Placemark><name>a</name><LineString><altitudeMode>absolute</altitudeMode>
<coordinates>-122.3,47.6,-2 -122.301,47.6,-2 -122.301,47.601,-2</coordinates></LineString></Placemark>
<Placemark><name>b</name><gx:Track><when>2026-05-01T08:00:00Z</when><when>2026-05-01T08:02:00Z</when>
<gx:coord>-122.3 47.6 0</gx:coord><gx:coord>-122.3 47.601 0</gx:coord></gx:Track></Placemark>
<Placemark><name>keep-out</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
-122.31,47.6 -122.311,47.6 -122.311,47.601 -122.31,47.6</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
</Folder></Document></kml>
"""
CSV = """track,lat,lon,depth_m,speed_mps,hold_s,time_s
a,47.60001,-122.30011,3,1.1,0,0
a,47.60111,-122.30012,3,1.1,5,120
a,47.60112,-122.30123,3,1.1,0,240
"""
METRES = "x;y\n0,5;0,25\n40,5;0,25\n40,5;10,75\n0,5;10,75\n"
WKT = 'name,wkt\na,"LINESTRING (-122.3 47.6, -122.301 47.6, -122.301 47.601)"\nkeep-out,"POLYGON ((0 0, 1 0, 1 1, 0 0))"\n'
ANGLES = "lat,lon\n47°36'00\"N,122°18'00\"W\n47°36'10\"N,122°18'00\"W\n47°36'10\"N,122°18'10\"W\n"
MOOS = """Behavior = BHV_Waypoint
{
  name   = survey
  speed  = 1.2
  repeat = 1
  points = format=lawnmower, label=s, x=80, y=-80, width=60, height=30, lane_width=8, rows=north-south, degs=80
}
Behavior = BHV_Waypoint
{
  name = other
  points = pts={0,0:50,0:50,-20}
}
Behavior = BHV_OpRegion
{
  polygon = pts={-100,-200:200,-200:200,100:-100,100}
}
"""
SOUND: dict[str, list[str]] = {
    ".plan": [json.dumps(PLAN, indent=1)],
    ".geojson": [json.dumps(GEOJSON)],
    ".waypoints": [WPL],
    ".gpx": [GPX],
    ".kml": [KML],
    ".csv": [CSV, METRES, WKT, ANGLES],
    ".bhv": [MOOS],
}
TOKENS = [
    *(
        "0",
        "-1",
        "1e308",
        "-1e308",
        "1e-308",
        "nan",
        "inf",
        "-inf",
        "9" * 30,
        "9" * 5000,
        "1_0",
        "0x10",
        "1e",
        "",
        " ",
        "null",
        "true",
        "[]",
    ),
    *(
        "{}",
        "91",
        "181",
        "361",
        "1e5",
        "1e6",
        "2147483648",
        "65536",
        "99999",
        "-0.0",
        "47.6",
        "٣",
        "1,5",
        "1.2.3",
        '"',
        "'",
        "\x1b[31m",
        "\x00",
    ),
    *(
        "\r",
        "\n",
        ",",
        ";",
        "=1+1",
        "[" * 600,
        "]" * 5,
        "<a>" * 600,
        "{" * 600,
        "x" * 300,
        "&lt;",
        "&x;",
        "<!DOCTYPE a>",
        "\ufeff",
        "é",
        "//",
        "#",
    ),
]
LONGEST = 3_000_000  # letters of a text whose lines are repeated
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def missions(seed: int, count: int) -> Iterator[tuple[str, bytes]]:
    """So many mutated files: the suffix and the content."""
    rng = random.Random(seed)
    for _ in range(count):
        suffix = rng.choice(list(SOUND))
        text = rng.choice(SOUND[suffix])
        for _ in range(rng.choice((1, 1, 2, 3))):
            text = mutated(text, rng)
        content = text.encode("utf-8", "surrogatepass")
        if rng.random() < 0.1 and content:
            at = rng.randrange(len(content))
            content = content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :]
        yield suffix, content


def mutated(text: str, rng: random.Random) -> str:
    """A text with one place changed."""
    kind = rng.random()
    numbers = list(_NUMBER.finditer(text))
    if kind < 0.45 and numbers:
        number = rng.choice(numbers)
        return text[: number.start()] + rng.choice(TOKENS) + text[number.end() :]
    at = rng.randrange(len(text) + 1)
    if kind < 0.6:
        return text[:at]
    if kind < 0.75:
        return text[:at] + rng.choice(TOKENS) + text[at:]
    lines = text.splitlines(keepends=True)
    i = rng.randrange(max(len(lines), 1))
    if kind < 0.85:
        return "".join(lines[:i] + lines[i + 1 :])
    if kind < 0.95:
        repeated = lines[i : i + 1] * rng.choice((2, 50, 3000))
        longer = "".join(lines[:i] + repeated + lines[i + 1 :])
        return longer if len(longer) < LONGEST else text
    end = min(at + rng.choice((1, 5, 100)), len(text))
    return text[:at] + text[end:]
