"""Scenarios that are wrong or extreme, by seed: one sound scenario with a few of its keys mutated."""

import copy
import random
from collections.abc import Iterator
from typing import Any

POND: dict[str, Any] = {
    "name": "pond",
    "seed": 1,
    "time_step": 0.5,
    "duration": 12.0,
    "origin": {"lat": 47.6, "lon": -122.3},
    "cna": {
        "speed": 2.0,
        "min_turn_radius": 5.0,
        "start": {"x": 0.0, "y": -10.0, "heading_deg": 90.0},
    },
    "auv": [
        {
            "name": "alpha",
            "speed": 1.0,
            "weight": 1.0,
            "survey": {"kind": "lawnmower", "legs": 2, "length": 40.0, "spacing": 10.0},
            "first_estimate": {"sigma_position": 2.0, "sigma_heading_deg": 2.0, "sigma_speed": 0.3},
            "process_noise": {"position": 0.02, "heading_deg": 0.1, "speed": 0.01},
        }
    ],
    "environment": {"current": [0.1, 0.0]},
    "ranging": {"kind": "range", "interval": 2.0, "sigma": 1.0, "heading_sigma_deg": 1.0},
    "constraints": {"min_separation": 0.0},
    "planner": {"kind": "path-inertia", "interval": 1.0, "knowledge": "estimate"},
    "export": {"replays": 0},
}
SURVEYS: list[dict[str, Any]] = [
    {
        "kind": "lawnmower",
        "legs": 3,
        "length": 20.0,
        "spacing": 5.0,
        "heading_deg": 30.0,
        "x": 1.0,
        "y": 2.0,
        "side": "right",
    },
    {
        "kind": "waypoints",
        "points": [[0.0, 0.0], [20.0, 0.0], [20.0, 10.0]],
        "speeds": [1.0, 0.5],
        "holds": [0.0, 3.0, 0.0],
    },
    {"kind": "static", "x": 5.0, "y": 5.0, "heading_deg": 10.0},
    {"kind": "formation", "leader": "alpha", "east": 5.0, "north": -5.0},
    {"kind": "mission", "file": "pond.csv", "track": "pond"},
]
PLANNERS: list[dict[str, Any]] = [
    {
        "kind": "path-inertia",
        "gamma": 1.0,
        "objective": "difference",
        "solver": "osqp",
        "change_weight": 0.1,
    },
    {
        "kind": "path-inertia",
        "objective": "condition-number",
        "max_radius": 50.0,
        "max_center_distance": 80.0,
    },
    {"kind": "gramian", "turn_rates": 7, "horizon": 10.0, "metric": "condition-number"},
    {"kind": "gramian", "turn_rates": 5, "circles": 0.5, "gramian": "empirical"},
    {
        "kind": "gramian",
        "motion": "constant-velocity",
        "sampling": "pings",
        "block": "position",
        "noise": "sensor",
        "weighting": "covariance",
    },
    {"kind": "information", "horizon": 10.0, "stages": 2, "turn_rates": 3, "beam_width": 4},
    {
        "kind": "trajectory",
        "horizon": 10.0,
        "stages": 3,
        "max_iterations": 20,
        "speed_range": [1.0, 2.0],
    },
    {"kind": "whole-mission", "segment": 2.0, "starts": 1, "search_seed": 1},
    {"kind": "rolling", "segment": 2.0, "starts": 1, "iterations": 3},
    {"kind": "circle", "center": [0.0, 0.0], "radius": 20.0, "start_on_circle": False},
    {"kind": "centroid-orbit", "orbit_radius": 20.0},
    {"kind": "trail", "behind": 10.0, "left": 5.0},
    {"kind": "error-ellipse", "turn_rates": 5},
    {"kind": "random", "seed": 3, "hold": 2.0},
    {"kind": "stationary"},
    {"kind": "default"},
]
LIMITS: list[dict[str, Any]] = [
    {
        "keep_out": [{"x": 30.0, "y": 30.0, "radius": 5.0}],
        "min_separation": 2.0,
        "max_separation": 200.0,
    },
    {"geofence": [[-100.0, -100.0], [100.0, -100.0], [100.0, 100.0], [-100.0, 100.0]]},
    {
        "geofence": {"x": 0.0, "y": 0.0, "radius": 90.0},
        "keep_out": [{"points": [[30.0, 30.0], [40.0, 30.0], [35.0, 40.0]]}],
    },
]


class Raw(str):
    """Text that stands in the file as it is."""

    __slots__ = ()


NUMBERS: list[Any] = [
    *(
        0,
        0.0,
        -0.0,
        1,
        -1,
        2,
        3,
        10,
        1000,
        10**6,
        10**9,
        2**31,
        2**53,
        2**63 - 1,
        2**63,
        2**64,
        10**30,
        10**400,
        Raw("1" + "0" * 4500),
    ),
    *(
        1e-308,
        5e-324,
        1e-300,
        1e-12,
        1e-10,
        1e-6,
        1e-3,
        0.01,
        0.1,
        0.3,
        0.5,
        1.5,
        5.0,
        7.3,
        49.0,
        90.0,
        360.0,
        1e3,
        99e3,
        1e5,
    ),
    *(
        1e6,
        1e7,
        1e10,
        1e15,
        1e16,
        1e18,
        1e19,
        1e30,
        1e100,
        1e154,
        1e155,
        1e300,
        1e308,
        1.7976931348623157e308,
    ),
    *(float("inf"), float("-inf"), float("nan")),
]
TEXTS = [
    *(
        "",
        " ",
        "x",
        "alpha",
        "=1+1",
        "@x",
        "-x",
        "\t=x",
        "a\rb",
        "a\nb",
        "\x1b[31mred",
        "\x00",
        "\u202e",
        "ä" * 200,
        "x" * 300,
        "x" * 5000,
    ),
    *(
        "../x",
        "/dev/zero",
        ".",
        "con:cat",
        "os:system",
        "a:b:c",
        "no:Such",
        "pond.csv",
        "none.plan",
        "\ud800",
        "[bold]x[/bold]",
        "{x}",
        "%s",
        "nan",
    ),
]
OTHERS: list[Any] = [
    True,
    False,
    [],
    {},
    [[]],
    [{}],
    {"x": 1},
    [1, 2, 3],
    [[1.0, 2.0]],
    [0.0, 0.0],
    {"lat": 47.6, "lon": -122.3},
    {"kind": "x"},
]


EDGES = (
    0,
    1,
    1e-3,
    0.01,
    0.1,
    0.5,
    2.0,
    7.0,
    10.0,
    50.0,
    60.0,
    180.0,
    1e3,
    1e4,
    86_400.0,
    99e3,
    1e5,
    1e6,
    -1.0,
    -99e3,
)


def extremes(seed: int, count: int) -> Iterator[dict[str, Any]]:
    """So many scenarios with several numbers that may just be allowed."""
    rng = random.Random(seed)
    for _ in range(count):
        data = sound(rng)
        for _ in range(rng.choice((1, 2, 4))):
            holder, key = rng.choice(list(places(data)))
            if isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
                edge = rng.choice(EDGES)
                holder[key] = int(edge) if isinstance(holder[key], int) else float(edge)
        yield data


def scenarios(seed: int, count: int) -> Iterator[dict[str, Any]]:
    """So many mutated scenarios, as a TOML file would have them."""
    rng = random.Random(seed)
    for _ in range(count):
        yield scenario(rng)


def scenario(rng: random.Random) -> dict[str, Any]:
    """One scenario with one to three mutations."""
    data = sound(rng)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        mutate(data, rng)
    return data


def sound(rng: random.Random) -> dict[str, Any]:
    """One scenario with nothing wrong, of any planner, survey and limits."""
    data = copy.deepcopy(POND)
    data["planner"] = {**rng.choice(PLANNERS), "interval": 1.0}
    if rng.random() < 0.5:
        data["auv"].append(
            {"name": "bravo", "speed": 1.0, "survey": copy.deepcopy(rng.choice(SURVEYS))}
        )
    if rng.random() < 0.3:
        data["constraints"] = copy.deepcopy(rng.choice(LIMITS))
    if rng.random() < 0.1:
        data["ranging"]["kind"] = "squared-range"
    return data


def mutate(data: dict[str, Any], rng: random.Random) -> None:
    """Change one place: another value, a key gone, a key that nobody knows, or depth."""
    holder, key = rng.choice(list(places(data)))
    kind = rng.random()
    old = holder[key]
    if kind < 0.62 and isinstance(old, int | float) and not isinstance(old, bool):
        holder[key] = rng.choice(NUMBERS)
    elif kind < 0.7:
        holder[key] = (
            old * rng.choice((-1, 1e3, 1e6, 1e-3, 1e-6, 10))
            if isinstance(old, float)
            else rng.choice(NUMBERS)
        )
    elif kind < 0.78:
        holder[key] = rng.choice(TEXTS)
    elif kind < 0.86:
        holder[key] = copy.deepcopy(rng.choice(OTHERS))
    elif kind < 0.9:
        del holder[key]
    elif kind < 0.94 and isinstance(holder, dict):
        holder[rng.choice((*TEXTS[2:], "speed", "kind", "lat", "x"))] = rng.choice(
            (*NUMBERS, *TEXTS)
        )
    elif kind < 0.96:
        holder[key] = nested(rng.choice((20, 100, 400)), rng)
    elif isinstance(old, list) and old:
        holder[key] = old * rng.choice((2, 50, 150))
    else:
        holder[key] = rng.choice(NUMBERS)


def nested(depth: int, rng: random.Random) -> Raw:
    """Lists or tables within each other."""
    if rng.random() < 0.5:
        return Raw("[" * depth + "1.0" + "]" * depth)
    return Raw("{x = " * depth + "1.0" + "}" * depth)


def places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every place of nested tables and lists: what holds it, and its key."""
    for key in list(data) if isinstance(data, dict) else range(len(data)):
        yield data, key
        if isinstance(data[key], dict | list):
            yield from places(data[key])


def as_toml(value: Any) -> str:
    """A value in TOML, whatever it is; the top of a file line by line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Raw):
        return value
    if isinstance(value, dict):
        return "{" + ", ".join(f"{quoted(str(k))} = {as_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, int):
        return str(value)
    return quoted(value) if isinstance(value, str) else repr(value)


def quoted(text: str) -> str:
    """A string of TOML."""
    letters = (
        c
        if 32 <= ord(c) < 127 and c not in '"\\'
        else f"\\u{ord(c):04x}"
        if ord(c) < 0xD800
        else "?"
        for c in text
    )
    return '"' + "".join(letters) + '"'


def toml_file(data: dict[str, Any]) -> str:
    """A scenario file."""
    return "".join(f"{quoted(key)} = {as_toml(value)}\n" for key, value in data.items())
