"""Missions of MAVLink autopilots for tests: their items, written as a plan and as a waypoint file."""

import json
import re

import pytest

from obsplan.missions import read_mission

HOME = (63.4396, 10.3992)
A, B, C, D = (63.44, 10.4), (63.442, 10.4), (63.442, 10.401), (63.44, 10.401)
RING = [A, B, C, D]


def item(command, place=(0, 0), *params, altitude=0, frame=3):
    """A mission item: command, frame and seven parameters."""
    params = (*params, 0, 0, 0, 0)[:4]
    return command, frame, [*params, *place, altitude]


def go(*places):
    """Waypoints."""
    return [item(16, place) for place in places]


def simple(mission_item, number=None):
    """A simple item of a plan, as QGroundControl writes it."""
    command, frame, params = mission_item
    node = {"type": "SimpleItem", "command": command, "frame": frame, "params": params}
    return {**node, "autoContinue": True, "doJumpId": number}


def plan(*mission_items, home=HOME, **others):
    """A plan; dictionaries among the items are taken as they are."""
    nodes = [
        node if isinstance(node, dict) else simple(node, number)
        for number, node in enumerate(mission_items, start=1)
    ]
    mission = {"items": nodes, "version": 2, "cruiseSpeed": 15, "hoverSpeed": 5}
    if home is not None:
        mission["plannedHomePosition"] = [*home, 0]
    mission.update(others.pop("mission", {}))
    return {"fileType": "Plan", "version": 1, "mission": mission, **others}


def wpl(*mission_items, home=HOME, heading="QGC WPL 110", end="\n", blank="\t"):
    """A waypoint file; row 0 is the home, if there is one."""
    rows = list(mission_items)
    first = 1
    if home is not None:
        rows.insert(0, item(16, home, frame=0))
        first = 0
    lines = [heading]
    for index, (command, frame, params) in enumerate(rows, start=first):
        numbers = ["nan" if value is None else value for value in params]
        lines.append(blank.join(map(str, [index, int(index == 0), frame, command, *numbers, 1])))
    return end.join(lines) + end


FORMATS = {"a.plan": plan, "a.waypoints": wpl}
both_formats = pytest.mark.parametrize("name", FORMATS)


def speed(value, kind=1):
    """DO_CHANGE_SPEED."""
    return item(178, (0, 0), kind, value, -1, frame=2)


def jump(target, repeats):
    """DO_JUMP."""
    return item(177, (0, 0), target, repeats, frame=2)


def fence(polygons=(), circles=()):
    """The fence of a plan: areas and whether they include."""
    return {
        "polygons": [{"polygon": p, "inclusion": i, "version": 1} for p, i in polygons],
        "circles": [
            {"circle": {"center": c, "radius": r}, "inclusion": i, "version": 1}
            for c, r, i in circles
        ],
        "version": 2,
    }


def corners(command, *places):
    """A polygon among the items: each corner has their number."""
    return [item(command, place, len(places)) for place in places]


def write(folder, name, content):
    """Write text, bytes or JSON under a name; give the path."""
    path = folder / name
    if isinstance(content, dict):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def fly(folder, name, *mission_items, **others):
    """Write items in a format and read them; give the mission."""
    return read_mission(write(folder, name, FORMATS[name](*mission_items, **others)))


def track(mission):
    """The one track."""
    (only,) = mission.tracks.values()
    return only


def check_one_sentence(message):
    """A message is one line, without a full stop inside."""
    assert "\n" not in message
    assert ". " not in message


def said(mission, pattern):
    """How many remarks match a pattern."""
    return sum(re.search(pattern, remark) is not None for remark in mission.remarks)
