"""Claims about plans and waypoint files that are wrong, or damaged."""

import json
import random
import re
import time

import numpy as np
import pytest
from mavlink_files import (
    FORMATS,
    RING,
    A,
    B,
    C,
    D,
    both_formats,
    check_one_sentence,
    corners,
    fence,
    fly,
    go,
    item,
    jump,
    plan,
    simple,
    speed,
    track,
    wpl,
    write,
)

from obsplan.missions import read_mission
from obsplan.missions.mavlink import items
from obsplan.types import ObsplanError


def bad(*mission_items, **others):
    """The same fault in both formats."""
    return {name: write(*mission_items, **others) for name, write in FORMATS.items()}


ROW = "1\t0\t3\t16\t0\t0\t0\t0\t63.44\t10.4\t0\t1\n"
HUGE = "9" * 5000
BOTH = {
    "local frame": (bad(item(16, A, frame=1)), r"frame, must be global \(one of 0, 3, .*, got 1"),
    "half a place": (bad(item(16, (63.44, None))), r"longitude \(parameter 6\), must be"),
    "infinite place": (bad(item(16, (63.44, float("inf")))), "must be a finite number, got inf"),
    "swapped": (bad(item(16, (-122.3, 47.6))), "look swapped: exchange them, latitude comes first"),
    "not on Earth": (bad(item(16, (63.44, 400))), "longitude 400.0, beyond 360"),
    "metres": (bad(item(16, (550000, 5275000))), "beyond 90 degrees: give WGS 84"),
    "endless hold": (bad(item(16, A, 1e9)), r"time to hold \(parameter 1\), must be from 0 to"),
    "negative hold": (bad(item(16, A, -1)), "time to hold .* must be from 0 to 604800, got -1"),
    "endless delay": (bad(*go(A), item(93, A, 1e9)), "delay .* must be from -1 to 604800"),
    "wide circle": (bad(item(18, A, 1, 0, 1e6)), r"radius \(parameter 3\), must be from -10000"),
    "many turns": (bad(item(18, A, 1e6, 0, 10)), "number of turns .* from 0 to 1000"),
    "infinite turns": (bad(item(18, A, float("inf"), 0, 9)), "turns .* must be a finite number"),
    "in space": (bad(item(16, A, altitude=1e7)), r"altitude \(parameter 7\), must be from"),
    "infinite speed": (bad(*go(A, B), speed(float("inf"))), "speed .* must be a finite number"),
    "unknown speed": (bad(*go(A, B), speed(1, 9)), "type of speed .* must be from 0 to 3, got 9"),
    "jump to nowhere": (bad(*go(A), jump(-4, 1)), "target .* must be from 0 to 65535, got -4"),
    "many repeats": (bad(*go(A), jump(1, 1e9)), "repeat count .* from -1 to 65535"),
    "many commands": (bad(item(70000, A)), "command,? must be a whole number from 0 to 65535"),
    "part of a command": (bad(item(16.5, A)), "command,? must be a whole number .* got 16.5"),
    "no command": (bad(item(-16, A)), "command,? must be a whole number .* got -16"),
    "fence with a corner missing": (
        bad(*corners(5001, *RING)[:3]),
        "begins a fence of 4 corners, of which 3 follow: save the fence again",
    ),
    "fence of two corners": (bad(*corners(5002, A, B)), "fence of fewer than three corners"),
    "fence without a place": (bad(item(5003, (0, 0), 5)), "part of a fence without a place"),
    "fence without a radius": (bad(item(5004, A, 0)), "radius, must be positive and at most"),
    "identical waypoints": (bad(*go(A, A)), 'no line to follow .*track "a" has a single place'),
    "nothing": (bad(), "holds no line to follow"),
}
PLANS = {
    "geojson": ({"features": []}, "not a QGroundControl plan .*rename it to .geojson"),
    "other": ({"fileType": "Fence"}, "\"fileType\" is 'Fence'.*save it from QGroundControl"),
    "no mission": ({"fileType": "Plan"}, "has no list mission.items"),
    "cut short": (json.dumps(plan(*go(A)))[:-9], r"not valid JSON \(line 1, column \d+: .*cut"),
    "huge number": (
        json.dumps(plan(*go(A))).replace("63.44", HUGE),
        "is not JSON that can be read",
    ),
    "deep": ('{"fileType":"Plan","mission":{"items":' + "[" * 100_000, "nested too deeply"),
    "item not an object": (
        plan(*go(A), mission={"items": [5]}),
        r"mission.items\[0\] must be an object, got int",
    ),
    "item of no kind": ({**plan({"command": 16})}, r'type must be "SimpleItem" or "ComplexItem"'),
    "command of no kind": (
        plan({"type": "SimpleItem", "command": "go", "params": []}),
        r"items\[0\].command must be a number, got 'go'",
    ),
    "short params": (
        plan({"type": "SimpleItem", "command": 16, "params": [0]}),
        r"items\[0\].params must be a list of seven numbers, got \[0\]",
    ),
    "text in params": (
        plan(item(16, ("north", 2))),
        r"\(parameter 5\), must be a number, got 'nor",
    ),
    "flag in params": (plan(item(16, (True, 2))), r"\(parameter 5\), must be a number, got True"),
    "only a pattern": (
        plan({"type": "ComplexItem", "complexItemType": "StructureScan"}),
        r"holds no line to follow \(patterns with no path .*: 1 StructureScan[;)]",
    ),
    "half a home": (
        plan(*go(A), mission={"plannedHomePosition": [1]}),
        "plannedHomePosition must be .latitude, longitude., got .1.",
    ),
    "text as home": (
        plan(*go(A), mission={"plannedHomePosition": "here"}),
        "plannedHomePosition must be .latitude, longitude., got 'here'",
    ),
    "home in space": (plan(*go(A), home=(95, 190)), "plannedHomePosition has latitude 95"),
    "text as speed": (
        plan(*go(A), mission={"cruiseSpeed": "fast"}),
        "mission.cruiseSpeed must be a number, got 'fast'",
    ),
    "list as fence": (plan(*go(A), geoFence=[1]), "geoFence must be an object, got list"),
    "number as polygons": (plan(*go(A), geoFence={"polygons": 3}), "polygons must be a list"),
    "number as circle": (
        plan(*go(A), geoFence={"circles": [3]}),
        r"geoFence.circles\[0\] must be an object, got int",
    ),
    "circle without a circle": (
        plan(*go(A), geoFence={"circles": [{"inclusion": True}]}),
        r"circles\[0\].circle must be an object, got NoneType",
    ),
    "neither in nor out": (
        plan(*go(A), geoFence={"polygons": [{"polygon": [list(A)] * 4, "inclusion": 1}]}),
        r"polygons\[0\].inclusion must be true or false, got 1",
    ),
    "corner of a kind": (
        plan(*go(A), geoFence=fence(polygons=[([list(A), 3], True)])),
        r"polygon\[1\] must be .latitude, longitude., got 3",
    ),
    "circle without a radius": (
        plan(*go(A), geoFence=fence(circles=[(list(A), -3, True)])),
        r"circles\[0\].circle, radius, must be positive and at most 100000 m, got -3",
    ),
    "flat fence": (
        plan(*go(A), geoFence=fence(polygons=[([list(A), list(B), list(A)], False)])),
        r"polygons\[0\] is a fence of fewer than three corners",
    ),
    "number as rally points": (plan(*go(A), rallyPoints=3), "rallyPoints must be an object"),
}
ROWS = {
    "prose": ("dear diary\n", 'does not begin with "QGC WPL 110"'),
    "table": ("lat,lon\n1,2\n", "rename the file to what it is, say .csv"),
    "fence of ArduPilot": ("63.44 10.4\n63.442 10.4\n", 'does not begin with "QGC WPL 110"'),
    "other version": ("QGC WPL 100\n" + ROW, "version '100', and 110 can be read"),
    "protobuf": ("QGC WPL PB 110\n", "version 'PB 110'"),
    "binary": (b"\x89PNG\r\n\x1a\n\x00\x01", r"not UTF-8 text \(byte 0x89 at position 0\)"),
    "no rows": ("QGC WPL 110\n", "holds no line to follow"),
    "short row": ("QGC WPL 110\n" + ROW[:-3], "line 2 has 11 columns, and a row has 12"),
    "long row": ("QGC WPL 110\n" + ROW + ROW[:-1] + "\t1\n", "line 3 has 13 columns"),
    "text": (
        "QGC WPL 110\n" + ROW.replace("63.44", "north"),
        "column 9, must be a number, got 'no",
    ),
    "decimal comma": ("QGC WPL 110\n" + ROW.replace(".", ","), "column 9, .* got '63,44'"),
    "underscore": ("QGC WPL 110\n" + ROW.replace("63.44", "6_3"), "must be a number, got '6_3'"),
    "other digits": ("QGC WPL 110\n" + ROW.replace("63.44", "٦٣"), "must be a number, got '٦٣'"),
    "huge number": (
        "QGC WPL 110\n" + ROW.replace("63.44", HUGE),
        "must be a finite number, got inf",
    ),
    "huge index": ("QGC WPL 110\n" + HUGE + ROW, "index, must be a finite number, got inf"),
    "part of a frame": (
        "QGC WPL 110\n" + ROW.replace("\t3\t", "\t3.5\t"),
        "frame, must be a whole",
    ),
}
BAD = {
    **{f"{key} in {n}": (n, c, why) for key, (both, why) in BOTH.items() for n, c in both.items()},
    **{f"{key} as plan": ("a.plan", content, why) for key, (content, why) in PLANS.items()},
    **{f"{key} as rows": ("a.txt", content, why) for key, (content, why) in ROWS.items()},
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_in_one_sentence_that_says_where_what_and_how_to_mend(tmp_path, case):
    name, content, message = BAD[case]
    path = write(tmp_path, name, content)
    with pytest.raises(ObsplanError, match=message) as caught:
        read_mission(path)
    check_one_sentence(str(caught.value).replace(str(path), "FILE"))
    assert str(path) in str(caught.value)


@both_formats
def test_more_items_than_a_mission_may_have_are_refused(tmp_path, name, monkeypatch):
    monkeypatch.setattr(items, "MOST_ITEMS", 3)
    assert len(track(fly(tmp_path, name, *go(A, B, C), home=None)).points) == 3
    with pytest.raises(ObsplanError, match="holds more than 3 items, more than any autopilot"):
        fly(tmp_path, name, *go(A, B, C, D), home=None)


# --- damaged files --------------------------------------------------------------------------------

EVERYTHING = [
    item(22, A, altitude=5),
    speed(0.8),
    *go(B),
    item(18, C, 2, 0, 20),
    item(19, D, 30),
    jump(3, 2),
    item(206),
    item(195, B),
    item(93, (0, 0), 4),
    item(82, A, altitude=-3),
    item(20),
]
WHOLE = {
    "a.plan": json.dumps(
        plan(
            *EVERYTHING,
            {
                "type": "ComplexItem",
                "TransectStyleComplexItem": {"Items": [simple(go(B)[0])]},
            },
            geoFence=fence(polygons=[([list(p) for p in RING], True)], circles=[(A, 9, False)]),
            rallyPoints={"points": [[*B, 0]]},
        )
    ).encode(),
    "a.waypoints": wpl(*EVERYTHING, *corners(5001, *RING), item(5004, B, 9)).encode(),
}
VALUES = ["", "0", "-1", "1e308", "65535", "nan", "null", "[]", "{}", '"x"', "true", HUGE, "1e-9"]


def flip(content, rng):
    """Other bytes here and there."""
    broken = bytearray(content)
    for _ in range(rng.randint(1, 8)):
        broken[rng.randrange(len(broken))] = rng.randrange(256)
    return bytes(broken)


def truncate(content, rng):
    """No end."""
    return content[: rng.randrange(len(content))]


def cut(content, rng):
    """A part left out."""
    start, end = sorted(rng.choices(range(len(content)), k=2))
    return content[:start] + content[end:]


def swap(content, rng):
    """Other values in place of numbers."""
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?", content))
    for number in sorted(rng.sample(numbers, k=rng.randint(1, 3)), key=lambda n: -n.start()):
        value = rng.choice(VALUES).encode()
        content = content[: number.start()] + value + content[number.end() :]
    return content


def graft(content, rng):
    """Something else in place of a part of a JSON document, or of a row."""
    if not content.startswith(b"{"):
        rows = content.split(b"\n")
        rows[rng.randrange(len(rows))] = rng.choice(VALUES).encode()
        return b"\n".join(rows)
    document = json.loads(content)
    node = document
    while True:
        key = rng.choice(list(node) if isinstance(node, dict) else range(len(node)))
        if not isinstance(node[key], dict | list) or not node[key] or rng.random() < 0.2:
            node[key] = rng.choice([None, True, -1, 1e300, "", "x", [], {}, [None], [[]], {"a": 1}])
            return json.dumps(document).encode()
        node = node[key]


@pytest.mark.parametrize("name", WHOLE)
def test_damaged_files_give_a_mission_or_our_error_and_soon(tmp_path, name):
    assert track(read_mission(write(tmp_path, name, WHOLE[name])))
    rng = random.Random(name)
    read = 0
    for _ in range(100):
        path = write(
            tmp_path, name, rng.choice([flip, truncate, cut, swap, graft])(WHOLE[name], rng)
        )
        begin = time.perf_counter()
        try:
            mission = read_mission(path)
            read += 1
            assert np.isfinite(track(mission).points).all()
            assert all(remark.isprintable() for remark in mission.remarks)
        except ObsplanError as error:
            check_one_sentence(str(error).replace(str(path), "FILE"))
        assert time.perf_counter() - begin < 20
    assert 5 < read < 95  # some are harmless, and some are not
